"""The distance that the car's brakes need in a test, by closed form, against the distance that is available.

Speeds, times and the declared car in, metres out. Knows no controller: these bounds hold for every controller.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vve_sumo.sensors.radar import RadarConfig
from vve_sumo.timing import PERIOD
from vve_sumo.values import Floats, Vehicle

#: from a target's first visibility, or its braking, to a confirmed track: three scans of 50 ms, a margin, latency [s]
DETECTION = 0.2 + RadarConfig().latency
FIRST_ORDER_RAMP = 2.0  #: a first-order lag T costs as much distance as a linear ramp over 2 T
STEP = 0.001  #: time step at which motions are compared [s]
ROUNDING = 1e-9  #: numerical difference of two speeds at rest [m/s]


class BrakedMotion(NamedTuple):
    """A motion: constant speed, then after a delay a deceleration that builds up linearly, down to a last speed."""

    speed: float  #: at first [m/s]
    deceleration: float = 0.0  #: [m/s2]
    delay: float = 0.0  #: [s]
    build_up: float = 0.0  #: [s]
    last_speed: float = 0.0  #: [m/s]

    def duration(self) -> float:
        """Time until its last speed [s]; its delay where it keeps its speed."""
        lost = self.speed - self.last_speed
        if lost <= 0.0 or self.deceleration <= 0.0:
            return self.delay
        if lost <= 0.5 * self.deceleration * self.build_up:
            return self.delay + math.sqrt(2.0 * lost * self.build_up / self.deceleration)
        return self.delay + lost / self.deceleration + 0.5 * self.build_up

    def at(self, times: Floats) -> tuple[Floats, Floats]:
        """Return distance [m] and speed [m/s] at times [s]."""
        end = self.duration()
        braked = np.clip(times, None, end) - self.delay
        ramp = np.clip(braked, 0.0, self.build_up)
        full = np.clip(braked - self.build_up, 0.0, None)
        jerk = self.deceleration / self.build_up if self.build_up > 0.0 else 0.0
        way = self.speed * np.minimum(times, end) - jerk * ramp**3 / 6.0
        way -= 0.5 * jerk * ramp**2 * full + 0.5 * self.deceleration * full**2
        speed = self.speed - 0.5 * jerk * ramp**2 - self.deceleration * full
        return way + np.clip(times - end, 0.0, None) * speed, speed


class Need(NamedTuple):
    """Whether physics allows a row to be passed."""

    needed: float  #: reduction of the gap by full braking [m]
    available: float  #: gap when the need to brake begins [m]

    @property
    def unit(self) -> str:
        """Unit of both."""
        return "m"

    @property
    def avoidable(self) -> bool:
        """Whether the available gap is larger than needed."""
        return self.available > self.needed


def reaction_time(vehicle: Vehicle, detection: float = DETECTION) -> float:
    """Return the time from the begin of the need to brake to the first brake torque [s].

    The sum contains every delay of the pipeline that no controller can shorten; no other sum does.
    """
    return detection + PERIOD + vehicle.brake_delay


def full_braking(
    vehicle: Vehicle, speed: float, mass_factor: float = 1.0, detection: float = DETECTION
) -> BrakedMotion:
    """Return the hardest braking of the car: its reaction time, and its declared lag and ceiling."""
    ceiling = vehicle.deceleration_limit / mass_factor
    return BrakedMotion(speed, ceiling, reaction_time(vehicle, detection), FIRST_ORDER_RAMP * vehicle.brake_lag)


def gap_used(ego: BrakedMotion, lead: BrakedMotion, allowed: float = 0.0) -> float:
    """Return the largest reduction of the gap [m] while it closes faster than `allowed` [m/s]."""
    times = np.arange(0.0, max(ego.duration(), lead.duration()) + 1.0, STEP)
    (own, speed), (others, other) = ego.at(times), lead.at(times)
    closing = speed - other > allowed + ROUNDING
    return max(0.0, float((own - others)[closing].max(initial=0.0)))


def first_sight_distance(corner: float, before: float, speed: float, pace: float, reach: float) -> float:
    """Return the distance at which a pedestrian behind a corner is first visible from the middle of the bumper [m].

    The corner is `corner` [m] beside the car's path and `before` [m] nearer than the pedestrian's path. The car drives
    at `speed`, the pedestrian walks at `pace` [m/s] with a front `reach` [m] before the centre, and the two would meet
    in the middle of the car's path. At a distance d, the front is p d / v - r beside the path, and the line of sight
    past the corner is c d / (d - b) beside it. Both are equal where
    p/v d^2 - (p/v b + r + c) d + r b = 0: the greater root.
    """
    slope = pace / speed
    linear = slope * before + reach + corner
    return (linear + math.sqrt(linear * linear - 4.0 * slope * reach * before)) / (2.0 * slope)
