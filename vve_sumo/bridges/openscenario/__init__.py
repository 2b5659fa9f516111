"""Scenarios of ASAM OpenSCENARIO XML 1.x as scenario files: what is taken, and what is refused with its line."""
