"""Hunts for timelines of faults, driver, keys, brain and road under which the safety layer breaks an invariant."""
