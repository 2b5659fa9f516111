"""Cars, poses and actors that the sensor tests share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tests import vehicles
from vve_sumo.body_kinds import TYPICAL, number_of
from vve_sumo.values import Actors, Point, Pose

FUSION = vehicles.FUSION.vehicle
#: From the rear axle to the middle of the front bumper [m].
BUMPER = 3.84

#: x, y, heading, speed, length, width, radar cross-section
Row = tuple[float, float, float, float, float, float, float]


def car(x: float, y: float, heading: float = 0.0, speed: float = 0.0) -> Row:
    """A car of 4.5 m by 1.8 m and 10 m2."""
    return x, y, heading, speed, 4.5, 1.8, 10.0


def actors(
    rows: Sequence[Row], ids: Sequence[str] | None = None, lateral_speed: float = 0.0, kind: str = "car"
) -> Actors:
    names = tuple(ids) if ids is not None else tuple(f"car{row}" for row in range(len(rows)))
    table, count = np.array(rows, float).reshape(-1, 7).T.copy(), len(names)
    heights, kinds = np.full(count, TYPICAL[kind].height), np.full(count, number_of(kind), np.int8)
    return Actors(0.0, names, *table, np.full(count, lateral_speed), heights, kinds)


def rear_axle(
    x: float = 0.0,
    y: float = 0.0,
    heading: float = 0.0,
    speed: float = 0.0,
    yaw_rate: float = 0.0,
    lateral_speed: float = 0.0,
) -> Pose:
    return Pose(0.0, Point.REAR_AXLE, x, y, heading, speed, lateral_speed, yaw_rate, 0.0, 0.0)
