"""The terms of the tolerance against cars stepped through in time, and against the gateway's own constants."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.metrics.tables import CAR
from tests.metrics.test_stopping import PERIOD, braked, found, joined, steady
from vve_sumo.metrics.stopping import Stop
from vve_sumo.metrics.stopping_tolerance import GRADE, LOOP_GAIN, STRENGTH, Tolerance, tolerance
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.vehicle.actuation import INTEGRAL_GAIN

STEP = 1e-3
#: a car that has brakes to spare
STRONG = replace(CAR, deceleration_limit=1e3)


def stopped(speed: float, demand: float, lacking: float, gain: float) -> float:
    """Distance of a car that is asked for `demand` and lacks some of it, and whose loop asks for the more."""
    asked = left = speed
    driven = 0.0
    while left > 0.0:
        asked = max(asked - STEP * demand, 0.0)
        before, left = left, left - STEP * (demand - lacking + gain * (left - asked))
        driven += 0.5 * STEP * (before + left)
    return driven


def stop_of(speed: float, demand: float) -> Stop:
    """The stop of a car as declared at a constant deceleration."""
    return found(*braked(speed, demand))


def test_the_loop_is_the_gateways() -> None:
    assert LOOP_GAIN == INTEGRAL_GAIN


@settings(deadline=None, max_examples=20)
@given(speed=st.floats(5.0, 20.0), demand=st.floats(0.8, 5.0))
def test_a_car_that_is_weaker_within_what_is_tolerated_costs_no_more_than_its_term(speed: float, demand: float) -> None:
    """With brakes to spare the loop makes up for it; at the limit nothing does. Against cars stepped through."""
    stop, exact = stop_of(speed, demand), speed * speed / (2.0 * demand)
    for lacking, which in ((STRENGTH * demand, "strength"), (GRADE * GRAVITY, "grade")):
        spare = getattr(tolerance(stop, STRONG, PERIOD), which)
        assert 0.85 * spare - 0.01 <= stopped(speed, demand, lacking, LOOP_GAIN) - exact <= spare + 0.01
        limited = getattr(tolerance(stop, replace(CAR, deceleration_limit=demand), PERIOD), which)
        assert stopped(speed, demand, lacking, 0.0) - exact == pytest.approx(limited, rel=0.1, abs=0.01)


@settings(deadline=None, max_examples=20)
@given(speed=st.floats(8.0, 20.0), build_up=st.floats(0.2, 0.8))
def test_weaker_brakes_at_their_limit_cost_no_more_than_the_term(speed: float, build_up: float) -> None:
    """The course rises to the declared limit; brakes that have 5 % less of it take longer, and no loop helps them."""
    limit = 5.9
    stop = found(*braked(speed, limit, build_up=build_up), limit=limit)
    weaker, exact = (driven(speed, build_up, share * limit) for share in (1.0 - STRENGTH, 1.0))
    allowed = tolerance(stop, replace(CAR, deceleration_limit=limit), PERIOD).strength
    assert 0.5 * allowed <= weaker - exact <= allowed


def driven(speed: float, build_up: float, most: float) -> float:
    """Distance of a car whose deceleration rises for `build_up` towards 5.9 m/s2, up to the most it has."""
    way = time = 0.0
    while speed > 0.0:
        speed, way, time = speed - STEP * min(most, 5.9 * time / build_up), way + STEP * speed, time + STEP
    return way


def test_terms_combine_as_the_root_of_their_squares_and_grow_with_the_stop() -> None:
    assert Tolerance(0.3, 0.4, 0.0, 1.2).total == pytest.approx(1.3)
    hard, gentle = (tolerance(stop_of(12.0, a), STRONG, PERIOD) for a in (5.0, 1.0))
    assert gentle.grade > hard.grade
    assert gentle.speed == pytest.approx(5.0 * hard.speed, rel=0.02)
    assert gentle.tick == hard.tick == pytest.approx(12.0 * PERIOD / math.sqrt(12.0))
    longer = tolerance(stop_of(12.0, 5.0), STRONG, 2.0 * PERIOD)
    assert longer.tick == pytest.approx(2.0 * hard.tick)


def test_a_course_that_ripples_leaves_more_unknown() -> None:
    """3 and 1 m/s2 in turns, twelve times: the root mean square of the course is sqrt(5), its ripple 1."""
    parts, speed = [], 12.0
    for a in (3.0, 1.0) * 12:
        parts.append(steady(-a, speed, speed - 0.25 * a, 0.25))
        speed -= 0.25 * a
    smooth, rippling = stop_of(12.0, 2.0), found(*joined(*parts, steady(-1.0, 0.0, 0.0, 1.0)))
    assert rippling.ripple == pytest.approx(1.0, rel=0.1)
    terms = [tolerance(stop, STRONG, PERIOD) for stop in (rippling, smooth)]
    assert terms[0].strength == pytest.approx(math.sqrt(5.0) / 2.0 * terms[1].strength, rel=0.05)


def test_a_stop_on_which_the_car_gained_speed_has_none() -> None:
    lurch = steady(-3.0, 12.0, 6.0, 2.0), steady(1.5, 6.0, 7.5, 1.0), braked(7.5, 3.0, lead_in=0.0)
    stop = found(*joined(*lurch))
    assert stop.reversals == 2
    assert all(math.isnan(term) for term in tolerance(stop, STRONG, PERIOD))
