"""The simulated vehicle: what stands in for the real one, down to its bytes."""
