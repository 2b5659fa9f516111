"""The tick, the shells that run it, and the checks and replays of its record."""
