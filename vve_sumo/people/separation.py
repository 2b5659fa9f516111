"""The distance between a person's real place and the ground that the real car may cover.

Plane geometry in the field's map, in plain floats. Knows no alignment with the virtual road: where the twins are says
nothing about where people and cars are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

Pair = tuple[float, float]


def distance_to_fence(x: float, y: float, fence: Sequence[Pair]) -> float:
    """Return the distance [m] from a place to the ground inside a closed outline; 0 inside, inf without an outline.

    `fence` are the corners in order [m], the last joined to the first. NaN coordinates give NaN.
    """
    if not fence:
        return math.inf
    if math.isnan(x + y):
        return math.nan
    edges = list(pairwise((*fence, fence[0])))
    if _inside(x, y, edges):
        return 0.0
    return min(_to_edge(x, y, start, end) for start, end in edges)


def separation(x: float, y: float, radius: float, fence: Sequence[Pair]) -> float:
    """Return the least distance [m] from a circle of uncertainty to the ground; negative where it may lie inside."""
    return distance_to_fence(x, y, fence) - radius


def _inside(x: float, y: float, edges: Sequence[tuple[Pair, Pair]]) -> bool:
    """Return whether a ray from the place to +x crosses the outline an odd number of times."""
    crossed = False
    for (ax, ay), (bx, by) in edges:
        if (ay > y) != (by > y) and x < ax + (bx - ax) * (y - ay) / (by - ay):
            crossed = not crossed
    return crossed


def _to_edge(x: float, y: float, start: Pair, end: Pair) -> float:
    along_x, along_y = end[0] - start[0], end[1] - start[1]
    square = along_x * along_x + along_y * along_y
    share = ((x - start[0]) * along_x + (y - start[1]) * along_y) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(x - start[0] - share * along_x, y - start[1] - share * along_y)
