"""The real lot: where the car may be, how it comes to rest there, and how a path is placed in it."""
