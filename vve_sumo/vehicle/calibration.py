"""Longitudinal calibration of a car: maps from brake torque and throttle opening to forces, and back.

The forces act along the car and follow from numbers measured on that car; the simulated vehicle uses the same numbers.
The module knows no controller, no frame and no time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from vve_sumo.errors import ConfigError
from vve_sumo.laws import clamp
from vve_sumo.physical_constants import AIR_DENSITY, GRAVITY


@dataclass(frozen=True, slots=True)
class Calibration:
    """Longitudinal calibration of one car, by its vehicle file and by what was measured on it.

    Raises ConfigError for an impossible value.
    """

    mass: float  #: with occupants [kg]
    brake_gain: float  #: brake torque of all wheels for each m/s2 of deceleration [kg m]
    brake_torque_limit: float  #: largest torque that the DBW controller grants, all wheels together [N m]
    drive_force_limit: float  #: at full throttle and low speed [N]
    drive_power_limit: float  #: at full throttle and high speed [W]
    drive_lag: float  #: first-order time constant from throttle to drive force [s]
    creep_force: float  #: in drive at standstill with no pedal pressed [N]
    creep_speed: float  #: where the creep force has fallen to zero, linearly [m/s]
    rolling_resistance: float  #: rolling drag over weight
    drag_area: float  #: drag coefficient times frontal area [m2]
    wheel_speed_tolerance: float  #: share of the true speed by which the wheel speeds may be wrong

    def __post_init__(self) -> None:
        """Raise ConfigError for a value that no car can have."""
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"calibration: {field.name} must be finite and not negative, got {value!r}")
        for name in ("mass", "brake_gain", "brake_torque_limit", "drive_force_limit", "drive_power_limit"):
            if getattr(self, name) == 0.0:
                raise ConfigError(f"calibration: {name} must be positive, got 0")

    def full_throttle_force(self, speed: float) -> float:
        """Drive force at full throttle [N] at `speed` [m/s]: a constant force up to the constant-power hyperbola."""
        if speed * self.drive_force_limit <= self.drive_power_limit:
            return self.drive_force_limit
        return self.drive_power_limit / speed

    def drive_force(self, throttle: float, speed: float) -> float:
        """Drive force [N] of `throttle` (0 to 1) at `speed` [m/s], without creep."""
        return throttle * self.full_throttle_force(speed)

    def throttle(self, force: float, speed: float) -> float:
        """Throttle (0 to 1, clipped) for a drive `force` [N] at `speed` [m/s]; inverse of `drive_force`."""
        return clamp(force / self.full_throttle_force(speed), 0.0, 1.0)

    def creep(self, speed: float) -> float:
        """Force of the idling drivetrain [N] at `speed` [m/s]."""
        if speed >= self.creep_speed:
            return 0.0
        return self.creep_force * (1.0 - max(speed, 0.0) / self.creep_speed)

    def drag(self, speed: float) -> float:
        """Rolling and air resistance [N] of a car rolling forward at `speed` [m/s]."""
        return self.rolling_resistance * self.mass * GRAVITY + 0.5 * AIR_DENSITY * self.drag_area * speed * abs(speed)

    def force(self, acceleration: float, slope: float, speed: float) -> float:
        """Force [N] that pedals have to give for an `acceleration` over ground [m/s2], braking negative.

        `slope` is the sine of the grade, uphill positive; `speed` in m/s, forward positive.
        """
        force = self.mass * (acceleration + GRAVITY * slope)
        force += self.drag(speed) - self.creep(speed)
        return force

    def brake_force(self, torque: float) -> float:
        """Braking force [N] of `torque` [N m]."""
        return torque * self.mass / self.brake_gain

    def brake_torque(self, force: float) -> float:
        """Torque [N m] for a braking `force` [N], clipped to 0 and the limit; inverse of `brake_force`."""
        return clamp(force * self.brake_gain / self.mass, 0.0, self.brake_torque_limit)
