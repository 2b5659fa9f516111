"""The prediction that is tried out really is as old as it says."""

from __future__ import annotations

import math

import pytest

from vve_sumo.drive.prediction_error import MIN_AGE, SETTLING_TIME, PredictionError
from vve_sumo.values import Point, Pose

STEP = 0.02


def pose(time: float, speed: float, x: float, acceleration: float = 0.0) -> Pose:
    return Pose(time, Point.REAR_AXLE, x, 0.0, 0.0, speed, 0.0, 0.0, acceleration, 0.0)


def test_steady_driving_is_predicted_exactly() -> None:
    tried = PredictionError()
    for n in range(400):
        tried.step(pose(n * STEP, 12.0, 12.0 * n * STEP))
    assert tried.mean == pytest.approx(0.0, abs=1e-6)
    assert tried.greatest == pytest.approx(0.0, abs=1e-6)


def test_a_step_in_speed_is_off_by_speed_times_age() -> None:
    """The very first pose after a jump in speed of 1 m/s has travelled AGE longer than the old ones could know."""
    tried, x = PredictionError(), 0.0
    first = round((SETTLING_TIME + 2.0) / STEP)
    for n in range(first + round(MIN_AGE / STEP) + 1):
        speed = 10.0 if n < first else 11.0
        x += speed * STEP
        tried.step(pose(n * STEP, speed, x))
    assert tried.greatest == pytest.approx(1.0 * (MIN_AGE + STEP), abs=0.021)


def test_nothing_judged_is_not_a_number() -> None:
    tried = PredictionError()
    tried.step(pose(0.0, 1.0, 0.0))
    assert math.isnan(tried.mean)
    assert math.isnan(tried.greatest)
