"""Monitors that the car neither slows down nor fails to speed up without a command; a driver's foot is taken for it.

It compares the car's loss of speed with what the commanded pedals explain. A module that is overridden, and reports
nothing of it, shows here and nowhere else. The counterpart is `brake_monitor`.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.physical_constants import GRAVITY
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.brake_monitor import cusum_step
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.standstill import MAX_BRAKING

# What any sound car does at least. Brakes that give 10 % more torque than calibrated, on a car 15 % lighter, have a
# share of 1.3. An engine that gives a fifth less, on a car 15 % heavier, has a share of 0.7, and a smaller one while a
# transmission shifts.
BRAKE_SHARE: Final = 1.35  # of the commanded torque that the brakes may give at most
DRIVE_SHARE: Final = 0.5  # of the commanded drive force that the engine gives at least
DRAG_SHARE: Final = 1.5  # of the calibrated drag that the car may have
# Deceleration allowed beyond the modelled one: an unknown grade of 1.5 %, the drag of tyres in a bend at 3 m/s2 of
# lateral acceleration, the noise of the speeds [m/s2].
DECELERATION_MARGIN: Final = 0.35

# What this car did a moment ago: the difference between calibrated model and measurement, learnt while it drives. A
# foot changes it at once, the car's mass, its engine and its drag do not.
LEARNING_TIME: Final = 15.0  # [s]
LEARNING_SPEED: Final = 1.0  # from which on it is learnt [m/s]; creep is not known well below
CHANGE_MARGIN: Final = 0.35  # change that counts for nothing [m/s2]
CHANGE_SHARE: Final = 0.15  # and as much of the commanded acceleration: shifts of the transmission, warm brakes

# Time in which a released brake may go on braking beyond its declared delay and lag, and a pressed throttle may not yet
# push [s].
RELEASE_LAG: Final = 0.15
THROTTLE_DELAY: Final = 0.10
SPEED_DEFICIT: Final = 0.30  # slower than explained by this is a foot on the brake [m/s]
# The same beside what was learnt; a shift of the transmission costs 0.5 [m/s].
CHANGE_DEFICIT: Final = 0.70
GNSS_DEFICIT: Final = 0.10  # and by the receiver's speed this much at least, where it is known [m/s]


class SlowingMonitor:
    """Two one-sided cumulative sums (Page, Biometrika 41, 1954) of the car's missing speed.

    One is against the slowest car that is still sound, the other against this car as it was. `step` is called once a
    gateway step with the pedals commanded at the step before.
    """

    def __init__(self, vehicle: Vehicle, calibration: Calibration) -> None:
        self._calibration = calibration
        self._release_lag = RELEASE_LAG + vehicle.brake_delay + vehicle.brake_lag
        self._push_lag = 1.5 * calibration.drive_lag + THROTTLE_DELAY
        self.reset()

    def reset(self) -> None:
        """Forget the past: the gateway does not let the car move."""
        # How the car was held at first is not known, so its brakes may hold it.
        self._torque = self._calibration.brake_torque_limit  # that may still brake [N m]
        self._opening = 0.0  # of the throttle that pushes by now, 0 to 1
        self._speeds: tuple[float, float] | None = None  # by wheels and receiver, a step ago
        self._deficit = self._gnss_deficit = self._changed = self._gnss_changed = 0.0
        self._learnt = 0.0  # measured minus modelled acceleration [m/s2]

    def step(
        self, elapsed: float, pedals: Pedals, wheels: float, gnss: float, grade: float
    ) -> bool:  # fmt: skip
        """Return whether a foot slows the car at speeds `wheels`, `gnss` [m/s, NaN unknown] on `grade` [rad]."""
        known = math.isfinite(wheels)  # a change of speed needs both: one that is NaN would unteach what is learnt
        before, self._speeds = self._speeds, (wheels, gnss) if known else None
        self._follow(elapsed, pedals)
        if before is None or elapsed <= 0.0 or not known:
            self._deficit = self._gnss_deficit = self._changed = self._gnss_changed = 0.0
            return False
        # Wheel speeds that fall faster than any car brakes have failed: what they lose beyond that is nobody's foot.
        wheels_before, gnss_before = before
        gained, least = wheels - wheels_before, -MAX_BRAKING * elapsed
        if gained < least:
            gained = least
        seen = gnss - gnss_before
        any_car, modelled, margin = self._expected(wheels, grade)
        allowed = any_car * elapsed
        self._deficit = cusum_step(self._deficit, allowed - gained)
        self._gnss_deficit = cusum_step(self._gnss_deficit, allowed - seen)
        if wheels > LEARNING_SPEED:
            allowed = (modelled + self._learnt - margin) * elapsed
            self._changed = cusum_step(self._changed, allowed - gained)
            self._gnss_changed = cusum_step(self._gnss_changed, allowed - seen)
            self._learnt += (gained / elapsed - modelled - self._learnt) * elapsed / (LEARNING_TIME + elapsed)
        else:
            self._changed = self._gnss_changed = 0.0
        # One of two speeds alone points at locked wheels or a wrong receiver, not at a foot.
        unknown = not math.isfinite(gnss)
        slow = self._deficit > SPEED_DEFICIT and (unknown or self._gnss_deficit > GNSS_DEFICIT)
        slower = self._changed > CHANGE_DEFICIT and (unknown or self._gnss_changed > GNSS_DEFICIT)
        return slow or slower

    def _follow(self, elapsed: float, pedals: Pedals) -> None:
        """Advance the largest braking and the least push that the commanded `pedals` may have by now."""
        if elapsed <= 0.0:
            return
        torque, throttle, _acceleration = pedals
        fading = self._torque - self._torque * elapsed / (self._release_lag + elapsed)
        self._torque = fading if fading > torque else torque
        pushing = self._opening + (throttle - self._opening) * elapsed / (self._push_lag + elapsed)
        self._opening = pushing if pushing < throttle else throttle

    def _expected(self, speed: float, grade: float) -> tuple[float, float, float]:
        """Least acceleration of any sound car, this car's by its model, and what it may be less than that [m/s2]."""
        calibration = self._calibration
        mass, drag = calibration.mass, calibration.drag(speed)
        push = calibration.drive_force(self._opening, speed)
        braking, slope = calibration.brake_force(self._torque), GRAVITY * math.sin(grade)
        any_car = (DRIVE_SHARE * push - DRAG_SHARE * drag - BRAKE_SHARE * braking) / mass - slope - DECELERATION_MARGIN
        modelled = (push + calibration.creep(speed) - braking - drag) / mass - slope
        return any_car, modelled, CHANGE_MARGIN + CHANGE_SHARE * (push + braking) / mass
