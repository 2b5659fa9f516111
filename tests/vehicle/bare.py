"""A car of round numbers on which nothing acts but its pedals, and a wire that says what a test wants."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from tests import vehicles
from vve_sumo.values import Frame, Vehicle
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.interface import Report

#: 500 N m brake with 1 m/s2, a tenth of the throttle pushes with 1 m/s2.
BARE: Final = Calibration(
    mass=1000.0,
    brake_gain=500.0,
    brake_torque_limit=3000.0,
    drive_force_limit=10_000.0,
    drive_power_limit=1e9,
    drive_lag=0.2,
    creep_force=0.0,
    creep_speed=4.0,
    rolling_resistance=0.0,
    drag_area=0.0,
    wheel_speed_tolerance=0.02,
)
CAR: Final[Vehicle] = replace(vehicles.FUSION.vehicle, brake_delay=0.1, brake_lag=0.05)


class Saying(DataspeedDbw1):
    """An interface of which every frame says what a test wants."""

    said: tuple[Report, ...] = ()

    def decode(self, frame: Frame) -> tuple[Report, ...]:
        return self.said
