"""Tells whether a gap is long enough to cross or to join a way on which others go first: closed forms, no geometry.

All others go on as they are, or speed up to their limit. It must not know how others are seen.
"""

from __future__ import annotations

import math
from typing import NamedTuple

SPEEDING_UP = 1.0  #: others may speed up by this up to their limit [m/s2]
SLOWING_DOWN = 4.0  #: others slow down to their speed inside the junction by this at most [m/s2]
BRAKING = 2.0  #: who comes from behind a car that joined brakes by this at most [m/s2]
AFTER = 0.7  #: the car comes so long after one who has passed [s]
PASSING = 2.0  #: only who is faster passes before the car, with a time that is known [m/s]


class Run(NamedTuple):
    """How the car goes on from here: after a delay it speeds up steadily to a speed that it keeps."""

    speed: float  #: now [m/s]
    acceleration: float  #: [m/s2]
    top: float  #: the speed that it keeps [m/s]
    delay: float = 0.0  #: for which it keeps its speed of now [s]

    def time(self, distance: float) -> float:
        """Return the time after which it has gone a distance [s]."""
        if distance <= 0.0:
            return 0.0
        at_once = self.speed * self.delay
        if distance <= at_once:
            return distance / self.speed
        return self.delay + time_to_reach(distance - at_once, self.speed, self.acceleration, self.top)

    def speed_at(self, distance: float) -> float:
        """Return its speed when it has gone a distance [m/s]."""
        gone = max(distance - self.speed * self.delay, 0.0)
        return min(math.sqrt(self.speed**2 + 2.0 * self.acceleration * gone), max(self.top, self.speed))


class Coming(NamedTuple):
    """One who comes on a way that goes first."""

    distance: float  #: from its front to where the ways meet [m]; negative within
    past: float  #: from its rear to where they part [m]; negative once it has left
    speed: float  #: [m/s]
    top: float  #: that it may speed up to [m/s]
    across: float = math.inf  #: greatest speed where the ways meet [m/s]

    @property
    def arrival(self) -> float:
        """The time to where the ways meet, at the least [s]."""
        soonest = time_to_reach(self.distance, self.speed, SPEEDING_UP, self.top)
        return max(soonest, time_to_slow(self.distance, max(self.speed, self.top), self.across, SLOWING_DOWN))


def time_to_reach(distance: float, speed: float, acceleration: float, top: float) -> float:
    """Return the time to go a distance [s], speeding up steadily from a speed [m/s] to `top`; faster stays as fast."""
    if distance <= 0.0:
        return 0.0
    top = max(top, speed)
    way = (top * top - speed * speed) / (2.0 * acceleration)
    if distance <= way:
        return (math.sqrt(speed * speed + 2.0 * acceleration * distance) - speed) / acceleration
    return (top - speed) / acceleration + (distance - way) / top


def time_to_slow(distance: float, speed: float, across: float, deceleration: float) -> float:
    """Return the time to go a distance [s] at a speed [m/s] that has steadily come down to `across` at its end."""
    if distance <= 0.0 or across >= speed:
        return 0.0
    way = (speed * speed - across * across) / (2.0 * deceleration)
    if distance <= way:
        return (math.sqrt(across * across + 2.0 * deceleration * distance) - across) / deceleration
    return (distance - way) / speed + (speed - across) / deceleration


def may_cross(run: Run, begin: float, end: float, other: Coming, margin: float) -> bool:
    """Tell whether the car is past before another comes, by a margin [s], or comes after the other has passed.

    `begin` and `end` are how far the car has to go until its front is where the ways meet and its rear where they part
    [m].
    """
    if other.past <= 0.0:
        return True
    if other.speed > PASSING and other.past / other.speed + AFTER < run.time(begin):
        return True
    return other.arrival > run.time(end) + margin


def may_join(run: Run, begin: float, joined: float, other: Coming, margin: float) -> bool:
    """Tell whether the car may go on ahead of another on its way: who needs not brake harder than BRAKING for it.

    `begin` is how far the car has to go until its front is where the ways meet, `joined` until its rear is there [m].
    Who is past that place is somebody to follow, not to give way to.
    """
    if other.distance <= -other.past:
        return True
    if other.speed > PASSING and (max(other.distance, 0.0) + other.past) / other.speed + AFTER < run.time(begin):
        return True
    time, speed = run.time(joined), run.speed_at(joined)
    fastest = max(other.top, other.speed)
    then = min(fastest, other.across)
    left = other.distance - fastest * time
    return left > margin * then + max(then - speed, 0.0) ** 2 / (2.0 * BRAKING)
