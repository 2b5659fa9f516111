"""Stops before red signals, and before yellow ones where it can stop with comfort; needs a sensor of kind `signals`.

It must not know how the car steers, nor other road users. A line once known whose signal is no longer known is red.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vve_sumo.laws import stopping_distance
from vve_sumo.path import ReferencePath
from vve_sumo.values import Observation, StopLines, Vehicle

from .approach import NOWHERE, Goal

#: deceleration of a stop on yellow [m/s2]: 10 ft/s2, by which yellow times are chosen (ITE, "Guidelines for Determining
#: Traffic Signal Change and Clearance Intervals", 2020)
YELLOW_DECELERATION: Final = 3.0
JERK: Final = 4.0  #: by which comfort braking builds up [m/s3]
MARGIN: Final = 1.0  #: from the front bumper at rest to the line [m]
LOST: Final = 1.5  #: after it a signal that is not known any more counts as red [s]
SAME_LINE: Final = 3.0  #: a line moves by less than this from output to output [m]
PASSED: Final = 0.5  #: the front bumper is so far beyond a line that has been passed [m]
AHEAD: Final = 210.0  #: lines that are farther are not looked at [m]
ALONG: Final = math.cos(math.radians(45.0))  #: of the greatest angle between path and lane at a line
EXIT_SLACK: Final = 1.0  #: of the path from the middle of the lane beyond, on top of half its width [m]

STOP_AND_GO, RED, GREEN, YELLOW = frozenset({2}), frozenset({0, 3, 4}), frozenset({5, 6}), frozenset({7, 8})
#: the stricter a phase, the earlier it stands: of ways among which the path cannot be told apart the strictest counts
STRICTNESS: Final = (0, 3, 4, 2, 7, 8, 9, 1, 5, 6)


@dataclass(slots=True)
class Line:
    """A stop line on the path."""

    s: float  #: along the path [m]
    phase: int  #: as in `StopLines`
    known: float  #: drive time of what is known [s]
    end: float  #: drive time at which the phase ends at the earliest [s]; 0 unknown
    green_begin: float  #: of the next green at the earliest, drive time [s]; 0 unknown
    green_end: float  #: as green_begin


def yellow_stop_distance(speed: float, answer: float) -> float:
    """Return the distance in which a car at a speed [m/s] stops for yellow [m]; `answer` before its brakes act [s]."""
    return stopping_distance(speed, YELLOW_DECELERATION, answer, YELLOW_DECELERATION / JERK)


class SignalWatch:
    """Finds the stop lines of the path, and which of the ways across each junction the path takes."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._bumper = vehicle.rear_axle_to_bumper
        self._lines: dict[int, Line] = {}  # by the junction's number
        self._newest = -math.inf

    def step(self, observation: Observation, s: float) -> Line | None:
        """Return the next line ahead of the front bumper, None for none; `s` is that of the rear axle [m]."""
        lines = next((one for one in observation.sensors.values() if isinstance(one, StopLines)), None)
        if lines is not None and lines.time > self._newest:
            self._newest = lines.time
            self._take(lines, observation, s)
        bumper = s + self._bumper
        self._lines = {number: line for number, line in self._lines.items() if line.s > bumper - PASSED}
        return min(self._lines.values(), key=lambda line: line.s, default=None)

    def _take(self, lines: StopLines, observation: Observation, s: float) -> None:
        """Take what an output says of the lines ahead; it is of this tick, so places count from this tick's pose."""
        found: dict[int, list[tuple[bool, int, int, float]]] = {}
        for row in range(len(lines.x)):
            matched = self._match(lines, row, observation, s)
            if matched is not None:
                on_exit, at = matched
                strictness = STRICTNESS.index(int(lines.phase[row]))
                found.setdefault(int(lines.intersection[row]), []).append((not on_exit, strictness, row, at))
        for number, rows in found.items():
            _off, _strictness, row, at = min(rows)
            times = (lines.remaining[row], lines.green_begin[row], lines.green_end[row])
            end, begin, green_end = (lines.time + float(time) if time > 0.0 else 0.0 for time in times)
            self._lines[number] = Line(
                at, int(lines.phase[row]), lines.time - float(lines.age[row]), end, begin, green_end
            )

    def _match(self, lines: StopLines, row: int, observation: Observation, s: float) -> tuple[bool, float] | None:
        """Return whether the path takes a row's way, and where on the path its line is [m]; None if not on the path."""
        x, y, half = float(lines.x[row]), float(lines.y[row]), 0.5 * float(lines.width[row])
        if not -PASSED < x < AHEAD or abs(y) > AHEAD:
            return None
        pose, path = observation.pose, observation.path
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)

        def placed(ahead: float, left: float) -> tuple[float, float]:
            along = ahead + self._bumper
            return pose.x + along * cos - left * sin, pose.y + along * sin + left * cos

        foot = _foot(path, *placed(x, y), s + self._bumper + math.hypot(x, y))
        aligned = math.cos(float(lines.heading[row]) + pose.heading - path.at(foot[0]).heading) > ALONG
        if abs(foot[1]) > half or not aligned or foot[0] <= s + self._bumper - PASSED:
            return None
        exit_x, exit_y = float(lines.exit_x[row]), float(lines.exit_y[row])
        beyond = _foot(path, *placed(exit_x, exit_y), foot[0] + math.hypot(exit_x - x, exit_y - y))
        return abs(beyond[1]) <= half + EXIT_SLACK and beyond[0] > foot[0], foot[0]


def _foot(path: ReferencePath, x: float, y: float, near: float) -> tuple[float, float]:
    """Return s and d of a map point near an s on the path [m]."""
    place = path.project(x, y, min(near, path.length))
    return place.s, place.d


class SignalStop:
    """Decides for the next line whether to stop, once for each yellow."""

    def __init__(self, vehicle: Vehicle, period: float) -> None:
        self._watch, self._bumper = SignalWatch(vehicle), vehicle.rear_axle_to_bumper
        self._answer = vehicle.brake_delay + vehicle.brake_lag + period
        self._decided = -math.inf  # s of the line [m] that was decided on at yellow
        self._goes = False
        self.line: Line | None = None  #: the next one; None for none
        self.distance = math.inf  #: from the front bumper to it [m]

    def goal(self, observation: Observation, s: float) -> Goal:
        """Return where the front bumper shall not pass; `s` is that of the rear axle [m]."""
        line = self.line = self._watch.step(observation, s)
        if line is None:
            self.distance = math.inf
            return NOWHERE
        self.distance = line.s - s - self._bumper
        return Goal(self.distance - MARGIN) if self._stops(line, observation) else NOWHERE

    def _stops(self, line: Line, observation: Observation) -> bool:
        if line.phase in YELLOW and not self._is_decided(line):
            self._decided = line.s
            self._goes = self.distance - MARGIN < yellow_stop_distance(observation.pose.speed, self._answer)
        if line.phase in GREEN:
            self._decided = -math.inf
        elif self._is_decided(line) and self._goes:
            # Red, and slower since: behind somebody who waits. What it can stop for now it stops for.
            self._goes = line.phase in YELLOW or self.distance < yellow_stop_distance(
                observation.pose.speed, self._answer
            )
            if self._goes:
                return False
        return observation.time - line.known > LOST or line.phase in YELLOW | RED | STOP_AND_GO

    def _is_decided(self, line: Line) -> bool:
        return abs(line.s - self._decided) < SAME_LINE
