"""Odd driving in heavy traffic: the virtual road's drivers must not drive into the ego where they can stop."""
