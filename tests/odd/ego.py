"""An ego that drives oddly: stands, creeps, reverses, lies across the road, leaves it, takes the wrong side.

It stops for what stands in its way, so that what touches it has driven into it. No simulation, no clock: a pose a step.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from typing import Final, NamedTuple

from vve_sumo.geometry import Box, behind_bumper, overlap
from vve_sumo.path import ReferencePath
from vve_sumo.values import Actors, Point, Pose, Vehicle

GENTLE: Final = 1.5  #: how it speeds up and slows down [m/s2]
HARD: Final = 4.0  #: how it brakes for what is in its way [m/s2]
CLEARANCE: Final = 1.5  #: that it keeps [m]
STEERING: Final = 0.4  #: how fast it turns against the path [rad/s]
PATIENCE: Final = 300.0  #: it waits so long for what is in its way before it does something else [s]
SHARPEST: Final = 0.9  #: angle to the path while it lies across the road [rad]


class Manoeuvre(NamedTuple):
    """What the ego means to do next."""

    name: str
    speed: float  #: wanted [m/s]; negative is backwards
    seconds: float  #: how long
    d: float = 0.0  #: wanted beside the path [m], left positive
    turn: float = 0.3  #: greatest angle to the path on the way there [rad]
    in_junction: bool = False  #: wait for the next junction before it begins


def plan(chance: random.Random) -> Iterator[Manoeuvre]:
    """Yield what an odd driver does, without end."""
    while True:
        yield Manoeuvre("drive", chance.uniform(4.0, 12.0), chance.uniform(5.0, 25.0))
        inside = chance.random() < 0.6
        yield chance.choice(
            (
                Manoeuvre("stand", 0.0, chance.choice((15.0, 60.0, 300.0)), in_junction=inside),
                Manoeuvre("creep", chance.uniform(0.3, 1.5), chance.uniform(20.0, 60.0), in_junction=inside),
                Manoeuvre("creep", chance.uniform(0.3, 1.5), chance.uniform(20.0, 60.0), in_junction=True),
                Manoeuvre("reverse", -chance.uniform(0.5, 2.5), chance.uniform(5.0, 15.0), in_junction=inside),
                Manoeuvre("diagonal", 2.0, chance.uniform(3.0, 5.0), chance.choice((-7.0, 7.0)), SHARPEST, inside),
                Manoeuvre("wrong side", chance.uniform(2.0, 8.0), chance.uniform(15.0, 40.0), 3.4, in_junction=inside),
                Manoeuvre("off the road", 3.0, chance.uniform(15.0, 40.0), chance.choice((-8.0, 8.0)), 0.5, inside),
            )
        )
        if chance.random() < 0.5:
            yield Manoeuvre("stand", 0.0, chance.choice((10.0, 30.0, 120.0)))


class OddEgo:
    """The ego on its way; `step` moves it."""

    def __init__(self, path: ReferencePath, vehicle: Vehicle, start: float, means: Iterator[Manoeuvre]) -> None:
        """Begin at an s of the path [m], for the rear axle; `means` is what it does, one after the other."""
        self._path, self._vehicle, self._plan = path, vehicle, means
        self._s, self._d, self._turn, self._speed = start, 0.0, 0.0, 0.0
        self._time = self._until = 0.0
        self._next: Manoeuvre | None = None
        self.manoeuvre = next(self._plan)
        self._until = self.manoeuvre.seconds
        self.blocked_since = math.inf  #: since when something stands in its way while it means to move [s]
        self.blocked_by = ""

    def step(self, period: float, actors: Actors, in_junction: bool) -> Pose:
        """Return where the front bumper is a period [s] later; `actors` is what was around it a moment ago."""
        self._time += period
        self._choose(in_junction)
        wanted = self.manoeuvre.speed
        self.blocked_by = self._in_the_way(actors, 1.0 if wanted >= 0.0 else -1.0)
        if not self.blocked_by or wanted == 0.0 or abs(self._speed) > 0.3:
            self.blocked_since = math.inf
        elif self.blocked_since == math.inf:
            self.blocked_since = self._time
        most = (HARD if self.blocked_by else GENTLE) * period
        self._speed += min(max((0.0 if self.blocked_by else wanted) - self._speed, -most), most)
        self._move(period)
        return self.pose()

    def pose(self) -> Pose:
        """Return where the middle of the front bumper is."""
        x, y, heading = self._bumper()
        return Pose(self._time, Point.FRONT_BUMPER, x, y, heading, self._speed, 0.0, 0.0, 0.0, 0.0)

    def body(self) -> Box:
        """Return the ground that the ego covers."""
        return behind_bumper(*self._bumper(), self._vehicle.length, self._vehicle.width)

    def _bumper(self) -> tuple[float, float, float]:
        at = self._path.at(self._s)
        heading, ahead = at.heading + self._turn, self._vehicle.rear_axle_to_bumper
        x, y = at.x - self._d * math.sin(at.heading), at.y + self._d * math.cos(at.heading)
        return x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading

    def _choose(self, in_junction: bool) -> None:
        impatient = self._time - self.blocked_since > PATIENCE
        if self._next is not None and (in_junction or impatient):
            self.manoeuvre, self._next = self._next, None
        elif self._next is not None or (self._time < self._until and not impatient):
            return
        else:
            chosen = next(self._plan)
            if chosen.in_junction and not in_junction:
                self._next = chosen
                self.manoeuvre = Manoeuvre("drive", 5.0, math.inf)
                return
            self.manoeuvre = chosen
        self._until, self.blocked_since = self._time + self.manoeuvre.seconds, math.inf

    def _move(self, period: float) -> None:
        away = self.manoeuvre.d - self._d
        wanted = min(max(0.4 * away, -self.manoeuvre.turn), self.manoeuvre.turn) * (1.0 if self._speed >= 0.0 else -1.0)
        if self._speed != 0.0:
            most = STEERING * period
            self._turn += min(max(wanted - self._turn, -most), most)
        at = self._path.at(self._s)
        self._s += self._speed * period * math.cos(self._turn) / max(1.0 - at.curvature * self._d, 0.2)
        self._d += self._speed * period * math.sin(self._turn)
        if self._s > self._path.length - 60.0 and self._speed > 0.0:
            self._s -= self._path.length - 120.0

    def _in_the_way(self, actors: Actors, direction: float) -> str:
        """The actor that it would touch if it went on and then braked, "" for none."""
        body = self.body()
        ahead = CLEARANCE + self._speed * self._speed / (2.0 * HARD) + 0.3 * abs(self._speed)
        heading = body.heading if direction > 0.0 else body.heading + math.pi
        swept = Box(body.x, body.y, heading, body.length, body.width + 0.4).stretched(ahead)
        columns = (actors.x, actors.y, actors.heading, actors.length, actors.width)
        reach = body.length + ahead
        for name, x, y, turned, length, width in zip(actors.ids, *(c.tolist() for c in columns), strict=True):
            if max(abs(x - body.x), abs(y - body.y)) < reach + length and overlap(
                swept, Box(x, y, turned, length, width)
            ):
                return str(name)
        return ""
