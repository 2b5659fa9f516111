"""Observer, in the gateway's place where an external controller commands the car: it monitors all and commands nothing.

It has no encoder: not one frame can come out of it. Its arming states are those of the gateway and say when its
sensors may be valid, not when the car is commanded: from the operator's go until a stop, a fault or the driver's
override, or his foot on a pedal of a car under way. The module has no map, bus or clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from vve_sumo.values import ArmingState, Frame, GatewayStatus, Setpoint, Vehicle
from vve_sumo.vehicle.arming import COMMANDING, WAITING, ArmingEvent
from vve_sumo.vehicle.arming_machine import ENDS, ArmingMachine, OperatorCommand
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.gateway import GatewayOutput
from vve_sumo.vehicle.interface import VehicleInterface
from vve_sumo.vehicle.monitor import Monitor

#: A drive is over once the car has stood this long after a stop [s]: nothing from here holds it, or shifts to park.
STANDING_TIME: Final = 1.0
#: The note of every step: who commands the car.
EXTERNAL: Final = "external_brain"


class Observer:
    """Follows a drive that an external controller commands; inputs and outputs of a `Gateway`, without frames.

    `wheel_bias` is the steering-wheel angle at which the wheels point straight [rad], left positive, as calibrated.
    """

    def __init__(
        self, vehicle: Vehicle, calibration: Calibration, interface: VehicleInterface, wheel_bias: float = 0.0
    ) -> None:
        self.monitor = Monitor(vehicle, calibration, interface, wheel_bias)
        self._arming = ArmingMachine(STANDING_TIME)
        self._commands = interface.facts.commands
        self._last_now = math.nan

    @property
    def interface_error(self) -> str:
        """What the interface's own code raised last, with the place; empty while it has raised nothing."""
        return self.monitor.reports.error

    @property
    def done(self) -> bool:
        """Whether a drive is over: it was begun and ended, and the car stands, or nothing has moved for long."""
        return self._arming.ended and self.monitor.supervision_over

    def step(
        self,
        now: float,
        setpoint: Setpoint | None,
        reports: Sequence[Frame],
        command: OperatorCommand | None = None,
        process_faults: Sequence[str] = (),
    ) -> GatewayOutput:
        """Return the status at drive time `now` [s], and no frame; the inputs are those of `Gateway.step`."""
        arming, monitor = self._arming, self.monitor
        faults = [*self._watch(now, setpoint, reports), *process_faults]
        arming.begin_step([EXTERNAL, *monitor.notes], monitor.reports.overrides())
        if arming.state in COMMANDING:
            self._judge_commanded(now, faults)
        elif arming.state is not ArmingState.FAULT:
            arming.judge_idle(faults + monitor.missing(now))
        if command is not None:
            self._apply_command(command)
        if arming.state is ArmingState.ENGAGED and not arming.going:
            arming.notes.append(WAITING)
        angle = monitor.measured_steering
        status = GatewayStatus(
            state=arming.state,
            reasons=arming.reasons,
            steering=angle if math.isfinite(angle) else 0.0,
            acceleration=0.0,
            limited=(),
            brake_torque=0.0,
            throttle=0.0,
        )
        return GatewayOutput(status, ())

    def _watch(self, now: float, setpoint: Setpoint | None, frames: Sequence[Frame]) -> list[str]:
        monitor = self.monitor
        faults = monitor.reports.take(now, [frame for frame in frames if frame.id not in self._commands])
        elapsed = max(now - self._last_now, 0.0) if math.isfinite(self._last_now) else 0.0
        self._last_now = now
        faults += monitor.check_inputs(now, setpoint)
        return faults + monitor.check_motion(now, elapsed, idle=True, braking=None, steering=math.nan)

    def _judge_commanded(self, now: float, faults: list[str]) -> None:
        arming, monitor = self._arming, self.monitor
        # The brain clears what was latched before the drive.
        if arming.new_overrides():
            arming.apply(ArmingEvent.OVERRIDE, ["driver_override", *faults])
            return
        arming.judge_pedals(monitor.reports.driver())
        at_rest = monitor.standstill.at_rest
        arming.judge(now, faults, expired=not monitor.validator.valid(now), at_rest=at_rest, parked=at_rest)

    def _apply_command(self, command: OperatorCommand) -> None:
        if self._arming.state is ArmingState.FAULT and command in ENDS:
            return  # the driver has ended the drive: nobody else's command is a cause of that
        driver = self.monitor.reports.driver()
        self._arming.apply_command(command, may_go=not driver, obstacles=driver)
