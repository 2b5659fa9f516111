"""Where words stand in a window so that they hide nothing: rectangles, and which of several is least in the way.

Knows neither what is written nor what is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vve_sumo.values import Floats


class Rectangle(NamedTuple):
    """A part of a window, its sides along the window's [m]."""

    left: float
    low: float
    right: float
    high: float

    def overlap(self, other: Rectangle) -> float:
        """Return the area that it shares with another one [m2]."""
        wide = min(self.right, other.right) - max(self.left, other.left)
        tall = min(self.high, other.high) - max(self.low, other.low)
        return max(wide, 0.0) * max(tall, 0.0)

    def count(self, points: Floats) -> int:
        """Return how many points (n x 2) [m] lie in it."""
        right, up = points.T
        return int(((right > self.left) & (right < self.right) & (up > self.low) & (up < self.high)).sum())


def around(points: Floats) -> Rectangle:
    """Return the least rectangle around points (n x 2) [m]."""
    return Rectangle(*(float(value) for value in (*points.min(axis=0), *points.max(axis=0))))


def centred(x: float, y: float, width: float, height: float) -> Rectangle:
    """Return a rectangle by its middle and its size [m]."""
    return Rectangle(x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0)


def freest(candidates: Sequence[Rectangle], taken: Sequence[Rectangle], points: Floats) -> tuple[int, float]:
    """Return which candidate covers least of what is taken, and how much it covers [m2].

    Of several that cover as little, it is the one that covers the fewest of the points (n x 2), then the first one.
    """
    covered = [sum(one.overlap(other) for other in taken) for one in candidates]
    best = min(range(len(candidates)), key=lambda n: (covered[n], candidates[n].count(points)))
    return best, covered[best]


#: no points that words must not cover
NO_POINTS: Floats = np.zeros((0, 2))
