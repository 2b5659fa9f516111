"""Gateway and simulated vehicle on one interface, each with an instance of its own, run together tick by tick."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vve_sumo.frames import MapFrame, local_frame
from vve_sumo.plant.car import Car
from vve_sumo.rig import car_parameters
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState, Frame, Setpoint
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import HANDS_OFF, ActuationCommand, DriverInputs, Gear, load
from vve_sumo.vehicle.model import VehicleModel

EPOCH: Final = 1_447_000_000.0  # GNSS second of drive time 0: any does
ENGAGING: Final = 150  # ticks in which the car has to wait for the operator's go
SWERVE, SWERVE_RATE = 0.08, 1.5  # of the road wheels [rad], [rad/s]


class Drive:
    """A car that starts in park at the origin of its own map, and an operator who does what is called."""

    def __init__(self, model: VehicleModel) -> None:
        parameters = car_parameters.parameters(model, noise=0.0)
        lot: MapFrame = local_frame(math.radians(40.0), math.radians(-83.0))
        self._car = Car(parameters, (0.0, 0.0, 0.0), lot, EPOCH, np.random.SeedSequence(1))
        self._model = model
        self.gateway = Gateway(
            model.vehicle, calibration=model.calibration, limits=model.limits, interface=load(model.interface)
        )
        self.state = ArmingState.DISARMED
        self.reasons: tuple[str, ...] = ()
        self.withheld: frozenset[int] = frozenset()  #: identifiers of reports that do not arrive
        self._fault: tuple[str, float] | None = None
        self._heard: list[Frame] = []
        self._tick = -1

    @property
    def speed(self) -> float:
        """Return the true speed [m/s]."""
        return self._car.truth().speed

    @property
    def gear(self) -> Gear:
        """Return the gear that is engaged."""
        return self._car.interface.gear

    @property
    def enabled(self) -> tuple[bool, bool, bool]:
        """Return whether brake, throttle and steering act on commands."""
        return self._car.interface.enabled

    def run(
        self, seconds: float, acceleration: float, steering: float = 0.0, driver: DriverInputs = HANDS_OFF
    ) -> None:  # fmt: skip
        """Run ticks for `seconds`."""
        for _ in range(round(seconds / PERIOD)):
            self._step(acceleration, steering, driver=driver)

    def swerve(self, seconds: float) -> None:
        """Run ticks in which everything that is commanded changes: steering to and fro, driving and braking."""
        for number in range(round(seconds / PERIOD)):
            phase = SWERVE_RATE * number * PERIOD
            self._step(1.5 * math.cos(2.0 * phase), SWERVE * math.sin(phase))

    def engage(self) -> None:
        """Bring the car to "engaged, in drive, free to go", as far as it goes."""
        self.run(0.3, 0.0)
        self._step(0.0, command=OperatorCommand.ENGAGE)
        for _ in range(ENGAGING):
            self._step(0.0)
            if self.reasons == ("waiting_for_go",):
                break
        self._step(0.0, command=OperatorCommand.GO)

    def end(self) -> None:
        """Say that the drive is over."""
        self._step(0.0, command=OperatorCommand.END)

    def inject(self, kind: str, value: float) -> None:
        """Put a fault of the interface's own on, from now on."""
        self._fault = kind, value

    def intrude(self) -> None:
        """Let another node send a step's commands."""
        neutral = ActuationCommand(0.0, 0.0, 0.0, 0.0, Gear.NONE, enable=False, clear=False)
        self._heard += load(self._model.interface).encode(neutral)
        self._step(0.0)

    def _step(
        self,
        acceleration: float,
        steering: float = 0.0,
        command: OperatorCommand | None = None,
        driver: DriverInputs = HANDS_OFF,
    ) -> None:
        self._tick += 1
        now, truth = self._tick * PERIOD, self._car.truth()
        setpoint = Setpoint(
            steering=steering, acceleration=acceleration, emergency=False, note="", sequence=self._tick, time=now,
            expires=now + 0.1, x=truth.x, y=truth.y, heading=truth.heading, speed=truth.speed, yaw_rate=truth.yaw_rate,
            grade=0.0, faults=(), fallback_path=None,
        )  # fmt: skip
        output = self.gateway.step(now, setpoint, self._heard, command)
        self.state, self.reasons = output.status.state, output.status.reasons
        sent = self._car.step((self._tick + 1) * PERIOD, output.frames, driver).reports
        alter = self._car.interface.alter
        self._heard = [alter(time, frame, self._due) for time, frame in sent if frame.id not in self.withheld]

    def _due(self, kind: str, _time: float) -> float | None:
        return self._fault[1] if self._fault is not None and self._fault[0] == kind else None
