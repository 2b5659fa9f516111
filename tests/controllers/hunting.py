"""An adaptive cruise control whose gain is too high for the delay in its loop: it hunts on its way to a stop.

A controller of tests, `tests/controllers/hunting.py:make`. Pure pursuit; a speed that allows to stop comfortably before
the nearest radar detection in the way; and a proportional gain on the error of speed. A gain of 8 per second is stable
without delay, and oscillates where the pose is 0.3 s older than its epoch says.
"""

from __future__ import annotations

import math

import numpy as np

from vve_sumo.controller import Tuning, settle
from vve_sumo.laws import clamp
from vve_sumo.values import ControlCommand, Observation, Vehicle

BRAKING = 1.5  #: of the stop that is planned [m/s2]
ANSWER = 0.7  #: from a wish to the brakes' answer, as planned [s]
SIGHT = 120.0  #: ahead of the rear axle [m]
HALF_WIDTH = 1.3  #: detections farther beside the path are not in the way [m]
DEFAULTS: dict[str, float | str | bool] = {"gain_per_s": 8.0, "gap_m": 5.0}


class Hunting:
    """Steers to a point ahead; accelerates by the gain times the speed that it lacks."""

    def __init__(self, vehicle: Vehicle, gain: float, gap: float) -> None:
        """`gain` [1/s] from the error of speed to acceleration; `gap` [m] to stand at."""
        self._vehicle, self._gain, self._gap = vehicle, gain, gap
        self._s: float | None = None
        self._holds = False

    def step(self, observation: Observation) -> ControlCommand:
        """Answer one observation."""
        pose, path = observation.pose, observation.path
        self._s = here = path.project(pose.x, pose.y, self._s).s
        goal = path.at(here + 6.0 + pose.speed)
        dx, dy = goal.x - pose.x, goal.y - pose.y
        alpha = math.atan2(dy, dx) - pose.heading
        steering = math.atan(2.0 * self._vehicle.wheelbase * math.sin(alpha) / math.hypot(dx, dy))
        allowed = self._allowed(observation, here)
        self._holds = allowed < (2.0 if self._holds else 0.3)
        acceleration = clamp(self._gain * (min(allowed, observation.desired_speed) - pose.speed), -3.3, 2.0)
        return ControlCommand(steering, min(acceleration, -1.0) if self._holds else acceleration)

    def _allowed(self, observation: Observation, here: float) -> float:
        """Return the speed [m/s] from which the car can slow for bends, the end of the path and what is in the way."""
        pose, path, scan = observation.pose, observation.path, observation.radar
        bumper, bearing = self._vehicle.rear_axle_to_bumper, pose.heading + scan.azimuth
        x = pose.x + bumper * math.cos(pose.heading) + scan.range * np.cos(bearing)
        y = pose.y + bumper * math.sin(pose.heading) + scan.range * np.sin(bearing)
        s, lateral = path.locate(x, y, here, here + SIGHT)
        stops = s[np.abs(lateral) < HALF_WIDTH] - here - bumper - self._gap
        limits = [(d, 2.0 / max(abs(path.at(here + d).curvature), 1e-6)) for d in range(0, 60, 2)]
        limits += [(path.length - here, 0.0), *((d, 0.0) for d in stops.tolist())]
        return math.sqrt(max(0.0, min(u2 + 2.0 * BRAKING * (d - ANSWER * pose.speed) for d, u2 in limits)))


def make(vehicle: Vehicle, tuning: Tuning) -> Hunting:
    """Return the controller; raises ConfigError on a tuning key that it does not know."""
    settled = settle(tuning, DEFAULTS, {"gain_per_s": (0.1, 20.0), "gap_m": (0.5, 50.0)})
    return Hunting(vehicle, float(settled["gain_per_s"]), float(settled["gap_m"]))
