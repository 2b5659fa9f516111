"""Says at which places of the map a turn of the lidar would show a car: those that most of the rays to it reach.

What stands between may be anything that returns a ray. It must not know why a place is looked at.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vve_sumo.values import PointCloud

from .sightings import AxleMotion

LOW, HIGH = 0.3, 1.4  #: between these heights over the road a car is seen [m]
DEPTH: Final = 2.5  #: what returns from so little before a place does not hide the place [m]
HALF_SEEN: Final = 0.6  #: so far to both sides of a place its rays are looked at [m]
FREE: Final = 0.5  #: share of these rays that must be free for the place to be in sight


def in_sight(
    x: np.ndarray, y: np.ndarray, turn: PointCloud, axle: AxleMotion, forward: float, height: float, reach: float
) -> np.ndarray:
    """Return at which places of the map [m], shape (n,), the lidar would see a car.

    `axle` is the rear axle's motion at the turn's end. The lidar is `forward` of it [m] and `height` over the road [m];
    it sees a car as far away as `reach` [m].
    """
    cos, sin = math.cos(axle.heading), math.sin(axle.heading)
    east, north = x - axle.x - forward * cos, y - axle.y - forward * sin
    far = np.hypot(east, north)
    if not len(turn.azimuth):
        return np.zeros(len(far), np.bool_)
    step = math.tau / len(turn.azimuth)
    azimuth = np.arctan2(north, east) - axle.heading
    centre = (float(turn.azimuth[0]) - azimuth) / step
    aside = np.arctan2(HALF_SEEN, np.maximum(far, 1.0)) / step
    rays = np.rint(centre[:, None] + aside[:, None] * np.linspace(-1.0, 1.0, 5)).astype(np.intp) % len(turn.azimuth)
    slope = np.tan(turn.elevation)
    meets = (slope * far[:, None] > LOW - height) & (slope * far[:, None] < HIGH - height)
    ranges = turn.range[rays] * np.cos(turn.elevation)
    free = ((ranges == 0.0) | (ranges > far[:, None, None] - DEPTH)) & meets[:, None, :]
    looked = 5.0 * meets.sum(axis=1)
    visible: np.ndarray = (looked > 0.0) & (free.sum(axis=(1, 2)) >= FREE * looked) & (far < reach)
    return visible
