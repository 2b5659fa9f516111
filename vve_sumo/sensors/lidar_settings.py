"""The lidar as a kind of sensor: what a scenario may say of it, and the lidar that it means."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Final, Self

import numpy as np
from pydantic import Field, model_validator

from vve_sumo.config_file import Finite, Positive
from vve_sumo.sensors.drawing import Drawing, Mounting, Points, Polar
from vve_sumo.sensors.lidar import Lidar, LidarConfig
from vve_sumo.sensors.port import Content, Sensor, SensorColumn, SensorSettings
from vve_sumo.sensors.street import Street, walls_of
from vve_sumo.values import PointCloud, Vehicle

#: turns that may be missing before the lidar counts as late
LATE_TURNS: Final = 3.0

Angle = Annotated[float, Field(gt=-90.0, lt=90.0)]


class LidarSettings(SensorSettings):
    """A turning lidar, where it differs from a Velodyne VLP-16 on the roof."""

    columns: ClassVar[tuple[SensorColumn, ...]] = (
        SensorColumn("channel", "int8", "of the ray, from 0"),
        SensorColumn("azimuth_rad", "float", "of the ray from the lidar's x axis, left positive"),
        SensorColumn("elevation_rad", "float", "of the ray, up positive"),
        SensorColumn("range_m", "float", "along the ray"),
        SensorColumn("reflectivity", "int8", "apparent, in percent of a matt white surface met squarely"),
        SensorColumn("actor", "str", "name of the actor that was met, empty for ground and walls: truth"),
    )
    serves: ClassVar[tuple[Content, ...]] = ("points",)
    observation: ClassVar[type] = PointCloud

    ideal: bool = Field(default=False, description="no noise, no quantum, no ray lost")
    channels_deg: Annotated[tuple[Angle, ...], Field(min_length=1, max_length=128, strict=False)] = Field(
        default=tuple(float(angle) for low in range(-15, 0, 2) for angle in (low, low + 16)),
        description="elevation of each channel, up positive, in the order in which they fire",
    )
    rate_hz: Annotated[float, Field(ge=1.0, le=25.0)] = Field(default=10.0, description="turns a second")
    azimuth_step_deg: Annotated[float, Field(ge=0.05, le=5.0)] = Field(
        default=0.2, description="turn from one firing to the next; a turn is a whole number of steps"
    )
    x_m: Finite = Field(default=1.4, description="where it is mounted, forward from the rear axle")
    y_m: Finite = Field(default=0.0, description="where it is mounted, to the left")
    z_m: Annotated[float, Field(gt=0.0, le=10.0)] = Field(default=1.9, description="its height above the ground")
    yaw_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = Field(
        default=0.0, description="of its x axis, counter-clockwise from the car's forward axis"
    )
    range_max_m: Annotated[float, Field(gt=1.0, le=300.0)] = Field(
        default=100.0, description="farther surfaces do not come back"
    )
    range_dark_m: Positive = Field(
        default=60.0, description="at which half of the rays come back from a surface of 10 % that is met squarely"
    )
    range_sigma_m: Annotated[float, Field(ge=0.0, le=1.0)] = Field(default=0.015, description="noise of the range")

    @model_validator(mode="after")
    def _check_steps(self) -> Self:
        steps = 360.0 / self.azimuth_step_deg
        if abs(steps - round(steps)) > 1e-6:
            raise ValueError(f"azimuth_step_deg: expected a whole number of steps in 360, got {steps:g}")
        return self

    def config(self) -> LidarConfig:
        """Return the lidar's configuration."""
        channels = len(self.channels_deg)
        own = LidarConfig(
            elevations=tuple(map(math.radians, self.channels_deg)),
            rate=self.rate_hz,
            steps=round(360.0 / self.azimuth_step_deg),
            channel_spread=1.0 / (1.5 * channels),
            x=self.x_m,
            y=self.y_m,
            z=self.z_m,
            yaw=math.radians(self.yaw_deg),
            range_max=self.range_max_m,
            range_dark=self.range_dark_m,
            range_sigma=self.range_sigma_m,
        )
        return own.ideal() if self.ideal else own

    def drawing(self, vehicle: Vehicle, /) -> Drawing:
        """Return points that count from the lidar."""
        frame = Mounting(x_m=self.x_m, y_m=self.y_m, z_m=self.z_m, yaw_rad=math.radians(self.yaw_deg))
        place = Polar(range="range_m", azimuth="azimuth_rad", elevation="elevation_rad")
        return Points(place=place, frame=frame, actor="actor")

    def max_age(self) -> float:
        """Return how old the newest turn may be at a tick [s]."""
        return LATE_TURNS / self.rate_hz

    def sensor(self, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return a lidar on a vehicle, on a street without buildings."""
        return self.sensor_along(Street(), vehicle, generator)

    def sensor_along(self, street: Street, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return a lidar on a vehicle, on a street."""
        return Lidar(self.config(), generator, walls_of(street.buildings))


def make() -> type[SensorSettings]:
    """Return the kind's class."""
    return LidarSettings
