"""Measures on the drive's own poses how well the predictor bridges a time without a new pose.

Knows poses and the predictor; nothing of the shell that feeds it.
"""

from __future__ import annotations

import math
from collections import deque

from vve_sumo.pose.predict import Predictor
from vve_sumo.values import Pose

#: time over which poses are predicted [s]: the lifetime of a setpoint
MIN_AGE = 0.1
#: time after the first pose in which no prediction is judged [s], because the filter is still settling
SETTLING_TIME = 2.0


class PredictionError:
    """Predicts every pose from the poses at least MIN_AGE older, and keeps mean and maximum of the error."""

    def __init__(self) -> None:
        self._predictor = Predictor()
        self._waiting: deque[Pose] = deque()
        self._begin = math.nan
        self._count = 0
        self._sum = 0.0
        self.greatest = math.nan  #: [m]; NaN before anything was judged

    def step(self, pose: Pose) -> None:
        """Compare a trusted pose with its prediction from the poses at least MIN_AGE older."""
        if math.isnan(self._begin):
            self._begin = pose.time
        while self._waiting and self._waiting[0].time <= pose.time - MIN_AGE:
            self._predictor.update(self._waiting.popleft())
        predicted = self._predictor.at(pose.time)
        self._waiting.append(pose)
        if predicted is None or pose.time < self._begin + SETTLING_TIME:
            return
        error = math.hypot(predicted.x - pose.x, predicted.y - pose.y)
        self._count += 1
        self._sum += error
        self.greatest = error if math.isnan(self.greatest) else max(self.greatest, error)

    @property
    def mean(self) -> float:
        """Mean distance between prediction and pose [m]; NaN before anything was judged."""
        return self._sum / self._count if self._count else math.nan
