"""A module to try the mutation tool on."""

from __future__ import annotations

LIMIT = 2.0


def level(value: float, bound: float) -> float:
    """`value`, or `bound` where it is above that or not a number."""
    if not value <= bound:
        return bound
    return min(value, bound)
