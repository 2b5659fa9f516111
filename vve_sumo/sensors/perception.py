"""What an equipped vehicle of the virtual road perceives of others, as its collective perception messages tell it.

The model is simple, for it is another's sensor: a sector about the vehicle's forward axis from the middle of its front,
straight lines of sight past bodies and walls, and a place that errs. What is seen is recognised at once, is never
confused and never missed. Knows no message and no radio.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.body_kinds import BODY_KINDS, PERSONS, TYPICAL, number_of
from vve_sumo.sensors.body_shapes import finite_rows
from vve_sumo.sensors.radio import Antenna, Obstacles
from vve_sumo.sensors.street import Walls
from vve_sumo.v2x.triggering import Motion, PerceptionTrigger
from vve_sumo.values import Actors, Floats, Pose, Vehicle

#: the sensor's height above the ground, behind the windscreen of a car [m]: an assumption
EYE_HEIGHT: Final = 1.2
#: a vehicle follows the nearest that it sees, no more
MAX_OBJECTS: Final = 16
#: numbers of objects begin again after so many
OBJECT_NUMBERS: Final = 1 << 16


@dataclass(frozen=True, slots=True)
class Sector:
    """Where a sensor sees, about the forward axis."""

    range: float = 80.0  #: [m]
    view: float = math.radians(120.0)  #: opening angle [rad]
    sigma: float = 0.3  #: of a place relative to the sensor, on each axis [m]


class PerceivedBody(NamedTuple):
    """A body that a message is to tell of."""

    row: int  #: of the actors
    number: int  #: of the object
    off_x: float  #: its middle from the sensor, as it was measured, map [m]
    off_y: float  #: likewise


class Surroundings:
    """All that may be seen, or may hide others, at one time."""

    def __init__(self, actors: Actors, pose: Pose, vehicle: Vehicle, walls: Walls) -> None:
        """`pose` is that of the ego's rear axle; `walls` hide whatever is behind them."""
        self.actors = actors
        self._rows = finite_rows(actors)
        self._obstacles = Obstacles(_with_ego(actors, pose, vehicle), walls)

    def visible_rows(self, sector: Sector, own: int) -> list[int]:
        """Return the rows of the actors that the one in row `own` sees, the nearest first."""
        actors, eye = self.actors, eye_of(self.actors, own)
        heading = float(actors.heading[own])
        rows = self._rows[self._rows != own]
        east, north = actors.x[rows] - eye.x, actors.y[rows] - eye.y
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, far = east * cos + north * sin, np.sqrt(east * east + north * north)
        within = far <= sector.range
        if sector.view < math.tau:  # else rounding would leave out who is straight behind
            within &= ahead >= far * math.cos(0.5 * sector.view)
        rows, far = rows[within], far[within]
        seen = self._obstacles.visible(eye, rows, own)
        nearest = np.argsort(far[seen], kind="stable")
        found: list[int] = rows[seen][nearest].tolist()
        return found


@dataclass(slots=True)
class Perceiver:
    """The sensor of one vehicle, and what it has told of. Pass it every check in order."""

    sector: Sector
    chance: np.random.Generator
    _trigger: PerceptionTrigger = field(default_factory=PerceptionTrigger)
    _numbers: dict[str, int] = field(default_factory=dict)  # of the objects that it sees, by actor
    _next: int = 0

    def due(self, now: int, around: Surroundings, own: int) -> tuple[tuple[PerceivedBody, ...], int]:
        """Return the bodies that a message at a time [us] tells of, and how many are seen at all; often none."""
        actors, seen = around.actors, around.visible_rows(self.sector, own)
        rows = seen[:MAX_OBJECTS]
        names = {actors.ids[row]: row for row in rows}
        self._numbers = {name: self._number(name) for name in names}
        motions = {number: _motion(actors, names[name]) for name, number in self._numbers.items()}
        people = {self._numbers[name] for name, row in names.items() if BODY_KINDS[actors.kind[row]] in PERSONS}
        included = self._trigger.due(now, motions, people)
        due = [row for row in rows if self._numbers[actors.ids[row]] in included]
        eye, sigma = eye_of(actors, own), self.sector.sigma
        errors = self.chance.standard_normal((len(due), 2)).tolist()
        bodies = tuple(
            PerceivedBody(
                row,
                self._numbers[actors.ids[row]],
                float(actors.x[row]) - eye.x + sigma * east,
                float(actors.y[row]) - eye.y + sigma * north,
            )
            for row, (east, north) in zip(due, errors, strict=True)
        )
        return bodies, len(seen)

    def _number(self, name: str) -> int:
        if name in self._numbers:
            return self._numbers[name]
        number, self._next = self._next, (self._next + 1) % OBJECT_NUMBERS
        return number


def eye_of(actors: Actors, row: int) -> Antenna:
    """Return where an actor's sensor is: in the middle of its front."""
    heading, half = float(actors.heading[row]), 0.5 * float(actors.length[row])
    x, y = float(actors.x[row]) + half * math.cos(heading), float(actors.y[row]) + half * math.sin(heading)
    return Antenna(x, y, EYE_HEIGHT)


def _motion(actors: Actors, row: int) -> Motion:
    return Motion(float(actors.x[row]), float(actors.y[row]), float(actors.heading[row]), float(actors.speed[row]))


def _with_ego(actors: Actors, pose: Pose, vehicle: Vehicle) -> Actors:
    """Return the actors with the ego, which hides others as they do, in a row after them."""
    back = 0.5 * vehicle.length - vehicle.rear_overhang
    x, y = pose.x + back * math.cos(pose.heading), pose.y + back * math.sin(pose.heading)

    def with_own(column: Floats, value: float) -> Floats:
        return np.append(column, value)

    return Actors(
        actors.time,
        (*actors.ids, ""),
        with_own(actors.x, x),
        with_own(actors.y, y),
        with_own(actors.heading, pose.heading),
        with_own(actors.speed, abs(pose.speed)),
        with_own(actors.length, vehicle.length),
        with_own(actors.width, vehicle.width),
        with_own(actors.radar_cross_section, 0.0),
        with_own(actors.lateral_speed, 0.0),
        with_own(actors.height, TYPICAL["car"].height),
        np.append(actors.kind, np.int8(number_of("car"))),
    )
