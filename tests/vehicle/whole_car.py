"""The gateway in the loop with the whole simulated vehicle: its kit with a watchdog, its lags, its driver."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests import vehicles
from tests.setpoints import setpoint as complete
from vve_sumo.frames import MapFrame
from vve_sumo.plant.car import Car
from vve_sumo.values import ArmingState, Frame, GatewayStatus, Setpoint
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import HANDS_OFF, DriverInputs

PERIOD = 0.02
LOT = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-82.98 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
PARAMETERS = vehicles.parameters(noise=0.0)
VEHICLE = PARAMETERS.vehicle


def _car() -> Car:
    return Car(PARAMETERS, (0.0, 0.0, 0.0), LOT, 1_447_000_000.0, np.random.SeedSequence(1))


@dataclass
class WholeCar:
    """Gateway and car, run together tick by tick; the car starts in park at the origin, heading along x."""

    car: Car = field(default_factory=_car)
    gateway: Gateway = field(default_factory=lambda: Gateway(VEHICLE, calibration=PARAMETERS.calibration))
    tick: int = -1
    sequence: int = 0
    frames: tuple[Frame, ...] = ()
    heard: list[Frame] = field(default_factory=list)
    distance: float = 0.0  #: driven by the rear axle so far [m]

    def setpoint(self, acceleration: float, steering: float, **changes: Any) -> Setpoint:
        """The setpoint that an honest drive would send now."""
        self.sequence += 1
        now, truth = self.tick * PERIOD, self.car.truth()
        values = {
            "sequence": self.sequence,
            "time": now,
            "expires": now + 0.1,
            "x": truth.x,
            "y": truth.y,
            "heading": truth.heading,
            "speed": truth.speed,
            "yaw_rate": truth.yaw_rate,
        }
        return complete(steering, acceleration, **(values | changes))

    def step(
        self,
        acceleration: float | None = 0.0,
        steering: float = 0.0,
        command: OperatorCommand | None = None,
        driver: DriverInputs = HANDS_OFF,
        process_faults: tuple[str, ...] = (),
        **changes: Any,
    ) -> GatewayStatus:
        """One tick; acceleration None sends no setpoint."""
        self.tick += 1
        setpoint = None if acceleration is None else self.setpoint(acceleration, steering, **changes)
        output = self.gateway.step(self.tick * PERIOD, setpoint, self.heard, command, process_faults)
        self.frames = output.frames
        before = self.car.truth()
        self.heard = [frame for _time, frame in self.car.step((self.tick + 1) * PERIOD, output.frames, driver).reports]
        after = self.car.truth()
        self.distance += math.hypot(after.x - before.x, after.y - before.y)
        return output.status

    def engage(self) -> None:
        """Bring the car to "engaged, in drive, free to go"."""
        for _ in range(10):
            self.step()
        self.step(command=OperatorCommand.ENGAGE)
        for _ in range(100):
            if self.step().reasons == ("waiting_for_go",):
                break
        assert self.step(command=OperatorCommand.GO).state is ArmingState.ENGAGED
