"""Computes what the car is commanded in one step: its pedals, its steering and its gear, as it follows, waits or stops.

A car follows a setpoint, waits for the operator's go under its brakes, or stops along the fallback path. The module
reads the arming state and the causes of a stop; it finds no fault, ends no drive and knows no frames.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.laws import clamp
from vve_sumo.timing import MAX_PARK_REPORT_AGE
from vve_sumo.values import ArmingState, Setpoint, Vehicle
from vve_sumo.vehicle.actuation import Actuation, Pedals
from vve_sumo.vehicle.arming import COMMANDING, CRITICAL
from vve_sumo.vehicle.arming_machine import ArmingMachine
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.engagement import Engagement
from vve_sumo.vehicle.fallback import FallbackTracker
from vve_sumo.vehicle.interface import Gear, InterfaceFacts, WheelSpeeds
from vve_sumo.vehicle.limits import Limiter, Limits, move_towards
from vve_sumo.vehicle.monitor import Monitor
from vve_sumo.vehicle.reports import TOLERANCE
from vve_sumo.vehicle.standstill import WHEEL_REST

# Wheel speeds that are less than the receiver's by more than this are not trusted to limit the steering [m/s].
MAX_WHEEL_SPEED_DEFICIT: Final = 0.5

# Found once, for every step: looking them up in their class costs a call.
_ENGAGED, _STOPPING, _STOPPED = ArmingState.ENGAGED, ArmingState.STOPPING, ArmingState.STOPPED
_NO_GEAR: Final = Gear.NONE

#: Faults after which the odometry may be wrong on where the car is, or the steering may not follow its commands.
_ASTRAY: Final = frozenset(
    {
        "reports_inconsistent",
        "speed_mismatch",
        "steering_disabled",
        "steering_fault",
        "steering_not_following",
        "steering_report_stale",
        "steering_timeout",
        "wheel_speeds_frozen",
        "yaw_rate_mismatch",
    }
)

#: Faults after which the wheel speeds are wrong, or it is not known whether wheels or receiver are right.
_SPEED_UNKNOWN: Final = frozenset({"reports_inconsistent", "speed_mismatch", "wheel_speeds_frozen"})


class MotionCommand(NamedTuple):
    """What the car is commanded in one step."""

    pedals: Pedals
    acceleration: float  #: [m/s2]
    steering: float  #: road-wheel angle [rad], left positive
    limited: tuple[str, ...]  #: names of the limits that changed the request


class MotionControl:
    """Commands pedals and steering within the limits, step by step."""

    def __init__(
        self,
        vehicle: Vehicle,
        calibration: Calibration,
        limits: Limits,
        wire: InterfaceFacts,
        monitor: Monitor,
        arming: ArmingMachine,
        engagement: Engagement,
    ) -> None:
        self._monitor, self._arming, self._engagement = monitor, arming, engagement
        self._reports, self._standstill = monitor.reports, monitor.standstill
        self._limits = limits
        self._steering_limit = min(vehicle.steering_limit, wire.wheel_angle_limit / vehicle.steering_ratio)
        #: largest brake torque that is commanded, all wheels together [N m]
        self.torque_limit = min(
            vehicle.brake_torque_limit,
            calibration.brake_torque_limit,
            wire.largest_brake_torque(calibration.brake_gain),
        )
        self.hardest = -self.torque_limit / calibration.brake_gain  #: acceleration of that torque [m/s2]
        self.fallback_tracker = FallbackTracker(vehicle)
        self.limiter = Limiter(vehicle, limits, self._steering_limit)
        self.actuation = Actuation(calibration, vehicle.brake_delay, vehicle.brake_lag)

        self._elapsed = 0.0  # since the last step, bounded [s]
        self._fastest = math.nan  # largest speed by wheels or receiver, of a commanded car [m/s]; NaN where not known
        self._stop_deceleration = 0.0
        self._stop_jerk = 0.0
        self._followed: Setpoint | None = None  # the last setpoint that the car was given
        self._held_steering: float | None = None  # where the wheels are held on the fallback path, having no way

    def step(self, now: float, elapsed: float, fastest: float, driver: list[str]) -> MotionCommand:
        """Return what the car is commanded at `now` [s], `elapsed` after the last step.

        `fastest` is the largest speed that wheels or receiver report [m/s], NaN where neither is known; `driver` names
        the pedals that the driver touches.
        """
        self._elapsed, self._fastest = elapsed, fastest
        setpoint, arming = self._monitor.validator.setpoint, self._arming
        if arming.state is _ENGAGED:
            if arming.going and setpoint is not None:
                return self._follow(setpoint)
            arming.notes += self._engagement.waits_for(driver)
            return self._wait()
        if arming.state in COMMANDING:
            return self._stop(now)
        return MotionCommand(Pedals(0.0, 0.0), 0.0, self._measured_steering(), ())

    def engage(self) -> None:
        """Begin a drive: the car is at rest, and held."""
        self._followed = None
        self.limiter.reset(0.0, self._measured_steering())
        self.actuation.reset()

    def begin_stop(self) -> None:
        """Begin a stop: it brakes at least as hard as the car brakes already."""
        # A stop closes the throttle at once and never releases brakes that are already applied.
        limits = self._limits
        self._stop_deceleration = max(-self.limiter.acceleration, limits.stop_deceleration)
        self._stop_jerk = limits.stop_jerk
        # A fault during requested emergency braking must not soften that braking.
        self._apply_emergency(self._followed)
        self.limiter.acceleration = min(self.limiter.acceleration, 0.0)
        self._held_steering = None

    def grade(self) -> float:
        """Return the grade of the newest accepted setpoint [rad, uphill positive]; 0 without one."""
        return 0.0 if self._monitor.validator.setpoint is None else self._monitor.validator.setpoint.grade

    def gear(self, now: float) -> Gear:
        """Return the gear to request at `now` [s]: drive once enabled, park once the car has stopped, else none."""
        if not self._standstill.certain:
            return _NO_GEAR
        if self._arming.state is _STOPPED:
            # A car that rolled a moment ago, or that has not been heard since, may only seem to stand.
            heard = self._reports.age(WheelSpeeds, now) <= MAX_PARK_REPORT_AGE + TOLERANCE
            return Gear.PARK if self._standstill.settled and heard else _NO_GEAR
        if self._arming.state is _ENGAGED and self._engagement.enabled and not self._engagement.in_drive:
            return Gear.DRIVE
        return _NO_GEAR

    def _apply_emergency(self, setpoint: Setpoint | None) -> None:
        """Stop at least as hard as an emergency setpoint asks; never softer than before."""
        if setpoint is not None and setpoint.emergency:
            emergency = self._limits.emergency
            asked = min(-setpoint.acceleration, emergency.deceleration)
            self._stop_deceleration = max(self._stop_deceleration, asked)
            self._stop_jerk = max(self._stop_jerk, emergency.jerk)

    def _measured_steering(self) -> float:
        angle = self._monitor.measured_steering
        if angle != angle:
            return 0.0
        return clamp(angle, -self._steering_limit, self._steering_limit)

    def _follow(self, setpoint: Setpoint) -> MotionCommand:
        self._followed = setpoint
        speed, limiter = self._reports.speed, self.limiter
        requested = limiter.within_speed(setpoint.acceleration, self._fastest)
        acceleration, steering, limited = limiter.step(
            requested, setpoint.steering, self._steering_speed(), setpoint.emergency, self._elapsed
        )  # fmt: skip
        believed = not self._standstill.fell_too_fast
        pedals = self.actuation.step(acceleration, speed, setpoint.grade, self._elapsed, believed=believed)
        if requested != setpoint.acceleration:
            limited = (*limited, "speed")
        return MotionCommand(pedals, acceleration, steering, limited)

    def _wait(self) -> MotionCommand:
        """Hold the brakes until DBW controller and gear are confirmed, no pedal is touched and the operator says go."""
        pedals = self.actuation.step(0.0, self._reports.speed, self.grade(), self._elapsed)
        return MotionCommand(pedals, 0.0, self.limiter.steering, ())

    def _stop(self, now: float) -> MotionCommand:
        limits, limiter = self._limits, self.limiter
        if self._monitor.validator.valid(now):
            self._apply_emergency(self._monitor.validator.setpoint)
        weak = "brake_not_following" in self._arming.causes
        critical = not CRITICAL.isdisjoint(self._arming.causes)
        jerk = max(self._stop_jerk, limits.critical_jerk if critical else 0.0)
        requested = max(self._stop_deceleration, limits.critical_deceleration if critical else 0.0)
        if weak:
            jerk, requested = limits.emergency.jerk, limits.emergency.deceleration
        limiter.acceleration = move_towards(limiter.acceleration, -requested, jerk, jerk, self._elapsed)
        if self._standstill.certain or self._speed_believed(now):
            pedals = self.actuation.step(
                limiter.acceleration,
                self._reports.speed,
                self.grade(),
                self._elapsed,
                brakes_only=True,
                believed=not self._standstill.fell_too_fast,
            )
        else:
            pedals = self._brake_in_doubt(now)
        if weak and not self._standstill.certain:
            # Brakes that do not follow get the full torque at once.
            pedals = Pedals(self.torque_limit, 0.0, self.hardest)
        limited = self._steer_to_rest()
        return MotionCommand(pedals, limiter.acceleration, limiter.steering, limited)

    def _brake_in_doubt(self, now: float) -> Pedals:
        """Pedals of a stop whose speed is not believed: as hard as by feedforward, or harder where the wheels ask."""
        limiter, grade = self.limiter, self.grade()
        blind = self.actuation.without_speed(-limiter.acceleration, grade)
        if not self._reports.speed_known(now):
            self.actuation.lose_speed()
            return blind
        seen = self.actuation.step(
            limiter.acceleration,
            self._reports.speed,
            grade,
            self._elapsed,
            brakes_only=True,
            believed=not self._standstill.fell_too_fast,
        )
        return Pedals(max(blind.brake_torque, seen.brake_torque), 0.0, min(blind.acceleration, seen.acceleration))

    def _speed_believed(self, now: float) -> bool:
        """Whether the wheel speeds are known, above rest and not in doubt."""
        moving = self._reports.speed_known(now) and not self._reports.fastest_wheel < WHEEL_REST
        return moving and _SPEED_UNKNOWN.isdisjoint(self._arming.causes)

    def _steer_to_rest(self) -> tuple[str, ...]:
        """Steer along the fallback path while there is one; names of the limits that changed it."""
        angle, arming = None, self._arming
        if arming.state is _STOPPING and not self._standstill.certain and _ASTRAY.isdisjoint(arming.causes):
            angle = self.fallback_tracker.steering()
        if angle is not None:
            self._held_steering = None
            return self.limiter.steer(angle, self._steering_speed(), self._elapsed)
        if self._held_steering is None:
            # The measured angle is the best guess of where the road goes, better than zero and better than a request
            # not reached. At rest it keeps the wheels where they are. The limiter still applies: a wrong report must
            # not turn the wheels at once.
            self._held_steering = self._measured_steering()
        return self.limiter.steer(self._held_steering, self._steering_speed(), self._elapsed)

    def _steering_speed(self) -> float:
        """Speed at which steering is limited [m/s]: the wheels', or the receiver's where wheels say far too little."""
        wheels, gnss = self._reports.speed, self._monitor.gnss_speed
        return gnss if gnss > wheels + MAX_WHEEL_SPEED_DEFICIT else wheels
