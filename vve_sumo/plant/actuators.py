"""Actuator models of steering, brakes and throttle: dead time, lag and limits between a request and the road.

Exact for inputs constant over a step; without frames or the car's motion. Dead times are whole steps.
"""

from __future__ import annotations

import math
from collections import deque


class DeadTime:
    """Returns the input of `delay` seconds ago, rounded to whole steps."""

    __slots__ = ("_line",)

    def __init__(self, delay: float, duration: float, initial: float) -> None:
        self._line = deque([initial] * round(delay / duration))

    def step(self, value: float) -> float:
        """Put `value` in, take the delayed one out."""
        line = self._line
        if not line:
            return value
        line.append(value)
        return line.popleft()


def share_of_step(lag: float, duration: float) -> float:
    """Share of the way to its target that a first-order lag of time constant `lag` covers in `duration` [s]."""
    return 1.0 if lag <= 0.0 else -math.expm1(-duration / lag)


class Lagged:
    """A dead time followed by a first-order lag, for the brakes' torque [N m] and the throttle's opening."""

    __slots__ = ("_dead_time", "_share", "value")

    def __init__(self, delay: float, lag: float, duration: float) -> None:
        self.value = 0.0
        self._dead_time = DeadTime(delay, duration, 0.0)
        self._share = share_of_step(lag, duration)

    def step(self, request: float) -> float:
        """Return the value at the end of the step."""
        self.value += (self._dead_time.step(request) - self.value) * self._share
        return self.value


class Steering:
    """The steering wheel [rad, left positive] behind its motor: dead time, first-order lag, rate and angle limits.

    A request of NaN means that the wheel is not controlled: it then returns to straight ahead while the car rolls.
    """

    __slots__ = ("_dead_time", "_free_share", "_limit", "_rate", "_share", "angle")

    #: Time constant of a released wheel's return to straight ahead on a rolling car [s]; an assumption.
    RETURN_LAG = 0.5

    def __init__(self, delay: float, lag: float, rate_limit: float, angle_limit: float, duration: float) -> None:
        self.angle = 0.0
        self._dead_time = DeadTime(delay, duration, math.nan)
        self._share = share_of_step(lag, duration)
        self._free_share = share_of_step(self.RETURN_LAG, duration)
        self._rate = rate_limit * duration
        self._limit = angle_limit

    def step(self, request: float, rolling: bool) -> float:
        """Return the angle at the end of the step."""
        request = self._dead_time.step(request)
        if request != request:
            change = -self.angle * self._free_share if rolling else 0.0
        else:
            limit = self._limit
            target = -limit if request < -limit else limit if request > limit else request
            change = (target - self.angle) * self._share
        rate = self._rate
        self.angle += -rate if change < -rate else rate if change > rate else change
        return self.angle
