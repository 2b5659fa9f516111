"""A drive-by-wire interface under test: on a bench with its simulated other end, and between gateway and vehicle."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from tests import vehicles
from tests.vehicle.whole_car import LOT
from vve_sumo.plant.car import Car
from vve_sumo.values import ArmingState, Frame, Setpoint
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import (
    HANDS_OFF,
    Accelerations,
    ActuationCommand,
    BrakeState,
    DriverInputs,
    Gear,
    InterfaceConfig,
    Malformed,
    Measured,
    Report,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    YawRate,
    load,
)

STEP: Final = 0.005  # of the simulated end [s]
PERIOD: Final = 0.02  # of the gateway [s]
STANDING: Final = Measured(
    0.0, 0.0, WheelSpeeds(0.0, 0.0, 0.0, 0.0), Accelerations(0.0, 0.0, 9.81), YawRate(0.0, 0.0), 0.0, 0.0
)
NEUTRAL: Final = ActuationCommand(0.0, 0.0, 0.0, 0.0, Gear.NONE, enable=False, clear=False, acceleration=0.0)
#: The same braking in both ways of saying it, and enabled.
HELD: Final = NEUTRAL._replace(brake_torque=1000.0, acceleration=-1.8, enable=True)
#: How the bench's car turns an acceleration into pedals.
CALIBRATION: Final = vehicles.FUSION.calibration
SUBSYSTEMS: Final = (BrakeState, ThrottleState, SteeringState)


class Bench:
    """An interface and its simulated other end, with no car between actuators and sensors."""

    def __init__(self, config: InterfaceConfig) -> None:
        self.interface = load(config)
        self.end = self.interface.simulated(STEP)
        self.measured = STANDING
        self.acceleration = math.nan  #: that the other end asks of the car [m/s2]; NaN where it asks for pedals
        self.newest: dict[type, Report] = {}
        self.times: dict[type, list[float]] = {}
        self.fault: tuple[str, float] | None = None  #: kind and value of the one that is due
        self.malformed: set[int] = set()  #: identifiers of the malformed reports since the fault began
        self._steps = 0

    @property
    def now(self) -> float:
        return self._steps * STEP

    def run(self, seconds: float, command: ActuationCommand | None, driver: DriverInputs = HANDS_OFF) -> None:
        """Send `command` every 20 ms, or nothing; the actuators obey at once."""
        for _ in range(round(seconds / STEP)):
            if self._steps % 4 == 0:
                self.end.receive(
                    self.interface.encode(command) if command else (), self.measured.speed, self.measured.brake_torque
                )
            request = self.end.step(driver, self.measured.speed, self.measured.wheel_angle)
            angle = self.measured.wheel_angle if math.isnan(request.wheel_angle) else request.wheel_angle
            torque, self.acceleration = request.brake_torque, request.acceleration
            if not math.isnan(request.acceleration):
                force = CALIBRATION.force(request.acceleration, 0.0, self.measured.speed)
                torque = max(torque, CALIBRATION.brake_torque(-force))
            self.measured = self.measured._replace(wheel_angle=angle, brake_torque=torque)
            self._steps += 1
            if self._steps % 2 == 0:
                self._hear(self.end.reports(self.measured))

    def _hear(self, frames: list[Frame]) -> None:
        for frame in frames:
            reports = self.interface.decode(self.end.alter(self.now, frame, self._due))
            if isinstance(reports, Malformed):
                assert self.fault is not None, reports
                self.malformed.add(frame.id)
                continue
            for report in reports:
                self.newest[type(report)] = report
                self.times.setdefault(type(report), []).append(self.now)

    def _due(self, kind: str, _time: float) -> float | None:
        return self.fault[1] if self.fault is not None and self.fault[0] == kind else None

    def inject(self, kind: str, value: float = math.nan) -> None:
        """Put a fault on from now on, in place of the one before."""
        self.fault, self.malformed = (kind, value), set()

    def restore(self) -> None:
        """Put no fault on any more."""
        self.fault = None

    def enabled(self) -> list[bool]:
        return [self.newest[kind].enabled for kind in SUBSYSTEMS]  # type: ignore[union-attr]

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
