"""Steers the front axle onto its own track: the Stanley law.

delta = heading error + atan(k e / (ks + v)) at the front axle (Hoffmann et al., ACC 2007). The path here is the
rear axle's, so the front axle's track is the path shifted by the wheelbase along its tangent, and its direction
is turned by atan(L curvature): with that the deviation e dies out at the rate k, and the rear axle keeps the path.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.values import Observation, Vehicle

from .deviation import Deviation

SOFTENING: Final = 1.0  #: keeps the law calm at walking pace [m/s]
YAW_DAMPING: Final = 0.1  #: road-wheel angle for each rad/s that the car turns faster than the path asks [s]


class Stanley:
    """Heading error, a speed-scaled arctangent of the deviation, yaw damping."""

    def __init__(self, vehicle: Vehicle, rate: float = 1.0) -> None:
        """`rate` is k [1/s]."""
        self._vehicle, self._rate = vehicle, rate

    def steer(self, deviation: Deviation, observation: Observation) -> float:
        """Return the road-wheel angle [rad]."""
        vehicle, speed = self._vehicle, deviation.speed
        front = deviation.d + vehicle.wheelbase * math.sin(deviation.heading_error)
        bend = math.atan(vehicle.wheelbase * deviation.curvature)
        understeer = vehicle.understeer_gradient * speed * speed * deviation.curvature
        return (
            bend
            + understeer
            - deviation.heading_error
            - math.atan(self._rate * front / (SOFTENING + speed))
            - YAW_DAMPING * deviation.yaw_rate_error
        )
