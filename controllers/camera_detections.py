"""Turns a camera's objects into detections: one for each object, at the point of its near side next to the car's axis.

It must not know the path.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vve_sumo.values import CameraObjects, Detections, Observation

from .sightings import Noise, output_of

PIXEL: Final = 1.0  #: standard deviation of a place in the picture
#: Errors of one object are alike from picture to picture, by so much of them: a filter that takes them for independent
#: must count each so many times as large.
ALIKE: Final = 0.9
LARGER: Final = math.sqrt((1.0 + ALIKE) / (1.0 - ALIKE))
ROUNDING: Final = 0.2  #: least standard deviation, of range [m] and speed [m/s]


class CameraDetections:
    """Keeps the detections of the newest picture."""

    def __init__(self, sensor: str, focal_length: float, height: float) -> None:
        """`sensor` is the camera's name; its focal length [pixels], and its height over the road [m].

        An object's distance follows from where it meets the road in the picture: it is known worse with the square of
        the distance.
        """
        self._sensor = sensor
        self.noise: Final = Noise(
            range_sigma=ROUNDING,
            rate_sigma=ROUNDING,
            azimuth_sigma=LARGER * PIXEL / focal_length,
            growth=LARGER * PIXEL / (focal_length * height),
        )
        self._newest = Detections(-math.inf, np.empty(0), np.empty(0), np.empty(0), np.empty(0, np.int8))

    def scan(self, observation: Observation) -> Detections:
        """Return the detections of the newest picture; raises TypeError where the scenario has no such camera."""
        seen = output_of(observation, self._sensor, CameraObjects, "camera")
        if seen.time > self._newest.time:
            inner = np.copysign(np.maximum(np.abs(seen.y) - 0.5 * seen.width, 0.0), seen.y)
            azimuth = np.arctan2(inner, seen.x)
            rate = seen.relative_speed * np.cos(azimuth)
            mode = np.zeros(len(seen.x), np.int8)
            self._newest = Detections(seen.time, np.hypot(seen.x, inner), azimuth, rate, mode)
        return self._newest
