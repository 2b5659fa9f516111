"""The sense of signals as a kind of sensor: what a scenario may say of it, and the sensor that it means."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from pydantic import Field

from vve_sumo.frames import local_frame
from vve_sumo.sensors.drawing import Cartesian, Drawing, Points, front_bumper
from vve_sumo.sensors.port import Content, Sensor, SensorColumn, SensorSettings
from vve_sumo.sensors.signals import COLUMNS, SignalsConfig, SignalSense
from vve_sumo.sensors.street import Street
from vve_sumo.values import StopLines, Vehicle

#: outputs that may be missing before the sense counts as late
LATE_OUTPUTS: Final = 4.0


class SignalsSettings(SensorSettings):
    """A sense of stop lines and of what signals show."""

    columns: ClassVar[tuple[SensorColumn, ...]] = COLUMNS
    serves: ClassVar[tuple[Content, ...]] = ("stop_lines",)
    observation: ClassVar[type] = StopLines

    by: Literal["v2x", "sight"] = Field(
        default="v2x",
        description="`v2x`: SPATEM and MAPEM of the roadside units, with times; `sight`: what is shown ahead, no times",
    )
    range_m: Annotated[float, Field(gt=0.0, le=220.0)] = Field(
        default=200.0, description="to the middle of the junction; farther signals are not known"
    )
    field_of_view_deg: Annotated[float, Field(ge=5.0, le=180.0)] = Field(
        default=60.0, description="`sight`: the angle about the car's axis in which signals are seen"
    )
    rate_hz: Annotated[float, Field(ge=1.0, le=50.0)] = Field(default=10.0, description="outputs a second")
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.1, description="from what a signal shows to the output that has it"
    )
    loss: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.02, description="`v2x`: share of the SPATEMs that are not received"
    )

    @classmethod
    def sees_signals(cls) -> bool:
        """Whether the kind needs the intersections of the street."""
        return True

    def drawing(self, vehicle: Vehicle, /) -> Drawing:
        """Return the middles of the stop lines."""
        return Points(place=Cartesian(x="x_m", y="y_m"), frame=front_bumper(vehicle))

    def max_age(self) -> float:
        """Return how old the output may be at a tick [s]."""
        return LATE_OUTPUTS / self.rate_hz

    def sensor(self, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return the sense on a street without signals."""
        return self.sensor_along(Street(), vehicle, generator)

    def sensor_along(self, street: Street, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return the sense on a street."""
        half_angle = 0.5 * math.radians(self.field_of_view_deg)
        config = SignalsConfig(self.by == "v2x", self.range_m, half_angle, self.rate_hz, self.latency_s, self.loss)
        frame = street.map_frame or local_frame(0.0, 0.0)
        return SignalSense(config, vehicle, generator, street.intersections, frame)


def make() -> type[SignalsSettings]:
    """Return the kind."""
    return SignalsSettings
