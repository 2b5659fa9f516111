"""Learns the steering angle that drives straight: the steering wheel's own zero is off by a degree or two.

It must not know which law steers; its answer is added to the law's.
"""

from __future__ import annotations

from typing import Final

from vve_sumo.laws import clamp
from vve_sumo.values import Vehicle

from .deviation import steady_steering

LIMIT: Final = 0.02  #: road-wheel angle [rad]: 17 deg at the wheel, far beyond any honest zero error
MIN_SPEED: Final = 0.5  #: nothing is learnt while parked [m/s]
MAX_OFFSET: Final = 0.3  #: a greater deviation is an event, not an offset, and counts as this much [m]


def slow_rate(vehicle: Vehicle, share: float, washout_time: float, speed: float) -> float:
    """Return the rate of learning [rad/m2] that a loop bears whose law has an observer against delay around it.

    For about the `washout_time` 1/w [s] the observer hides what pushes the car, so that the loop answers to the trim
    with no more than the stiffness w^2 (L + K V^2) / V^2, after a way V/w: by a share of 1.4 of their quotient it
    swings (Routh, of s (s^2 + 2 D w s + w^2) + share w^3 with D = 0.7).
    """
    frequency = 1.0 / washout_time
    return share * frequency**3 * steady_steering(vehicle, speed, 1.0) / (speed * speed * speed)


class SteeringTrim:
    """Slow, bounded integral of the deviation over the distance driven.

    Against the law's own 2 L / ls^2 and its look-ahead ls the rate is `share` * 2 L / ls^3: with 0.2 an offset
    is learnt over about four look-aheads, and the loop keeps its damping. Around an observer against delay it is no
    more than `slow_rate`.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        share: float,
        look_ahead_time: float,
        look_ahead_least: float,
        washout_time: float | None = None,
    ) -> None:
        """`share`: of the law's stiffness, 0 learns nothing; look-ahead as the law's [s], [m].

        `washout_time` is that of an observer against delay around the law [s]; None without one.
        """
        self._vehicle, self._share, self._washout_time = vehicle, share, washout_time
        self._gain = share * 2.0 * vehicle.wheelbase
        self._time, self._least = look_ahead_time, look_ahead_least
        self.angle = 0.0  #: road-wheel angle to add [rad]

    def step(self, d: float, speed: float, period: float, saturated: bool) -> float:
        """Advance by a period [s]; `d` is the rear axle's [m], left positive.

        While the steering is saturated nothing is learnt.
        """
        if speed > MIN_SPEED and not saturated:
            look_ahead = max(self._least, self._time * speed)
            rate = self._gain / (look_ahead * look_ahead * look_ahead)
            if self._washout_time is not None:
                rate = min(rate, slow_rate(self._vehicle, self._share, self._washout_time, speed))
            learnt = self.angle - rate * clamp(d, -MAX_OFFSET, MAX_OFFSET) * speed * period
            self.angle = clamp(learnt, -LIMIT, LIMIT)
        return self.angle
