"""Oriented boxes in arrays: how far apart they are, and when two that move steadily touch.

The scalar twin for controllers is `vve_sumo.laws`. Knows rectangles; neither cars nor records.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.values import Floats


class Boxes(NamedTuple):
    """Oriented rectangles that move steadily without turning; all fields broadcast against each other."""

    x: Floats  #: centre, map [m]
    y: Floats  #: centre, map [m]
    heading: Floats  #: of the length [rad], counter-clockwise from the map's +x
    length: Floats  #: [m]
    width: Floats  #: [m]
    speed: Floats  #: along the heading [m/s]

    def taken(self, rows: NDArray[np.int64]) -> Boxes:
        """Return some of them, in the order of `rows`."""
        return Boxes(*(column[rows] for column in self))


class _Axis(NamedTuple):
    """Two boxes' shadows on the normal of an edge."""

    distance: Floats  #: of the other's centre from the one's along the normal [m]
    reach: Floats  #: sum of half their shadows [m]: they overlap where |distance| is no greater
    rate: Floats  #: of change of distance [m/s]


def time_to_collision_of_boxes(one: Boxes, other: Boxes) -> Floats:
    """Time until steadily moving boxes touch [s], pair by pair; 0 where they overlap already, inf where they never do.

    Exact: the method of the separating axes, swept over time (Gottschalk 1996; Ericson, Real-Time Collision Detection,
    5.5.8). Touching is overlapping. NaN where anything of either box is.
    """
    enters: Floats = np.zeros(())
    leaves: Floats = np.full((), np.inf)
    for distance, reach, rate in _axes(one, other):
        first, last = _interval(distance, reach, rate)
        enters, leaves = np.maximum(enters, first), np.minimum(leaves, last)
    return np.where(np.isnan(enters) | np.isnan(leaves), np.nan, np.where(enters <= leaves, enters, np.inf))


def separation(one: Boxes, other: Boxes) -> Floats:
    """Greatest distance between the shadows of two boxes on any edge's normal [m]: 0 at touch, negative at overlap.

    Where it is positive it is at most the boxes' distance: equal to it but for corner against corner.
    """
    apart = [np.abs(axis.distance) - axis.reach for axis in _axes(one, other)]
    return np.maximum(np.maximum(apart[0], apart[1]), np.maximum(apart[2], apart[3]))


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
    """Return when two shadows begin and cease to overlap [s]; never is from inf to -inf, always from -inf to inf."""
    always = np.where(np.abs(distance) <= reach, np.inf, -np.inf)
    always = np.where(np.isnan(distance + reach), np.nan, always)
    still = rate == 0.0
    divisor = np.where(still, 1.0, rate)
    with np.errstate(over="ignore"):
        one, two = (-reach - distance) / divisor, (reach - distance) / divisor
    return np.where(still, -always, np.minimum(one, two)), np.where(still, always, np.maximum(one, two))


def interval_in_lane(one: Boxes, other: Boxes) -> tuple[Floats, Floats]:
    """Return when `one`, going on steadily, begins and ceases to touch the straight lane that `other` covers [s].

    The lane has the other's width and runs along its heading, to both sides without end. Negative is in the past; never
    is from inf to -inf, always from -inf to inf.
    """
    cos, sin = np.cos(other.heading), np.sin(other.heading)
    along, across = np.cos(one.heading - other.heading), np.sin(one.heading - other.heading)
    distance = (one.y - other.y) * cos - (one.x - other.x) * sin
    reach = 0.5 * (other.width + one.length * np.abs(across) + one.width * np.abs(along))
    return _interval(distance, reach, one.speed * across)
