"""The tick, the shells that drive it, and the record it leaves."""
