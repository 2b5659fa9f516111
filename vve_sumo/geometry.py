"""Computes with oriented boxes on the ground: corners, overlap, separation, and when two steadily moving ones touch.

`Boxes` holds arrays, for metrics and figures. `Box` is one box in plain floats, for the tick: a drive's bytes depend on
its arithmetic, which uses `math` alone. Knows neither records, nor lanes, nor SUMO.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.frozen import fast_frozen
from vve_sumo.values import Floats, Vehicle

Corners = list[tuple[float, float]]

#: corners of a box, counter-clockwise from the front left, in half lengths forward and half widths to the left
SIGNS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))


@fast_frozen
@dataclass(frozen=True, slots=True)
class Box:
    """One oriented rectangle."""

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
        return [
            (self.x + f * ahead * cos - s * across * sin, self.y + f * ahead * sin + s * across * cos) for f, s in SIGNS
        ]

    def grown(self, margin: float) -> Box:
        """The same box, larger by `margin` [m] on every side."""
        return Box(self.x, self.y, self.heading, self.length + 2.0 * margin, self.width + 2.0 * margin)

    def stretched(self, ahead: float) -> Box:
        """The same box with its front moved forward by `ahead` [m]."""
        shift = 0.5 * ahead
        x, y = self.x + shift * math.cos(self.heading), self.y + shift * math.sin(self.heading)
        return Box(x, y, self.heading, self.length + ahead, self.width)


def behind_bumper(x: float, y: float, heading: float, length: float, width: float) -> Box:
    """Return the box of which the middle of the front side is at x, y."""
    half = 0.5 * length
    return Box(x - half * math.cos(heading), y - half * math.sin(heading), heading, length, width)


def overlap(first: Box, second: Box) -> bool:
    """Return whether two boxes overlap; boxes that only touch do not.

    Separating axes: two convex shapes are apart if and only if the normal of one of their sides separates them
    (S. Gottschalk et al., "OBBTree", SIGGRAPH 1996). `separation` uses the same axes for arrays.
    """
    dx, dy = second.x - first.x, second.y - first.y
    turn = second.heading - first.heading
    along, skew = abs(math.cos(turn)), abs(math.sin(turn))
    return _within(dx, dy, first, second, along, skew) and _within(dx, dy, second, first, along, skew)


def _within(dx: float, dy: float, own: Box, other: Box, along: float, skew: float) -> bool:
    cos, sin = math.cos(own.heading), math.sin(own.heading)
    reach = own.length + other.length * along + other.width * skew
    breadth = own.width + other.length * skew + other.width * along
    return 2.0 * abs(dx * cos + dy * sin) < reach and 2.0 * abs(dy * cos - dx * sin) < breadth


class Boxes(NamedTuple):
    """Oriented rectangles that move steadily without turning; all fields broadcast against each other."""

    x: Floats  #: centre, map [m]
    y: Floats  #: centre, map [m]
    heading: Floats  #: of the long axis [rad], counter-clockwise from the map's +x
    length: Floats  #: [m]
    width: Floats  #: [m]
    speed: Floats  #: along the heading [m/s]

    def select(self, rows: NDArray[Any]) -> Boxes:
        """Return the boxes of these rows, in the order of `rows`."""
        return Boxes(*(column[rows] for column in self))

    def corners(self) -> tuple[Floats, Floats]:
        """Return x and y of the corners, (4, ...), in the order of SIGNS."""
        length, width = 0.5 * self.length, 0.5 * self.width
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        x = [self.x + forward * length * cos - left * width * sin for forward, left in SIGNS]
        y = [self.y + forward * length * sin + left * width * cos for forward, left in SIGNS]
        return np.array(x), np.array(y)


def vehicle_boxes(x: Floats, y: Floats, heading: Floats, speed: Floats, vehicle: Vehicle) -> Boxes:
    """Return the boxes of a vehicle whose rear axle is at these places."""
    ahead = vehicle.rear_axle_to_bumper - 0.5 * vehicle.length
    length, width = np.full_like(x, vehicle.length), np.full_like(x, vehicle.width)
    return Boxes(x + ahead * np.cos(heading), y + ahead * np.sin(heading), heading, length, width, speed)


class _Axis(NamedTuple):
    """Two boxes' projections on the normal of an edge."""

    distance: Floats  #: from the first box's centre to the second's along the normal [m]
    reach: Floats  #: half the sum of both projections [m]: they overlap where |distance| is no greater
    rate: Floats  #: rate of change of the distance [m/s]


def separation(one: Boxes, other: Boxes) -> Floats:
    """Return the greatest distance between two boxes' projections on any edge's normal [m].

    It is 0 where the boxes touch and negative where they overlap. A positive value is the boxes' distance or, for
    corner against corner, less.
    """
    apart = [np.abs(axis.distance) - axis.reach for axis in _axes(one, other)]
    return np.maximum(np.maximum(apart[0], apart[1]), np.maximum(apart[2], apart[3]))


def distance(one: Boxes, other: Boxes) -> Floats:
    """Return the distance between two boxes' nearest points [m], pair by pair; 0 where they touch or overlap.

    The nearest points of two rectangles apart are a corner of one and a point of the other.
    """
    nearest = np.minimum(_to_corners(one, other), _to_corners(other, one))
    return np.where(separation(one, other) > 0.0, nearest, 0.0)


def _to_corners(box: Boxes, other: Boxes) -> Floats:
    """Return the distance from a box to the nearest corner of another [m]."""
    x, y = other.corners()
    cos, sin = np.cos(box.heading), np.sin(box.heading)
    along, across = (x - box.x) * cos + (y - box.y) * sin, (y - box.y) * cos - (x - box.x) * sin
    beyond = np.maximum(np.abs(along) - 0.5 * box.length, 0.0), np.maximum(np.abs(across) - 0.5 * box.width, 0.0)
    nearest: Floats = np.hypot(*beyond).min(axis=0)
    return nearest


def time_to_collision_2d(one: Boxes, other: Boxes) -> Floats:
    """Return the time until steadily moving boxes touch [s], pair by pair.

    It is 0 where they overlap or touch already, inf where they never do, NaN where a value of either box is NaN. Exact:
    separating axes, swept over time (Gottschalk 1996; Ericson, Real-Time Collision Detection, 5.5.8).
    """
    enters: Floats = np.zeros(())
    leaves: Floats = np.full((), np.inf)
    for distance, reach, rate in _axes(one, other):
        first, last = _interval(distance, reach, rate)
        enters, leaves = np.maximum(enters, first), np.minimum(leaves, last)
    return np.where(np.isnan(enters) | np.isnan(leaves), np.nan, np.where(enters <= leaves, enters, np.inf))


def interval_in_lane(one: Boxes, other: Boxes) -> tuple[Floats, Floats]:
    """Return when `one`, at constant velocity, begins and ceases to touch the straight lane of `other` [s].

    The lane has the other's width and runs without end along its heading, both ways. Negative times are in the past.
    Never is (inf, -inf), always is (-inf, inf).
    """
    cos, sin = np.cos(other.heading), np.sin(other.heading)
    along, across = np.cos(one.heading - other.heading), np.sin(one.heading - other.heading)
    distance = (one.y - other.y) * cos - (one.x - other.x) * sin
    reach = 0.5 * (other.width + one.length * np.abs(across) + one.width * np.abs(along))
    return _interval(distance, reach, one.speed * across)


def _axes(one: Boxes, other: Boxes) -> Iterator[_Axis]:
    dx, dy = other.x - one.x, other.y - one.y
    cos, sin = (np.cos(one.heading), np.cos(other.heading)), (np.sin(one.heading), np.sin(other.heading))
    vx, vy = other.speed * cos[1] - one.speed * cos[0], other.speed * sin[1] - one.speed * sin[0]
    along, across = np.abs(cos[0] * cos[1] + sin[0] * sin[1]), np.abs(cos[0] * sin[1] - sin[0] * cos[1])
    for c, s, own, far in ((cos[0], sin[0], one, other), (cos[1], sin[1], other, one)):
        reach = 0.5 * (own.length + far.length * along + far.width * across)
        yield _Axis(dx * c + dy * s, reach, vx * c + vy * s)
        reach = 0.5 * (own.width + far.length * across + far.width * along)
        yield _Axis(dy * c - dx * s, reach, vy * c - vx * s)


def _interval(distance: Floats, reach: Floats, rate: Floats) -> tuple[Floats, Floats]:
    """Return when two projections begin and cease to overlap [s]; never is (inf, -inf), always (-inf, inf)."""
    always = np.where(np.abs(distance) <= reach, np.inf, -np.inf)
    always = np.where(np.isnan(distance + reach), np.nan, always)
    still = rate == 0.0
    divisor = np.where(still, 1.0, rate)
    with np.errstate(over="ignore"):
        one, two = (-reach - distance) / divisor, (reach - distance) / divisor
    return np.where(still, -always, np.minimum(one, two)), np.where(still, always, np.maximum(one, two))
