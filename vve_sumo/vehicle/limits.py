"""Limits of what the car may be commanded (comfort and emergency apart), and the limiter that applies them.

The limiter knows the car's geometry and speed, but neither the reason for a request nor how it is actuated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.laws import clamp
from vve_sumo.values import Vehicle


def _check_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ConfigError(f"{name} must be a positive number, got {value!r}")


@dataclass(frozen=True, slots=True)
class Envelope:
    """Limits of acceleration and jerk."""

    deceleration: float  #: largest [m/s2], a positive number
    acceleration: float  #: largest [m/s2]
    jerk: float  #: of a pedal pressed further: acceleration moving away from zero [m/s3]
    release_jerk: float  #: of a pedal released: acceleration moving towards zero [m/s3]
    lateral_jerk: float  #: from steering, on a steady circle [m/s3]

    def __post_init__(self) -> None:
        """Raise ConfigError for a limit that is not finite and positive."""
        for field in fields(self):
            _check_positive(f"limits: {field.name}", getattr(self, field.name))


@dataclass(frozen=True, slots=True)
class EmergencyBraking:
    """Limits of deceleration and jerk in emergency braking; all else keeps to the comfort envelope."""

    deceleration: float  #: largest [m/s2], a positive number
    jerk: float  #: of the throttle released and the brake pressed [m/s3]

    def __post_init__(self) -> None:
        """Raise ConfigError for a limit that is not finite and positive."""
        for field in fields(self):
            _check_positive(f"limits: emergency {field.name}", getattr(self, field.name))


# -3.5 and +2.0 m/s2: limits of ISO 15622 (ACC) at high speed, and of opendbc's safety model (opendbc/safety, Ford) at
# any speed. Lateral jerk 5 m/s3: ISO 11270 (lane keeping).
COMFORT = Envelope(deceleration=3.5, acceleration=2.0, jerk=5.0, release_jerk=10.0, lateral_jerk=5.0)
# At most the friction of a dry road; the brakes' own rise time is of the order of 0.3 s.
EMERGENCY = EmergencyBraking(deceleration=9.0, jerk=30.0)


@dataclass(frozen=True, slots=True)
class Limits:
    """All limits that the gateway applies; a rig makes them stricter or looser only explicitly, in its own file."""

    comfort: Envelope = COMFORT  #: what every setpoint gets
    emergency: EmergencyBraking = EMERGENCY  #: how a setpoint may brake that asks for it
    lateral_acceleration: float = 3.0  #: largest [m/s2], ISO 11270
    stop_deceleration: float = 2.4  #: of the gateway's own stop [m/s2], as Autoware's vehicle_cmd_gate
    stop_jerk: float = 5.0  #: with which it sets in [m/s3]
    stop_lateral_jerk: float = 10.0  #: from steering along the fallback path [m/s3], twice the comfort one
    critical_deceleration: float = 4.0  #: of the gateway's own stop after a critical fault [m/s2]
    critical_jerk: float = 15.0  #: with which it sets in [m/s3]
    speed: float | None = None  #: largest speed of the car [m/s]; None for no limit

    def __post_init__(self) -> None:
        """Raise ConfigError for limits that are not positive, or emergency braking weaker than other braking."""
        for name in (
            "lateral_acceleration", "stop_deceleration", "stop_jerk", "stop_lateral_jerk", "critical_deceleration",
            "critical_jerk",
        ):  # fmt: skip
            _check_positive(f"limits: {name}", getattr(self, name))
        if self.speed is not None:
            _check_positive("limits: speed", self.speed)
        if self.emergency.deceleration < max(self.comfort.deceleration, self.critical_deceleration):
            raise ConfigError(
                "limits: emergency deceleration must not be below the comfort and critical ones, "
                f"got {self.emergency.deceleration:g}"
            )


# The speed limit is approached exponentially with this time constant, several times the drive's delay and lag [s].
SPEED_LIMIT_TIME: Final = 0.8
SPEED_LIMIT_BRAKING: Final = 1.0  # largest deceleration with which a car above its speed limit is slowed [m/s2]
#: A car faster than its limit by more than this is stopped: the wheels' scale, a steep slope, the last of a push [m/s].
SPEED_LIMIT_MARGIN: Final = 1.0


class LimitedMotion(NamedTuple):
    """A request after limiting."""

    acceleration: float  #: [m/s2]
    steering: float  #: road-wheel angle [rad], left positive
    limited: tuple[str, ...]  #: names of the limits that changed it


class Limiter:
    """Limits acceleration and steering, and their rates over the time that has passed.

    `steering_limit` is the largest road-wheel angle [rad]. Rate limits take precedence: where the car has become too
    fast for its steering angle, the angle moves back at its largest rate, and does not jump.
    """

    def __init__(self, vehicle: Vehicle, limits: Limits, steering_limit: float) -> None:
        self._limits = limits
        self._wheelbase = vehicle.wheelbase
        self._understeer = vehicle.understeer_gradient
        self._steering_limit = steering_limit
        self._steering_rate = vehicle.steering_rate_limit
        self.acceleration = 0.0
        self.steering = 0.0

    def reset(self, acceleration: float, steering: float) -> None:
        """Set what was granted last: acceleration [m/s2] and road-wheel angle [rad]."""
        self.acceleration = acceleration
        self.steering = steering

    def step(
        self, acceleration: float, steering: float, speed: float, emergency: bool, elapsed: float
    ) -> LimitedMotion:
        """Return what is granted of the requested `acceleration` [m/s2] and `steering` [rad] at `speed` [m/s].

        `elapsed` is the time since the last grant [s]. An `emergency` loosens braking only: acceleration, the release
        of the brakes and steering keep to the comfort envelope. A request that is not finite changes nothing and is
        reported as "not_finite".
        """
        if not (math.isfinite(acceleration) and math.isfinite(steering) and math.isfinite(speed + elapsed)):
            return LimitedMotion(self.acceleration, self.steering, ("not_finite",))
        limited: list[str] = []
        self.acceleration = self._limit_acceleration(acceleration, emergency, elapsed, limited)
        self.steering = self._limit_steering(steering, speed, self._limits.comfort.lateral_jerk, elapsed, limited)
        return LimitedMotion(self.acceleration, self.steering, tuple(limited))

    def within_speed(self, acceleration: float, speed: float) -> float:
        """Return `acceleration` [m/s2], or the largest that keeps the speed limit at `speed` [m/s], which is less.

        Without a speed limit, and where the speed is not known, nothing is limited.
        """
        limit = self._limits.speed
        if limit is None:
            return acceleration
        largest = max((limit - speed) / SPEED_LIMIT_TIME, -SPEED_LIMIT_BRAKING)
        return largest if largest < acceleration else acceleration  # nor where the speed is not known

    def too_fast(self, speed: float) -> bool:
        """Return whether the car is beyond its speed limit and the margin at `speed` [m/s]; False where unknown."""
        limit = self._limits.speed
        return limit is not None and speed > limit + SPEED_LIMIT_MARGIN

    def steer(self, steering: float, speed: float, elapsed: float) -> tuple[str, ...]:
        """Move towards road-wheel angle `steering` [rad] alone; names of the limits that changed it.

        The lateral jerk of a stop applies: while the car comes to rest, staying on the path goes before comfort.
        """
        if not math.isfinite(steering + speed + elapsed):
            return ("not_finite",)
        limited: list[str] = []
        self.steering = self._limit_steering(steering, speed, self._limits.stop_lateral_jerk, elapsed, limited)
        return tuple(limited)

    def steering_bound(self, speed: float) -> float:
        """Largest road-wheel angle [rad] at `speed` [m/s], by the car's own limit and by the lateral acceleration.

        Steady circle of the single-track model: atan(L a / v^2) + K a (Rajamani, Vehicle Dynamics and Control, 3.3).
        """
        lateral = self._limits.lateral_acceleration
        turning = math.atan2(self._wheelbase * lateral, speed * speed) + self._understeer * lateral
        if not turning < self._steering_limit:  # nor where the speed is not known
            return self._steering_limit
        return turning if turning > 0.0 else 0.0

    def steering_rate_bound(self, speed: float, lateral_jerk: float) -> float:
        """Largest rate of the road-wheel angle [rad/s] at `speed` [m/s], by the car's limit and the lateral jerk."""
        square = speed * speed
        if square * self._steering_rate <= lateral_jerk * self._wheelbase:
            return self._steering_rate
        return lateral_jerk * self._wheelbase / square

    def _limit_acceleration(self, requested: float, emergency: bool, elapsed: float, limited: list[str]) -> float:
        comfort, braking = self._limits.comfort, self._limits.emergency
        target = clamp(requested, -(braking if emergency else comfort).deceleration, comfort.acceleration)
        if target != requested:
            limited.append("acceleration")
        away, towards = comfort.jerk, comfort.release_jerk
        if emergency and target < self.acceleration:
            away = towards = braking.jerk
        granted = move_towards(self.acceleration, target, away, towards, elapsed)
        if granted != target:
            limited.append("jerk")
        return granted

    def _limit_steering(
        self, requested: float, speed: float, lateral_jerk: float, elapsed: float, limited: list[str]
    ) -> float:  # fmt: skip
        bound = self.steering_bound(speed)
        target = clamp(requested, -bound, bound)
        if target != requested:
            limited.append("steering_angle" if bound == self._steering_limit else "lateral_acceleration")
        change = self.steering_rate_bound(speed, lateral_jerk) * elapsed
        granted = clamp(target, self.steering - change, self.steering + change)
        if granted != target:
            limited.append("steering_rate")
        return granted


def move_towards(value: float, target: float, away: float, towards: float, period: float) -> float:
    """Return `value` moved towards `target` by as much as `period` [s] allows.

    The rate is `towards` while the value approaches 0 and `away` while it leaves 0.
    """
    if value * target < 0.0:
        to_zero = abs(value) / towards
        if to_zero >= period:
            return value - math.copysign(towards * period, value)
        return move_towards(0.0, target, away, towards, period - to_zero)
    change = period * (away if abs(target) > abs(value) else towards)
    return clamp(target, value - change, value + change)
