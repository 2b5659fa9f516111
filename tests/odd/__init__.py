"""Odd driving in heavy traffic: the street's drivers must not drive into the ego where they can stop."""
