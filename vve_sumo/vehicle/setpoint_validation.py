"""Validates setpoints by form, order and age.

The result is reason codes; the module knows no arming state and commands nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from vve_sumo.timing import SETPOINT_LIFETIME
from vve_sumo.values import FallbackPath, Setpoint
from vve_sumo.vehicle.fallback import well_formed
from vve_sumo.vehicle.reports import TOLERANCE


class Debounce:
    """Detects a condition that has been bad for `duration` [s] without a break."""

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self._since = math.inf

    def reset(self) -> None:
        """Forget the past."""
        self._since = math.inf

    def step(self, now: float, bad: bool) -> bool:
        """Whether the condition, which is `bad` or not now, has been bad ever since `now - duration`."""
        if not bad:
            self._since = math.inf
            return False
        self._since = min(self._since, now)
        return now - self._since >= self._duration - TOLERANCE


@dataclass(frozen=True, slots=True)
class Rejection:
    """Why a setpoint is rejected."""

    reason: str  #: reason code
    fatal: bool  #: the setpoint shows a broken controller; otherwise the ones before and after may be good


class SetpointValidator:
    """Keeps the newest accepted setpoint."""

    def __init__(self) -> None:
        self.setpoint: Setpoint | None = None
        self._sequence = -1

    def take(self, now: float, setpoint: Setpoint) -> Rejection | None:
        """Accept and keep `setpoint`, or return why it is rejected."""
        rejection = self._check(now, setpoint)
        if rejection is None:
            self.setpoint = setpoint
            self._sequence = setpoint.sequence
        return rejection

    def valid(self, now: float) -> bool:
        """Whether there is an accepted setpoint that has not expired at `now` [s]."""
        return self.setpoint is not None and now <= self.setpoint.expires + TOLERANCE

    def faults(self, now: float) -> list[str]:
        """Reason codes that the newest setpoint carries; none once it has expired."""
        return list(self.setpoint.faults) if self.setpoint is not None and self.valid(now) else []

    def _check(self, now: float, setpoint: Setpoint) -> Rejection | None:
        motion = setpoint.speed + setpoint.yaw_rate + setpoint.grade + setpoint.x + setpoint.y + setpoint.heading
        if not math.isfinite(setpoint.steering + setpoint.acceleration + motion):
            return Rejection("setpoint_not_finite", fatal=True)
        if setpoint.sequence < 0 or not math.isfinite(setpoint.time + setpoint.expires):
            return Rejection("setpoint_incomplete", fatal=True)
        # Who follows a deferred path checks it once it is computed.
        if isinstance(setpoint.fallback_path, FallbackPath) and not well_formed(setpoint.fallback_path):
            return Rejection("profile_invalid", fatal=True)
        if setpoint.sequence <= self._sequence:
            return Rejection("setpoint_out_of_order", fatal=False)
        if setpoint.expires - setpoint.time > SETPOINT_LIFETIME + TOLERANCE:
            return Rejection("setpoint_lifetime", fatal=False)
        if setpoint.time > now + TOLERANCE:
            return Rejection("setpoint_from_future", fatal=False)
        return None
