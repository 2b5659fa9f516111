"""The functions and classes of `import vve_sumo`: they put other rooms together for scripts and notebooks.

A drive goes on in a process of its own, so that a notebook can drive again and again and survives a crash of SUMO.
"""
