"""Estimates where a person is now, how fast, and how uncertain that is, from the positions that are believed.

A Kalman filter of a place and a velocity that changes at random (white-noise acceleration: Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, chapter 6.2). Errors are the same in every
direction, so both axes share their variances and the uncertainty is a circle. Knows no virtual road.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.people.report_gate import Place

#: Radius of the circle that holds 95 % of an error with standard deviation 1 on each of two axes: sqrt(-2 ln 0.05).
CIRCLE_95: Final = math.sqrt(-2.0 * math.log(0.05))

#: How fast a person's velocity wanders, by kind: variance gained in a second, on each axis [m2/s3]. A person who walks
#: at 1.4 m/s stops, sets off or turns about within a second or two; an assumption, as is the bicycle's.
WANDERING: Final = {"pedestrian": 0.5, "bicycle": 1.0}

#: For longer than this after the newest position [s] a person is not taken to go on as they went: the place then
#: stays, and its circle grows.
EXTRAPOLATION: Final = 2.0

#: Below this speed [m/s] the estimated velocity is the positions' noise: the person is taken to stand.
MIN_SPEED: Final = 0.5


class Estimate(NamedTuple):
    """Where a person is at a time, in the field's map."""

    x: float  #: [m]
    y: float  #: [m]
    speed: float  #: [m/s]; 0 below MIN_SPEED
    heading: float  #: direction of motion, or the direction faced where they stand [rad], counter-clockwise from +x
    radius: float  #: of the circle that holds the place with 95 % [m]
    age: float  #: of the newest position [s]


class Track:
    """The filter of one person, begun by the first position."""

    def __init__(self, kind: str, max_speed: float, first: Place) -> None:
        self._wandering, self._max_speed = WANDERING[kind], max_speed
        self._x, self._y, self._vx, self._vy = first.x, first.y, 0.0, 0.0
        # Variances of place and velocity and their covariance, the same on both axes.
        self._pp, self._pv, self._vv = (first.accuracy / CIRCLE_95) ** 2, 0.0, (0.5 * max_speed) ** 2
        self._newest, self._facing = first, 0.0

    def update(self, place: Place, facing: float) -> None:
        """Take a believed position, newer than the last; `facing` is where the person says they face, NaN for unknown.

        Angles are in the field's map [rad].
        """
        self._x, self._y, self._pp, self._pv, self._vv = self._predicted(place.time - self._newest.time)
        noise = (place.accuracy / CIRCLE_95) ** 2
        gain, gain_velocity = self._pp / (self._pp + noise), self._pv / (self._pp + noise)
        off_x, off_y = place.x - self._x, place.y - self._y
        self._x, self._y = self._x + gain * off_x, self._y + gain * off_y
        self._vx, self._vy = self._vx + gain_velocity * off_x, self._vy + gain_velocity * off_y
        self._vv -= gain_velocity * self._pv
        self._pv *= 1.0 - gain
        self._pp *= 1.0 - gain
        speed = math.hypot(self._vx, self._vy)
        if speed > self._max_speed:
            self._vx, self._vy = self._vx * self._max_speed / speed, self._vy * self._max_speed / speed
        self._newest = place
        self.face(facing)

    def face(self, facing: float) -> None:
        """Take where the person says they face [rad]; NaN for unknown."""
        if math.isfinite(facing):
            self._facing = facing
        if math.hypot(self._vx, self._vy) >= MIN_SPEED:
            self._facing = math.atan2(self._vy, self._vx)

    def at(self, time: float) -> Estimate:
        """Return the estimate for a drive time [s].

        The circle is never smaller than that of the newest position: a receiver's errors hold for minutes, and the
        mean of many positions does not take them away.
        """
        age = max(time - self._newest.time, 0.0)
        x, y, variance, _, _ = self._predicted(age)
        speed = math.hypot(self._vx, self._vy) if age <= EXTRAPOLATION else 0.0
        radius = max(CIRCLE_95 * math.sqrt(variance), self._newest.accuracy)
        return Estimate(x, y, speed if speed >= MIN_SPEED else 0.0, self._facing, radius, age)

    def _predicted(self, step: float) -> tuple[float, float, float, float, float]:
        """Return place, and the three variances, a time [s] after the newest position."""
        going, gained = min(step, EXTRAPOLATION), self._wandering * step
        variance = self._pp + step * (2.0 * self._pv + step * (self._vv + gained / 3.0))
        covariance = self._pv + step * (self._vv + 0.5 * gained)
        return self._x + going * self._vx, self._y + going * self._vy, variance, covariance, self._vv + gained
