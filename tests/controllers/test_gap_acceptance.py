"""The closed forms of gap acceptance against motions that are integrated in small steps."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.gap_acceptance import (
    AFTER,
    BRAKING,
    SLOWING_DOWN,
    Coming,
    Run,
    may_cross,
    may_join,
    time_to_reach,
    time_to_slow,
)

STEP = 4e-3

SPEEDS, DISTANCES = st.floats(0.0, 15.0), st.floats(0.5, 60.0)


def integrated(
    distance: float, speed: float, acceleration: float, top: float, delay: float = 0.0
) -> tuple[float, float]:
    """Return when a distance has been gone [s], and the speed then [m/s], step by step."""
    gone, time = 0.0, 0.0
    while gone < distance and time < 200.0:
        if time >= delay:
            speed = min(speed + acceleration * STEP, max(top, speed))
        gone, time = gone + speed * STEP, time + STEP
    return time, speed


@given(distance=DISTANCES, speed=SPEEDS, acceleration=st.floats(0.5, 3.0), top=st.floats(2.0, 15.0))
def test_the_time_to_reach_a_place_is_that_of_the_motion(
    distance: float, speed: float, acceleration: float, top: float
) -> None:
    expected, _ = integrated(distance, speed, acceleration, top)
    assert time_to_reach(distance, speed, acceleration, top) == pytest.approx(expected, abs=0.03)


@given(distance=DISTANCES, speed=st.floats(0.0, 6.0), delay=st.floats(0.0, 1.0))
def test_the_cars_run_is_that_of_the_motion(distance: float, speed: float, delay: float) -> None:
    run = Run(speed, 1.4, 8.0, delay)
    time, then = integrated(distance, speed, 1.4, 8.0, delay)
    assert run.time(distance) == pytest.approx(time, abs=0.03)
    assert run.speed_at(distance) == pytest.approx(then, abs=0.05)


@given(
    begin=st.floats(1.0, 15.0),
    width=st.floats(1.0, 8.0),
    distance=st.floats(0.0, 150.0),
    speed=st.floats(0.0, 15.0),
    margin=st.floats(0.0, 2.0),
)
def test_whoever_is_let_through_is_met_by_nobody_who_speeds_up_or_goes_on(
    begin: float, width: float, distance: float, speed: float, margin: float
) -> None:
    """The two are in the conflict area one after the other, by the margin or by AFTER."""
    run, other = Run(0.0, 1.4, 8.0, 0.5), Coming(distance, distance + width + 5.0, speed, 12.0)
    if not may_cross(run, begin, begin + width + 5.0, other, margin):
        return
    enters, leaves = run.time(begin), run.time(begin + width + 5.0)
    for faster in (0.0, 1.0):
        arrives = integrated(distance, speed, faster, 12.0)[0] if speed + faster > 0.0 else math.inf
        gone = integrated(distance + width + 5.0, speed, faster, 12.0)[0] if speed + faster > 0.0 else math.inf
        assert arrives >= leaves + margin - 0.03 or gone + AFTER <= enters + 0.03


@given(distance=DISTANCES, speed=st.floats(5.0, 15.0), across=st.floats(1.0, 15.0))
def test_who_has_to_slow_down_comes_no_sooner_than_by_slowing_down_last_of_all(
    distance: float, speed: float, across: float
) -> None:
    """Backwards in time: it speeds up from the place by SLOWING_DOWN to its speed."""
    expected = 0.0 if across >= speed else integrated(distance, across, SLOWING_DOWN, speed)[0]
    assert time_to_slow(distance, speed, across, SLOWING_DOWN) == pytest.approx(expected, abs=0.03)


def test_nobody_on_the_way_is_no_reason_to_wait_and_one_in_the_area_is() -> None:
    run = Run(0.0, 1.4, 8.0)
    assert may_cross(run, 5.0, 15.0, Coming(-20.0, -10.0, 0.0, 12.0), 1.0)
    assert not may_cross(run, 5.0, 15.0, Coming(-1.0, 4.0, 0.0, 12.0), 1.0)


@given(distance=st.floats(1.0, 200.0), speed=st.floats(3.0, 14.0), margin=st.floats(0.2, 2.0))
def test_who_comes_from_behind_a_car_that_joined_brakes_by_no_more_than_was_said(
    distance: float, speed: float, margin: float
) -> None:
    """The other goes on until the car has joined and then brakes to its speed: the margin is left."""
    run, other, begin = Run(0.0, 1.4, 5.0, 0.5), Coming(distance, 5.0, speed, speed), 6.0
    passes_before = distance + 5.0 < speed * (run.time(begin) - AFTER)
    if passes_before or not may_join(run, begin, begin + 5.0, other, margin):
        return
    time = run.time(begin + 5.0)
    left, own = distance - speed * time, run.speed_at(begin + 5.0)
    slowing = max(speed - own, 0.0) ** 2 / (2.0 * BRAKING)
    assert left - slowing >= margin * speed - 1e-9
