"""How well a car keeps to its path: lateral deviation and heading error in the path's own frame.

Knows poses and a path; neither records nor controllers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vve_sumo.path import ReferencePath
from vve_sumo.values import Floats

#: how far along the path a pose may lie from where the drive itself placed it [m]
WINDOW = 10.0


class Tracking(NamedTuple):
    """Poses against the path: one entry a pose, NaN where the pose is not known."""

    lateral_deviation: Floats  #: of the rear axle from the path [m], left positive
    heading_error: Floats  #: car's heading minus the path's at the foot [rad], left positive, within ±pi
    path_heading: Floats  #: at the foot [rad], counter-clockwise from the map's +x


def track(path: ReferencePath, x: Floats, y: Floats, heading: Floats, near_s: Floats) -> Tracking:
    """Return deviation and heading error of poses; x, y of the rear axle, map [m]; heading [rad].

    `near_s` [m] is near each pose's own s, so that a path that crosses itself does not mix its branches.
    """
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y) & np.isfinite(near_s))
    lateral, along = np.full(len(x), np.nan), np.full(len(x), np.nan)
    _, lateral[known], along[known] = path.project_many(x[known], y[known], near_s[known], WINDOW)
    return Tracking(lateral, wrapped(heading - along), along)


def wrapped(angle: Floats) -> Floats:
    """Return angles [rad] brought into [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
