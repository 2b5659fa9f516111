"""How to come up to a place, or to something that moves: constant deceleration with a soft end, no creeping.

The speed over the remaining distance follows v^2 = 2 a d far out and dies out in proportion to the distance at
the end. It must not know what the place is: a car, a stop line, the end of the path.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.values import Vehicle

TRACKING: Final = 2.2  #: acceleration for each m/s off the profile [1/s]
SOFT_END: Final = 1.2  #: time constant of the end [s]: the deceleration fades below a * SOFT_END of speed
LAST_SPEED: Final = 0.4  #: at which the last bit begins [m/s]: the brakes are held on until rest
LAST_DECELERATION: Final = 0.5  #: of the last bit [m/s2]
STANDING: Final = 0.5  #: a target slower than this is standing [m/s]


class Goal(NamedTuple):
    """Somewhere not to be passed."""

    distance: float  #: still to go [m]
    speed: float = 0.0  #: at which it moves away along the path [m/s]


NOWHERE = Goal(math.inf)


class Approach:
    """Follows the profile, seeing the car as it will be when the brakes answer."""

    def __init__(self, vehicle: Vehicle, deceleration: float, period: float) -> None:
        """`deceleration` far out [m/s2]; `period` of the tick [s], which the command waits on its way."""
        self._deceleration = deceleration
        self._answer = vehicle.brake_delay + vehicle.brake_lag + period
        self._last_way = LAST_SPEED * LAST_SPEED / (2.0 * LAST_DECELERATION)
        self._bend_speed = deceleration * SOFT_END
        self._bend_distance = self._last_way + SOFT_END * (self._bend_speed - LAST_SPEED)

    def profile(self, distance: float) -> tuple[float, float]:
        """Return the closing speed [m/s] allowed at a distance [m] and the deceleration along the profile [m/s2]."""
        beyond = distance - self._bend_distance
        if beyond > 0.0:
            return math.sqrt(self._bend_speed**2 + 2.0 * self._deceleration * beyond), self._deceleration
        closing = LAST_SPEED + (distance - self._last_way) / SOFT_END
        return closing, closing / SOFT_END

    def acceleration(self, goal: Goal, speed: float, acceleration: float) -> float:
        """Return what to command [m/s2] at a measured speed [m/s] and acceleration [m/s2]."""
        wait, closing = self._answer, speed - goal.speed
        distance = goal.distance - closing * wait - 0.5 * acceleration * wait * wait
        allowed, slowing = self.profile(distance)
        return -slowing + TRACKING * (allowed - closing - acceleration * wait)

    def is_last_bit(self, goal: Goal, speed: float, acceleration: float) -> bool:
        """Tell whether the car shall now simply be braked to rest: slow, and the goal standing right ahead."""
        soon = speed + min(acceleration, 0.0) * self._answer
        return goal.speed < STANDING and soon <= LAST_SPEED and goal.distance < 3.0 * self._last_way


class Standstill:
    """Holds the car once it has come to a goal, until the goal has gone for good."""

    RELEASE_DISTANCE = 1.5  #: the goal is farther than this ... [m]
    RELEASE_TIME = 1.0  #: ... for this long [s]
    REST_SPEED = 0.05  #: [m/s]
    HOLD: Final = -1.0  #: pressed on at rest, also on a slope of 10 % [m/s2]

    def __init__(self, period: float) -> None:
        self._period = period
        self._gone = 0.0
        self._resting = False
        self.holding = False  #: the car is being braked to rest, or held

    def step(self, distance: float, speed: float, last_bit: bool, at_once: bool = False) -> float | None:
        """Return the acceleration that holds the car [m/s2], or None while nothing does.

        `at_once`: it has been decided to set out, so a goal that has gone is not waited for.
        """
        self._gone = self._gone + self._period if distance > self.RELEASE_DISTANCE else 0.0
        self.holding = last_bit or (self.holding and self._gone < (self._period if at_once else self.RELEASE_TIME))
        self._resting = self.holding and (self._resting or speed < self.REST_SPEED)
        if not self.holding:
            return None
        return self.HOLD if self._resting else -LAST_DECELERATION
