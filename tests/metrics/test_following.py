"""Same-lane measures against closed forms, decimals of fifty digits, and small steps."""

from __future__ import annotations

import math
from decimal import Decimal, getcontext

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from vve_sumo import laws
from vve_sumo.metrics import following

getcontext().prec = 50


def signed(least: float, most: float) -> st.SearchStrategy[float]:
    """Numbers of either sign, and 0, whose squares do not vanish."""
    size = st.floats(least, most)
    return st.one_of(st.just(0.0), size, size.map(lambda value: -value))


def first_root(gap: float, closing: float, acceleration: float) -> float:
    """Smallest positive root of g - dv t - da t^2 / 2, by the textbook's formula."""
    g, dv, da = Decimal(gap), Decimal(closing), Decimal(acceleration)
    if da == 0:
        return float(g / dv) if dv > 0 else math.inf
    square = dv * dv + 2 * da * g
    if square < 0:
        return math.inf
    positive = [root for root in ((-dv + square.sqrt()) / da, (-dv - square.sqrt()) / da) if root > 0]
    return float(min(positive)) if positive else math.inf


@given(st.floats(1e-3, 200.0), signed(1e-6, 40.0), signed(1e-15, 12.0))
def test_modified_time_to_collision_is_the_first_positive_root(gap: float, closing: float, acceleration: float) -> None:
    expected = first_root(gap, closing, acceleration)
    square = closing * closing + 2.0 * acceleration * gap
    # Next to a double root nothing says from which side rounding comes.
    assume(abs(square) > 1e-9 * closing * closing)
    found = float(following.modified_time_to_collision(gap, closing, acceleration))
    assert found == pytest.approx(expected, rel=1e-6 if abs(square) < 1e-4 * closing * closing else 1e-9)


def test_a_tiny_acceleration_changes_the_time_by_a_tiny_bit() -> None:
    sizes = np.array([0.0, 1e-18, 1e-14, 1e-10])
    found = following.modified_time_to_collision(20.0, 10.0, np.concatenate((sizes, -sizes)))
    np.testing.assert_allclose(found, 2.0, rtol=1e-10)
    assert following.modified_time_to_collision(20.0, -10.0, 1e-12) == pytest.approx(2e13, rel=1e-9)


def test_a_leader_that_has_stopped_goes_on_backwards_in_the_published_formula() -> None:
    """20 m behind a leader of 5 m/s that rests after 1 s and 2.5 m at 5 m/s2; the follower keeps its 10 m/s."""
    published = float(following.modified_time_to_collision(20.0, 5.0, 5.0))
    assert published == pytest.approx(2.0, abs=1e-9)
    assert published < (20.0 + 2.5) / 10.0


def test_closed_forms() -> None:
    close = pytest.approx
    assert following.headway(30.0, 15.0) == close(2.0, abs=1e-9)
    assert following.headway_front(30.0, 15.0, 4.5) == close(2.3, abs=1e-9)
    assert following.time_to_collision(24.0, 8.0) == close(3.0, abs=1e-9)
    assert following.required_deceleration(24.0, 8.0) == close(64.0 / 48.0, abs=1e-9)
    # dv / (2 (TTC - PRT)), as it is published.
    assert following.required_deceleration(24.0, 8.0, 1.0) == close(8.0 / (2.0 * (3.0 - 1.0)), abs=1e-9)
    # 13.9 + 1.75 + 17.4^2 / 8 - 10^2 / 16
    assert following.rss_distance(13.9, 10.0) == close(47.245, abs=1e-9)
    assert following.rss_distance(1.0, 30.0) == 0.0


@pytest.mark.parametrize(
    ("measure", "arguments", "expected"),
    [
        (following.headway, (10.0, 0.0), math.inf),
        (following.headway, (10.0, -1.0), math.inf),
        (following.headway, (-1.0, 2.0), -0.5),
        (following.time_to_collision, (10.0, 0.0), math.inf),
        (following.time_to_collision, (10.0, -3.0), math.inf),
        (following.time_to_collision, (0.0, -3.0), 0.0),
        (following.time_to_collision, (-2.0, 3.0), 0.0),
        (following.modified_time_to_collision, (-2.0, 3.0, 1.0), 0.0),
        (following.modified_time_to_collision, (10.0, 0.0, 0.0), math.inf),
        (following.modified_time_to_collision, (10.0, 4.0, -1.0), math.inf),
        (following.modified_time_to_collision, (10.0, -4.0, -1.0), math.inf),
        (following.modified_time_to_collision, (8.0, 0.0, 4.0), 2.0),
        (following.modified_time_to_collision, (7.5, 4.0, -1.0), 3.0),
        (following.modified_time_to_collision, (6.0, -1.0, 4.0), 2.0),
        (following.required_deceleration, (10.0, 0.0), 0.0),
        (following.required_deceleration, (-1.0, -3.0), 0.0),
        (following.required_deceleration, (0.0, 3.0), math.inf),
        (following.required_deceleration, (3.0, 3.0, 1.0), math.inf),
        (following.rss_distance, (-1.0, 5.0), math.nan),
        (following.rss_distance, (5.0, -1.0), math.nan),
    ],
)
def test_edges(measure, arguments, expected) -> None:
    np.testing.assert_equal(float(measure(*arguments)), expected)


@pytest.mark.parametrize(
    ("measure", "count"),
    [(following.headway, 2), (following.headway_front, 3), (following.time_to_collision, 2),
     (following.modified_time_to_collision, 3), (following.required_deceleration, 3), (following.rss_distance, 2)],
)  # fmt: skip
@pytest.mark.parametrize("other", [5.0, 0.0, -5.0])
def test_not_a_number_in_is_not_a_number_out_and_arrays_broadcast(measure, count, other) -> None:
    for position in range(count):
        arguments = [math.nan if number == position else other for number in range(count)]
        assert np.isnan(measure(*arguments)), arguments
    assert isinstance(measure(*[other] * count), float)
    columns = [np.full((3, 1), 5.0), np.full(2, 2.0), np.ones(())]
    assert measure(*columns[:count]).shape == (3, 2)


@given(st.floats(0.1, 100.0), st.floats(0.1, 30.0), st.floats(0.0, 1.0))
def test_the_needed_deceleration_just_stops_before_contact(gap: float, closing: float, delay: float) -> None:
    needed = float(following.required_deceleration(gap, closing, delay))
    assert math.isinf(needed) == (gap <= closing * delay)
    if math.isfinite(needed):
        assert laws.stopping_distance(closing, needed, delay) == pytest.approx(gap)


def test_exposure_of_an_approach_at_constant_speed() -> None:
    """TTC falls from 4 s to 0.5 s in as many seconds: 1 s below 1.5 s, and the area of the triangle cut at 0.5 s."""
    time = np.linspace(0.0, 3.5, 3501)
    ttc = 4.0 - time
    assert following.time_exposed(time, ttc) == pytest.approx(1.0, abs=1.1e-3)
    assert following.time_integrated(time, ttc) == pytest.approx(0.5, abs=1e-3)
    assert following.time_exposed(time, ttc, 2.0) == pytest.approx(1.5, abs=1.1e-3)


def test_exposure_counts_each_tick_until_the_next() -> None:
    time, ttc = np.array([0.0, 0.1, 0.4, 0.5]), np.array([1.0, 1.2, np.nan, 0.1])
    assert following.time_exposed(time, ttc) == pytest.approx(0.4, abs=1e-12)
    assert following.time_integrated(time, ttc) == pytest.approx(0.1 * 0.5 + 0.3 * 0.3, abs=1e-12)
    drac = np.array([9.0, 3.0, 9.0, 9.0])
    assert following.crash_potential_index(time, drac, 5.9) == pytest.approx(0.4, abs=1e-12)
    assert math.isnan(following.crash_potential_index(time[:1], drac[:1], 5.9))
    assert math.isnan(following.time_exposed(time[:0], ttc[:0]))
