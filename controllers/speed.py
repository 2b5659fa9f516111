"""Keeps the desired speed, slower where the path bends: accelerations within comfort.

It must not know other road users; who wants to stop for one asks for less acceleration than this.
"""

from __future__ import annotations

import math
from typing import Final, Protocol

from vve_sumo.laws import PI, squared_speed_limits
from vve_sumo.path import SAMPLE_SPACING, ReferencePath
from vve_sumo.values import Vehicle

LATERAL_COMFORT: Final = 2.0  #: lateral acceleration in bends [m/s2]
SLOWING: Final = 1.5  #: deceleration ahead of bends [m/s2]
SPEEDING_UP: Final = 1.5  #: [m/s2]
NO_SPEED_LIMIT: Final = 60.0  #: stands for "no limit" in the table, so that differences stay finite [m/s]
LEARNING_BAND: Final = 0.5  #: greater speed errors are transients and teach nothing [m/s]
TRACKING: Final = 0.8  #: acceleration for each m/s of speed error [1/s]
LEARNING: Final = 0.05  #: integral gain [1/s2]: what throttle map and drag get wrong goes in about 16 s


class SpeedProfile:
    """The greatest speed at each s that keeps bends comfortable and can be braked down to in time."""

    def __init__(self, path: ReferencePath, lateral: float = LATERAL_COMFORT, slowing: float = SLOWING) -> None:
        """`lateral` and `slowing`: accelerations in bends and ahead of them [m/s2]."""
        table = path.samples
        self._first = float(table.s[0])
        self._squares = squared_speed_limits(table.curvature.tolist(), NO_SPEED_LIMIT, lateral, slowing, SAMPLE_SPACING)

    def at(self, s: float) -> tuple[float, float]:
        """Return the speed [m/s] and the acceleration along the profile [m/s2] at s [m]."""
        place = min(max((s - self._first) / SAMPLE_SPACING, 0.0), len(self._squares) - 1.001)
        row = int(place)
        here, there = self._squares[row], self._squares[row + 1]
        return math.sqrt(here + (place - row) * (there - here)), (there - here) / (2.0 * SAMPLE_SPACING)


class Profile(Protocol):
    """Whatever limits the speed along a path."""

    def at(self, s: float) -> tuple[float, float]:
        """Return the speed [m/s] and the acceleration along the profile [m/s2] at s [m]."""
        ...


class SpeedKeeper:
    """PI on the desired speed; P and feedforward on the profile of the bends, whichever asks for less."""

    def __init__(self, vehicle: Vehicle, period: float) -> None:
        self._period = period
        self._answer = vehicle.brake_delay + vehicle.brake_lag + period
        self._loop = PI(TRACKING, LEARNING, -SLOWING, SPEEDING_UP)

    def step(
        self, profile: Profile, s: float, speed: float, acceleration: float, desired: float, governing: bool
    ) -> float:
        """Return the acceleration [m/s2]; learns only while its own last answer was `governing` the car.

        `speed` and `acceleration` are measured at `s` [m]; the command acts on what comes of them.
        """
        speed += acceleration * self._answer
        error = desired - speed
        cruise = self._loop.step(error, self._period if governing and abs(error) < LEARNING_BAND else 0.0)
        bend_speed, along = profile.at(s + speed * self._answer)
        bend = max(along, -SLOWING) + TRACKING * (bend_speed - speed)
        return min(cruise, bend)
