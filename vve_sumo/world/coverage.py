"""Computes which part of a straight band of ground, such as a piece of a lane, a convex shape covers.

Pure plane geometry; knows nothing of lanes, SUMO or time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from vve_sumo.geometry import Corners


class RoadStrip(NamedTuple):
    """A straight strip of ground, such as one piece of a lane; a tuple, because a town has ten thousand."""

    x: float  #: start of its centre line [m]
    y: float  #: start of its centre line [m]
    cos: float  #: direction of its centre line, x part
    sin: float  #: direction of its centre line, y part
    length: float  #: [m]
    half_width: float  #: [m]


def covered(corners: Sequence[tuple[float, float]], band: RoadStrip) -> tuple[float, float] | None:
    """Return start and end, along a band [m], of the part that a convex shape covers; None if it covers none.

    The shape is clipped at the four sides of the band one after the other (I. E. Sutherland and
    G. W. Hodgman, "Reentrant polygon clipping", CACM 1974).
    """
    shape = [
        ((x - band.x) * band.cos + (y - band.y) * band.sin, (y - band.y) * band.cos - (x - band.x) * band.sin)
        for x, y in corners
    ]
    shape = _cut(shape, [d - band.half_width for _, d in shape])
    shape = _cut(shape, [-d - band.half_width for _, d in shape])
    shape = _cut(shape, [s - band.length for s, _ in shape])
    shape = _cut(shape, [-s for s, _ in shape])
    along = [s for s, _ in shape]
    return (min(along), max(along)) if along else None


def _cut(shape: Corners, beyond: Sequence[float]) -> Corners:
    """Return the part of a shape on one side of a line; `beyond` is how far each corner lies past the line [m].

    Empty where less than a triangle is left.
    """
    if max(beyond, default=0.0) < 0.0:
        return shape
    kept: Corners = []
    for i, (s, d) in enumerate(shape):
        (last_s, last_d), was, now = shape[i - 1], beyond[i - 1], beyond[i]
        if (was < 0.0) != (now < 0.0):
            part = was / (was - now)
            kept.append((last_s + part * (s - last_s), last_d + part * (d - last_d)))
        if now < 0.0:
            kept.append((s, d))
    return kept if len(kept) > 2 else []
