"""Where targets lie along a recorded way, and how far the car is off it: what the brains that follow by a law share.

Other than `driving.Brain`, which bends its corridor with its steering, these know their way and look along it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from driving import BUMPER, Brain, Seen

from vve_sumo.values import Fix

HALF_WIDTH = 1.5  # of the way that is looked along [m]
WINDOW = 80  # points of the way that are looked at from the nearest one on
HOLD_SPEED, HOLD_GAP = 0.6, 1.5  # slower, and not farther before the wanted gap, the car is held [m/s], [m]


class Lead(NamedTuple):
    """What is ahead on the way."""

    gap: float  #: from the front bumper [m]
    closing: float  #: speed at which the gap shrinks [m/s]


class Spot(NamedTuple):
    """A place beside the way."""

    along: float  #: the way [m]
    aside: float  #: of it [m], left positive
    heading: float  #: of the way there [rad]


class Follower(Brain):
    """A brain that keeps a law to what is ahead on its way; steering and law are its kinds'."""

    standoff = 4.0  # [m]

    def __init__(self, waypoints: list[tuple[float, float]], speed: float) -> None:
        super().__init__(waypoints, speed)
        self._along = [0.0]
        for (ax, ay), (bx, by) in zip(self._path, self._path[1:], strict=False):
            self._along.append(self._along[-1] + math.hypot(bx - ax, by - ay))

    def answer(self, fix: Fix, radar: Seen) -> tuple[float, float]:
        """Return steering [rad] and acceleration [m/s2] for a valid fix and radar datagram."""
        x, y = self._rear_axle(fix)
        ranges = [math.hypot(px - x, py - y) for px, py in self._path[self._nearest : self._nearest + WINDOW]]
        self._nearest += ranges.index(min(ranges))
        free = self._speeds[min(self._nearest + 5, len(self._speeds) - 1)]
        lead = self._lead(x, y, fix.heading, radar)
        if lead is not None and radar.speed < HOLD_SPEED and lead.gap < self.standoff + HOLD_GAP:
            return self.steering(x, y, fix.heading, radar.speed), -1.0
        return self.steering(x, y, fix.heading, radar.speed), max(self.law(radar.speed, free, lead), -6.0)

    def steering(self, x: float, y: float, heading: float, speed: float) -> float:
        """Return the road-wheel angle [rad] for a pose of the rear axle."""
        raise NotImplementedError

    def law(self, speed: float, free: float, lead: Lead | None) -> float:
        """Return the acceleration [m/s2] behind a lead where there is one, at the way's `free` speed [m/s]."""
        raise NotImplementedError

    def spot(self, x: float, y: float) -> Spot:
        """Return where a place lies beside the way, of which the car is near."""
        path, low = self._path, max(self._nearest - 5, 0)
        high = min(low + WINDOW, len(path) - 1)
        n = min(range(low, high), key=lambda k: math.hypot(path[k][0] - x, path[k][1] - y))
        n = min(n, len(path) - 2)
        (ax, ay), (bx, by) = path[n], path[n + 1]
        heading = math.atan2(by - ay, bx - ax)
        cos, sin = math.cos(heading), math.sin(heading)
        return Spot(self._along[n] + cos * (x - ax) + sin * (y - ay), cos * (y - ay) - sin * (x - ax), heading)

    def _lead(self, x: float, y: float, heading: float, radar: Seen) -> Lead | None:
        here = self.spot(x, y).along + BUMPER
        cos, sin = math.cos(heading), math.sin(heading)
        found: Lead | None = None
        for target in radar.targets:
            azimuth = self.azimuth(target)
            ahead, left = BUMPER + target.range * math.cos(azimuth), target.range * math.sin(azimuth)
            spot = self.spot(x + cos * ahead - sin * left, y + sin * ahead + cos * left)
            # What comes towards the car is in the other lane.
            if abs(spot.aside) > HALF_WIDTH or self.range_rate(target) < -1.5 * max(radar.speed, 1.0):
                continue
            closing = -self.range_rate(target)
            gap = spot.along - here - radar.speed * self.age(radar)
            if gap > 0.0 and (found is None or gap < found.gap):
                found = Lead(gap, closing)
        return found
