"""The hardware-free car: what stands in for the real one, down to its bytes."""
