"""A range finder of an invented make, in one file: a flat beam straight ahead of the front bumper.

In a scenario, `[[sensors]]` with `name = "ahead"` and `kind = "range_finder.py:make"` puts it on the car.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from vve_sumo.config_file import NotNegative, Positive
from vve_sumo.sensors.drawing import Drawing, Points, Polar, front_bumper
from vve_sumo.sensors.port import Column, SensorColumn, SensorSettings
from vve_sumo.values import Actors, Floats, Pose, Vehicle

PERIOD = 0.04  # from one measurement to the next [s]


@dataclass(frozen=True, slots=True)
class Range:
    """What a controller is handed: no row where nothing is in the beam."""

    time: float  #: drive time at which it was measured [s]
    range: Floats  #: from the front bumper, along the car's forward axis [m]


@dataclass(frozen=True, slots=True)
class Reading:
    """What the record keeps: the range, and the actor behind it, which no controller is told."""

    measured: Range
    actors: tuple[str, ...]

    def columns(self) -> tuple[Column, ...]:
        """Return the rows of the record's table."""
        return self.measured.range, self.actors


class RangeFinder(SensorSettings):
    """The range finder."""

    columns: ClassVar[tuple[SensorColumn, ...]] = (
        SensorColumn("range_m", "float", "from the front bumper to the nearest point of a body in the beam"),
        SensorColumn("actor", "str", "whose body that is: truth that no controller is told"),
    )
    observation: ClassVar[type] = Range

    width_m: Positive = Field(default=1.5, description="of the beam")
    reach_m: Positive = Field(default=80.0, description="farthest that it measures")
    sigma_m: NotNegative = Field(default=0.05, description="1 sigma of the noise")

    def drawing(self, vehicle: Vehicle, /) -> Drawing:
        """Return a point straight ahead of the front bumper, by its range alone."""
        return Points(place=Polar(range="range_m"), frame=front_bumper(vehicle), actor="actor")

    def max_age(self) -> float:
        """Return how old the newest range may be at a tick [s]."""
        return 0.1

    def sensor(self, vehicle: Vehicle, generator: np.random.Generator, /) -> Beam:
        """Return a range finder on a vehicle."""
        return Beam(self, vehicle.rear_axle_to_bumper, generator)


class Beam:
    """Measures every PERIOD, and says so at once."""

    def __init__(self, settings: RangeFinder, bumper: float, generator: np.random.Generator) -> None:
        self._settings, self._bumper, self._generator = settings, bumper, generator
        self._due = -math.inf
        self.output = Range(-math.inf, np.zeros(0))
        self.refused = 0

    def step(self, time: float, pose: Pose, actors: Actors) -> Reading | None:
        """Measure, where it is due."""
        self.refused = 0
        if time < self._due - 1e-9:
            return None
        self._due = time + PERIOD
        numbers = np.column_stack([actors.x, actors.y, actors.heading, actors.length, actors.width])
        sound = np.isfinite(numbers).all(axis=1)
        self.refused = int(len(sound) - sound.sum())
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        found, actor = math.inf, ""
        for row in np.flatnonzero(sound).tolist():
            x, y, heading, length, width = numbers[row].tolist()
            dx, dy = x - pose.x, y - pose.y
            ahead, left = cos * dx + sin * dy - self._bumper, cos * dy - sin * dx
            found, actor = min(
                (found, actor), (self._nearest(ahead, left, heading - pose.heading, length, width), actors.ids[row])
            )
        noise = self._settings.sigma_m * float(self._generator.standard_normal())
        seen = [max(found + noise, 0.0)] if found <= self._settings.reach_m else []
        self.output = Range(time, np.array(seen))
        return Reading(self.output, (actor,) * len(seen))

    def _nearest(self, ahead: float, left: float, turned: float, length: float, width: float) -> float:
        """Return the least distance of a box in the beam, infinite for none: of its edges, cut to the beam."""
        cos, sin, half = math.cos(turned), math.sin(turned), 0.5 * self._settings.width_m
        corners = [
            (ahead + 0.5 * (a * length * cos - b * width * sin), left + 0.5 * (a * length * sin + b * width * cos))
            for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
        ]
        places = [x for x, y in corners if abs(y) <= half]
        for (x, y), (other_x, other_y) in zip(corners, corners[1:] + corners[:1], strict=True):
            places += [
                x + (side - y) / (other_y - y) * (other_x - x)
                for side in (-half, half)
                if min(y, other_y) < side < max(y, other_y)
            ]
        return min((place for place in places if place >= 0.0), default=math.inf)


def make() -> type[SensorSettings]:
    """Return the kind's class."""
    return RangeFinder
