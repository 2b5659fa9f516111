"""The last party before the car: watches the car, the setpoints and itself, and speaks the frames.

It knows setpoints, reports and time as they are handed in; no map, no controller, no bus, no clock. Whatever it finds
wrong is a reason code, never an exception, and leads to rest, unless the driver has taken over.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from vve_sumo.values import ArmingState, Frame, Setpoint, Vehicle, Verdict
from vve_sumo.vehicle import dbw
from vve_sumo.vehicle.actuation import REST, Actuation, Pedals
from vve_sumo.vehicle.admission import Admission, Persistence
from vve_sumo.vehicle.arming import COMMANDING, CRITICAL, Event, transition
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.dbw import Gear
from vve_sumo.vehicle.limits import Limiter, Limits, approach
from vve_sumo.vehicle.reports import TOLERANCE, CarReports

HANDSHAKE_TIME: Final = 0.400  # from the act to all modules enabled [s], as Apollo's lincoln_controller waits
SHIFT_TIME: Final = 3.0  # from asking for drive to drive confirmed [s]; a rotary shifter takes about one
REST_TIME: Final = 0.3  # standing this long is rest [s]
# Command and measurement differ by the rate times delay and lag while the steering moves; more than this beyond it, for
# as long as this, is a steering that does not do as told.
STEERING_DIFFERENCE: Final = 0.10  # road-wheel angle [rad]
STEERING_DIFFERENCE_TIME: Final = 0.5  # [s]

#: Faults that latch even while nothing is commanded: they tell of the gateway itself or of a second master.
_LATCHING = frozenset({"another_writer", "timer_gap"})


class Act(enum.StrEnum):
    """What an operator does, by a deliberate act."""

    ENGAGE = "engage"
    STOP = "stop"
    DISARM = "disarm"


class GatewayOutput(NamedTuple):
    """What one step of the gateway gives."""

    verdict: Verdict  #: what was made of the setpoint
    frames: tuple[Frame, ...]  #: to be sent now, in this order: brake, throttle, steering, gear


class _Command(NamedTuple):
    """What the frames of one step shall say."""

    pedals: Pedals
    acceleration: float  #: granted [m/s2]
    steering: float  #: road-wheel angle [rad]
    limited: tuple[str, ...] = ()


class Gateway:
    """Turns setpoints into command frames, once a `period` [s], as long as all is well; otherwise stops the car.

    The counter in the frames counts once a step, so the kit's own watchdog brakes when nobody steps the gateway.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        limits: Limits | None = None,
        calibration: Calibration | None = None,
        period: float = 0.02,
        variant: dbw.Variant = dbw.Variant.DBW1_2024,
    ) -> None:
        self._limits = limits or Limits()
        calibration = calibration or Calibration()
        self._period = period
        self._variant = variant
        self._ratio = vehicle.steering_ratio
        steering_limit = min(vehicle.steering_limit, dbw.WHEEL_ANGLE_LIMIT[variant] / vehicle.steering_ratio)
        self._steering_limit = steering_limit
        self._wheel_rate = min(vehicle.steering_rate_limit * vehicle.steering_ratio, dbw.WHEEL_RATE_LIMIT[variant])
        self._torque_limit = min(
            vehicle.brake_torque_limit, calibration.brake_torque_limit, dbw.TORQUE_LIMIT[variant]
        )  # fmt: skip
        self._steering_tolerance = STEERING_DIFFERENCE + vehicle.steering_rate_limit * (
            vehicle.steering_delay + vehicle.steering_lag
        )
        self._reports = CarReports(vehicle.wheel_radius, variant)
        self._admission = Admission()
        self._limiter = Limiter(vehicle, self._limits, steering_limit, period)
        self._actuation = Actuation(calibration, vehicle.brake_delay, vehicle.brake_lag, period)
        self._stands = Persistence(REST_TIME)
        self._steering_differs = Persistence(STEERING_DIFFERENCE_TIME)

        self._state = ArmingState.DISARMED
        self._causes: list[str] = []  # why the car is being stopped or commanded no more, first cause first
        self._notes: list[str] = []  # what an operator should know of this step only
        self._last_now = math.nan
        self._counter = -1
        self._engaged_at = math.nan
        self._enabled = False  # the kit has confirmed
        self._in_drive = False  # and the gear
        self._shifting_since = math.nan
        self._old_overrides: frozenset[str] = frozenset()
        self._clear = False
        self._stop_deceleration = 0.0
        self._stop_jerk = 0.0
        self._followed: Setpoint | None = None  # the last setpoint that the car was given

    def step(
        self, now: float, setpoint: Setpoint | None, reports: Sequence[Frame], act: Act | None = None
    ) -> GatewayOutput:
        """Verdict and frames at drive time `now` [s].

        `setpoint` is the newest one, or None where none came since the last step; `reports` are the frames heard on
        the car's bus since the last step, in order; `act` is what the operator did since then.
        """
        self._notes.clear()
        self._clear = False
        faults = self._watch(now, setpoint, reports)
        if self._state in COMMANDING:
            self._judge_commanded(now, faults)
        else:
            self._judge_idle(now, faults)
        if act is not None:
            self._obey(now, act)
        return self._speak(now)

    @property
    def measured_steering(self) -> float:
        """Road-wheel angle that the car last reported [rad], left positive; NaN before the first report."""
        return self._reports.wheel_angle / self._ratio

    # What is going on: everything here only looks.

    def _watch(self, now: float, setpoint: Setpoint | None, reports: Sequence[Frame]) -> list[str]:
        """Reason codes of what is wrong whatever the state is."""
        faults = self._reports.take(now, reports)
        gap = now - self._last_now
        # Also when time stands still or runs backwards; the very first step has no gap, and NaN passes no comparison.
        if gap <= 0.0 or gap > 2.0 * self._period + TOLERANCE or not math.isfinite(now):
            faults.append("timer_gap")
        self._last_now = now
        faults += self._reports.stale(now)
        faults += self._reports.faults()
        if setpoint is not None:
            refusal = self._admission.take(now, setpoint)
            if refusal is not None:
                (faults if refusal.fatal else self._notes).append(refusal.reason)
                # Refused as a command; what it says is wrong counts all the same.
                faults += setpoint.faults
        faults += self._admission.faults(now, self._reports.speed, self._reports.yaw_rate)
        return faults

    def _missing(self, now: float) -> list[str]:
        """Reason codes of what is missing for engaging, beside faults."""
        reports = self._reports
        missing = []
        if not self._admission.valid(now):
            missing.append("no_setpoint")
        if not reports.fastest_wheel < REST:
            missing.append("not_standing")
        if reports.gear.gear not in (Gear.PARK, Gear.DRIVE):
            missing.append("gear_not_park_or_drive")
        if reports.any_enabled():
            missing.append("kit_already_enabled")
        if reports.throttle.driver:
            missing.append("driver_on_throttle")
        return missing

    def _progress(self, now: float) -> list[str]:
        """Follow the kit's confirmation, the gear and the steering; reason codes of what does not come about."""
        reports = self._reports
        if self._state is not ArmingState.ENGAGED:
            return reports.dropped_out() if self._enabled else []
        if not self._enabled:
            self._enabled = reports.all_enabled()
            if not self._enabled:
                return ["handshake_timeout"] if now - self._engaged_at > HANDSHAKE_TIME + TOLERANCE else []
            self._shifting_since = now
        troubles = reports.dropped_out()
        in_drive = reports.gear.gear is Gear.DRIVE
        if self._in_drive and not in_drive:
            troubles.append("gear_lost")
        elif not in_drive and now - self._shifting_since > SHIFT_TIME + TOLERANCE:
            troubles.append("gear_not_confirmed")
        self._in_drive = self._in_drive or in_drive
        difference = abs(self._limiter.steering - reports.steering.wheel_angle / self._ratio)
        if self._steering_differs.step(now, not difference <= self._steering_tolerance):
            troubles.append("steering_not_following")
        return troubles

    # What follows from it.

    def _judge_idle(self, now: float, faults: list[str]) -> None:
        latching = [code for code in faults if code in _LATCHING]
        if latching:
            self._happen(now, Event.FAULT, latching)
        if self._state is ArmingState.FAULT:
            return
        missing = faults + self._missing(now)
        self._happen(now, Event.CONDITIONS_LOST if missing else Event.CONDITIONS_MET, [])
        self._notes += missing

    def _judge_commanded(self, now: float, faults: list[str]) -> None:
        overrides = self._reports.overrides()
        # An override that was latched before engaging counts for nothing until the CLEAR of the act has reached it.
        self._old_overrides &= overrides
        if overrides - self._old_overrides:
            self._happen(now, Event.OVERRIDE, ["driver_override", *faults])
            return
        faults += self._progress(now)
        if faults:
            self._happen(now, Event.FAULT, faults)
        if self._state is ArmingState.ENGAGED and not self._admission.valid(now):
            self._happen(now, Event.EXPIRED, ["setpoint_expired"])
        stands = self._reports.speed_known(now) and self._reports.fastest_wheel < REST
        if self._stands.step(now, stands) and self._state is ArmingState.STOPPING:
            self._happen(now, Event.AT_REST, [])

    def _obey(self, now: float, act: Act) -> None:
        match act:
            case Act.ENGAGE:
                self._happen(now, Event.ENGAGE, [])
            case Act.STOP:
                self._happen(now, Event.STOP, ["stop_asked"])
            case Act.DISARM if self._state is ArmingState.STOPPED and self._reports.gear.gear is not Gear.PARK:
                # Without brakes a car in drive creeps away, and the kit's watchdog brakes when EN drops in gear.
                self._notes.append("not_in_park")
            case Act.DISARM:
                self._happen(now, Event.DISARM, ["disarm_asked"])

    def _happen(self, now: float, event: Event, causes: list[str]) -> None:
        """Go where the table says, and keep the causes of whatever ends the drive."""
        before, after = self._state, transition(self._state, event)
        self._state = after
        if before in COMMANDING or after is ArmingState.FAULT:
            self._causes += [code for code in dict.fromkeys(causes) if code not in self._causes]
        if after is before:
            return
        if after is ArmingState.ENGAGED:
            self._engage(now)
        elif after is ArmingState.STOPPING:
            self._begin_stop()
        elif after is ArmingState.DISARMED:
            self._causes.clear()
            if event is Event.DISARM:
                # Whoever engages next may be another controller, which counts from zero again.
                self._admission = Admission()

    def _engage(self, now: float) -> None:
        self._causes.clear()
        self._engaged_at = now
        self._enabled = self._in_drive = False
        self._followed = None
        self._clear = True
        self._old_overrides = self._reports.overrides()
        self._limiter.reset(0.0, self._measured_steering())
        self._actuation.reset()
        self._stands.reset()
        self._steering_differs.reset()

    def _begin_stop(self) -> None:
        # The throttle goes at once; brakes that are on already are never released by stopping. The angle that the
        # wheels have is the best guess of where the road goes, better than zero and better than a wish not reached.
        limits = self._limits
        self._stop_deceleration = max(-self._limiter.acceleration, limits.stop_deceleration)
        self._stop_jerk = limits.stop_jerk
        # An emergency that was asked for is not called off by the fault that comes on top of it.
        self._heed(self._followed)
        self._limiter.reset(min(self._limiter.acceleration, 0.0), self._measured_steering())

    def _heed(self, setpoint: Setpoint | None) -> None:
        """Stop at least as hard as an emergency asks; never softer than before."""
        if setpoint is not None and setpoint.emergency:
            emergency = self._limits.emergency
            asked = min(-setpoint.acceleration, emergency.deceleration)
            self._stop_deceleration = max(self._stop_deceleration, asked)
            self._stop_jerk = max(self._stop_jerk, emergency.jerk)

    def _measured_steering(self) -> float:
        angle = self._reports.wheel_angle / self._ratio
        if angle != angle:
            return 0.0
        return min(max(angle, -self._steering_limit), self._steering_limit)

    # What the car is told.

    def _speak(self, now: float) -> GatewayOutput:
        command = self._command(now)
        enable = self._state in COMMANDING
        self._counter = (self._counter + 1) & 0xFF
        torque = min(command.pedals.brake_torque, self._torque_limit)
        wheel_limit = dbw.WHEEL_ANGLE_LIMIT[self._variant]
        wheel_angle = min(max(command.steering * self._ratio, -wheel_limit), wheel_limit)
        variant, counter, clear = self._variant, self._counter, self._clear
        frames = (
            dbw.encode(dbw.BrakeCommand(dbw.BrakeKind.TORQUE, torque, enable, counter, clear), variant),
            dbw.encode(
                dbw.ThrottleCommand(dbw.ThrottleKind.PERCENT, command.pedals.throttle, enable, counter, clear), variant
            ),
            dbw.encode(dbw.SteeringCommand(wheel_angle, self._wheel_rate, enable, counter, clear), variant),
            dbw.encode(dbw.GearCommand(self._gear_wish(), clear), variant),
        )
        verdict = Verdict(
            state=self._state,
            reasons=tuple(dict.fromkeys(self._causes + self._notes)),
            steering=command.steering,
            acceleration=command.acceleration,
            limited=command.limited,
            brake_torque=torque,
            throttle=command.pedals.throttle,
        )
        return GatewayOutput(verdict, frames)

    def _command(self, now: float) -> _Command:
        setpoint = self._admission.setpoint
        match self._state:
            case ArmingState.ENGAGED if self._enabled and self._in_drive and setpoint is not None:
                return self._follow(setpoint)
            case ArmingState.ENGAGED:
                self._notes.append("shifting" if self._enabled else "engaging")
                return self._wait()
            case ArmingState.STOPPING | ArmingState.STOPPED:
                return self._stop(now)
            case _:
                return _Command(Pedals(0.0, 0.0), 0.0, self._measured_steering())

    def _follow(self, setpoint: Setpoint) -> _Command:
        self._followed = setpoint
        speed = self._reports.speed
        granted = self._limiter.step(setpoint.acceleration, setpoint.steering, speed, setpoint.emergency)
        pedals = self._actuation.step(granted.acceleration, speed, setpoint.grade)
        return _Command(pedals, granted.acceleration, granted.steering, granted.limited)

    def _wait(self) -> _Command:
        """Stand on the brakes until the kit and the gear are there."""
        pedals = self._actuation.step(0.0, self._reports.speed, self._grade())
        return _Command(pedals, 0.0, self._limiter.steering)

    def _stop(self, now: float) -> _Command:
        limits, limiter = self._limits, self._limiter
        if self._admission.valid(now):
            self._heed(self._admission.setpoint)
        critical = not CRITICAL.isdisjoint(self._causes)
        jerk = max(self._stop_jerk, limits.critical_jerk if critical else 0.0)
        wish = max(self._stop_deceleration, limits.critical_deceleration if critical else 0.0)
        limiter.acceleration = approach(limiter.acceleration, -wish, jerk, jerk, self._period)
        if self._reports.speed_known(now):
            pedals = self._actuation.step(
                limiter.acceleration, self._reports.speed, self._grade(), brakes_only=True
            )  # fmt: skip
        else:
            pedals = self._actuation.without_speed(-limiter.acceleration)
        return _Command(pedals, limiter.acceleration, limiter.steering)

    def _grade(self) -> float:
        return 0.0 if self._admission.setpoint is None else self._admission.setpoint.grade

    def _gear_wish(self) -> Gear:
        if self._state is ArmingState.STOPPED:
            return Gear.PARK
        if self._state is ArmingState.ENGAGED and self._enabled and not self._in_drive:
            return Gear.DRIVE
        return Gear.NONE
