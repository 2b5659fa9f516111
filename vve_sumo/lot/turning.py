"""How far setpoints may still turn the wheel before a stop begins, by the bounds of the gateway's limiter.

The angle that the car reports lags behind the commanded one, and the last good setpoint is acted on until it expires.
Arithmetic only; knows neither lot nor body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vve_sumo.timing import PERIOD
from vve_sumo.values import Floats, Vehicle

PANELS: Final = 8  #: of the integration, for each interval between knots

Angles = tuple[float, float]  #: least and greatest road-wheel angle [rad], left positive


@dataclass(frozen=True, slots=True)
class Turning:
    """What the limiter lets setpoints do to the road-wheel angle."""

    wheelbase: float  #: [m]
    limit: float  #: greatest angle [rad]
    rate: float  #: greatest rate by the car [rad/s]
    lateral_jerk: float  #: greatest from steering [m/s3]
    answer_time: float  #: by which the reported angle lags behind the commanded one [s]
    lifetime: float  #: from a setpoint's time until the gateway no longer acts on it [s]
    acceleration: float  #: greatest that setpoints may ask for [m/s2]

    @classmethod
    def of(cls, vehicle: Vehicle, lateral_jerk: float, lifetime: float, acceleration: float) -> Turning:
        """Return the car's."""
        answer_time = vehicle.steering_delay + vehicle.steering_lag + PERIOD  # a setpoint that came after the check
        return cls(
            vehicle.wheelbase,
            vehicle.steering_limit,
            vehicle.steering_rate_limit,
            lateral_jerk,
            answer_time,
            lifetime,
            acceleration,
        )

    def at_once(self, speed: float, steering: float, requested: Angles) -> Angles:
        """Angles that the car has been commanded when nothing is commanded any more.

        `steering` is the reported angle, `requested` holds the angles that the latest setpoints asked for.
        """
        return self._within(speed, steering, requested, PERIOD)

    def until_stop(self, speed: float, steering: float, requested: Angles) -> Angles:
        """Angles that the last good setpoint may have turned the wheel to when the gateway begins to stop."""
        return self._within(speed, steering, requested, self.lifetime)

    def led_astray(
        self, knots: Floats, spacing: float, speed: float, steering: float, requested: Angles
    ) -> list[Floats]:  # fmt: skip
        """Curvatures [1/m] of a car whose wheel setpoints turned away from a fallback path before it was followed.

        One for either side; `knots` are the path's, given every `spacing` [m]. The wheel turns at the limiter's rate
        until the gateway stops and the steering answers, T, then back at that rate. Each knot holds the mean around
        it, so that the heading is right. The wheel is back after 2 T at the latest. Until then the way is at most
        v t + a t^2 / 2 with the greatest acceleration a, less than that of a car which is faster by a T all the time;
        no brakes count.
        """
        rate = self._rate(speed)
        until = self.lifetime + self.answer_time
        fast = speed + self.acceleration * until
        count = PANELS * (len(knots) - 1) + 1
        s = np.arange(count) * (spacing / PANELS)
        ways = []
        for angle in self.until_stop(speed, steering, requested):
            rise = min(abs(angle - steering) / rate, until)
            bend = (math.tan(angle) - math.tan(steering)) / self.wheelbase
            away = np.interp(s, fast * np.array([0.0, rise, until, until + rise]), [0.0, bend, bend, 0.0])
            turned = np.concatenate(([0.0], np.cumsum(0.5 * (away[:-1] + away[1:]))))
            half = turned[PANELS // 2 :: PANELS]
            means = np.diff(half, prepend=0.0, append=turned[-1]) / PANELS
            means[0] *= 2.0  # of half an interval
            means[-1] *= 2.0
            ways.append(knots + means)
        return ways

    def _rate(self, speed: float) -> float:
        """Greatest rate of the road-wheel angle [rad/s]; the limiter's, v^2 rate / wheelbase <= lateral jerk."""
        square = speed * speed
        if square * self.rate <= self.lateral_jerk * self.wheelbase:
            return self.rate
        return self.lateral_jerk * self.wheelbase / square

    def _within(self, speed: float, steering: float, requested: Angles, duration: float) -> Angles:
        """Least and greatest angle: as far as earlier requests lead within the answer time, any for `duration` [s]."""
        rate = self._rate(speed)
        answered, newest = rate * self.answer_time, rate * duration
        low = steering - min(answered, max(steering - requested[0], 0.0)) - newest
        high = steering + min(answered, max(requested[1] - steering, 0.0)) + newest
        # A report beyond the limit is no reason to check less than where the wheel is.
        return max(low, min(steering, -self.limit)), min(high, max(steering, self.limit))
