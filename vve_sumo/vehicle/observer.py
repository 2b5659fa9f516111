"""Observer, in the gateway's place where an external brain commands the car: it monitors all and commands nothing.

It has no encoder: not one frame can come out of it. Its arming states are those of the gateway and say when the brain's
sensors may be valid, not when the car is commanded: from the operator's go until a stop, a fault or the driver's
override, or his foot on a pedal of a car under way. The module has no map, bus or clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from vve_sumo.values import ArmingState, Frame, GatewayStatus, Setpoint, Vehicle
from vve_sumo.vehicle.arming import COMMANDING, ArmingEvent, transition
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.gateway import GatewayOutput, OperatorCommand
from vve_sumo.vehicle.interface import VehicleInterface
from vve_sumo.vehicle.monitor import Monitor
from vve_sumo.vehicle.setpoint_validation import Debounce

#: A drive is over once the car has stood this long after a stop [s]: nothing from here holds it, or shifts to park.
STANDING_TIME: Final = 1.0
#: The note of every step: who commands the car.
EXTERNAL: Final = "external_brain"


class Observer(Monitor):
    """Follows a drive that an external brain commands, with the inputs and the outputs of a `Gateway`, without frames.

    `wheel_bias` is the steering-wheel angle at which the wheels point straight [rad], left positive, as calibrated.
    """

    def __init__(
        self, vehicle: Vehicle, calibration: Calibration, interface: VehicleInterface, wheel_bias: float = 0.0
    ) -> None:
        super().__init__(vehicle, calibration, interface, wheel_bias)
        self._commands = interface.facts.commands
        self._standing_long = Debounce(STANDING_TIME)
        self._going = False

    def step(
        self,
        now: float,
        setpoint: Setpoint | None,
        reports: Sequence[Frame],
        act: OperatorCommand | None = None,
        found: Sequence[str] = (),
    ) -> GatewayOutput:
        """Return the status at drive time `now` [s], and no frame; the inputs are those of `Gateway.step`."""
        self._notes = [EXTERNAL]
        faults = [*self._watch(now, setpoint, reports), *found]
        before = self._state
        if before in COMMANDING:
            self._judge_drive(now, faults)
        else:
            self._judge_idle(now, faults)
        if act is not None and (self._state is before or self._state is not ArmingState.FAULT):
            self._apply_command(act)
        if self._state is ArmingState.ENGAGED and not self._going:
            self._notes.append("waiting_for_go")
        angle = self.measured_steering
        status = GatewayStatus(
            state=self._state,
            reasons=tuple(dict.fromkeys([*self._causes, *self._notes])),
            steering=angle if math.isfinite(angle) else 0.0,
            acceleration=0.0,
            limited=(),
            brake_torque=0.0,
            throttle=0.0,
        )
        return GatewayOutput(status, ())

    def _watch(self, now: float, setpoint: Setpoint | None, frames: Sequence[Frame]) -> list[str]:
        faults = self._reports.take(now, [frame for frame in frames if frame.id not in self._commands])
        elapsed = max(now - self._last_now, 0.0) if math.isfinite(self._last_now) else 0.0
        self._last_now = now
        taken = self._validator.setpoint
        faults += self._look(now, setpoint)
        fresh = self._validator.setpoint is not taken
        faults += self._compare(now, elapsed, fresh, braking=None, steering=math.nan)
        self._let_go = self._let_go_long.step(now, not self._standstill.moves)
        return faults

    def _judge_idle(self, now: float, faults: list[str]) -> None:
        if self._state is ArmingState.FAULT:
            return
        missing = list(faults)
        if not self._validator.valid(now):
            missing.append("no_setpoint")
        if not self._standstill.certain:
            missing.append("not_standing")
        self._apply_event(ArmingEvent.CONDITIONS_LOST if missing else ArmingEvent.CONDITIONS_MET, [])
        self._notes += missing

    def _judge_drive(self, now: float, faults: list[str]) -> None:
        # An override that was latched before the drive counts once the brain has cleared it.
        overrides = self._reports.overrides()
        self._old_overrides &= overrides
        if overrides - self._old_overrides:
            self._apply_event(ArmingEvent.OVERRIDE, ["driver_override", *faults])
            return
        under_way = self._state is ArmingState.STOPPING or (self._state is ArmingState.ENGAGED and self._going)
        if under_way and (signs := self._reports.driver()):
            self._apply_event(ArmingEvent.DRIVER, signs)
        if faults:
            self._apply_event(ArmingEvent.FAULT, faults)
        if self._state is ArmingState.ENGAGED and not self._validator.valid(now):
            self._apply_event(ArmingEvent.EXPIRED, ["setpoint_expired"])
        if self._standstill.at_rest:
            self._apply_event(ArmingEvent.AT_REST, [])
        if self._standing_long.step(now, self._state is ArmingState.STOPPED and self._standstill.at_rest):
            self._apply_event(ArmingEvent.PARKED, [])

    def _apply_command(self, act: OperatorCommand) -> None:
        match act:
            case OperatorCommand.ENGAGE:
                self._apply_event(ArmingEvent.ENGAGE, [])
            case OperatorCommand.GO if self._state is ArmingState.ENGAGED and not self._reports.driver():
                self._going = True
            case OperatorCommand.GO:
                self._notes += ["go_too_early", *self._reports.driver()]
            case OperatorCommand.STOP:
                self._apply_event(ArmingEvent.STOP, ["stop_asked"])
            case OperatorCommand.STOP_BY_PAGE:
                self._apply_event(ArmingEvent.STOP, ["stop_asked_by_page"])
            case OperatorCommand.END:
                self._apply_event(ArmingEvent.STOP, ["drive_over"])
            case OperatorCommand.DISARM:
                self._apply_event(ArmingEvent.DISARM, ["disarm_asked"])

    def _apply_event(self, event: ArmingEvent, causes: list[str]) -> None:
        """Apply `event` to the arming state, and keep the causes of what ends the drive."""
        before, after = self._state, transition(self._state, event)
        self._state = after
        if before in COMMANDING:
            self._causes.update(dict.fromkeys(causes))
        if after is before:
            return
        if after is ArmingState.ENGAGED:
            self._causes.clear()
            self._has_been_engaged, self._going = True, False
            self._old_overrides = self._reports.overrides()
            self._standing_long.reset()
        elif event is ArmingEvent.DISARM and after is ArmingState.DISARMED:
            self._causes.clear()
