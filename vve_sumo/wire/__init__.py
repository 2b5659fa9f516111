"""Encoders of the virtual sensors for a control computer of somebody else's, each with its inverse; no I/O."""
