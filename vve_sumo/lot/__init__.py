"""The real lot: where the car may be, how it comes to rest, and how a path fits in."""
