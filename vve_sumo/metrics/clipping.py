"""The part of a box that lies in a band along a course, and where that part begins.

Boxes are clipped against both edges of the band (Sutherland and Hodgman 1974) in the course's own coordinates, in which
the sides of a box are bent where the course bends. Knows corners and a projection; neither whose band it is nor why.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.values import Floats

Indices = NDArray[np.int64]

#: rounds in which the place of a crossing is narrowed down; where the course is straight the first one is exact
ROUNDS = 6

#: takes numbers of boxes, x and y [m] of a point of each, and about how far ahead it is [m]; returns how far ahead and
#: how far beside the course (left positive) it is [m]
Projection = Callable[[Indices, Floats, Floats, Floats], tuple[Floats, Floats]]


class _Points(NamedTuple):
    """Points of the sides of boxes."""

    x: Floats  #: [m]
    y: Floats  #: [m]
    ahead: Floats  #: [m]
    beside: Floats  #: [m]


def nearest_in_band(
    corners: tuple[Floats, Floats], ahead: Floats, project: Projection, right: Floats, left: Floats, pieces: int
) -> Floats:
    """Return how far ahead the nearest point in the band of each box is [m]; inf for a box that has none.

    corners: x and y of the corners in order around each box, and ahead: about how far ahead they are [m], shape (4, n).
    The band is where right < beside < left [m], shape (n,). Each of the `pieces` of a side crosses an edge of the band
    once at most. On its way along a straight side, as along an edge of the
    band, a point goes either ahead or back all the time. So the nearest point is a corner in the band, or one where a
    side crosses an edge.
    """
    x, y, near = (_subdivided(column, pieces) for column in (*corners, ahead))
    box = np.broadcast_to(np.arange(x.shape[1]), x.shape)
    points = _Points(x, y, *project(box, x, y, near))
    inside = (points.beside > right) & (points.beside < left)
    nearest: Floats = np.min(np.where(inside, points.ahead, np.inf), axis=0)
    for edge, inwards in ((right, 1.0), (left, -1.0)):
        within = inwards * (points.beside - edge) > 0.0
        crosses = within != np.roll(within, -1, axis=0)
        begins = _Points(*(column[crosses] for column in points))
        ends = _Points(*(np.roll(column, -1, axis=0)[crosses] for column in points))
        number = box[crosses]
        np.minimum.at(nearest, number, _crossing(begins, ends, number, edge[number], inwards, project))
    return nearest


def _subdivided(corners: Floats, pieces: int) -> Floats:
    """Return a value at the corners, and between each two at the ends of the pieces: (4 pieces, n)."""
    share = np.arange(pieces)[:, None] / pieces
    sides = corners[:, None] + share * (np.roll(corners, -1, axis=0) - corners)[:, None]
    return sides.reshape(4 * pieces, corners.shape[-1])


def _crossing(
    begins: _Points, ends: _Points, box: Indices, edge: Floats, inwards: float, project: Projection
) -> Floats:
    """Return how far ahead pieces of sides cross an edge of the band [m], by false position.

    Distances from the edge count `inwards` (1 for the right edge, -1 for the left): of the two ends of a piece one is
    always above 0, and the other, which may lie on the edge, never.
    """
    low, high = np.zeros(len(box)), np.ones(len(box))
    at_low, at_high, ahead = inwards * (begins.beside - edge), inwards * (ends.beside - edge), begins.ahead
    for _ in range(ROUNDS):
        share = low + (high - low) * at_low / (at_low - at_high)
        x, y, near = (one + share * (other - one) for one, other in zip(begins[:3], ends[:3], strict=True))
        ahead, beside = project(box, x, y, near)
        inside = inwards * (beside - edge)
        same = (inside > 0.0) == (at_low > 0.0)
        low, at_low = np.where(same, share, low), np.where(same, inside, at_low)
        high, at_high = np.where(same, high, share), np.where(same, at_high, inside)
    return ahead
