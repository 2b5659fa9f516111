"""Finds reports of the car that jump to and fro faster than a car can move: old ones mixed among fresh ones.

It knows measurements in the order in which they were reported; it must not know frames, commands or what follows.
"""

from __future__ import annotations

from collections import deque
from typing import Final

# A report that lies off both its neighbours by more than this, on the same side, is a spike. Reports come every 10 or
# 20 ms, so the bounds are accelerations to and fro that no wheel, body or steering has from one report to the next. In
# recordings of a real Ford Fusion, hard braking included, the greatest are 0.065 m/s, 0.0022 rad/s and 0.3 deg, every
# report taken or every second one (tests/vehicle/test_report_consistency.py). Computed and not measured: an anti-lock
# brake that swings both wheels by A = 1 m/s to both sides, as a sine of f = 8 Hz, makes spikes of
# A (1 - cos(2 pi f T)) at its turning points: 0.12 m/s with a report every T = 10 ms, as wheel speeds come; with
# one every 20 ms it would be 0.46 m/s and found.
SPEED_SPIKE: Final = 0.35  # of the rear axle by the wheels [m/s]: 35 m/s2 in 10 ms, and back in the next
YAW_RATE_SPIKE: Final = 0.05  # [rad/s]
STEERING_SPIKE: Final = 0.07  # of the steering wheel's angle [rad]: 200 deg/s to one side, then to the other
MAX_SPIKES: Final = 3  # of one measurement within WINDOW; a damaged report or a wheel that catches makes one
WINDOW: Final = 0.5  # [s]


class _Spikes:
    """Counts the spikes of one measurement."""

    __slots__ = ("_bound", "_change", "_value", "times")

    def __init__(self, bound: float) -> None:
        self._bound = bound
        self._value = self._change = 0.0
        self.times: deque[float] = deque(maxlen=MAX_SPIKES + 1)  #: of the newest spikes [s]

    def step(self, now: float, value: float) -> None:
        """Take the measurement of the next report."""
        change = value - self._value
        self._value = value
        if -self._bound <= change <= self._bound:
            self._change = 0.0
            return
        if change * self._change < 0.0:  # never where one of the two is not a number
            self.times.append(now)
        self._change = change


class ReportConsistency:
    """Watches wheel speeds, yaw rate and steering-wheel angle, report by report."""

    def __init__(self) -> None:
        self.speed = _Spikes(SPEED_SPIKE)  #: of the rear axle, by the wheels [m/s]
        self.yaw_rate = _Spikes(YAW_RATE_SPIKE)  #: [rad/s]
        self.wheel_angle = _Spikes(STEERING_SPIKE)  #: of the steering wheel [rad]
        self._times = (self.speed.times, self.yaw_rate.times, self.wheel_angle.times)

    def faults(self, now: float) -> list[str]:
        """Reason codes at drive time `now` [s]."""
        for times in self._times:
            if len(times) > MAX_SPIKES and now - times[0] <= WINDOW:
                return ["reports_inconsistent"]
        return []
