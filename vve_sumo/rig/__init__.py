"""Rig files: which car, bus, receiver and lot, as measured and dated."""
