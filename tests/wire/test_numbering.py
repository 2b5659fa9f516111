"""Numbers of radar objects: kept while seen, freed when gone, never shared; against objects whose ways are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.values import Detections
from vve_sumo.wire.numbering import MAX_UNSEEN, Numbering

PERIOD = 0.05


def _scan(time: float, points: list[tuple[float, float, float]]) -> Detections:
    columns = np.array(points, np.float64).reshape(-1, 3).T
    return Detections(time, columns[0], columns[1], columns[2], np.zeros(len(points), np.int8))


def _polar(x: float, y: float, vx: float, vy: float) -> tuple[float, float, float]:
    far = math.hypot(x, y)
    return far, math.atan2(y, x), (x * vx + y * vy) / far


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), objects=st.integers(1, 8))
def test_objects_apart_keep_their_numbers(seed: int, objects: int) -> None:
    generator = np.random.default_rng(seed)
    lanes = 8.0 * np.arange(objects) - 4.0 * objects
    ahead, speed = generator.uniform(40.0, 100.0, objects), generator.uniform(-25.0, 10.0, objects)
    numbering = Numbering(64)
    given_: dict[int, int] = {}
    for step in range(20):
        time = PERIOD * step
        order = generator.permutation(objects)
        points = [_polar(ahead[n] + speed[n] * time, lanes[n], speed[n], 0.0) for n in order]
        for n, numbered in zip(order, numbering.step(_scan(time, points), 0.0), strict=True):
            assert numbered is not None
            assert numbered.new == (step == 0)
            assert given_.setdefault(n, numbered.number) == numbered.number
    assert sorted(given_.values()) == list(range(objects))


def test_standing_objects_keep_their_numbers_in_a_bend() -> None:
    """From scan to scan the car turns by nearly as much as the objects are apart."""
    numbering, yaw_rate = Numbering(64), 0.5
    first = [numbered.number for numbered in _step(numbering, 0, yaw_rate)]
    for step in range(1, 10):
        assert [numbered.number for numbered in _step(numbering, step, yaw_rate)] == first


def _step(numbering: Numbering, step: int, yaw_rate: float) -> list:  # type: ignore[type-arg]
    turned = -yaw_rate * PERIOD * step
    return numbering.step(_scan(PERIOD * step, [(60.0, turned, 0.0), (60.0, turned + 0.03, 0.0)]), yaw_rate)


def test_a_number_is_free_again_only_after_a_while() -> None:
    numbering = Numbering(2)
    (one,) = numbering.step(_scan(0.0, [(30.0, 0.0, 0.0)]), 0.0)
    assert one is not None
    (other,) = numbering.step(_scan(0.05, [(90.0, 0.0, 0.0)]), 0.0)
    assert other is not None
    assert other.number != one.number
    (none,) = numbering.step(_scan(0.1, [(10.0, 0.5, 0.0)]), 0.0)
    assert none is None
    (again,) = numbering.step(_scan(0.051 + MAX_UNSEEN, [(10.0, 0.5, 0.0)]), 0.0)
    assert again is not None
    assert again.number == one.number
    assert again.new


def test_range_acceleration_is_the_slope_of_the_range_rate() -> None:
    numbering = Numbering(4)
    numbering.step(_scan(0.0, [(30.0, 0.0, -4.0)]), 0.0)
    (back,) = numbering.step(_scan(0.05, [(29.8, 0.0, -4.2)]), 0.0)
    assert back is not None
    assert back.range_acceleration == pytest.approx(-4.0)


def test_an_older_scan_begins_anew() -> None:
    numbering = Numbering(4)
    numbering.step(_scan(5.0, [(30.0, 0.0, 0.0)]), 0.0)
    (back,) = numbering.step(_scan(1.0, [(30.0, 0.0, 0.0)]), 0.0)
    assert back is not None
    assert back.new
