"""Live drives: real time, real buses, one process for each duty; the same core as in lockstep."""
