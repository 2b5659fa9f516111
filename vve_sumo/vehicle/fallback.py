"""Tracks the car along its fallback path by the wheels alone, and gives the road-wheel angle that the path needs.

It knows the newest path and the distance driven along it; no pose, no map, and no reason to stop.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.values import DeferredFallbackPath, FallbackPath, Vehicle

MAX_KNOTS: Final = 64  # of a fallback path: 64 m at a metre each is twice the stopping distance from 10 m/s at 2.4 m/s2
MAX_CURVATURE: Final = 1.0  # [1/m]; no car turns tighter than 0.3, so a larger value means "as tight as possible"
# After 100 ms without commands the DBW controller releases the steering: after a longer gap the car may have left the
# path.
MAX_GAP: Final = 0.100  # [s]
_ROUNDING: Final = 1e-6  # [s]


def well_formed(fallback_path: FallbackPath) -> bool:
    """Whether `fallback_path` is a usable path: 1 to 64 finite knots at a finite, positive spacing."""
    return (
        0.0 < fallback_path.spacing < math.inf
        and 1 <= len(fallback_path.curvature) <= MAX_KNOTS
        # A sum that is finite has finite terms; one that is not may have overflowed.
        and (math.isfinite(sum(fallback_path.curvature)) or all(map(math.isfinite, fallback_path.curvature)))
    )


class FallbackTracker:
    """Follows the newest fallback path by odometry.

    The road-wheel angle is that of the single-track model on a steady circle: atan(L k) + K k v^2 (Rajamani, Vehicle
    Dynamics and Control, 3.3), for the curvature k where the rear axle will be after the steering's delay and lag.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._wheelbase = vehicle.wheelbase
        self._understeer = vehicle.understeer_gradient
        self._answer_time = vehicle.steering_delay + vehicle.steering_lag
        self._profile: FallbackPath | DeferredFallbackPath | None = None
        self._distance = math.nan  # along the path [m]; NaN where not known
        self._speed = math.nan

    def take(self, age: float, fallback_path: FallbackPath | DeferredFallbackPath | None) -> None:
        """Follow `fallback_path` from now on, which begins where the car was `age` seconds ago; None for no path.

        A deferred path is computed by the first call of `steering`, and is no path where it is not `well_formed`.
        """
        self._profile = fallback_path
        self._distance = self._speed * age

    def move(self, duration: float, speed: float) -> None:
        """Advance by `duration` [s] to `speed` [m/s] at its end; NaN where the speed is not known."""
        if 0.0 < duration <= MAX_GAP + _ROUNDING:
            self._distance += 0.5 * (self._speed + speed) * duration
        else:
            self._distance = math.nan
        self._speed = speed

    def steering(self) -> float | None:
        """Road-wheel angle [rad] for the path, left positive; None without a path or a known distance along it."""
        ahead = self._distance + self._speed * self._answer_time
        if self._profile is None or not math.isfinite(ahead):
            return None
        fallback_path = self._followed(self._profile)
        if fallback_path is None:
            return None
        curvature = min(max(_curvature(fallback_path, ahead), -MAX_CURVATURE), MAX_CURVATURE)
        return math.atan(self._wheelbase * curvature) + self._understeer * curvature * self._speed * self._speed

    def _followed(self, fallback_path: FallbackPath | DeferredFallbackPath) -> FallbackPath | None:
        if isinstance(fallback_path, FallbackPath):
            return fallback_path
        path = fallback_path.path()
        self._profile = path if path is not None and well_formed(path) else None
        return self._profile


def _curvature(fallback_path: FallbackPath, distance: float) -> float:
    """Curvature [1/m] at a `distance` [m]: linear between knots, constant before the first and beyond the last."""
    knots, place = fallback_path.curvature, distance / fallback_path.spacing
    if place >= len(knots) - 1:
        return knots[-1]
    if place <= 0.0:
        return knots[0]
    index = int(place)
    return knots[index] + (place - index) * (knots[index + 1] - knots[index])
