"""Formulas for controllers and analysis: stopping and swerving, speed limits in bends, rate limits, PI control.

Floats in, floats out: nothing here knows a car, a map, a sensor or a clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterable


def stopping_distance(speed: float, deceleration: float, delay: float = 0.0, build_up: float = 0.0) -> float:
    """Return the distance to standstill [m]: no braking for `delay`, a linear ramp over `build_up`, then constant.

    d = v tau + v t_r - a t_r^2 / 6 + (v - a t_r / 2)^2 / (2 a), where the ramp ends before standstill.
    speed [m/s] >= 0, deceleration [m/s2] > 0, times [s].
    """
    if speed <= 0.0:
        return 0.0
    lost = 0.5 * deceleration * build_up
    if speed <= lost:
        return speed * (delay + math.sqrt(2.0 * speed * build_up / deceleration) * 2.0 / 3.0)
    ramp = speed * build_up - deceleration * build_up * build_up / 6.0
    return speed * delay + ramp + (speed - lost) ** 2 / (2.0 * deceleration)


def stopping_time(speed: float, deceleration: float, delay: float = 0.0, build_up: float = 0.0) -> float:
    """Return the time to standstill [s] with the deceleration profile of `stopping_distance`."""
    if speed <= 0.0:
        return 0.0
    if speed <= 0.5 * deceleration * build_up:
        return delay + math.sqrt(2.0 * speed * build_up / deceleration)
    return delay + 0.5 * build_up + speed / deceleration


def sideways_reach(time: float, acceleration: float, jerk: float) -> float:
    """Return how far a car that drives straight comes to the side in a time [m], as far as two limits let it.

    Its lateral acceleration rises with `jerk` [m/s3] up to `acceleration` [m/s2]: y = j t^3 / 6, and after the rise
    t_a = a / j: y = a t_a^2 / 6 + a t_a (t - t_a) / 2 + a (t - t_a)^2 / 2. It still moves sideways then.
    """
    if time <= 0.0:
        return 0.0
    rise = acceleration / jerk
    if time <= rise:
        return jerk * time * time * time / 6.0
    after = time - rise
    return acceleration * (rise * rise / 6.0 + 0.5 * after * (rise + after))


def swerve_time(offset: float, acceleration: float, jerk: float, delay: float = 0.0) -> float:
    """Return the least time to come to the side by an offset [m]: `delay` [s] and the inverse of `sideways_reach`."""
    if offset <= 0.0:
        return 0.0
    rise = acceleration / jerk
    risen = acceleration * rise * rise / 6.0
    if offset <= risen:
        return delay + math.cbrt(6.0 * offset / jerk)
    return delay + 0.5 * rise + math.sqrt(0.25 * rise * rise + 2.0 * (offset - risen) / acceleration)


def time_to_cover(distance: float, speed: float, deceleration: float, delay: float = 0.0) -> float:
    """Return the time until a car has gone a distance [s], braking constantly after `delay`; inf if it stops before.

    `deceleration` [m/s2] may be 0. speed [m/s], distance [m].
    """
    if distance <= speed * delay:
        return distance / speed if distance > 0.0 else 0.0
    if deceleration <= 0.0:
        return distance / speed if speed > 0.0 else math.inf
    square = speed * speed - 2.0 * deceleration * (distance - speed * delay)
    return math.inf if square < 0.0 else delay + (speed - math.sqrt(square)) / deceleration


def impact_speed(speed: float, gap: float, deceleration: float, delay: float = 0.0) -> float:
    """Return the speed at the end of the gap [m/s], braking constantly after `delay`; 0 if the car stops before."""
    braked = max(gap - speed * delay, 0.0)
    return math.sqrt(max(0.0, speed * speed - 2.0 * deceleration * braked))


def squared_speed_limits(
    curvature: Iterable[float], limit: float, lateral: float, slowing: float, spacing: float
) -> list[float]:
    """Return squares of the greatest speeds [m2/s2] along a path whose curvature [1/m] is given every `spacing` [m].

    Backward pass: v^2 <= limit^2, v^2 <= lateral / |curvature| and v^2 <= v_next^2 + 2 slowing spacing. So the speed
    keeps to `limit` [m/s] and to the acceleration `lateral` [m/s2] in bends, and falls by at most `slowing` [m/s2].
    """
    fastest = limit * limit
    squares = [min(fastest, lateral / abs(bend)) if bend else fastest for bend in curvature]
    for row in range(len(squares) - 2, -1, -1):
        squares[row] = min(squares[row], squares[row + 1] + 2.0 * slowing * spacing)
    return squares


def clamp(value: float, low: float, high: float) -> float:
    """Return the value limited to two bounds; NaN stays NaN, so that a later check sees it."""
    return low if value < low else high if value > high else value


def rate_limit(target: float, previous: float, rate: float, period: float) -> float:
    """Return the target, limited to a step of rate * period from the previous value."""
    step = rate * period
    return clamp(target, previous - step, previous + step)


def jerk_limit(
    target: float, previous: float, low: float, high: float, jerk_down: float, jerk_up: float, period: float
) -> float:
    """Limit an acceleration to [low, high] [m/s2], then its change to the two jerks [m/s3].

    From a previous value outside the bounds the result returns at the jerk limit, not at once.
    """
    return clamp(clamp(target, low, high), previous - jerk_down * period, previous + jerk_up * period)


class PI:
    """A PI controller with bounded output and anti-windup.

    While the output is beyond a bound, the integral can only move back from it (conditional integration, Åström
    and Hägglund, PID Controllers, 1995, 3.5).
    """

    __slots__ = ("high", "integral", "ki", "kp", "low")

    def __init__(self, kp: float, ki: float, low: float, high: float) -> None:
        self.kp, self.ki, self.low, self.high = kp, ki, low, high
        self.integral = 0.0

    def step(self, error: float, period: float) -> float:
        """Advance by a period [s] and return the bounded output."""
        integral = self.integral + self.ki * error * period
        output = self.kp * error + integral
        wound_up = (output > self.high and error > 0.0) or (output < self.low and error < 0.0)
        if not wound_up:
            self.integral = clamp(integral, self.low, self.high)
        return clamp(self.kp * error + self.integral, self.low, self.high)

    def reset(self) -> None:
        """Set the integral to 0."""
        self.integral = 0.0
