"""A road for controllers that steer around: the package's radar and lidar, boxes that move as told, a single-track car.

No SUMO: a second of drive takes tenths of one. The gateway's limiter stands between controller and car.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from shapely.geometry import Polygon

from tests import vehicles
from tests.controllers.bench import Body
from tests.controllers.street import PERIOD, Car, Flaws
from vve_sumo.body_kinds import TYPICAL, number_of
from vve_sumo.commanded_path import flaw
from vve_sumo.controller import Controller
from vve_sumo.geometry import Box
from vve_sumo.path import ReferencePath
from vve_sumo.sensors.lidar import Lidar, LidarConfig, empty_cloud
from vve_sumo.sensors.radar import BEFORE_FIRST_SCAN, Radar, RadarConfig
from vve_sumo.sensors.street import walls_of
from vve_sumo.values import Actors, ControlCommand, Observation
from vve_sumo.vehicle.limits import COMFORT, Limiter, Limits

CAR = vehicles.FUSION.vehicle
#: half of a VLP-16's rays
LIDAR = replace(LidarConfig(), steps=900)


@dataclass
class Drive:
    """What came of a drive: a row a tick."""

    time: np.ndarray
    s: np.ndarray  #: of the true rear axle
    d: np.ndarray  #: likewise
    speed: np.ndarray
    clearance: np.ndarray  #: of the bodies, between their polygons and the car's [m]
    emergency: np.ndarray
    commands: list[ControlCommand]
    lateral: np.ndarray  #: acceleration [m/s2]

    @property
    def least(self) -> float:
        return float(self.clearance.min())


def drive(
    controller: Controller, path: ReferencePath, speed: float, bodies: Sequence[Body], seconds: float, *,
    kinds: Sequence[str] = (), seed: int = 0, start: float | None = None, flaws: Flaws | None = None,
    until: float = math.inf, stop: Callable[[float], bool] | None = None,
) -> Drive:  # fmt: skip
    """Drive a path from its start at a speed [m/s] for some seconds, or to an s along it, or to contact."""
    random = np.random.default_rng(seed)
    car = Car(CAR, path, flaws or Flaws(), speed if start is None else start)
    radar, lidar = Radar(RadarConfig(), CAR, random), Lidar(LIDAR, random, walls_of(()))
    limiter, limits = Limiter(CAR, Limits(), CAR.steering_limit), COMFORT
    assert limits.lateral_jerk == 5.0
    scan, cloud = BEFORE_FIRST_SCAN, empty_cloud(LIDAR)
    names = list(kinds) or ["car"] * len(bodies)
    near, rows, commands = 0.0, [], []
    for tick in range(round(seconds / PERIOD)):
        time = tick * PERIOD
        actors = _actors(time, bodies, names)
        pose = car.pose(time, random)
        read = radar.step(time, pose, actors)
        scan = scan if read is None else read.detections
        lidar.step(time, pose, actors)
        command = controller.step(Observation(tick, time, pose, path, speed, {"radar": scan, "roof": cloud}, car.wheel))
        if command.path is not None:
            assert not flaw(command.path, pose)
        turn = lidar.prepare()
        cloud = cloud if turn is None else turn.cloud
        here = path.project(car.x, car.y, near)
        near = here.s
        own = _own(car)
        away = min((own.distance(_polygon(body, time)) for body in bodies), default=math.inf)
        rows.append((time, here.s, here.d, car.speed, away, command.emergency, car.speed * car.yaw_rate))
        commands.append(command)
        if away == 0.0 or here.s > until:
            break
        granted = limiter.step(command.acceleration, command.steering, car.speed, command.emergency, PERIOD)
        car.drive(replace(command, steering=granted.steering))
    columns = np.array(rows, dtype=float).T
    return Drive(*columns[:5], columns[5] > 0.5, commands, columns[6])


def _own(car: Car) -> Polygon:
    ahead = CAR.rear_axle_to_bumper - 0.5 * CAR.length
    x, y = car.x + ahead * math.cos(car.heading), car.y + ahead * math.sin(car.heading)
    return Polygon(Box(x, y, car.heading, CAR.length, CAR.width).corners())


def _polygon(body: Body, time: float) -> Polygon:
    x, y, heading, _speed = body.place(time)
    return Polygon(Box(x, y, heading, body.length, body.width).corners())


def _actors(time: float, bodies: Sequence[Body], kinds: Sequence[str]) -> Actors:
    if not bodies:
        return Actors.none(time)
    columns = np.array([body.place(time) for body in bodies], dtype=float).T.copy()
    sizes = np.array([body[1:] for body in bodies], dtype=float).T.copy()
    heights = np.array([TYPICAL[kind].height for kind in kinds])
    numbers = np.array([number_of(kind) for kind in kinds], np.int8)
    names = tuple(f"body{number}" for number in range(len(bodies)))
    return Actors(time, names, *columns, *sizes, np.zeros(len(bodies)), heights, numbers)
