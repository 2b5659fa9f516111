"""A road for matrices of emergency braking: the package's radar, boxes on prescribed courses, a car that brakes.

The car keeps to its path, by default a straight one. No SUMO and no steering: a second of drive takes
milliseconds. The controllers on trial are the shipped ones.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tests import vehicles
from vve_sumo.controller import Controller
from vve_sumo.geometry import Box, overlap
from vve_sumo.path import ReferencePath
from vve_sumo.sensors.radar import BEFORE_FIRST_SCAN, Radar, RadarConfig
from vve_sumo.values import Actors, ControlCommand, Detections, Observation, Point, Pose

PERIOD, SUBSTEPS = 0.02, 4
EMERGENCY_JERK = 30.0  # of the gateway [m/s3]
KMH, G = 1.0 / 3.6, 9.81
ROAD = ReferencePath.from_points([0.0, 1000.0], [0.0, 0.0])
CAR = vehicles.FUSION.vehicle


class Body(NamedTuple):
    """Something on the virtual road: where the middle of its box is at a time [s], and its sizes [m]."""

    place: Callable[[float], tuple[float, float, float, float]]  #: x, y, heading, speed
    length: float = 4.5
    width: float = 1.8
    cross_section: float = 10.0


def steady(x: float, y: float, speed: float = 0.0, heading: float = 0.0, **sizes: float) -> Body:
    """A body that keeps its speed; x and y of its middle at time 0."""
    vx, vy = speed * math.cos(heading), speed * math.sin(heading)
    return Body(lambda time: (x + vx * time, y + vy * time, heading, speed), **sizes)


def walker(ego_speed: float, arrives: float, at_offset: float, speed: float, from_right: bool = True,
           size: tuple[float, float] = (0.5, 0.6)) -> Body:  # fmt: skip
    """One who crosses so that an unbraked ego's bumper meets its middle at `at_offset` [m] after `arrives` [s]."""
    side = 1.0 if from_right else -1.0
    x = CAR.rear_axle_to_bumper + ego_speed * arrives + 0.5 * size[1]
    return steady(x, at_offset - side * speed * arrives, speed, side * 0.5 * math.pi,
                  length=size[0], width=size[1], cross_section=0.5)  # fmt: skip


def from_kerb(ego_speed: float, aside: float, at_offset: float, speed: float, within: float,
              size: tuple[float, float] = (0.6, 0.5), stops: float = math.inf, late: float = 0.0) -> Body:  # fmt: skip
    """One who waits `aside` [m, left positive], comes to a speed `within` a way, and is met at `at_offset` after 4 s.

    So it is unless he comes `late` [s]; one who `stops` so far from the kerb does so with 2 m/s2.
    """
    side, brakes = math.copysign(1.0, aside), speed * speed / 4.0
    gains = 0.5 * speed * speed / within
    sets_out = 4.0 + late - (abs(aside - at_offset) + within) / speed

    def gone(time: float) -> tuple[float, float]:
        walks = max(time - sets_out, 0.0)
        if walks < speed / gains:
            return 0.5 * gains * walks * walks, gains * walks
        way = within + speed * (walks - speed / gains)
        braked = min(max(way - (stops - brakes), 0.0) / speed, 0.5 * speed)
        return (way, speed) if not braked else (stops - brakes + speed * braked - braked**2, speed - 2.0 * braked)

    def place(time: float) -> tuple[float, float, float, float]:
        way, pace = gone(time)
        return x, aside - side * way, -side * 0.5 * math.pi, pace

    x = CAR.rear_axle_to_bumper + 4.0 * ego_speed + 0.5 * size[1]
    return Body(place, length=size[0], width=size[1], cross_section=1.0)


def changes_lane(x: float, y: float, speed: float, begins: float, lasts: float) -> Body:
    """A car that comes over from `y` to the middle of the road, with the least jerk; x and y of its middle."""

    def place(time: float) -> tuple[float, float, float, float]:
        share = min(max((time - begins) / lasts, 0.0), 1.0)
        rate = -y * 30.0 * share**2 * (1.0 - share) ** 2 / lasts
        aside = y * (1.0 - share**3 * (10.0 - 15.0 * share + 6.0 * share * share))
        return x + speed * time, aside, math.atan2(rate, speed), math.hypot(rate, speed)

    return Body(place)


def weaves(x: float, y: float, speed: float, swing: float, period: float, phase: float) -> Body:
    """A car that swings [m] to both sides of `y` in a period [s]; x and y of its middle, phase [rad]."""
    pace = math.tau / period

    def place(time: float) -> tuple[float, float, float, float]:
        rate = swing * pace * math.cos(pace * time + phase)
        aside = y + swing * math.sin(pace * time + phase)
        return x + speed * time, aside, math.atan2(rate, speed), math.hypot(rate, speed)

    return Body(place)


def braking_lead(gap: float, speed: float, deceleration: float, build_up: float, since: float) -> Body:
    """A car ahead that brakes to rest from a time [s] on, its deceleration building up linearly [s]."""
    step, ahead = 0.005, [(CAR.rear_axle_to_bumper + gap + 2.25, speed)]
    while len(ahead) < 12000:
        x, v = ahead[-1]
        late = step * len(ahead) - since
        share = 0.0 if late <= 0.0 else min(late / build_up, 1.0) if build_up else 1.0
        slower = max(v - deceleration * share * step, 0.0)
        ahead.append((x + 0.5 * (v + slower) * step, slower))

    def place(time: float) -> tuple[float, float, float, float]:
        x, v = ahead[min(round(time / step), len(ahead) - 1)]
        return x, 0.0, 0.0, v

    return Body(place)


class Ride(NamedTuple):
    """What came of a ride."""

    impact: float  #: relative speed at contact [m/s]; 0 without one
    least_gap: float  #: along the car's axis to what was ahead in its width; inf where nothing was [m]
    hardest: float  #: acceleration [m/s2]
    began: float  #: when the emergency did [s]; NaN never
    speed: float  #: at the end [m/s]


class Brakes:
    """Gateway's jerk, dead time, torque ceiling, first-order lag; a heavier car gets less of the same torque."""

    def __init__(self, mass_factor: float) -> None:
        steps = round((PERIOD + CAR.brake_delay) / PERIOD * SUBSTEPS)
        self._way = deque([0.0] * steps)
        self._mass_factor, self._granted, self.acceleration = mass_factor, 0.0, 0.0

    def step(self, setpoint: ControlCommand) -> list[float]:
        """Go on by one period; return the acceleration of each substep."""
        jerk, least = (EMERGENCY_JERK, -9.0) if setpoint.emergency else (5.0, -3.5)
        wanted = min(max(setpoint.acceleration, least), 2.0)
        self._granted += min(max(wanted - self._granted, -jerk * PERIOD), jerk * PERIOD)
        share = 1.0 - math.exp(-PERIOD / SUBSTEPS / CAR.brake_lag)
        course = []
        for _ in range(SUBSTEPS):
            self._way.append(max(self._granted, -CAR.deceleration_limit))
            self.acceleration += share * (self._way.popleft() / self._mass_factor - self.acceleration)
            course.append(self.acceleration)
        return course


def ride(controller: Controller, speed: float, bodies: Sequence[Body], seconds: float, *, seed: int = 0,
         ideal: bool = False, mass_factor: float = 1.0, begins: float = 0.0, stays: bool = False,
         path: ReferencePath = ROAD) -> Ride:  # fmt: skip
    """Drive along a path from a speed [m/s] for some seconds, or to contact, or to rest unless it `stays`.

    `ideal` takes noise and misses from the radar, `begins` shifts its scans against the ticks [s].
    """
    generator = np.random.default_rng(seed)
    config = RadarConfig().ideal() if ideal else RadarConfig()
    radar, brakes = Radar(config, CAR, generator), Brakes(mass_factor)
    s, v, newest, began, least_gap, hardest = 0.0, speed, BEFORE_FIRST_SCAN, math.nan, math.inf, 0.0
    for tick in range(round(seconds / PERIOD)):
        time = tick * PERIOD
        places = [body.place(time) for body in bodies]
        at = path.at(s)
        pose = Pose(time, Point.REAR_AXLE, at.x, at.y, at.heading, v, 0.0, v * at.curvature, brakes.acceleration, 0.0)
        impact, gap = _contact(pose, bodies, places)
        least_gap = min(least_gap, gap)
        if impact is not None or (v <= 0.0 and not stays):
            return Ride(impact or 0.0, least_gap, hardest, began, v)
        newest = _scanned(radar, time + begins, pose, bodies, places, newest)
        setpoint = controller.step(Observation(tick, time, pose, path, speed, {"radar": newest}, 0.0))
        if setpoint.emergency and math.isnan(began):
            began = time
        for acceleration in brakes.step(setpoint):
            slower = max(v + acceleration * PERIOD / SUBSTEPS, 0.0)
            s, v = s + 0.5 * (v + slower) * PERIOD / SUBSTEPS, slower
        hardest = min(hardest, brakes.acceleration)
    return Ride(0.0, least_gap, hardest, began, v)


def _scanned(radar: Radar, due: float, pose: Pose, bodies: Sequence[Body],
             places: Sequence[tuple[float, float, float, float]], newest: Detections) -> Detections:  # fmt: skip
    columns = np.array(places, dtype=float).reshape(-1, 4).T.copy()
    sizes = np.array([body[1:] for body in bodies], dtype=float).reshape(-1, 3).T.copy()
    names = tuple(f"body{i}" for i in range(len(bodies)))
    shapes = np.zeros(len(bodies)), np.full(len(bodies), 1.5), np.zeros(len(bodies), np.int8)
    scan = radar.step(due, pose, Actors(due, names, *columns, *sizes, *shapes))
    return newest if scan is None else replace(scan.detections, time=scan.detections.time - (due - pose.time))


def _contact(pose: Pose, bodies: Sequence[Body], places: Sequence[tuple[float, float, float, float]]
             ) -> tuple[float | None, float]:  # fmt: skip
    """Return the speed along the car's axis at which it touches a body, None for no contact, and the least gap [m]."""
    own = Box(CAR.rear_axle_to_bumper - 0.5 * CAR.length, 0.0, 0.0, CAR.length, CAR.width)
    cos_car, sin_car = math.cos(pose.heading), math.sin(pose.heading)
    least_gap = math.inf
    for body, (body_x, body_y, heading, speed) in zip(bodies, places, strict=True):
        away_x, away_y, turned = body_x - pose.x, body_y - pose.y, heading - pose.heading
        x, y = away_x * cos_car + away_y * sin_car, away_y * cos_car - away_x * sin_car
        cos, sin = math.cos(turned), math.sin(turned)
        half_x = 0.5 * (body.length * abs(cos) + body.width * abs(sin))
        half_y = 0.5 * (body.length * abs(sin) + body.width * abs(cos))
        if abs(y) > half_y + 0.5 * CAR.width or x + half_x < own.x - 0.5 * CAR.length:
            continue
        least_gap = min(least_gap, x - half_x - CAR.rear_axle_to_bumper)
        if least_gap < 1.0 and overlap(own, Box(x, y, turned, body.length, body.width)):
            return abs(pose.speed - speed * cos), least_gap
    return None, least_gap
