"""The simulated vehicle: replaces the real one, down to its bytes."""
