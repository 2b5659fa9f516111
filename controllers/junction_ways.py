"""Finds the way across the next junction that the path takes, and where those that go first meet it.

Needs a sensor of kind `right_of_way`. It must not know who comes on these ways.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.path import ReferencePath
from vve_sumo.values import Observation, RightOfWay, Vehicle

YIELD, STOP, ALL_WAY_STOP, EQUAL, SIGNAL = 1, 2, 3, 4, 5  #: `control` of a `RightOfWay`
PASSED: Final = 0.5  #: the front bumper is so far beyond a line that is not looked for any more [m]
AHEAD: Final = 120.0  #: lines that are farther are not looked at [m]
ALONG: Final = math.cos(math.radians(45.0))  #: of the greatest angle between path and way at a line
EXIT_SLACK: Final = 1.0  #: of the path from the middle of the lane beyond, on top of half its width [m]
SPACING: Final = 0.5  #: of the places at which it is looked where two ways meet [m]
HALF_BODY: Final = 0.95  #: half the width of a car [m]
ROOM: Final = 0.3  #: beside both bodies [m]
INSIDE: Final = 60.0  #: the way across a junction is no longer than this [m]
BEFORE: Final = 5.0  #: two ways may meet so far before the line of the one that goes first [m]


class Way(NamedTuple):
    """The middle of a way across a junction, with the lanes before it."""

    x: np.ndarray  #: map [m]
    y: np.ndarray  #: map [m]
    s: np.ndarray  #: along it [m]
    width: float  #: of the lane [m]
    limit: float  #: of the speed [m/s]
    limit_across: float  #: of the speed inside the junction [m/s]
    ends: bool  #: whether nobody comes from beyond its begin

    def locate(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return s and d of map points [m], shape (n,), d left positive."""
        dx, dy = np.diff(self.x), np.diff(self.y)
        length = np.hypot(dx, dy)
        east, north = x[:, None] - self.x[:-1], y[:, None] - self.y[:-1]
        along = (east * dx + north * dy) / length
        across = (north * dx - east * dy) / length
        beyond = along - np.clip(along, 0.0, length)
        piece = np.argmin(beyond * beyond + across * across, axis=1)
        row = np.arange(len(x))
        away = np.hypot(beyond[row, piece], across[row, piece])
        s = self.s[piece] + np.clip(along[row, piece], 0.0, length[piece])
        return s, np.copysign(away, across[row, piece])

    def at(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the map points at some s [m]."""
        return np.interp(s, self.s, self.x), np.interp(s, self.s, self.y)


class Conflict(NamedTuple):
    """Where a way that goes first meets the path."""

    way: Way
    begin: float  #: of the path, where a front bumper comes into the other's way [m]
    end: float  #: of the path, where a rear bumper leaves it [m]; infinite where the ways go on as one
    reach: float  #: of the other's way, where it meets the path [m]
    leave: float  #: of the other's way, where it leaves the path [m]; infinite likewise

    @property
    def joins(self) -> bool:
        """Whether the ways go on as one."""
        return math.isinf(self.end)


@dataclass(slots=True)
class Crossing:
    """The way across a junction that the path takes."""

    line: float  #: where on the path its line is [m]
    control: int  #: as in `RightOfWay`
    conflicts: list[Conflict]  #: in the order in which the car comes to them

    @property
    def entry(self) -> float:
        """Where on the path a front bumper comes into the way of others for the first time [m]."""
        return self.conflicts[0].begin

    @property
    def committed(self) -> float:
        """Where on the path it comes into the way of others for the last time [m]."""
        return max(one.begin for one in self.conflicts)


class JunctionWatch:
    """Keeps the crossings that lie ahead."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._bumper, self._half = vehicle.rear_axle_to_bumper, 0.5 * vehicle.width
        self._crossings: dict[int, Crossing] = {}  # by the junction's number
        self._newest = -math.inf

    def step(self, observation: Observation, known: RightOfWay, s: float) -> Crossing | None:
        """Return the next crossing whose conflicts the front bumper has not all come into; `s` of the rear axle [m]."""
        bumper = s + self._bumper
        if known.time > self._newest:
            self._newest = known.time
            self._take(known, observation, bumper)
        self._crossings = {key: one for key, one in self._crossings.items() if one.committed > bumper}
        return min(self._crossings.values(), key=lambda one: one.line, default=None)

    def _take(self, known: RightOfWay, observation: Observation, bumper: float) -> None:
        for row in np.unique(known.own).tolist():
            number, way = int(known.junction[row]), _way(known, row)
            at = self._match(way, known, row, observation, bumper)
            if at is None or (number in self._crossings and abs(self._crossings[number].line - at) < PASSED):
                continue
            rows = known.prior[known.own == row].tolist()
            found = [self._conflict(observation.path, _way(known, one), known, one, at) for one in rows]
            conflicts = sorted((one for one in found if one is not None), key=lambda one: one.begin)
            if conflicts:
                self._crossings[number] = Crossing(at, int(known.control[row]), conflicts)

    def _match(self, way: Way, known: RightOfWay, row: int, observation: Observation, bumper: float) -> float | None:
        """Return where on the path the line of a way is that the path takes [m]; None if the path does not take it."""
        path, pose, half = observation.path, observation.pose, 0.5 * way.width
        line, exit_ = float(known.line[row]), float(known.exit[row])
        (x0, x, beyond_x), (y0, y, beyond_y) = (
            values.tolist() for values in way.at(np.array((line - 1.0, line, exit_)))
        )
        away = math.hypot(x - pose.x, y - pose.y)
        if away > AHEAD:
            return None
        foot = path.project(x, y, min(bumper + away, path.length))
        heading = math.atan2(y - y0, x - x0)
        aligned = math.cos(heading - foot.heading) > ALONG
        if abs(foot.d) > half or not aligned or foot.s <= bumper - PASSED:
            return None
        far = math.hypot(beyond_x - x, beyond_y - y)
        beyond = path.project(beyond_x, beyond_y, min(foot.s + far, path.length))
        takes = abs(beyond.d) <= half + EXIT_SLACK and beyond.s > foot.s
        return foot.s if takes else None

    def _conflict(self, path: ReferencePath, way: Way, known: RightOfWay, row: int, line: float) -> Conflict | None:
        """Return where a way meets the path beyond the path's line [m]; None for nowhere."""
        places = np.arange(float(known.line[row]) - BEFORE, float(way.s[-1]), SPACING)
        s, d = path.locate(*way.at(places), line - BEFORE, line + INSIDE)
        near = np.flatnonzero(np.abs(d) < self._half + HALF_BODY + ROOM)
        if not len(near):
            return None
        apart = np.flatnonzero(np.diff(near) > 1)
        near = near[: apart[0] + 1] if len(apart) else near
        begin, end = float(s[near].min()) - HALF_BODY - ROOM, float(s[near].max()) + HALF_BODY + ROOM
        reach, leave = float(places[near[0]]), float(places[near[-1]])
        goes_on = near[-1] == len(places) - 1 or end > line + INSIDE - 2.0 * SPACING
        return Conflict(way, begin, math.inf, reach, math.inf) if goes_on else Conflict(way, begin, end, reach, leave)


def _way(known: RightOfWay, row: int) -> Way:
    """Return a way of an output."""
    points = slice(int(known.first[row]), int(known.first[row + 1]))
    x, y = known.x[points], known.y[points]
    pieces = np.hypot(np.diff(x), np.diff(y))
    kept = np.concatenate(([True], pieces > 0.0))
    s = np.concatenate(([0.0], np.cumsum(pieces)))
    limits = float(known.speed_limit[row]), float(known.speed_across[row])
    return Way(x[kept], y[kept], s[kept], float(known.width[row]), *limits, bool(known.ends[row]))
