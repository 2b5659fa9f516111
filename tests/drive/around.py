"""A controller for drives with SUMO: it goes around a place of its path, and its commands carry the way around."""

from __future__ import annotations

import math

import numpy as np

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import CommandedPath, ControlCommand, Observation, Vehicle

#: where on the path it is wholly aside [m]; it goes over and comes back within RAMP before and behind
FIRST, LAST, RAMP = 50.0, 72.0, 25.0


class Around:
    """Goes over to the left by `over_m` before FIRST, and back behind LAST; `says` whether its commands say so."""

    def __init__(self, vehicle: Vehicle, tuning: Tuning) -> None:
        tuned = settle(tuning, {"over_m": 3.5, "says": True})
        self._wheelbase, self._over, self._says = vehicle.wheelbase, float(tuned["over_m"]), bool(tuned["says"])
        self._s: float | None = None

    def step(self, observation: Observation) -> ControlCommand:
        pose, path = observation.pose, observation.path
        self._s = s = path.project(pose.x, pose.y, self._s).s

        def at(at_s: float) -> tuple[float, float]:
            place, aside = path.at(at_s), self._aside(at_s)
            return place.x - aside * math.sin(place.heading), place.y + aside * math.cos(place.heading)

        goal = at(s + 3.0 + 0.6 * pose.speed)
        dx, dy = goal[0] - pose.x, goal[1] - pose.y
        alpha = math.atan2(dy, dx) - pose.heading
        steering = math.atan(2.0 * self._wheelbase * math.sin(alpha) / math.hypot(dx, dy))
        acceleration = min(max(observation.desired_speed - pose.speed, -1.0), 1.0)
        if not self._says:
            return ControlCommand(steering, acceleration)
        points = [at(s + ahead) for ahead in np.arange(0.0, 45.0, 1.5)]
        speeds = np.full(len(points), observation.desired_speed)
        return ControlCommand(
            steering,
            acceleration,
            path=CommandedPath(*np.array(points).T, speeds),  # type: ignore[arg-type]
        )

    def _aside(self, s: float) -> float:
        share = min(max((s - FIRST + RAMP) / RAMP, 0.0), max((LAST + RAMP - s) / RAMP, 0.0), 1.0)
        return self._over * share**3 * (10.0 - 15.0 * share + 6.0 * share * share)


def make(vehicle: Vehicle, tuning: Tuning) -> Around:
    return Around(vehicle, tuning)
