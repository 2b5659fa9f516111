"""Reads the obstacles of a Mobileye-like camera from a CAN bus of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, Protocol

from driving import Scan

from vve_sumo.errors import RigError
from vve_sumo.values import Frame
from vve_sumo.wire import mobileye

LATENCY = 0.1  # from a picture to its list on the bus [s]: no frame says it
LIFETIME = 0.3  # of a list, which comes every 67 ms [s]


class Bus(Protocol):
    """What the camera's frames come from."""

    def drain(self) -> Sequence[Frame]:
        """Return the frames that have come since the last call."""


class Camera:
    """The newest whole list of a camera."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self._stamp, self._missing, self._failed = -1, 0, True
        self._coming: list[Any] = []
        self._came, self._found = -math.inf, ()

    def scan(self, now: float, speed: float) -> Scan | None:
        """Take what has come by GNSS time `now` [s]; None where the camera has failed or its list is too old."""
        try:
            frames = self.bus.drain()
        except RigError:
            self._failed = True
            frames = []
        for frame in frames:
            self._take(frame, now)
        if self._failed or now - self._came > LIFETIME:
            return None
        return Scan(now, self._came - LATENCY, speed, self._found)

    def _take(self, frame: Frame, now: float) -> None:
        if (status := mobileye.decode_status(frame)) is not None:
            self._failed = status.failed
            # A list that repeats its stamp shows no new picture: a camera that hangs repeats it for good.
            self._missing = status.obstacles if status.stamp != self._stamp else -1
            self._stamp, self._coming = status.stamp, []
        elif self._missing > 0 and (one := mobileye.decode_obstacle(frame)) is not None:
            self._coming.append(_target(one))
            self._missing -= 1
        if self._missing == 0:
            self._came, self._found, self._missing = now, tuple(self._coming), -1


def _target(one: mobileye.Obstacle) -> Any:
    azimuth = math.atan2(one.y, one.x)
    return SimpleNamespace(
        range=math.hypot(one.x, one.y), azimuth=azimuth, range_rate=one.relative_speed * math.cos(azimuth)
    )
