"""A controller that follows its path and stops for what the sensor "ahead" has in its beam; it never asks the radar."""

from __future__ import annotations

import math

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import ControlCommand, Observation, Vehicle

BRAKING = 1.5  # [m/s2]
DELAY = 0.7  # from a wish to the brakes' answer [s]


class RangeStop:
    """Pure pursuit, and a speed that allows to stop with a gap."""

    def __init__(self, wheelbase: float, gap: float) -> None:
        self._wheelbase, self._gap = wheelbase, gap
        self._s: float | None = None
        self._holds = False

    def step(self, observation: Observation) -> ControlCommand:
        """Return what to do at a tick."""
        pose, path = observation.pose, observation.path
        self._s = here = path.project(pose.x, pose.y, self._s).s
        goal = path.at(here + 2.5 + 0.4 * pose.speed)
        dx, dy = goal.x - pose.x, goal.y - pose.y
        steering = math.atan(2.0 * self._wheelbase * math.sin(math.atan2(dy, dx) - pose.heading) / math.hypot(dx, dy))
        squares = [2.0 / max(abs(path.at(here + d).curvature), 1e-6) + 2.0 * BRAKING * d for d in range(0, 60, 2)]
        stops = [path.length - here, *(seen - self._gap for seen in observation.sensors["ahead"].range.tolist())]
        squares += [2.0 * BRAKING * (stop - DELAY * pose.speed) for stop in stops]
        allowed = math.sqrt(max(min(squares), 0.0))
        self._holds = allowed < (2.0 if self._holds else 0.5)
        acceleration = min(max(2.0 * (min(allowed, observation.desired_speed) - pose.speed), -3.0), 1.5)
        return ControlCommand(steering, min(acceleration, -1.0) if self._holds else acceleration)


def make(vehicle: Vehicle, tuning: Tuning) -> RangeStop:
    """Return the controller."""
    return RangeStop(vehicle.wheelbase, float(settle(tuning, {"gap_m": 6.0})["gap_m"]))
