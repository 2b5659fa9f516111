"""A drive-by-wire interface on a bench: with its simulated other end, and no car between actuators and sensors."""

from __future__ import annotations

import math
from typing import Any, Final

from vve_sumo.values import Frame
from vve_sumo.vehicle.calibration import Calibration
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
STEPS_PER_COMMAND, STEPS_PER_REPORT = 4, 2
STANDING: Final = Measured(
    0.0, 0.0, WheelSpeeds(0.0, 0.0, 0.0, 0.0), Accelerations(0.0, 0.0, 9.81), YawRate(0.0, 0.0), 0.0, 0.0
)
NEUTRAL: Final = ActuationCommand(0.0, 0.0, 0.0, 0.0, Gear.NONE, enable=False, clear=False, acceleration=0.0)
#: The same braking in both ways of saying it, and enabled.
HELD: Final = NEUTRAL._replace(brake_torque=1000.0, acceleration=-1.8, enable=True)
SUBSYSTEMS: Final = (BrakeState, ThrottleState, SteeringState)


class Bench:
    """An interface and its simulated other end; the actuators obey at once, by a car's `calibration`."""

    def __init__(self, config: InterfaceConfig, calibration: Calibration) -> None:
        self.interface = load(config)
        self.end = self.interface.simulated(STEP)
        self.measured = STANDING
        self.acceleration = math.nan  #: that the other end asks of the car [m/s2]; NaN where it asks for pedals
        self.newest: dict[type, Any] = {}  #: reports by their kind
        self.times: dict[type, list[float]] = {}  #: at which reports of a kind came [s]
        self.fault: tuple[str, float] | None = None  #: kind and value of the one that is due
        self.malformed: set[int] = set()  #: identifiers of the malformed reports since the fault began
        self._calibration = calibration
        self._steps = 0

    @property
    def now(self) -> float:
        """Return the time since the beginning [s]."""
        return self._steps * STEP

    def run(self, seconds: float, command: ActuationCommand | None, driver: DriverInputs = HANDS_OFF) -> None:
        """Send `command` every 20 ms, or nothing."""
        for _ in range(round(seconds / STEP)):
            if self._steps % STEPS_PER_COMMAND == 0:
                self.send(self.interface.encode(command) if command else ())
            self._advance(driver)

    def repeat(self, seconds: float, frames: tuple[Frame, ...]) -> None:
        """Send the same frames every 20 ms, as a program that has frozen behind its driver does."""
        for _ in range(round(seconds / STEP)):
            if self._steps % STEPS_PER_COMMAND == 0:
                self.send(frames)
            self._advance(HANDS_OFF)

    def send(self, frames: tuple[Frame, ...]) -> None:
        """Put frames on the bus."""
        self.end.receive(frames, self.measured.speed, self.measured.brake_torque)

    def inject(self, kind: str, value: float = math.nan) -> None:
        """Put a fault on from now on, in place of the one before."""
        self.fault, self.malformed = (kind, value), set()

    def restore(self) -> None:
        """Put no fault on any more."""
        self.fault = None

    def enabled(self) -> list[bool]:
        """Return what brake, throttle and steering report."""
        return [self.newest[kind].enabled for kind in SUBSYSTEMS]

    def _advance(self, driver: DriverInputs) -> None:
        measured = self.measured
        request = self.end.step(driver, measured.speed, measured.wheel_angle)
        angle = measured.wheel_angle if math.isnan(request.wheel_angle) else request.wheel_angle
        torque, self.acceleration = request.brake_torque, request.acceleration
        if not math.isnan(request.acceleration):
            force = self._calibration.force(request.acceleration, 0.0, measured.speed)
            torque = max(torque, self._calibration.brake_torque(-force))
        self.measured = measured._replace(wheel_angle=angle, brake_torque=torque)
        self._steps += 1
        if self._steps % STEPS_PER_REPORT == 0:
            for frame in self.end.reports(self.measured):
                self._hear(self.end.alter(self.now, frame, self._due))

    def _hear(self, frame: Frame) -> None:
        reports = self.interface.decode(frame)
        if isinstance(reports, Malformed):
            self.malformed.add(frame.id)
            return
        for report in reports:
            self._keep(report)

    def _keep(self, report: Report) -> None:
        self.newest[type(report)] = report
        self.times.setdefault(type(report), []).append(self.now)

    def _due(self, kind: str, _time: float) -> float | None:
        return self.fault[1] if self.fault is not None and self.fault[0] == kind else None
