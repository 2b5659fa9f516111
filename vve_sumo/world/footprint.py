"""Rectangles on the ground: where a car's body is, whether two touch, how much of a band one covers.

Pure plane geometry; knows nothing of lanes, SUMO or time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

Corners = list[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A box on the ground, turned by its heading."""

    x: float  #: centre [m]
    y: float  #: centre [m]
    heading: float  #: of the long axis [rad], counter-clockwise from +x
    length: float  #: along the heading [m]
    width: float  #: across the heading [m]

    @property
    def radius(self) -> float:
        """Distance from the centre to a corner [m]."""
        return 0.5 * math.hypot(self.length, self.width)

    def corners(self) -> Corners:
        """The four corners, counter-clockwise from the front left."""
        ahead, across = 0.5 * self.length, 0.5 * self.width
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        signs = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
        return [
            (self.x + f * ahead * cos - s * across * sin, self.y + f * ahead * sin + s * across * cos) for f, s in signs
        ]

    def grown(self, margin: float) -> Rectangle:
        """The same box, larger by `margin` [m] on every side."""
        return Rectangle(self.x, self.y, self.heading, self.length + 2.0 * margin, self.width + 2.0 * margin)

    def stretched(self, ahead: float) -> Rectangle:
        """The same box with its front moved forward by `ahead` [m]."""
        shift = 0.5 * ahead
        x, y = self.x + shift * math.cos(self.heading), self.y + shift * math.sin(self.heading)
        return Rectangle(x, y, self.heading, self.length + ahead, self.width)


class Band(NamedTuple):
    """A straight strip of ground, such as one piece of a lane; a tuple, for a town has ten thousand."""

    x: float  #: start of its centre line [m]
    y: float  #: start of its centre line [m]
    cos: float  #: direction of its centre line, x part
    sin: float  #: direction of its centre line, y part
    length: float  #: [m]
    half_width: float  #: [m]


def behind_bumper(x: float, y: float, heading: float, length: float, width: float) -> Rectangle:
    """Return the body whose middle of the front bumper is at x, y."""
    half = 0.5 * length
    return Rectangle(x - half * math.cos(heading), y - half * math.sin(heading), heading, length, width)


def overlap(first: Rectangle, second: Rectangle) -> bool:
    """Return whether two boxes share ground; boxes that only touch do not.

    Separating axes: two convex shapes are apart if and only if the normal of one of their sides separates
    them (S. Gottschalk et al., "OBBTree", SIGGRAPH 1996).
    """
    dx, dy = second.x - first.x, second.y - first.y
    turn = second.heading - first.heading
    along, skew = abs(math.cos(turn)), abs(math.sin(turn))
    return _within(dx, dy, first, second, along, skew) and _within(dx, dy, second, first, along, skew)


def _within(dx: float, dy: float, own: Rectangle, other: Rectangle, along: float, skew: float) -> bool:
    cos, sin = math.cos(own.heading), math.sin(own.heading)
    reach = own.length + other.length * along + other.width * skew
    breadth = own.width + other.length * skew + other.width * along
    return 2.0 * abs(dx * cos + dy * sin) < reach and 2.0 * abs(dy * cos - dx * sin) < breadth


def covered(corners: Sequence[tuple[float, float]], band: Band) -> tuple[float, float] | None:
    """Return from where to where along a band [m] a convex shape covers it; None where it does not.

    The shape is clipped at the four sides of the band one after the other (I. E. Sutherland and
    G. W. Hodgman, "Reentrant polygon clipping", CACM 1974).
    """
    shape = [
        ((x - band.x) * band.cos + (y - band.y) * band.sin, (y - band.y) * band.cos - (x - band.x) * band.sin)
        for x, y in corners
    ]
    for normal_s, normal_d, limit in (
        (0.0, 1.0, band.half_width),
        (0.0, -1.0, band.half_width),
        (1.0, 0.0, band.length),
        (-1.0, 0.0, 0.0),
    ):
        shape = _cut(shape, normal_s, normal_d, limit)
        if len(shape) < 3:
            return None
    along = [s for s, _ in shape]
    return min(along), max(along)


def _cut(shape: Corners, normal_s: float, normal_d: float, limit: float) -> Corners:
    beyond = [normal_s * s + normal_d * d - limit for s, d in shape]
    if max(beyond) < 0.0:
        return shape
    kept: Corners = []
    for i, (s, d) in enumerate(shape):
        (last_s, last_d), was, now = shape[i - 1], beyond[i - 1], beyond[i]
        if (was < 0.0) != (now < 0.0):
            part = was / (was - now)
            kept.append((last_s + part * (s - last_s), last_d + part * (d - last_d)))
        if now < 0.0:
            kept.append((s, d))
    return kept
