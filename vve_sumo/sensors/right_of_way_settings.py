"""The sense of right of way as a kind of sensor: what a scenario may say of it, and the sensor that it means."""

from __future__ import annotations

from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import Field

from vve_sumo.sensors.drawing import Cartesian, Drawing, Points, front_bumper
from vve_sumo.sensors.port import Sensor, SensorColumn, SensorSettings
from vve_sumo.sensors.right_of_way import COLUMNS, RightOfWayConfig, RightOfWaySense
from vve_sumo.sensors.street import Street
from vve_sumo.values import RightOfWay, Vehicle

#: outputs that may be missing before the sense counts as late
LATE_OUTPUTS: Final = 4.0


class RightOfWaySettings(SensorSettings):
    """A sense of the ways across junctions and of which of them go first."""

    columns: ClassVar[tuple[SensorColumn, ...]] = COLUMNS
    observation: ClassVar[type] = RightOfWay

    range_m: Annotated[float, Field(gt=0.0, le=300.0)] = Field(
        default=120.0, description="from the front bumper to the nearest line of a junction that is known"
    )
    rate_hz: Annotated[float, Field(ge=0.5, le=50.0)] = Field(default=5.0, description="outputs a second")

    @classmethod
    def sees_junctions(cls) -> bool:
        """Whether the kind needs the junctions of the street."""
        return True

    def drawing(self, vehicle: Vehicle, /) -> Drawing:
        """Return the middles of the lines at which the car may have to give way."""
        return Points(place=Cartesian(x="x_m", y="y_m"), frame=front_bumper(vehicle))

    def max_age(self) -> float:
        """Return how old the output may be at a tick [s]."""
        return LATE_OUTPUTS / self.rate_hz

    def sensor(self, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return the sense on a street without junctions."""
        return self.sensor_along(Street(), vehicle, generator)

    def sensor_along(self, street: Street, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return the sense on a street."""
        return RightOfWaySense(RightOfWayConfig(self.range_m, self.rate_hz), vehicle, street.junctions)


def make() -> type[RightOfWaySettings]:
    """Return the kind."""
    return RightOfWaySettings
