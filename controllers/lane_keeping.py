"""Where across the path a car kept its lane until a second ago. One that is elsewhere now is leaving that lane.

A driver who keeps a lane wanders about a place. The driver model of UN R157 takes up to 0.375 m for wandering.
It must not know bands, nor what is done about the car.
"""

from __future__ import annotations

from collections import deque
from typing import Final

LAG: Final = 1.0  #: what was seen since is of a car that may be leaving its lane already [s]
DRIFT: Final = 0.001  #: of the place that is kept [m2/s]: it is averaged over about three seconds


class KeptPlace:
    """A Kalman filter on a place, fed with measurements once they are LAG old."""

    __slots__ = ("_recent", "_time", "value", "variance")

    def __init__(self, time: float, place: float, variance: float) -> None:
        """Begin at a time [s] with a measured place [m] and its variance [m2]."""
        self._recent: deque[tuple[float, float, float]] = deque()
        self._time, self.value, self.variance = time, place, variance

    def update(self, time: float, place: float, variance: float) -> None:
        """Take a measurement in, later than all before."""
        self._recent.append((time, place, variance))
        while self._recent[0][0] < time - LAG:
            then, seen, doubt = self._recent.popleft()
            self.variance += DRIFT * (then - self._time)
            gain = self.variance / (self.variance + doubt)
            self._time, self.value = then, self.value + gain * (seen - self.value)
            self.variance *= 1.0 - gain

    def left_towards_path(self, place: float) -> float:
        """Return how much nearer to the middle of the path a place is [m]."""
        return self.value - place if self.value > 0.0 else place - self.value
