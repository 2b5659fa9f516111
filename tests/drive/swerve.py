"""A controller that drives around what stands in its lane, and says so with a path of its own."""

from __future__ import annotations

import math

import numpy as np

from vve_sumo.path import ReferencePath
from vve_sumo.values import CommandedPath, ControlCommand, Observation, Vehicle

#: of a commanded path, from the car on [m]
REACH = 45.0


def over_and_back(along: tuple[float, float, float, float], aside: float, length: float = 300.0) -> ReferencePath:
    """Return a line along x that goes over by `aside` [m] between the first two places, and back between the others."""
    x = np.arange(0.0, length + 1.0, 1.0)
    begin, over, back, end = along

    def step(share: np.ndarray) -> np.ndarray:
        u = np.clip(share, 0.0, 1.0)
        return u**3 * (10.0 - 15.0 * u + 6.0 * u * u)

    return ReferencePath.from_points(x, aside * (step((x - begin) / (over - begin)) - step((x - back) / (end - back))))


class Swerver:
    """Steers along its own line by pure pursuit, at a constant speed; `says` whether its commands carry that line."""

    def __init__(self, vehicle: Vehicle, line: ReferencePath, speed: float, says: bool = True) -> None:
        self.vehicle, self.line, self.speed, self.says = vehicle, line, speed, says
        self.steered = line  #: what it steers along
        self.fails_from = math.inf  #: drive time from which it raises [s]
        self._s: float | None = None

    def step(self, observation: Observation) -> ControlCommand:
        if observation.time >= self.fails_from:
            raise RuntimeError("no idea")
        pose = observation.pose
        self._s = self.steered.project(pose.x, pose.y, self._s).s
        goal = self.steered.at(self._s + 3.0 + 0.6 * pose.speed)
        dx, dy = goal.x - pose.x, goal.y - pose.y
        alpha = math.atan2(dy, dx) - pose.heading
        steering = math.atan(2.0 * self.vehicle.wheelbase * math.sin(alpha) / math.hypot(dx, dy))
        acceleration = min(max(self.speed - pose.speed, -1.0), 1.0)
        return ControlCommand(steering, acceleration, path=self._ahead(pose.x, pose.y) if self.says else None)

    def _ahead(self, x: float, y: float) -> CommandedPath:
        s = self.line.project(x, y, self._s).s
        points = [self.line.at(s + ahead) for ahead in np.arange(0.0, REACH, 1.5)]
        columns = tuple(point.x for point in points), tuple(point.y for point in points)
        return CommandedPath(*columns, (self.speed,) * len(points))
