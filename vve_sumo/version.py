"""The version of the package, where every room may read it; `vve_sumo` itself belongs to those who use the package."""

__version__ = "0.1.0"
