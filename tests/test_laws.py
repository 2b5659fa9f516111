"""The shared arithmetic against published numbers, integration in small steps and brute force."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import box as rectangle

from vve_sumo import laws
from vve_sumo.laws import Box

KMH = 1.0 / 3.6


@pytest.mark.parametrize(
    ("delay", "deceleration", "jerk", "by_speed"),
    [
        (0.1, 9.0, 30.0, {20: 3.07, 40: 9.60, 60: 19.57, 80: 32.96}),
        (0.3, 6.0, 12.0, {20: 5.57, 40: 16.34, 60: 32.25, 80: 53.31}),
    ],
)
def test_stopping_distance_with_delay_and_ramp(delay, deceleration, jerk, by_speed):
    for speed, distance in by_speed.items():
        found = laws.stopping_distance(speed * KMH, deceleration, delay, deceleration / jerk)
        assert found == pytest.approx(distance, abs=0.005)


@given(st.floats(0.0, 40.0), st.floats(0.5, 10.0), st.floats(0.0, 1.0), st.floats(0.0, 1.5))
def test_stopping_is_what_small_steps_add_up_to(speed, deceleration, delay, build_up):
    way, v, t, dt = 0.0, speed, 0.0, 2e-3
    while v > 0.0:
        now = deceleration * (min(max((t + dt / 2 - delay) / build_up, 0.0), 1.0) if build_up else t + dt / 2 > delay)
        step = min(dt, v / now) if now else dt
        way, v, t = way + v * step - now * step * step / 2, v - now * step, t + step
        v = 0.0 if v < 1e-9 else v
    assert laws.stopping_distance(speed, deceleration, delay, build_up) == pytest.approx(way, abs=0.1)
    assert laws.stopping_time(speed, deceleration, delay, build_up) == pytest.approx(t, abs=0.02) or speed < 1e-3


def test_impact_speed_of_a_late_start():
    speed = 60 * KMH
    assert laws.impact_speed(speed, speed * 1.0, 7.0, 0.2) / KMH == pytest.approx(34.36, abs=0.005)
    assert laws.impact_speed(10.0, 10.01, 5.0) == 0.0
    assert laws.impact_speed(10.0, 1.0, 5.0, 0.5) == 10.0


@given(st.floats(0.1, 50.0), st.floats(0.1, 100.0), st.floats(0.0, 1.0))
def test_required_deceleration_just_stops(speed, gap, delay):
    needed = laws.required_deceleration(speed, gap, delay)
    if gap <= speed * delay:
        assert needed == math.inf
    else:
        assert laws.stopping_distance(speed, needed, delay) == pytest.approx(gap)


def test_nothing_is_required_when_nothing_closes():
    assert laws.required_deceleration(0.0, 5.0) == 0.0
    assert laws.required_deceleration(-3.0, 0.0) == 0.0


def no_smaller_than(least, low, high):
    """Floats whose squares do not vanish."""
    return st.floats(low, high).filter(lambda value: value == 0.0 or abs(value) > least)


@given(no_smaller_than(1e-3, 0.0, 100.0), no_smaller_than(1e-6, -30.0, 30.0), no_smaller_than(1e-6, -5.0, 5.0))
def test_time_to_collision_is_the_first_positive_root(gap, closing, acceleration):
    found = laws.time_to_collision(gap, closing, acceleration)
    left = lambda t: gap - closing * t - acceleration * t * t / 2  # noqa: E731
    if math.isfinite(found):
        assert left(found) == pytest.approx(0.0, abs=1e-6 * (1.0 + found * found + abs(closing) * found))
        assert all(left(found * k / 50.0) > -1e-6 for k in range(50))
    else:
        assert all(left(t / 10.0) > 0.0 for t in range(600))


@pytest.mark.parametrize(
    ("gap", "closing", "acceleration", "expected"),
    [(20.0, 10.0, 0.0, 2.0), (20.0, -1.0, 0.0, math.inf), (0.0, 5.0, 0.0, 0.0), (-1.0, 5.0, 0.0, 0.0),
     (8.0, 0.0, 4.0, 2.0), (10.0, 4.0, -1.0, math.inf), (7.5, 4.0, -1.0, 3.0), (6.0, -1.0, 4.0, 2.0)],
)  # fmt: skip
def test_time_to_collision_in_one_dimension(gap, closing, acceleration, expected):
    assert laws.time_to_collision(gap, closing, acceleration) == pytest.approx(expected)


def test_headway():
    assert laws.headway(30.0, 15.0) == 2.0
    assert laws.headway(30.0, 0.0) == math.inf


boxes = st.builds(
    Box, st.floats(-30, 30), st.floats(-30, 30), st.floats(-3.2, 3.2), st.floats(1, 12), st.floats(0.5, 3),
    st.floats(-15, 15), st.floats(-15, 15),
)  # fmt: skip


def body(box: Box, t: float):
    shape = affinity.rotate(rectangle(-box.length / 2, -box.width / 2, box.length / 2, box.width / 2), box.heading,
                            origin=(0, 0), use_radians=True)  # fmt: skip
    return affinity.translate(shape, box.x + box.velocity_x * t, box.y + box.velocity_y * t)


@given(boxes, boxes)
def test_boxes_touch_when_shapely_says_so(one, other):
    found = laws.time_to_collision_of_boxes(one, other)
    assert found == pytest.approx(laws.time_to_collision_of_boxes(other, one), abs=1e-9)
    if math.isinf(found):
        # Brushing contacts shorter than the grid are beyond this oracle.
        assert all(body(one, t / 10).intersection(body(other, t / 10)).area < 0.5 for t in range(80))
    elif found == 0.0:
        assert body(one, 0.0).distance(body(other, 0.0)) < 1e-9
    elif found < 100.0:
        assert body(one, found).distance(body(other, found)) < 1e-6
        assert body(one, 0.999 * found).distance(body(other, 0.999 * found)) > 0.0


def test_boxes_head_on_and_parallel():
    one = Box(0, 0, 0, 4, 2, 10, 0)
    assert laws.time_to_collision_of_boxes(one, Box(24, 0, math.pi, 4, 2, -10, 0)) == pytest.approx(1.0)
    assert laws.time_to_collision_of_boxes(one, Box(24, 2.1, math.pi, 4, 2, -10, 0)) == math.inf
    assert laws.time_to_collision_of_boxes(one, Box(2, 1, 1.0, 4, 2)) == 0.0
    assert laws.time_to_collision_of_boxes(one, Box(-24, 0, 0, 4, 2)) == math.inf


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(0.0, 20.0))
def test_rate_limit_goes_towards_the_target_and_no_faster(target, previous, rate):
    found = laws.rate_limit(target, previous, rate, 0.02)
    assert abs(found - previous) <= rate * 0.02 + 1e-12
    assert min(target, previous) <= found <= max(target, previous)
    assert found == target or abs(found - previous) == pytest.approx(rate * 0.02)


def test_limits_let_nan_through_to_be_seen():
    assert math.isnan(laws.clamp(math.nan, -1.0, 1.0))
    assert math.isnan(laws.rate_limit(math.nan, 0.0, 1.0, 0.02))


def test_jerk_limit_bounds_the_value_and_its_change():
    assert laws.jerk_limit(-9.0, -3.49, -3.5, 2.0, 5.0, 2.5, 0.02) == -3.5
    assert laws.jerk_limit(-9.0, 0.0, -3.5, 2.0, 5.0, 2.5, 0.02) == pytest.approx(-0.1)
    assert laws.jerk_limit(9.0, 0.0, -3.5, 2.0, 5.0, 2.5, 0.02) == pytest.approx(0.05)
    assert laws.jerk_limit(0.0, -9.0, -3.5, 2.0, 5.0, 30.0, 0.02) == pytest.approx(-8.4)


def test_pi_without_bounds_in_reach_is_the_textbook_sum():
    loop, errors = laws.PI(2.0, 0.5, -100.0, 100.0), [1.0, 0.5, -0.25, 2.0]
    outputs = [loop.step(error, 0.1) for error in errors]
    assert outputs == pytest.approx([2.0 * e + 0.5 * 0.1 * sum(errors[: i + 1]) for i, e in enumerate(errors)])
    loop.reset()
    assert loop.step(0.0, 0.1) == 0.0


def test_pi_does_not_wind_up():
    loop = laws.PI(1.0, 1.0, -1.0, 1.0)
    assert {loop.step(10.0, 0.1) for _ in range(1000)} == {1.0}
    assert loop.integral == 0.0
    assert loop.step(-0.5, 0.1) == pytest.approx(-0.55)


@given(st.lists(st.floats(-20, 20), max_size=60))
def test_pi_stays_inside_its_bounds(errors):
    loop = laws.PI(0.8, 0.3, -2.0, 1.5)
    for error in errors:
        assert -2.0 <= loop.step(error, 0.02) <= 1.5
        assert -2.0 <= loop.integral <= 1.5
