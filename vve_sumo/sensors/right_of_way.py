"""A sense of right of way: the ways across the junctions around the car and which of them go first, as a map has it.

It knows the street alone: neither traffic nor what signals show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.junctions import Junction, JunctionWay
from vve_sumo.sensors.port import Column, SensorColumn
from vve_sumo.values import Actors, Floats, Point, Pose, RightOfWay, Vehicle

COLUMNS: Final = (
    SensorColumn("junction", "str", "SUMO's id of the junction (ground truth)"),
    SensorColumn("way", "int", "row of the way in the output"),
    SensorColumn("control", "int8", "what tells it to give way: 1 minor, 2 stop, 3 all-way stop, 4 equal, 5 signal"),
    SensorColumn("x_m", "float", "middle of the way's line, ahead of the front bumper"),
    SensorColumn("y_m", "float", "middle of the way's line, left of the car's axis"),
    SensorColumn("heading_rad", "float", "of the lane at the line from the car's axis, counter-clockwise"),
    SensorColumn("prior", "int", "number of ways that go first"),
)
#: the rows of the record are ways that lead in the car's direction by this [rad]
ALONG: Final = math.radians(60.0)
#: the line of such a way is no farther behind the front bumper than this [m]
BEHIND: Final = 3.0


@dataclass(frozen=True, slots=True)
class RightOfWayConfig:
    """What is known of the junctions."""

    range: float  #: from the front bumper to the line of one of its ways [m]
    rate: float  #: outputs a second [Hz]


class _Line(NamedTuple):
    """The line of a way that has to give way."""

    junction: int  #: row of the junction
    way: int  #: row of the way at its junction
    x: float  #: map [m]
    y: float
    heading: float  #: of the lane [rad], counter-clockwise from the map's +x


class RightOfWayReading(NamedTuple):
    """The rows of one output."""

    ids: Sequence[str]
    rows: Floats

    def columns(self) -> tuple[Column, ...]:
        """Return the rows as the columns of the sensor's table."""
        way, control, x, y, heading, prior = self.rows.T.copy()
        return (self.ids, way.astype(np.int64), control.astype(np.int8), x, y, heading, prior.astype(np.int64))


class RightOfWaySense:
    """A sensor of who goes first."""

    refused = 0  #: it looks at no actors

    def __init__(self, config: RightOfWayConfig, vehicle: Vehicle, junctions: Sequence[Junction]) -> None:
        self._config, self._bumper, self._junctions = config, vehicle.rear_axle_to_bumper, junctions
        places = [[_line_of(way) for way in one.ways] for one in junctions]
        self._lines = [
            _Line(number, row, *places[number][row])
            for number, one in enumerate(junctions)
            for row, way in enumerate(one.ways)
            if way.prior
        ]
        count = [len(one.ways) for one in junctions]
        self._of = np.repeat(np.arange(len(junctions)), count)
        self._x = np.array([place[0] for own in places for place in own])
        self._y = np.array([place[1] for own in places for place in own])
        self._near: tuple[int, ...] = ()
        self._next = -math.inf
        self.output: RightOfWay = _output((), ())

    def step(self, time: float, pose: Pose, actors: Actors) -> RightOfWayReading | None:
        """Look from the rear axle's pose at drive time `time` [s]; `actors` hide nothing."""
        if pose.point is not Point.REAR_AXLE:
            raise ValueError(f"right_of_way: the pose must be the rear axle's, got {pose.point}")
        if time < self._next - 1e-9:
            return None
        self._next = max(self._next, time) + 1.0 / self._config.rate
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        front_x, front_y = pose.x + self._bumper * cos, pose.y + self._bumper * sin
        distance = np.hypot(self._x - front_x, self._y - front_y)
        near = tuple(np.unique(self._of[distance <= self._config.range]).tolist())
        if near != self._near:
            self._near, self.output = near, _output(near, [self._junctions[number] for number in near])
        self.output = replace(self.output, time=time)
        ids, rows = [], []
        begins = dict(zip(near, accumulate((len(self._junctions[one].ways) for one in near), initial=0), strict=False))
        for line in self._lines:
            east, north = line.x - front_x, line.y - front_y
            ahead, heading = east * cos + north * sin, math.remainder(line.heading - pose.heading, math.tau)
            if line.junction in begins and ahead > -BEHIND and abs(heading) < ALONG:
                way = self._junctions[line.junction].ways[line.way]
                place = (ahead, north * cos - east * sin, heading)
                ids.append(self._junctions[line.junction].id)
                rows.append((begins[line.junction] + line.way, way.control, *place, len(way.prior)))
        return RightOfWayReading(ids, np.array(rows, np.float64).reshape(-1, len(COLUMNS) - 1))


def _line_of(way: JunctionWay) -> tuple[float, float, float]:
    """Return place [m] and heading [rad] of a way's line."""
    left = way.line
    for (x0, y0), (x, y) in zip(way.points, way.points[1:], strict=False):
        piece = math.hypot(x - x0, y - y0)
        if piece > 0.0 and piece >= left - 1e-6:
            share = min(left / piece, 1.0)
            return x0 + share * (x - x0), y0 + share * (y - y0), math.atan2(y - y0, x - x0)
        left -= piece
    raise ValueError(f"right_of_way: the line of {way.incoming} lies beyond its way")


def _output(numbers: Sequence[int], near: Sequence[Junction]) -> RightOfWay:
    """Return junctions, by their numbers, as an output of no date."""
    ways = [way for one in near for way in one.ways]
    begins = list(accumulate((len(one.ways) for one in near), initial=0))[:-1]
    pairs = [
        (begin + row, begin + prior)
        for begin, one in zip(begins, near, strict=True)
        for row, way in enumerate(one.ways)
        for prior in way.prior
    ]
    own, prior = np.array(pairs, np.int64).reshape(-1, 2).T.copy()
    points = np.array([point for way in ways for point in way.points], np.float64).reshape(-1, 2)
    return RightOfWay(
        time=-math.inf,
        junction=np.repeat(np.array(numbers, np.int64), [len(one.ways) for one in near]),
        control=np.array([way.control for way in ways], np.int8),
        width=np.array([way.width for way in ways], np.float64),
        speed_limit=np.array([way.speed_limit for way in ways], np.float64),
        speed_across=np.array([way.speed_across for way in ways], np.float64),
        line=np.array([way.line for way in ways], np.float64),
        exit=np.array([way.exit for way in ways], np.float64),
        ends=np.array([way.ends for way in ways], np.bool_),
        first=np.array(list(accumulate((len(way.points) for way in ways), initial=0)), np.int64),
        x=points[:, 0].copy(),
        y=points[:, 1].copy(),
        own=own,
        prior=prior,
    )
