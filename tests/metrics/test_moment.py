"""The moment that matters, in cases whose answer is known in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests import vehicles
from tests.metrics.tables import actors_of, ticks_of
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.moment import MomentMeasure, moment_of
from vve_sumo.path import ReferencePath

CAR = vehicles.FUSION.vehicle
PERIOD = 0.1
PATH = ReferencePath.from_points(np.arange(0.0, 301.0, 2.0), np.zeros(151))


def drive(rows: list[dict[str, Any]], others: list[dict[str, Any]]) -> DriveData:
    """Return a drive along the path; each row says where the rear axle is and how fast."""
    placed = [
        {"time_s": n * PERIOD, "true_x_m": row["s_m"], "true_speed_mps": row["speed_mps"], "contacts": ""} | row
        for n, row in enumerate(rows)
    ]
    plain = {"y_m": 0.0, "heading_rad": 0.0, "length_m": 4.0, "width_m": 2.0}
    return DriveData(ticks_of(placed), actors_of([plain | row for row in others]), PATH, CAR, PERIOD)


def braking(count: int) -> list[dict[str, Any]]:
    """Rows of a car that brakes from 10 m/s at 2 m/s2."""
    times = PERIOD * np.arange(count)
    return [{"s_m": 20.0 + 10.0 * t - t * t, "speed_mps": 10.0 - 2.0 * t} for t in times.tolist()]


def standing(count: int, x: float) -> list[dict[str, Any]]:
    return [{"tick": tick, "actor": "other", "x_m": x, "speed_mps": 0.0} for tick in range(count)]


def test_the_least_time_to_collision() -> None:
    """Behind a standing car that braking leaves a gap to, gap over speed is least while it still moves."""
    count, x = 50, 20.0 + 25.0 + CAR.rear_axle_to_bumper + 2.0 + 4.0
    moment = moment_of(drive(braking(count), standing(count, x)))
    assert moment is not None
    times = PERIOD * np.arange(count)
    gaps = x - 2.0 - CAR.rear_axle_to_bumper - (20.0 + 10.0 * times - times * times)
    ratio = gaps / (10.0 - 2.0 * times)
    assert moment.measure is MomentMeasure.TIME_TO_COLLISION
    assert moment.actor == "other"
    assert moment.row == int(np.argmin(ratio))
    assert moment.value == pytest.approx(float(ratio.min()), abs=0.05)


def test_a_contact_comes_before_all_else() -> None:
    rows = braking(50)
    rows[30]["contacts"] = "other+third"
    moment = moment_of(drive(rows, standing(50, 60.0)))
    assert moment is not None
    assert (moment.row, moment.measure, moment.actor, moment.value) == (30, MomentMeasure.CONTACT, "other", 0.0)


def test_without_conflict_the_nearest_actor() -> None:
    """A car parked 8 m beside the path is nearest where the two centres are side by side."""
    rows = [{"s_m": 50.0 + n, "speed_mps": 10.0} for n in range(60)]
    others = [row | {"y_m": 8.0} for row in standing(60, 80.0)]
    moment = moment_of(drive(rows, others))
    assert moment is not None
    assert (moment.measure, moment.actor) == (MomentMeasure.DISTANCE, "other")
    centre = CAR.rear_axle_to_bumper - CAR.length / 2.0
    assert abs(50.0 + moment.row + centre - 80.0) <= 0.5
    assert moment.value == pytest.approx(math.hypot(8.0, 50.0 + moment.row + centre - 80.0), abs=1e-6)


def test_nobody_near_is_no_moment() -> None:
    assert moment_of(drive(braking(20), [])) is None
    assert moment_of(drive(braking(20), [row | {"y_m": 90.0} for row in standing(20, 60.0)])) is None
