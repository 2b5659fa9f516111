"""A walk over a field that is known beforehand: where somebody is at which time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple


class WalkPoint(NamedTuple):
    """A row of a walk."""

    time: float  #: drive time [s]
    forward: float  #: from the field's anchor, along its heading [m]
    left: float  #: from the anchor, to the left of that [m]


class WalkingPose(NamedTuple):
    """Where somebody is in the field's map, and which way they go."""

    x: float  #: [m]
    y: float  #: [m]
    heading: float  #: [rad], counter-clockwise from +x
    speed: float  #: [m/s]


class Walk:
    """A walk, straight and steady between its points; who walks stands before the first and after the last."""

    def __init__(self, points: Sequence[WalkPoint], heading: float) -> None:
        """`points` are one or more, at times that rise strictly; `heading` [rad] is the anchor's in the field's map."""
        cosine, sine = math.cos(heading), math.sin(heading)
        self._times = [point.time for point in points]
        self._places = [
            (cosine * one.forward - sine * one.left, sine * one.forward + cosine * one.left) for one in points
        ]
        self._heading = heading

    def at(self, time: float) -> WalkingPose:
        """Return the pose at a drive time [s]."""
        after = bisect_right(self._times, time)
        if after == 0 or after == len(self._times):
            x, y = self._places[0 if after == 0 else -1]
            return WalkingPose(x, y, self._facing(max(after - 1, 0)), 0.0)
        (ax, ay), (bx, by) = self._places[after - 1], self._places[after]
        duration = self._times[after] - self._times[after - 1]
        share = (time - self._times[after - 1]) / duration
        speed = math.hypot(bx - ax, by - ay) / duration
        return WalkingPose(ax + share * (bx - ax), ay + share * (by - ay), self._facing(after), speed)

    def _facing(self, end: int) -> float:
        """Return the direction of the stretch that ends at a point; of no way the one before it."""
        for number in range(end, 0, -1):
            (ax, ay), (bx, by) = self._places[number - 1], self._places[number]
            if (ax, ay) != (bx, by):
                return math.atan2(by - ay, bx - ax)
        return self._heading
