"""What the page shows of the lot at one moment: metres to the edge, and the ground that a stop now would cover.

Knows the geofence; neither records nor live drives.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vve_sumo.drive.assembly import LotAlignment
from vve_sumo.geometry import vehicle_boxes
from vve_sumo.lot.polygon import outline
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.schema import Rig
from vve_sumo.values import FallbackPath, Floats, Pose, Vehicle


class LotView:
    """The lot of one drive; everything is in the lot's own map [m]."""

    def __init__(self, rig: Rig, resolved: Mapping[str, Any], vehicle: Vehicle) -> None:
        alignment = LotAlignment.from_dict(resolved).alignment
        self._to_lot = alignment.inverse()
        self._geofence = meaning.geofence_of(rig, alignment)
        self._vehicle = vehicle

    def place(self, pose: Pose) -> Pose:
        """Return a pose on the virtual road as it is in the lot."""
        return self._to_lot.apply(pose)

    def to_edges(self, x: Floats, y: Floats, heading: Floats) -> Floats:
        """Return the distance of the car's body to the lot's edge, margin kept [m], for poses of the rear axle.

        0 where the body reaches over the edge, NaN without a pose.
        """
        found = np.full(len(x), np.nan)
        known = np.flatnonzero(np.isfinite(x + y + heading))
        boxes = vehicle_boxes(x[known], y[known], heading[known], np.zeros(len(known)), self._vehicle)
        corners = np.moveaxis(np.array(boxes.corners()), (0, 1, 2), (2, 1, 0))
        found[known] = self._geofence.lot.clearances(corners)
        return found

    def footprint(self, pose: Pose, steering: float, fallback_path: FallbackPath | None) -> Floats | None:
        """Return the line around the ground that any stop from here would cover, (n, 2) [m]; None for no rest.

        `pose` is the rear axle's in the lot, `steering` its road-wheel angle by report [rad], `fallback_path` the
        one that the setpoint carries. It is the ground that the geofence checks.
        """
        swept = self._geofence.sweep(pose, steering, fallback_path)
        return None if swept is None else outline(swept)
