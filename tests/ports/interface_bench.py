"""A drive-by-wire interface under test: on a bench with its simulated other end, and between gateway and vehicle."""

from __future__ import annotations

from typing import Final

import numpy as np

from tests import vehicles
from tests.vehicle.whole_car import LOT
from vve_sumo.commissioning import interface_bench as bench
from vve_sumo.commissioning.interface_bench import HELD, NEUTRAL, STANDING, SUBSYSTEMS
from vve_sumo.plant.car import Car
from vve_sumo.values import ArmingState, Frame, Setpoint
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import (
    HANDS_OFF,
    ActuationCommand,
    DriverInputs,
    InterfaceConfig,
    load,
)

__all__ = ["CALIBRATION", "HELD", "NEUTRAL", "PERIOD", "STANDING", "SUBSYSTEMS", "Bench", "Drive"]

PERIOD: Final = 0.02  # of the gateway [s]
#: How the bench's car turns an acceleration into pedals.
CALIBRATION: Final = vehicles.FUSION.calibration


class Bench(bench.Bench):
    """The bench, on which every report has to be understood while no fault is put on."""

    def __init__(self, config: InterfaceConfig) -> None:
        super().__init__(config, CALIBRATION)

    def run(self, seconds: float, command: ActuationCommand | None, driver: DriverInputs = HANDS_OFF) -> None:
        super().run(seconds, command, driver)
        assert self.fault is not None or not self.malformed, self.malformed

    def restore(self) -> None:
        super().restore()
        self.malformed = set()

    def engaged(self) -> Bench:
        """Enable everything, on the brakes."""
        self.run(0.1, NEUTRAL)
        self.run(0.3, HELD)
        assert all(self.enabled())
        return self


class Drive:
    """Gateway and simulated vehicle, each with an interface of its own, run together."""

    def __init__(self, config: InterfaceConfig) -> None:
        parameters = vehicles.parameters(noise=0.0, interface=config)
        self.car = Car(parameters, (0.0, 0.0, 0.0), LOT, 1_447_000_000.0, np.random.SeedSequence(1))
        interface = load(config)
        self.gateway = Gateway(parameters.vehicle, calibration=parameters.calibration, interface=interface)
        self.heard: list[Frame] = []
        self.state = ArmingState.DISARMED
        self.reasons: tuple[str, ...] = ()
        self._tick = -1

    @property
    def speed(self) -> float:
        return self.car.truth().speed

    def step(
        self,
        acceleration: float,
        steering: float = 0.0,
        command: OperatorCommand | None = None,
        driver: DriverInputs = HANDS_OFF,
    ) -> None:
        """One tick."""
        self._tick += 1
        now, truth = self._tick * PERIOD, self.car.truth()
        setpoint = Setpoint(
            steering=steering, acceleration=acceleration, emergency=False, note="", sequence=self._tick, time=now,
            expires=now + 0.1, x=truth.x, y=truth.y, heading=truth.heading, speed=truth.speed, yaw_rate=truth.yaw_rate,
            grade=0.0, faults=(), fallback_path=None,
        )  # fmt: skip
        output = self.gateway.step(now, setpoint, self.heard, command)
        self.state, self.reasons = output.status.state, output.status.reasons
        said = self.car.step((self._tick + 1) * PERIOD, output.frames, driver)
        self.heard = [frame for _time, frame in said.reports]

    def run(self, seconds: float, acceleration: float, steering: float = 0.0, driver: DriverInputs = HANDS_OFF) -> None:
        """Ticks for `seconds`."""
        for _ in range(round(seconds / PERIOD)):
            self.step(acceleration, steering, driver=driver)

    def engage(self) -> None:
        """Bring the car to "engaged, in drive, free to go"."""
        self.run(0.3, 0.0)
        self.step(0.0, command=OperatorCommand.ENGAGE)
        for _ in range(150):
            self.step(0.0)
            if self.reasons == ("waiting_for_go",):
                break
        self.step(0.0, command=OperatorCommand.GO)
        assert self.state is ArmingState.ENGAGED, self.reasons
