"""The track of a drive by the distance driven."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vve_sumo.values import Floats


class TrackPlace(NamedTuple):
    """A pose on a track."""

    x: float  #: map [m]
    y: float  #: map [m]
    heading: float  #: of the track [rad]


class DrivenTrack:
    """The track of a drive's rear axle by the distance driven; straight beyond its end."""

    def __init__(self, time: Floats, x: Floats, y: Floats, heading: Floats) -> None:
        """Columns of the true pose, a row a tick: drive time [s], map [m], [rad]; rows that are NaN are left out."""
        known = np.isfinite(x) & np.isfinite(y) & np.isfinite(heading)
        self._time, self._x, self._y = time[known], x[known], y[known]
        self._heading = np.unwrap(heading[known])
        steps = np.hypot(np.diff(self._x), np.diff(self._y))
        self._driven = np.concatenate([[0.0], np.cumsum(steps)])[: len(self._x)]

    def driven(self, time: float) -> float:
        """Return the distance driven by a drive time [m]."""
        return float(np.interp(time, self._time, self._driven))

    def place(self, driven: float, d: float = 0.0) -> TrackPlace:
        """Return the pose at a distance driven [m], with a lateral `offset` from the track [m], left positive."""
        end = float(self._driven[-1])
        within = min(max(driven, 0.0), end)
        x, y, heading = (float(np.interp(within, self._driven, row)) for row in (self._x, self._y, self._heading))
        beyond = driven - within
        cos, sin = math.cos(heading), math.sin(heading)
        return TrackPlace(x + beyond * cos - d * sin, y + beyond * sin + d * cos, heading)

    def position_ahead(self, driven: float, ahead: float) -> tuple[float, float]:
        """Return the point `ahead` [m] along the track in the car's axes: forward, left [m]."""
        here, target = self.place(driven), self.place(driven + ahead)
        dx, dy = target.x - here.x, target.y - here.y
        cos, sin = math.cos(here.heading), math.sin(here.heading)
        return cos * dx + sin * dy, cos * dy - sin * dx

    def curvature(self, driven: float) -> float:
        """Return the curvature of the track at a distance driven, over a metre on either side [1/m], left positive."""
        return 0.5 * (self.place(driven + 1.0).heading - self.place(driven - 1.0).heading)
