"""Errors of the simulated vehicle's accelerometers: noise of the running car, and an offset that a drive keeps.

The offset stands for the sensor's zero and its mounting, and for slope and camber of a road that the simulated lot does
not have. It knows measurements and no motion.
"""

from __future__ import annotations

import numpy as np

from vve_sumo.plant.noise import wander, white
from vve_sumo.vehicle.interface import Accelerations
from vve_sumo.vehicle.model import Imperfections


class AccelerationErrors:
    """Turns true accelerations, one set each `period`, into measured ones."""

    def __init__(self, imperfections: Imperfections, size: float, period: float, seeds: np.random.SeedSequence) -> None:
        """`size` is a factor on all errors; the drive's offsets are drawn from `seeds` at once."""
        streams = seeds.spawn(3)
        offsets, time = white(streams[2]), imperfections.acceleration_correlation
        self._longitudinal_offset = size * imperfections.longitudinal_acceleration_bias * next(offsets)
        self._lateral_offset = size * imperfections.lateral_acceleration_bias * next(offsets)
        self._longitudinal = wander(size * imperfections.longitudinal_acceleration_noise, time, period, streams[0])
        self._lateral = wander(size * imperfections.lateral_acceleration_noise, time, period, streams[1])

    def measured(self, true: Accelerations) -> Accelerations:
        """Return what the accelerometers measure of the present accelerations [m/s2]."""
        return true._replace(
            longitudinal=true.longitudinal + self._longitudinal_offset + next(self._longitudinal),
            lateral=true.lateral + self._lateral_offset + next(self._lateral),
        )
