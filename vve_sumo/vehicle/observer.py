"""Observer, in the gateway's place where an external brain commands the car: it monitors all and commands nothing.

It has no encoder: not one frame can come out of it. Its arming states are those of the gateway and say when the brain's
sensors may be valid, not when the car is commanded: from the operator's go until a stop, a fault or the driver's
override. The module has no map, bus or clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from vve_sumo.values import ArmingState, Frame, GatewayStatus, Setpoint, Vehicle
from vve_sumo.vehicle.arming import COMMANDING, Event, transition
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.gateway import DRIVER_TIME, UNCHANGED_TIME, GatewayOutput, OperatorCommand
from vve_sumo.vehicle.interface import VehicleInterface
from vve_sumo.vehicle.plausibility import CarMotion, Plausibility
from vve_sumo.vehicle.reports import CarReports
from vve_sumo.vehicle.setpoint_validation import Debounce, SetpointValidator
from vve_sumo.vehicle.standstill import Evidence, Standstill

#: A drive is over once the car has stood this long after a stop [s]: nothing from here holds it, or shifts to park.
STANDING_TIME: Final = 1.0
#: The note of every step: who commands the car.
EXTERNAL: Final = "external_brain"
#: The drive's reason code for a pose without a recent trusted fix; the motion in such a setpoint is only a guess.
_GUESSED: Final = "pose_stale"


class Observer:
    """Follows a drive that an external brain commands, with the inputs and the outputs of a `Gateway`, without frames.

    `wheel_bias` is the steering-wheel angle at which the wheels point straight [rad], left positive, as calibrated.
    """

    def __init__(
        self, vehicle: Vehicle, calibration: Calibration, interface: VehicleInterface, wheel_bias: float = 0.0
    ) -> None:
        self._ratio, self._wheel_bias = vehicle.steering_ratio, wheel_bias
        self._commands = interface.facts.commands
        self._reports = CarReports(vehicle.wheel_radius, interface)
        self._admission = SetpointValidator()
        self._plausibility = Plausibility(vehicle, calibration)
        self._standstill = Standstill()
        self._standing_long, self._still_long = Debounce(STANDING_TIME), Debounce(DRIVER_TIME)
        self._state = ArmingState.DISARMED
        self._causes: dict[str, None] = {}  # reason codes of why the drive was ended: each once, first cause first
        self._notes: list[str] = []
        self._last_now = math.nan
        self._has_been_engaged = self._going = self._still = False
        self._old_overrides: frozenset[str] = frozenset()

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
            self._obey(act)
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

    @property
    def measured_steering(self) -> float:
        """Last valid road-wheel angle that the car reported [rad], left positive; NaN before the first."""
        return (self._reports.wheel_angle - self._wheel_bias) / self._ratio

    @property
    def wheel_speed(self) -> float:
        """Speed of the rear axle by the last wheel speeds [m/s], forward positive; NaN without valid ones."""
        return self._reports.speed

    @property
    def gear(self) -> str:
        """Gear that the car last reported, in lower case; "none" before the first report."""
        return self._reports.gear.gear.name.lower()

    @property
    def sequence(self) -> int:
        """Sequence number of the drive's newest accepted setpoint, which carries its faults; -1 for none."""
        return -1 if self._admission.setpoint is None else self._admission.setpoint.sequence

    @property
    def last_dbw_report(self) -> float:
        """Drive time at which a report of the DBW controller was last decoded [s]; -inf before the first."""
        return self._reports.last_dbw_report

    @property
    def done(self) -> bool:
        """Whether a drive is over: it was begun and ended, and the car stands, or nothing has moved for long."""
        if not self._has_been_engaged or self._state in COMMANDING:
            return False
        return (self._standstill.certain and self._standstill.at_rest) or self._still

    def _watch(self, now: float, setpoint: Setpoint | None, frames: Sequence[Frame]) -> list[str]:
        reports = self._reports
        faults = reports.take(now, [frame for frame in frames if frame.id not in self._commands])
        elapsed = max(now - self._last_now, 0.0) if math.isfinite(self._last_now) else 0.0
        self._last_now = now
        faults += reports.stale(now)
        faults += reports.faults()
        taken = self._admission.setpoint
        if setpoint is not None and (rejection := self._admission.take(now, setpoint)) is not None:
            if rejection.fatal:
                faults.append(rejection.reason)
            else:
                self._notes.append(rejection.reason)
            faults += setpoint.faults
        faults += self._admission.faults(now)
        return faults + self._compare(now, elapsed, self._admission.setpoint is not taken)

    def _compare(self, now: float, elapsed: float, fresh: bool) -> list[str]:
        """Compare receiver and car reports on the same motion; reason codes of what disagrees."""
        reports, standstill = self._reports, self._standstill
        known = reports.speed_known(now)
        setpoint = self._admission.setpoint if self._admission.valid(now) else None
        if setpoint is not None and _GUESSED in setpoint.faults:
            setpoint = None
        believed = known and not reports.unchanged(now) > UNCHANGED_TIME
        evidence = Evidence(
            reports.fastest_wheel if believed else None, None if setpoint is None else abs(setpoint.speed)
        )
        standstill.step(now, elapsed, evidence, None)
        self._still = self._still_long.step(now, not standstill.moves)
        speed = reports.speed if known else math.nan
        car = CarMotion(
            speed, reports.yaw_rate, self.measured_steering, reports.wheels, math.nan, standstill.certain
        )  # fmt: skip
        return self._plausibility.step(now, elapsed, car, setpoint, fresh)

    def _judge_idle(self, now: float, faults: list[str]) -> None:
        if self._state is ArmingState.FAULT:
            return
        missing = list(faults)
        if not self._admission.valid(now):
            missing.append("no_setpoint")
        if not self._standstill.certain:
            missing.append("not_standing")
        self._happen(Event.CONDITIONS_LOST if missing else Event.CONDITIONS_MET, [])
        self._notes += missing

    def _judge_drive(self, now: float, faults: list[str]) -> None:
        # An override that was latched before the drive counts once the brain has cleared it.
        overrides = self._reports.overrides()
        self._old_overrides &= overrides
        if overrides - self._old_overrides:
            self._happen(Event.OVERRIDE, ["driver_override", *faults])
            return
        if faults:
            self._happen(Event.FAULT, faults)
        if self._state is ArmingState.ENGAGED and not self._admission.valid(now):
            self._happen(Event.EXPIRED, ["setpoint_expired"])
        if self._standstill.at_rest:
            self._happen(Event.AT_REST, [])
        if self._standing_long.step(now, self._state is ArmingState.STOPPED and self._standstill.at_rest):
            self._happen(Event.PARKED, [])

    def _obey(self, act: OperatorCommand) -> None:
        match act:
            case OperatorCommand.ENGAGE:
                self._happen(Event.ENGAGE, [])
            case OperatorCommand.GO if self._state is ArmingState.ENGAGED:
                self._going = True
            case OperatorCommand.GO:
                self._notes.append("go_too_early")
            case OperatorCommand.STOP:
                self._happen(Event.STOP, ["stop_asked"])
            case OperatorCommand.END:
                self._happen(Event.STOP, ["drive_over"])
            case OperatorCommand.DISARM:
                self._happen(Event.DISARM, ["disarm_asked"])

    def _happen(self, event: Event, causes: list[str]) -> None:
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
        elif event is Event.DISARM:
            self._causes.clear()
