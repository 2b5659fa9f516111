"""The shared arithmetic against published numbers, integration in small steps and brute force."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo import laws

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


@given(st.lists(st.floats(-0.5, 0.5), max_size=40), st.floats(1.0, 30.0), st.floats(0.5, 5.0), st.floats(0.2, 5.0))
def test_speed_limits_are_the_greatest_that_bends_and_braking_allow(curvature, limit, lateral, slowing):
    """Against the least over every later bend of what can be slowed down from to that bend's own speed."""
    squares = laws.squared_speed_limits(curvature, limit, lateral, slowing, 0.5)
    own = [min(limit**2, lateral / abs(bend) if bend else math.inf) for bend in curvature]
    for row, square in enumerate(squares):
        reachable = (own[later] + 2.0 * slowing * 0.5 * (later - row) for later in range(row, len(own)))
        assert square == pytest.approx(min(reachable))


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


@given(st.floats(0.0, 5.0), st.floats(0.5, 8.0), st.floats(1.0, 30.0))
def test_sideways_reach_is_what_small_steps_add_up_to(time, acceleration, jerk):
    y, speed, dt = 0.0, 0.0, 1e-3
    for step in range(round(time / dt)):
        now = min(jerk * (step + 0.5) * dt, acceleration)
        y, speed = y + speed * dt + now * dt * dt / 2, speed + now * dt
    assert laws.sideways_reach(round(time / dt) * dt, acceleration, jerk) == pytest.approx(y, abs=1e-3)


@given(st.floats(0.0, 20.0), st.floats(0.5, 8.0), st.floats(1.0, 30.0), st.floats(0.0, 0.5))
def test_swerve_time_is_the_inverse_of_the_reach(offset, acceleration, jerk, delay):
    time = laws.swerve_time(offset, acceleration, jerk, delay)
    assert laws.sideways_reach(time - delay, acceleration, jerk) == pytest.approx(offset, rel=1e-9, abs=1e-9)


def test_swerve_time_by_hand():
    """j 5 up to a 3 takes 0.6 s and 0.18 m at 0.9 m/s; then 0.9 t + 1.5 t^2 = 1.32 m."""
    assert laws.swerve_time(1.5, 3.0, 5.0) == pytest.approx(
        0.6 + (math.sqrt(0.81 + 4 * 1.5 * 1.32) - 0.9) / 3.0, abs=1e-12
    )
    assert laws.swerve_time(0.1, 3.0, 5.0, 0.2) == pytest.approx(0.2 + 0.12 ** (1 / 3), abs=1e-12)


@given(st.floats(0.0, 60.0), st.floats(0.1, 30.0), st.floats(0.01, 9.0), st.floats(0.0, 1.0))
def test_time_to_cover_ends_where_the_distance_does(distance, speed, deceleration, delay):
    time = laws.time_to_cover(distance, speed, deceleration, delay)
    if math.isinf(time):
        assert laws.stopping_distance(speed, deceleration, delay) <= distance * (1.0 + 1e-12)
        return
    braked = max(time - delay, 0.0)
    assert speed * time - deceleration * braked * braked / 2 == pytest.approx(distance, rel=1e-6, abs=1e-6)
    assert speed - deceleration * braked >= -1e-9
