"""Bridges to tools that others use: one module or a few for each, its packages an extra of pyproject.toml.

Nothing of the package imports a bridge before it is asked for by name.
"""
