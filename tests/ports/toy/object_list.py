"""An object list of an invented make, in one file: boxes of the bodies near the car, or rays to their middles.

In a scenario, `[[sensors]]` with `name = "around"` and `kind = "object_list.py:make"` puts it on the car. It is
mounted on the roof and looks to the left, so that its frame is neither the car's nor the front bumper's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from vve_sumo.config_file import Positive
from vve_sumo.sensors.drawing import Boxes, Cartesian, Drawing, FieldOfView, Mounting, Rays, ViewSector
from vve_sumo.sensors.port import Column, SensorColumn, SensorSettings
from vve_sumo.values import Actors, Floats, Pose, Vehicle

PERIOD = 0.1  # from one list to the next [s]
ROOF = Mounting(x_m=1.2, y_m=0.3, yaw_rad=0.5 * math.pi)


@dataclass(frozen=True, slots=True)
class Objects:
    """What a controller is handed: boxes in the sensor's frame."""

    time: float  #: drive time at which they were measured [s]
    x: Floats  #: of the middle, to the car's left [m]
    y: Floats  #: of the middle, to the car's rear [m]
    heading: Floats  #: from the sensor's x axis [rad]
    length: Floats  #: [m]
    width: Floats  #: [m]


@dataclass(frozen=True, slots=True)
class Reading:
    """What the record keeps: the boxes, and whose they are."""

    measured: Objects
    actors: tuple[str, ...]

    def columns(self) -> tuple[Column, ...]:
        """Return the rows of the record's table."""
        seen = self.measured
        return seen.x, seen.y, seen.heading, seen.length, seen.width, self.actors


class ObjectList(SensorSettings):
    """The object list."""

    columns: ClassVar[tuple[SensorColumn, ...]] = (
        SensorColumn("x_m", "float", "middle of a box, to the car's left from the roof"),
        SensorColumn("y_m", "float", "middle of a box, to the car's rear from the roof"),
        SensorColumn("turn_rad", "float", "heading of a box from the sensor's x axis, counter-clockwise"),
        SensorColumn("length_m", "float", "of a box"),
        SensorColumn("width_m", "float", "of a box"),
        SensorColumn("whose", "str", "whose body that is: truth that no controller is told"),
    )
    observation: ClassVar[type] = Objects

    reach_m: Positive = Field(default=60.0, description="farthest middle that it lists")
    rays: bool = Field(default=False, description="drawn as rays to the middles instead of boxes")

    def drawing(self, vehicle: Vehicle, /) -> Drawing:
        """Return boxes in the frame on the roof, or rays."""
        place = Cartesian(x="x_m", y="y_m")
        if self.rays:
            return Rays(place=place, frame=ROOF)
        ahead = FieldOfView(frame=Mounting(x_m=1.2, y_m=0.3), sectors=[ViewSector(range_m=60.0, half_angle_rad=1.5)])
        return Boxes(
            place=place,
            frame=ROOF,
            heading="turn_rad",
            length="length_m",
            width="width_m",
            actor="whose",
            view=ahead,
        )

    def max_age(self) -> float:
        """Return how old the newest list may be at a tick [s]."""
        return 0.3

    def sensor(self, vehicle: Vehicle, generator: np.random.Generator, /) -> Lister:
        """Return an object list."""
        return Lister(self.reach_m)


class Lister:
    """Lists every PERIOD, without noise, and says so at once."""

    def __init__(self, reach: float) -> None:
        self._reach, self._due = reach, -math.inf
        self.output = Objects(-math.inf, *(np.zeros(0) for _ in range(5)))
        self.refused = 0

    def step(self, time: float, pose: Pose, actors: Actors) -> Reading | None:
        """List, where it is due."""
        self.refused = 0
        if time < self._due - 1e-9:
            return None
        self._due = time + PERIOD
        boxes = np.column_stack([actors.x, actors.y, actors.heading, actors.length, actors.width])
        sound = np.isfinite(boxes).all(axis=1)
        self.refused = int(len(sound) - sound.sum())
        axis = pose.heading + ROOF.yaw_rad
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        east = boxes[:, 0] - (pose.x + ROOF.x_m * cos - ROOF.y_m * sin)
        north = boxes[:, 1] - (pose.y + ROOF.x_m * sin + ROOF.y_m * cos)
        near = sound & (np.hypot(east, north) <= self._reach)
        x, y = east * math.cos(axis) + north * math.sin(axis), north * math.cos(axis) - east * math.sin(axis)
        self.output = Objects(time, x[near], y[near], boxes[near, 2] - axis, boxes[near, 3], boxes[near, 4])
        return Reading(self.output, tuple(actors.ids[row] for row in np.flatnonzero(near).tolist()))


def make() -> type[SensorSettings]:
    """Return the kind's class."""
    return ObjectList
