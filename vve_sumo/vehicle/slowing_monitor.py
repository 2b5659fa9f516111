"""Monitors that the car neither slows down nor fails to speed up without a command; a driver's foot is taken for it.

It compares the car's loss of speed with the largest that a sound car would have under the commanded pedals. A module
that is overridden, and reports nothing of it, shows here and nowhere else. The counterpart is `brake_monitor`.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.brake_monitor import added
from vve_sumo.vehicle.calibration import GRAVITY, Calibration

# Brakes that give 10 % more torque than calibrated, on a car 15 % lighter, have a share of 1.3.
BRAKE_SHARE: Final = 1.35  # of the commanded torque that the brakes may give at most
# An engine that gives a fifth less than calibrated, on a car 15 % heavier, has a share of 0.7; while an automatic
# transmission shifts it is less.
DRIVE_SHARE: Final = 0.5  # of the commanded drive force that the engine gives at least
DRAG_SHARE: Final = 1.5  # of the calibrated drag that the car may have
# Deceleration allowed beyond the modelled one: an unknown grade of 1.5 %, the drag of tyres in a bend at 3 m/s2 of
# lateral acceleration, the noise of the speeds [m/s2].
DECELERATION_MARGIN: Final = 0.35
# Time in which a released brake may go on braking, and a pressed throttle may not yet push [s].
RELEASE_LAG: Final = 0.15
THROTTLE_DELAY: Final = 0.10
SPEED_DEFICIT: Final = 0.30  # slower than the slowest car that is still sound by this is a foot on the brake [m/s]
SATELLITE_DEFICIT: Final = 0.10  # and by the receiver's speed this much at least, where it is known [m/s]


class SlowingMonitor:
    """A one-sided cumulative sum (Page, Biometrika 41, 1954) of the car's missing speed.

    `step` is called once a gateway step with the pedals commanded at the step before.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self._push_lag = 1.5 * calibration.drive_lag + THROTTLE_DELAY
        self.reset()

    def reset(self) -> None:
        """Forget the past: the gateway does not let the car move."""
        self._torque = math.inf  # that may still brake [N m]; at first it is not known how the car was held
        self._opening = 0.0  # of the throttle that pushes by now, 0 to 1
        self._speeds: tuple[float, float] | None = None  # by wheels and receiver, a step ago
        self._deficit = self._satellite_deficit = 0.0

    def step(
        self, elapsed: float, pedals: Pedals, wheels: float, satellite: float, grade: float
    ) -> bool:  # fmt: skip
        """Return whether a foot slows the car at speeds `wheels`, `satellite` [m/s, NaN unknown] on `grade` [rad]."""
        before, self._speeds = self._speeds, (wheels, satellite)
        self._follow(elapsed, pedals)
        if before is None or elapsed <= 0.0 or not math.isfinite(wheels):
            self._deficit = self._satellite_deficit = 0.0
            return False
        allowed = self._least(wheels, grade) * elapsed
        self._deficit = added(self._deficit, allowed - (wheels - before[0]))
        self._satellite_deficit = added(self._satellite_deficit, allowed - (satellite - before[1]))
        # One of two speeds alone points at locked wheels or a wrong receiver, not at a foot.
        confirmed = self._satellite_deficit > SATELLITE_DEFICIT or not math.isfinite(satellite)
        return self._deficit > SPEED_DEFICIT and confirmed

    def _follow(self, elapsed: float, pedals: Pedals) -> None:
        """Advance the largest braking and the least push that the commanded `pedals` may have by now."""
        if elapsed <= 0.0:
            return
        if self._torque == math.inf:
            self._torque = self._calibration.brake_torque_limit
        fading = self._torque - self._torque * elapsed / (RELEASE_LAG + elapsed)
        self._torque = max(pedals.brake_torque, fading)
        pushing = self._opening + (pedals.throttle - self._opening) * elapsed / (self._push_lag + elapsed)
        self._opening = min(pedals.throttle, pushing)

    def _least(self, speed: float, grade: float) -> float:
        """Least acceleration that a sound car may have now [m/s2]; -inf where its brakes may hold it at rest."""
        calibration = self._calibration
        force = DRIVE_SHARE * calibration.drive_force(self._opening, max(speed, 0.0))
        force -= DRAG_SHARE * calibration.drag(speed) + BRAKE_SHARE * calibration.brake_force(self._torque)
        return force / calibration.mass - GRAVITY * math.sin(grade) - DECELERATION_MARGIN
