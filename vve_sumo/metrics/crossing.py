"""Measures of two road users whose ways cross: post-encroachment time, and the times to the zone where they cross.

Knows boxes over time; neither records nor who is a pedestrian and who a car.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.geometry import Boxes, interval_in_lane, separation
from vve_sumo.values import Floats

Indices = NDArray[np.int64]

#: instants of one that are held against all of the other's at a time: bounds the memory
CHUNK = 256
#: a box further than this from all that the other covers is not looked at [m]; none goes so far in an instant
MAX_DISTANCE = 5.0


class Encroachment(NamedTuple):
    """When two road users were in the area that both of them covered [s]; NaN where there is none, or not known."""

    one_enters: float
    one_leaves: float  #: NaN of one that is still in it when its trajectory ends
    other_enters: float
    other_leaves: float  #: as one_leaves

    @property
    def one_first(self) -> bool:
        """Whether `one` was the first to enter."""
        return self.one_enters <= self.other_enters

    @property
    def time(self) -> float:
        """Post-encroachment time [s]: from the first one's leaving to the other's entering, whoever was first.

        Negative where the second entered while the first one was still there. NaN without a common area, and where the
        first one never leaves.
        """
        return self.other_enters - self.one_leaves if self.one_first else self.one_enters - self.other_leaves


class Passages(NamedTuple):
    """When two that go on steadily pass the zone where their lanes cross: counted from now [s], instant by instant."""

    one_reaches: Floats  #: 0 inside, inf where it never does, or not any more
    one_leaves: Floats  #: inf where it never does, or is past it
    other_reaches: Floats  #: as one_reaches
    other_leaves: Floats  #: as one_leaves

    @property
    def difference(self) -> Floats:
        """The one's time to reach the zone minus the other's [s]: positive where the other is there first.

        ±inf where only one of them reaches it, NaN where neither does.
        """
        with np.errstate(invalid="ignore"):
            return self.one_reaches - self.other_reaches


def encroachment(time: Floats, one: Boxes, other_time: Floats, other: Boxes) -> Encroachment:
    """Return when two were in their conflict area: the ground that the boxes of both covered, at whatever time.

    time, other_time: of the boxes [s], ascending. After Allen, Shin and Cooper 1978. Between two instants the way into
    and out of the area is taken as steady. An instant with a NaN in it was nowhere. One that is in the area from its
    first instant on entered then, at the latest.
    """
    mine, theirs = np.full(len(time), np.inf), np.full(len(other_time), np.inf)
    near, columns = _near(one, other), _near(other, one)
    for start in range(0, len(near), CHUNK):
        rows = near[start : start + CHUNK]
        apart = separation(Boxes(*(column[:, None] for column in one.select(rows))), other.select(columns))
        mine[rows] = np.fmin.reduce(apart, axis=1, initial=np.inf)
        theirs[columns] = np.fmin(theirs[columns], np.fmin.reduce(apart, axis=0, initial=np.inf))
    return Encroachment(*_stay(time, mine), *_stay(other_time, theirs))


def time_to_collision_zone(one: Boxes, other: Boxes) -> Passages:
    """Return when each of two, going on steadily, reaches and leaves the zone where their straight lanes cross.

    A lane has its user's width and runs along its heading; the zone is where the lanes overlap, and a box is in it
    while it touches the other's lane. Arrays broadcast. Parallel lanes cross nowhere, or everywhere.
    """
    return Passages(*_ahead(*interval_in_lane(one, other)), *_ahead(*interval_in_lane(other, one)))


def _near(one: Boxes, other: Boxes) -> Indices:
    """Return the instants of `one` at which it is not far from the rectangle around all the places of `other`."""
    radius = 0.5 * np.hypot(one.length, one.width) + MAX_DISTANCE
    near = np.ones(len(one.x), np.bool_)
    for mine, theirs in ((one.x, other.x), (one.y, other.y)):
        low = np.fmin.reduce(theirs - 0.5 * np.hypot(other.length, other.width), initial=np.inf)
        high = np.fmax.reduce(theirs + 0.5 * np.hypot(other.length, other.width), initial=-np.inf)
        near &= (mine > low - radius) & (mine < high + radius)
    return np.flatnonzero(near)


def _ahead(enters: Floats, leaves: Floats) -> tuple[Floats, Floats]:
    """Return the times from now on; what is over or never comes is inf."""
    unknown, comes = np.isnan(enters) | np.isnan(leaves), leaves >= np.maximum(enters, 0.0)
    reaches = np.where(comes, np.maximum(enters, 0.0), np.inf)
    return np.where(unknown, np.nan, reaches), np.where(unknown, np.nan, np.where(comes, leaves, np.inf))


def _stay(time: Floats, apart: Floats) -> tuple[float, float]:
    """Return when the distance `apart` [m] is first and last no more than 0; the last is NaN where it stays so."""
    inside = np.flatnonzero(apart <= 0.0)
    if len(inside) == 0:
        return float("nan"), float("nan")
    first, last = int(inside[0]), int(inside[-1])
    enters = _touch(time, apart, first, first - 1) if first > 0 else float(time[0])
    return enters, _touch(time, apart, last, last + 1) if last + 1 < len(time) else float("nan")


def _touch(time: Floats, apart: Floats, inside: int, outside: int) -> float:
    """Return when the distance was 0 between two neighbouring instants."""
    if not np.isfinite(apart[outside]):
        return float(time[inside])
    share = apart[inside] / (apart[inside] - apart[outside])
    return float(time[inside] + share * (time[outside] - time[inside]))
