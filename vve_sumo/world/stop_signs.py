"""Tells when an ego passes the line of a stop sign without having stood before it. Knows no path and no controller."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import libsumo

from vve_sumo.values import Pose

#: SUMO's state of a link with a stop sign: one, and one of many at a junction where everybody has one
STOP: Final = frozenset("sw")
#: who is slower than this stands [m/s] ...
STANDING: Final = 0.1
#: ... before the line that the front bumper is so near to [m]
BEFORE_LINE: Final = 5.0


class _Line(NamedTuple):
    """The end of a lane with a stop sign."""

    lane: str  #: SUMO's id
    x: float  #: of its middle, map [m]
    y: float
    cos: float  #: of the lane's heading
    sin: float
    half: float  #: of its width [m]
    ways: frozenset[tuple[str, str]]  #: edges before and after the ways that have the sign


class StopSigns:
    """The stop signs of the network that SUMO runs, and before which of them each ego has stood."""

    def __init__(self) -> None:
        """Read them from SUMO; raises SUMO's errors."""
        self._lines = [line for lane in libsumo.lane.getIDList() if (line := _line(lane)) is not None]
        self._stood: set[tuple[str, str]] = set()  # ego and lane

    def passed(self, ego: str, before: Pose, after: Pose, route: Sequence[str]) -> str:
        """Return the lane past whose sign a front bumper went between two poses without standing; empty for none.

        It must have stood in the last BEFORE_LINE before the line. Of a lane's ways that count which the `route` takes;
        where it takes none of them, all.
        """
        for line in self._lines:
            behind, across = _place(line, before)
            if not (-BEFORE_LINE <= behind < 0.0 and across <= line.half):
                continue
            if abs(before.speed) < STANDING:
                self._stood.add((ego, line.lane))
            if _place(line, after)[0] < 0.0:
                continue
            stood = (ego, line.lane) in self._stood
            self._stood.discard((ego, line.lane))
            if not stood and _has_sign(line, route):
                return line.lane
        return ""


def _line(lane: str) -> _Line | None:
    """Return the line of a lane; None where no way from it has a stop sign."""
    if lane.startswith(":"):
        return None
    links = libsumo.lane.getLinks(lane)
    edge = libsumo.lane.getEdgeID(lane)
    ways = frozenset((edge, libsumo.lane.getEdgeID(link[0])) for link in links if link[5] in STOP)
    if not ways:
        return None
    (x0, y0), (x, y) = libsumo.lane.getShape(lane)[-2:]
    heading = math.atan2(y - y0, x - x0)
    return _Line(lane, x, y, math.cos(heading), math.sin(heading), 0.5 * libsumo.lane.getWidth(lane), ways)


def _place(line: _Line, pose: Pose) -> tuple[float, float]:
    """Return how far a front bumper is beyond a line, negative before it, and how far from its middle [m]."""
    east, north = pose.x - line.x, pose.y - line.y
    return east * line.cos + north * line.sin, abs(north * line.cos - east * line.sin)


def _has_sign(line: _Line, route: Sequence[str]) -> bool:
    """Tell whether a route's way from the line has the sign; of a route that takes no way from there, yes."""
    edge = next(iter(line.ways))[0]
    taken = {pair for pair in pairwise(route) if pair[0] == edge}
    return not taken or bool(taken & line.ways)
