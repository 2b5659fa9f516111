"""The V2X receiver as a kind of sensor: what a scenario may say of it, and the receiver that it means."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import Field

from vve_sumo.config_file import Finite
from vve_sumo.frames import local_frame
from vve_sumo.sensors.drawing import Boxes, Cartesian, Drawing, front_bumper
from vve_sumo.sensors.perception import Sector
from vve_sumo.sensors.port import Content, Sensor, SensorColumn, SensorSettings
from vve_sumo.sensors.street import Street, walls_of
from vve_sumo.sensors.v2x import HEARTBEAT, V2xConfig, V2xReceiver
from vve_sumo.sensors.v2x_messages import COLUMNS, MORE_COLUMNS
from vve_sumo.values import Stations, Vehicle

#: heartbeats after which a receiver counts as late
LATE_BEATS: Final = 3.0

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Sigma = Annotated[float, Field(ge=0.0, le=50.0)]


class V2xSettings(SensorSettings):
    """A receiver of V2X messages."""

    columns: ClassVar[tuple[SensorColumn, ...]] = COLUMNS
    serves: ClassVar[tuple[Content, ...]] = ("stations",)
    observation: ClassVar[type] = Stations

    ideal: bool = Field(default=False, description="everybody sends, every packet is received, no station errs")
    equipped: Share = Field(default=1.0, description="share of the vehicles that send CAMs")
    equipped_vulnerable: Share = Field(default=1.0, description="share of the people and bicycles that send VAMs")
    latency_s: Annotated[float, Field(ge=0.0, le=2.0)] = Field(
        default=0.05, description="from the time that a message tells of to its coming out; a tick more passes"
    )
    longest_cam_interval_s: Annotated[float, Field(ge=0.1, le=1.0)] = Field(
        default=1.0,
        description="between two CAMs of a vehicle; 0.1: ten a second, as cooperative driving and SAE J2945/1 have it",
    )
    power_dbm: Annotated[float, Field(ge=-30.0, le=60.0)] = Field(
        default=23.0, description="that every station radiates, the gains of both antennas included"
    )
    sensitivity_dbm: Annotated[float, Field(ge=-150.0, le=0.0)] = Field(
        default=-82.0, description="least power at which a packet is received"
    )
    loss: Share = Field(default=0.02, description="share of the packets that are lost to others' at the same time")
    jammed_from_s: Annotated[float, Field(ge=0.0)] | None = Field(
        default=None, description="drive time from which on nothing is received any more; left out: never"
    )
    x_m: Finite = Field(default=1.0, description="where the antenna is, forward from the rear axle")
    y_m: Finite = Field(default=0.0, description="where the antenna is, to the left")
    z_m: Annotated[float, Field(gt=0.2, le=10.0)] = Field(default=1.5, description="height of the antenna")
    position_sigma_m: Sigma = Field(default=0.5, description="of a vehicle's own place, on each axis")
    position_sigma_vulnerable_m: Sigma = Field(
        default=1.5, description="of a person's or a cyclist's own place, on each axis"
    )
    speed_sigma_mps: Annotated[float, Field(ge=0.0, le=5.0)] = Field(
        default=0.1, description="of a station's own speed"
    )
    warnings: bool = Field(
        default=False, description="vehicles that send CAMs also warn by DENMs: of hard braking, and of standing"
    )
    hazard_lights: str = Field(
        default="", description="ids of the actors and obstacles whose hazard lights are on, with spaces between them"
    )
    perceiving: Share = Field(
        default=0.0, description="share of the vehicles that send CAMs which also tell by CPMs of what they perceive"
    )
    perception_range_m: Annotated[float, Field(gt=0.0, le=400.0)] = Field(
        default=80.0, description="how far they perceive"
    )
    perception_view_deg: Annotated[float, Field(gt=0.0, le=360.0)] = Field(
        default=120.0, description="the angle in which they do, about their forward axis"
    )
    perception_sigma_m: Sigma = Field(
        default=0.3, description="of a perceived body's place from the vehicle, on each axis"
    )

    def table(self) -> tuple[SensorColumn, ...]:
        """Return the columns, with those of warnings and perceived bodies where the settings have such."""
        return COLUMNS + MORE_COLUMNS if self.config().more else COLUMNS

    def config(self) -> V2xConfig:
        """Return the configuration of receiver and stations."""
        own = V2xConfig(
            equipped=self.equipped,
            equipped_vulnerable=self.equipped_vulnerable,
            latency=self.latency_s,
            longest_cam_interval=self.longest_cam_interval_s,
            power=self.power_dbm,
            sensitivity=self.sensitivity_dbm,
            loss=self.loss,
            jammed_from=math.inf if self.jammed_from_s is None else self.jammed_from_s,
            x=self.x_m,
            y=self.y_m,
            z=self.z_m,
            position_sigma=self.position_sigma_m,
            position_sigma_vulnerable=self.position_sigma_vulnerable_m,
            speed_sigma=self.speed_sigma_mps,
            warnings=self.warnings,
            hazard_lights=frozenset(self.hazard_lights.split()),
            perceiving=self.perceiving,
            sector=Sector(self.perception_range_m, math.radians(self.perception_view_deg), self.perception_sigma_m),
        )
        return own.ideal() if self.ideal else own

    def drawing(self, vehicle: Vehicle, /) -> Drawing:
        """Return boxes that count from the front bumper."""
        return Boxes(
            place=Cartesian(x="x_m", y="y_m"),
            frame=front_bumper(vehicle),
            actor="actor",
            heading="heading_rad",
            length="length_m",
            width="width_m",
        )

    def max_age(self) -> float:
        """Return how old the output may be at a tick [s]: it comes out also where nothing is heard."""
        return LATE_BEATS * HEARTBEAT

    def sensor(self, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return a receiver on a vehicle, on a street without buildings somewhere on Earth."""
        return self.sensor_along(Street(), vehicle, generator)

    def sensor_along(self, street: Street, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return a receiver on a vehicle, on a street; one that lies nowhere is laid about 0 N, 0 E."""
        frame = street.map_frame or local_frame(0.0, 0.0)
        return V2xReceiver(self.config(), vehicle, generator, walls_of(street.buildings), frame)


def make() -> type[SensorSettings]:
    """Return the kind's class."""
    return V2xSettings
