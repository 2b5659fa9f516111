"""Vehicle in Virtual Environment testing on SUMO: a real drive-by-wire car, a virtual street."""

__version__ = "0.1.0"
