"""Numbers of radar objects: kept while seen, freed when gone, never shared; against objects whose ways are known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.values import Detections
from vve_sumo.wire.numbering import ACCELERATION_GAIN, MAX_UNSEEN, RATE_GAIN, Numbering

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


def _accelerations(rates: Sequence[float]) -> list[float]:
    """The range acceleration of an object whose range rates come scan by scan; it stays where it is seen."""
    numbering, found = Numbering(4), []
    for step, rate in enumerate(rates):
        (numbered,) = numbering.step(_scan(PERIOD * step, [(30.0, 0.0, rate)]), 0.0)
        assert numbered is not None
        found.append(numbered.range_acceleration)
    return found


def test_range_acceleration_comes_to_the_slope_of_the_range_rate() -> None:
    found = _accelerations([-4.0 - 4.0 * PERIOD * step for step in range(80)])
    assert found[0] == 0.0
    assert found[-1] == pytest.approx(-4.0, abs=0.01)
    assert min(found) > -4.0 * 1.3  # it overshoots by little
    # Two thirds of a change are there when the constants say.
    assert next(n for n, value in enumerate(found) if value < -4.0 * 2 / 3) * PERIOD == pytest.approx(0.45, abs=0.06)


def test_noise_of_the_range_rate_is_filtered() -> None:
    """Against the variance of an alpha-beta filter's rate, 2 b^2 / (a (4 - 2 a - b)) (Kalata 1984), in its units."""
    sigma, gain = 0.12, ACCELERATION_GAIN
    rates = np.random.default_rng(1).normal(-4.0, sigma, 20_000)
    found = np.array(_accelerations(rates.tolist()))[200:]
    expected = sigma / PERIOD * math.sqrt(2.0 * gain**2 / (RATE_GAIN * (4.0 - 2.0 * RATE_GAIN - gain)))
    assert np.std(found) == pytest.approx(expected, rel=0.1)
    assert np.std(found) < 0.2 < np.std(np.diff(rates) / PERIOD) / 10.0
    assert abs(np.mean(found)) < 0.02


def test_an_older_scan_begins_anew() -> None:
    numbering = Numbering(4)
    numbering.step(_scan(5.0, [(30.0, 0.0, 0.0)]), 0.0)
    (back,) = numbering.step(_scan(1.0, [(30.0, 0.0, 0.0)]), 0.0)
    assert back is not None
    assert back.new
