"""Drives and sweeps in the formats of other programs. Reads records through the analysis; knows nothing of SUMO."""
