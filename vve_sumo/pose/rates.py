"""Yaw rate and acceleration as differences of heading and speed, for receivers that measure neither."""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

RATE_WINDOW: Final = 100  #: over which yaw rate and acceleration are differenced [ms]
RATE_GAP: Final = 500  #: fixes further apart give no rate [ms]


class _Past(NamedTuple):
    clock: int
    heading: float
    speed: float


class DifferencedRates:
    """Differences the fixes of one receiver, in the order of their times."""

    def __init__(self) -> None:
        self._past: deque[_Past] = deque()

    def step(self, clock: int, heading: float, speed: float) -> tuple[float, float]:
        """Return yaw rate [rad/s] and rate of change of speed [m/s2] since the oldest fix of the window.

        `clock` is the fix's time [ms], `heading` [rad] and `speed` along it [m/s] may be NaN. The window holds at least
        the previous fix; both rates are NaN for the first fix and after a gap.
        """
        now, past = _Past(clock, heading, speed), self._past
        if past and clock - past[-1].clock > RATE_GAP:
            past.clear()
        while len(past) > 1 and past[0].clock < clock - RATE_WINDOW:
            past.popleft()
        then = past[0] if past else _Past(clock - 1, math.nan, math.nan)
        past.append(now)
        step = (clock - then.clock) / 1000.0
        turned = heading - then.heading
        yaw_rate = math.remainder(turned, math.tau) / step if math.isfinite(turned) else math.nan
        return yaw_rate, (speed - then.speed) / step
