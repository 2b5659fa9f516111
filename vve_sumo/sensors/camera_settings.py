"""The camera as a kind of sensor: what a scenario may say of it, and the camera that it means."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import Field

from vve_sumo.config_file import Finite, Positive
from vve_sumo.sensors.camera import COLUMNS, Camera, CameraConfig
from vve_sumo.sensors.drawing import Cartesian, Drawing, FieldOfView, Mounting, Points, ViewSector, front_bumper
from vve_sumo.sensors.image_mask import Pinhole
from vve_sumo.sensors.port import Content, Sensor, SensorColumn, SensorSettings
from vve_sumo.sensors.street import Lanes, Street, walls_of
from vve_sumo.values import CameraObjects, Vehicle

#: frames that may be missing beyond the latency before the camera counts as late
LATE_FRAMES: Final = 4.0

Pixels = Annotated[int, Field(ge=16, le=4096)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class CameraSettings(SensorSettings):
    """A camera that reports a list of objects, behind the windscreen."""

    columns: ClassVar[tuple[SensorColumn, ...]] = COLUMNS
    serves: ClassVar[tuple[Content, ...]] = ("objects",)
    observation: ClassVar[type] = CameraObjects

    ideal: bool = Field(default=False, description="no latency, no noise, nothing missed, no false object")
    columns_px: Pixels = Field(default=1280, description="width of the picture")
    rows_px: Pixels = Field(default=480, description="height of the picture; the horizon lies in its middle")
    field_of_view_deg: Annotated[float, Field(ge=5.0, le=120.0)] = Field(
        default=52.0, description="from the left to the right edge of the picture"
    )
    rate_hz: Annotated[float, Field(ge=1.0, le=50.0)] = Field(default=15.0, description="pictures a second")
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.1, description="from a picture to its list's coming out; it is dated when the picture was taken"
    )
    x_m: Finite = Field(default=1.9, description="where it is mounted, forward from the rear axle")
    y_m: Finite = Field(default=0.0, description="where it is mounted, to the left")
    z_m: Annotated[float, Field(gt=0.2, le=10.0)] = Field(default=1.3, description="its height above the ground")
    yaw_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = Field(
        default=0.0, description="of its axis, counter-clockwise from the car's forward axis"
    )
    range_max_m: Positive = Field(default=150.0, description="nothing farther is listed")
    min_rows_px: Positive = Field(default=16.0, description="rows that must be seen of a vehicle")
    min_rows_small_px: Positive = Field(default=32.0, description="rows that must be seen of a person or a two-wheeler")
    min_visible: Share = Field(default=0.4, description="least share of an object's own pixels that must be seen")
    pixel_sigma_px: Annotated[float, Field(ge=0.0, le=20.0)] = Field(
        default=1.0,
        description="noise of a place in the picture, of which the errors of range, bearing and speed follow",
    )
    noise_correlation: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.9, description="of one object's errors from picture to picture; 0 is white noise"
    )
    miss_rate: Share = Field(
        default=0.02, description="share of the pictures in which an object in sight is not listed"
    )
    false_objects: Annotated[float, Field(ge=0.0, le=10.0)] = Field(default=0.0, description="mean number a picture")

    def config(self) -> CameraConfig:
        """Return the camera's configuration."""
        focal = 0.5 * self.columns_px / math.tan(0.5 * math.radians(self.field_of_view_deg))
        own = CameraConfig(
            view=Pinhole(self.columns_px, self.rows_px, focal),
            rate=self.rate_hz,
            latency=self.latency_s,
            x=self.x_m,
            y=self.y_m,
            z=self.z_m,
            yaw=math.radians(self.yaw_deg),
            range_max=self.range_max_m,
            min_rows=self.min_rows_px,
            min_rows_small=self.min_rows_small_px,
            min_visible=self.min_visible,
            pixel_sigma=self.pixel_sigma_px,
            noise_correlation=self.noise_correlation,
            miss_rate=self.miss_rate,
            false_objects=self.false_objects,
        )
        return own.ideal() if self.ideal else own

    def drawing(self, vehicle: Vehicle, /) -> Drawing:
        """Return points that count from the front bumper, and the field of view of the camera behind it."""
        config = self.config()
        camera = Mounting(x_m=config.x, y_m=config.y, z_m=config.z, yaw_rad=config.yaw)
        sector = ViewSector(range_m=config.range_max, half_angle_rad=config.view.half_angle)
        return Points(
            place=Cartesian(x="x_m", y="y_m"),
            frame=front_bumper(vehicle),
            actor="actor",
            view=FieldOfView(frame=camera, sectors=[sector]),
        )

    def max_age(self) -> float:
        """Return how old the newest list may be at a tick [s]."""
        return self.latency_s + LATE_FRAMES / self.rate_hz

    def sensor(self, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return a camera on a vehicle, on a street without buildings and lanes."""
        return self.sensor_along(Street(), vehicle, generator)

    def sensor_along(self, street: Street, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return a camera on a vehicle, on a street."""
        return Camera(self.config(), vehicle, generator, walls_of(street.buildings), Lanes(street.lanes))


def make() -> type[SensorSettings]:
    """Return the kind's class."""
    return CameraSettings
