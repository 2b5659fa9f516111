"""Which setpoints are believed: form, order, age, and whether satellite and car tell of the same motion.

It knows no state of arming and commands nothing; it gives reason codes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vve_sumo.values import Setpoint
from vve_sumo.vehicle.profile import well_formed
from vve_sumo.vehicle.reports import TOLERANCE

MAX_LIFETIME: Final = 0.100  # of a setpoint [s]: the kit's own timeout for commands

# Satellite speed against wheel speed: the wheels slip by up to a tenth while the brakes work, and the two are up to a
# tenth of a second apart at 9 m/s2. Longer than half a second is a wrong receiver, a wrong wheel or a wrong car.
SPEED_DIFFERENCE: Final = 1.0  # [m/s]
SPEED_DIFFERENCE_SHARE: Final = 0.10  # of the wheel speed
# A gyroscope's bias is of the order of 0.01 rad/s; a wrong sign or axis shows as twice the yaw rate.
YAW_RATE_DIFFERENCE: Final = 0.10  # [rad/s]
DIFFERENCE_TIME: Final = 0.5  # [s]


class Persistence:
    """Tells when something has been bad for `duration` [s] without a break."""

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self._since = math.inf

    def reset(self) -> None:
        """Forget what was."""
        self._since = math.inf

    def step(self, now: float, bad: bool) -> bool:
        """Whether it has been bad all the time from `now - duration` on."""
        if not bad:
            self._since = math.inf
            return False
        self._since = min(self._since, now)
        return now - self._since >= self._duration - TOLERANCE


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a setpoint isn't acted on."""

    reason: str  #: reason code
    fatal: bool  #: the setpoint shows a broken controller; otherwise the ones before and after may be good


class Admission:
    """Keeps the newest setpoint that may be acted on."""

    def __init__(self) -> None:
        self.setpoint: Setpoint | None = None
        self._sequence = -1
        self._speed_differs = Persistence(DIFFERENCE_TIME)
        self._yaw_rate_differs = Persistence(DIFFERENCE_TIME)

    def take(self, now: float, setpoint: Setpoint) -> Refusal | None:
        """Keep `setpoint`, or say why not."""
        refusal = self._check(now, setpoint)
        if refusal is None:
            self.setpoint = setpoint
            self._sequence = setpoint.sequence
        return refusal

    def valid(self, now: float) -> bool:
        """Whether the newest setpoint may still be acted on."""
        return self.setpoint is not None and now <= self.setpoint.expires + TOLERANCE

    def faults(self, now: float, speed: float, yaw_rate: float) -> list[str]:
        """Reason codes that the newest setpoint brings, or shows when compared with the car's own motion.

        A satellite `speed` [m/s] or `yaw_rate` [rad/s] that differs for too long is a fault, and so is one that the
        car cannot state. A setpoint that has expired tells nothing.
        """
        setpoint = self.setpoint
        if setpoint is None or not self.valid(now):
            self._speed_differs.reset()
            self._yaw_rate_differs.reset()
            return []
        reasons = list(setpoint.faults)
        speed_limit = SPEED_DIFFERENCE + SPEED_DIFFERENCE_SHARE * abs(speed)
        if self._speed_differs.step(now, not abs(setpoint.speed - speed) <= speed_limit):
            reasons.append("speed_mismatch")
        if self._yaw_rate_differs.step(now, not abs(setpoint.yaw_rate - yaw_rate) <= YAW_RATE_DIFFERENCE):
            reasons.append("yaw_rate_mismatch")
        return reasons

    def _check(self, now: float, setpoint: Setpoint) -> Refusal | None:
        motion = setpoint.speed + setpoint.yaw_rate + setpoint.grade
        if not math.isfinite(setpoint.steering + setpoint.acceleration + motion):
            return Refusal("setpoint_not_finite", fatal=True)
        if setpoint.sequence < 0 or not math.isfinite(setpoint.time + setpoint.expires):
            return Refusal("setpoint_incomplete", fatal=True)
        if setpoint.profile is not None and not well_formed(setpoint.profile):
            return Refusal("profile_invalid", fatal=True)
        if setpoint.sequence <= self._sequence:
            return Refusal("setpoint_out_of_order", fatal=False)
        if setpoint.expires - setpoint.time > MAX_LIFETIME + TOLERANCE:
            return Refusal("setpoint_lifetime", fatal=False)
        if setpoint.time > now + TOLERANCE:
            return Refusal("setpoint_from_future", fatal=False)
        return None
