"""Plain arithmetic that controller authors and analysts share: stopping, collision times, limits, PI.

Floats in, floats out: nothing here knows a car, a map, a sensor or a clock.
"""

from __future__ import annotations

import math
from typing import NamedTuple


def stopping_distance(speed: float, deceleration: float, delay: float = 0.0, build_up: float = 0.0) -> float:
    """Distance to standstill [m]: nothing for `delay`, a linear ramp over `build_up`, then constant.

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
    """Time to standstill [s] for the course of deceleration of `stopping_distance`."""
    if speed <= 0.0:
        return 0.0
    if speed <= 0.5 * deceleration * build_up:
        return delay + math.sqrt(2.0 * speed * build_up / deceleration)
    return delay + 0.5 * build_up + speed / deceleration


def required_deceleration(closing_speed: float, gap: float, delay: float = 0.0) -> float:
    """Constant deceleration after `delay` that just avoids contact [m/s2]: DRAC, with the delay MDRAC.

    0 where nothing closes in; inf where the gap [m] is used up before the brakes answer.
    """
    if closing_speed <= 0.0:
        return 0.0
    rest = gap - closing_speed * delay
    return closing_speed * closing_speed / (2.0 * rest) if rest > 0.0 else math.inf


def impact_speed(speed: float, gap: float, deceleration: float, delay: float = 0.0) -> float:
    """Speed at the end of the gap [m/s] under constant deceleration after `delay`; 0 if it stops before."""
    braked = max(gap - speed * delay, 0.0)
    return math.sqrt(max(0.0, speed * speed - 2.0 * deceleration * braked))


def headway(gap: float, speed: float) -> float:
    """Time headway over the gap, bumper to bumper [s]; inf at standstill."""
    return gap / speed if speed > 0.0 else math.inf


def time_to_collision(gap: float, closing_speed: float, closing_acceleration: float = 0.0) -> float:
    """Time until the gap [m] is used up [s]: TTC, with an acceleration MTTC; inf if never, 0 if gap <= 0.

    Smallest positive root of g - dv t - da t^2 / 2 = 0; both rates count as positive when they close.
    """
    if gap <= 0.0:
        return 0.0
    if closing_acceleration == 0.0:
        return gap / closing_speed if closing_speed > 0.0 else math.inf
    discriminant = closing_speed * closing_speed + 2.0 * closing_acceleration * gap
    if discriminant < 0.0:
        return math.inf
    # Rationalised: no cancellation, however small the acceleration. A root <= 0 is in the past.
    denominator = closing_speed + math.sqrt(discriminant)
    return 2.0 * gap / denominator if denominator > 0.0 else math.inf


class Box(NamedTuple):
    """An oriented rectangle that moves steadily without turning."""

    x: float  #: centre [m]
    y: float  #: centre [m]
    heading: float  #: of its length [rad], counter-clockwise from +x
    length: float  #: [m]
    width: float  #: [m]
    velocity_x: float = 0.0  #: [m/s]
    velocity_y: float = 0.0  #: [m/s]


def time_to_collision_of_boxes(one: Box, other: Box) -> float:
    """Time until two steadily moving boxes touch [s]; 0 if they overlap already, inf if they never do.

    Exact: convex bodies overlap when their shadows overlap on each of the four edge normals, and each
    shadow pair overlaps during one interval of time (separating axes, Gottschalk 1996; swept as in
    Ericson, Real-Time Collision Detection, 5.5.8).
    """
    dx, dy = other.x - one.x, other.y - one.y
    vx, vy = other.velocity_x - one.velocity_x, other.velocity_y - one.velocity_y
    enters, leaves = 0.0, math.inf
    for heading in (one.heading, one.heading + 0.5 * math.pi, other.heading, other.heading + 0.5 * math.pi):
        nx, ny = math.cos(heading), math.sin(heading)
        reach = _half_shadow(one, nx, ny) + _half_shadow(other, nx, ny)
        distance, rate = dx * nx + dy * ny, vx * nx + vy * ny
        if rate == 0.0:
            if abs(distance) > reach:
                return math.inf
            continue
        first, second = (-reach - distance) / rate, (reach - distance) / rate
        enters, leaves = max(enters, min(first, second)), min(leaves, max(first, second))
    return enters if enters <= leaves else math.inf


def _half_shadow(box: Box, nx: float, ny: float) -> float:
    ux, uy = math.cos(box.heading), math.sin(box.heading)
    return 0.5 * (box.length * abs(ux * nx + uy * ny) + box.width * abs(ux * ny - uy * nx))


def clamp(value: float, low: float, high: float) -> float:
    """Return the value, held between two bounds; NaN stays NaN, so that the next boundary sees it."""
    return low if value < low else high if value > high else value


def rate_limit(target: float, previous: float, rate: float, period: float) -> float:
    """Move from the previous value towards the target by no more than rate * period."""
    step = rate * period
    return clamp(target, previous - step, previous + step)


def jerk_limit(
    target: float, previous: float, low: float, high: float, jerk_down: float, jerk_up: float, period: float
) -> float:
    """Hold an acceleration inside [low, high] [m/s2], then its change inside the two jerks [m/s3].

    A previous value outside the bounds comes back at the jerk's pace, not at once.
    """
    return clamp(clamp(target, low, high), previous - jerk_down * period, previous + jerk_up * period)


class PI:
    """Proportional and integral action on an error, the output bounded, the integral never wound up.

    While the output is at a bound the integral only moves away from it (conditional integration, Åström
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
        """Forget the past."""
        self.integral = 0.0
