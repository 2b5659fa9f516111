"""The radar as a kind of sensor: what a scenario may say of it, and the radar that it means."""

from __future__ import annotations

from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import Field

from vve_sumo.sensors.drawing import Drawing, FieldOfView, Mounting, Points, Polar, ViewSector, front_bumper
from vve_sumo.sensors.port import Content, Sensor, SensorColumn, SensorSettings
from vve_sumo.sensors.radar import COLUMNS, Radar, RadarConfig, RadarMode
from vve_sumo.values import Detections, Vehicle

#: silence beyond the latency after which the radar counts as late [s]: four of its cycles
SILENCE: Final = 0.2


class RadarSettings(SensorSettings):
    """The virtual radar, where it differs from the Delphi ESR defaults."""

    columns: ClassVar[tuple[SensorColumn, ...]] = COLUMNS
    serves: ClassVar[tuple[Content, ...]] = ("detections",)
    observation: ClassVar[type] = Detections

    ideal: bool = Field(
        default=False, description="no latency, noise, quanta or false alarms, every visible target detected"
    )
    range_limit_m: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = Field(
        default=None, description="blind beyond this range in every mode"
    )
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.09, description="from measuring to a scan's coming out; it is dated when it was measured"
    )
    noise_correlation: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.0, description="of one actor's errors from scan to scan; 0 is white noise"
    )
    false_alarms: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        default=0.0, description="mean number a scan, anywhere in the field of view"
    )

    def config(self) -> RadarConfig:
        """Return the radar's configuration."""
        modes = RadarConfig().modes
        if self.range_limit_m is not None:
            limit = self.range_limit_m
            modes = tuple(RadarMode(min(mode.range_max, limit), mode.half_angle) for mode in modes)
        config = RadarConfig(
            modes=modes,
            latency=self.latency_s,
            noise_correlation=self.noise_correlation,
            false_alarms=self.false_alarms,
        )
        return config.ideal() if self.ideal else config

    def drawing(self, vehicle: Vehicle, /) -> Drawing:
        """Return points that count from the front bumper, and the field of view of the antenna behind it."""
        config = self.config()
        antenna = Mounting(
            x_m=vehicle.rear_axle_to_bumper + config.mount.x, y_m=config.mount.y, yaw_rad=config.mount.yaw
        )
        sectors = [ViewSector(range_m=mode.range_max, half_angle_rad=mode.half_angle) for mode in config.modes]
        return Points(
            place=Polar(range="range_m", azimuth="azimuth_rad"),
            frame=front_bumper(vehicle),
            range_rate="range_rate_mps",
            actor="actor",
            view=FieldOfView(frame=antenna, sectors=sectors),
        )

    def max_age(self) -> float:
        """Return how old the newest scan may be at a tick [s]."""
        return self.latency_s + SILENCE

    def sensor(self, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return a radar on a vehicle."""
        return Radar(self.config(), vehicle, generator)


def make() -> type[SensorSettings]:
    """Return the kind's class."""
    return RadarSettings
