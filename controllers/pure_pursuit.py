"""Steers along the circle through a goal point on the path: pure pursuit.

delta = atan(2 L sin(alpha) / ld) from the rear axle (Coulter, CMU-RI-TR-92-01, 1992), plus what understeer takes.
"""

from __future__ import annotations

import math

from vve_sumo.values import Observation, Vehicle

from .deviation import Deviation, turned


class PurePursuit:
    """Look-ahead proportional to speed, within bounds."""

    def __init__(self, vehicle: Vehicle, look_ahead_time: float = 0.8, look_ahead_least: float = 4.0) -> None:
        """`look_ahead_time` times speed is the distance to the goal point [s], at least `look_ahead_least` [m]."""
        self._vehicle = vehicle
        self._time, self._least = look_ahead_time, look_ahead_least

    def steer(self, deviation: Deviation, observation: Observation) -> float:
        """Return the road-wheel angle [rad]."""
        pose, path, vehicle = observation.pose, observation.path, self._vehicle
        goal = path.at(deviation.s + max(self._least, self._time * deviation.speed))
        dx, dy = goal.x - pose.x, goal.y - pose.y
        course = path.at(deviation.s).heading + deviation.heading_error
        sine = math.sin(turned(math.atan2(dy, dx) - course))
        curvature = 2.0 * sine / math.hypot(dx, dy)
        understeer = vehicle.understeer_gradient * deviation.speed * deviation.speed * curvature
        return math.atan(vehicle.wheelbase * curvature) + understeer
