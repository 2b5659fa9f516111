"""Learns the steering angle that drives straight: the steering wheel's own zero is off by a degree or two.

It must not know which law steers; its answer is added to the law's.
"""

from __future__ import annotations

from typing import Final

from vve_sumo.laws import clamp
from vve_sumo.values import Vehicle

LIMIT: Final = 0.02  #: road-wheel angle [rad]: 17 deg at the wheel, far beyond any honest zero error
MIN_SPEED: Final = 0.5  #: nothing is learnt while parked [m/s]
MAX_OFFSET: Final = 0.3  #: a greater deviation is an event, not an offset, and counts as this much [m]


class SteeringTrim:
    """Slow, bounded integral of the deviation over the distance driven.

    Against the law's own 2 L / ls^2 and its look-ahead ls the rate is `share` * 2 L / ls^3: with 0.2 an offset
    is learnt over about four look-aheads, and the loop keeps its damping.
    """

    def __init__(self, vehicle: Vehicle, share: float, look_ahead_time: float, look_ahead_least: float) -> None:
        """`share`: of the law's stiffness, 0 learns nothing; look-ahead as the law's [s], [m]."""
        self._gain = share * 2.0 * vehicle.wheelbase
        self._time, self._least = look_ahead_time, look_ahead_least
        self.angle = 0.0  #: road-wheel angle to add [rad]

    def step(self, offset: float, speed: float, period: float, saturated: bool) -> float:
        """Advance by a period [s]; while the steering is saturated nothing is learnt."""
        if speed > MIN_SPEED and not saturated:
            look_ahead = max(self._least, self._time * speed)
            rate = self._gain / (look_ahead * look_ahead * look_ahead)
            learnt = self.angle - rate * clamp(offset, -MAX_OFFSET, MAX_OFFSET) * speed * period
            self.angle = clamp(learnt, -LIMIT, LIMIT)
        return self.angle
