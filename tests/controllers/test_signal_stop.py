"""The shipped law before signals: what it could stop for it stops for, and the advice arrives in green."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.approach import NOWHERE, Approach
from controllers.follow_and_stop import COMFORT_LIMIT, JERK_DOWN, JERK_UP, PERIOD
from controllers.green_advice import DECELERATION, LEAST_SPEED, advised_speed
from controllers.signal_stop import LOST, MARGIN, SignalStop, SignalWatch, yellow_stop_distance
from tests.controllers.bench import CAR, ROAD
from vve_sumo.laws import jerk_limit
from vve_sumo.values import Floats, Observation, Point, Pose, StopLines

RED, GREEN, YELLOW = 3, 6, 8
BUMPER = CAR.rear_axle_to_bumper
ANSWER = CAR.brake_delay + CAR.brake_lag + PERIOD


def lines(time: float, *rows: tuple[float, float, float, float, int]) -> StopLines:
    """Return lines straight ahead: where each is, where its way leads (ahead, left), and what is shown."""
    x, exit_x, exit_y, heading, phase = (np.array(column, np.float64) for column in zip(*rows, strict=True))
    zeros: Floats = np.zeros(len(rows))
    number = np.zeros(len(rows), np.int64)
    return StopLines(
        time, number, number + 1, x, zeros, heading, zeros + 3.5, exit_x, exit_y, phase.astype(np.int8), zeros, zeros,
        zeros, zeros,
    )  # fmt: skip


def seen(time: float, s: float, speed: float, *rows: tuple[float, float, float, float, int]) -> Observation:
    pose = Pose(time, Point.REAR_AXLE, s, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0)
    return Observation(0, time, pose, ROAD, 15.0, {"signals": lines(time, *rows)} if rows else {}, 0.0)


@settings(deadline=None, max_examples=25)
@given(
    speed=st.floats(3.0, 20.0),
    distance=st.floats(5.0, 120.0),
    yellow=st.floats(2.0, 6.0),
    before=st.floats(0.0, 6.0),
)
def test_no_line_is_passed_on_red_before_which_the_car_could_have_stopped(
    speed: float, distance: float, yellow: float, before: float
) -> None:
    """The car keeps its speed until the law says stop; its brakes act after their dead time and lag."""
    law, approach = SignalStop(CAR, PERIOD), Approach(CAR, 2.0, PERIOD)
    line, s, v, a, command, time = BUMPER + distance, 0.0, speed, 0.0, 0.0, 0.0
    sent, could_stop = deque([0.0] * round(CAR.brake_delay / PERIOD)), None
    while time < before + yellow + 20.0 and s + BUMPER < line and v > 0.01:
        phase = GREEN if time < before else YELLOW if time < before + yellow else RED
        left = line - s - BUMPER
        if phase == YELLOW and could_stop is None:
            could_stop = left - MARGIN >= yellow_stop_distance(v, ANSWER)
        goal = law.goal(seen(time, s, v, (left, left + 15.0, 0.0, 0.0, phase)), s)
        wanted = 0.0 if goal is NOWHERE else min(0.0, approach.acceleration(goal, v, a))
        command = jerk_limit(wanted, command, COMFORT_LIMIT, 0.0, JERK_DOWN, JERK_UP, PERIOD)
        sent.append(command)
        a += (sent.popleft() - a) * (1.0 - math.exp(-PERIOD / CAR.brake_lag))
        v = max(v + a * PERIOD, 0.0)
        s += v * PERIOD
        time += PERIOD
    if could_stop:
        assert s + BUMPER < line
    elif could_stop is False:
        assert s + BUMPER >= line, "it began to stop and stands in the junction's way, or before it could not"


def test_on_yellow_it_goes_where_the_closed_form_says_that_it_cannot_stop() -> None:
    """Uniform braking after a dead time and a linear ramp; the distance is that at which the decision tips."""
    v, ramp = 13.0, 0.75
    lost = 0.5 * 3.0 * ramp
    by_hand = v * ANSWER + v * ramp - 3.0 * ramp**2 / 6.0 + (v - lost) ** 2 / 6.0
    for beyond, stops in ((0.5, True), (-0.5, False)):
        left = by_hand + MARGIN + beyond
        goal = SignalStop(CAR, PERIOD).goal(seen(0.0, 0.0, v, (left, left + 15.0, 0.0, 0.0, YELLOW)), 0.0)
        assert (goal is not NOWHERE) is stops


def test_who_decided_to_go_on_yellow_is_not_stopped_by_red() -> None:
    law = SignalStop(CAR, PERIOD)
    assert law.goal(seen(0.0, 0.0, 13.0, (15.0, 30.0, 0.0, 0.0, YELLOW)), 0.0) is NOWHERE
    assert law.goal(seen(0.1, 1.3, 13.0, (13.7, 28.7, 0.0, 0.0, RED)), 1.3) is NOWHERE


@pytest.mark.parametrize(("left", "speed"), [(8.0, 2.0), (0.5, 0.0)])
def test_who_decided_to_go_but_was_held_up_does_not_go_on_red(left: float, speed: float) -> None:
    """Somebody who waits ahead has slowed it down, or stopped it short of the line."""
    law, s = SignalStop(CAR, PERIOD), 15.0 - left
    assert law.goal(seen(0.0, 0.0, 13.0, (15.0, 30.0, 0.0, 0.0, YELLOW)), 0.0) is NOWHERE
    assert law.goal(seen(2.0, s, speed, (left, left + 15.0, 0.0, 0.0, YELLOW)), s) is NOWHERE
    for time in (4.0, 5.0):
        goal = law.goal(seen(time, s, speed, (left, left + 15.0, 0.0, 0.0, RED)), s)
        assert goal.distance == pytest.approx(left - MARGIN)


def test_of_the_ways_across_a_junction_the_paths_own_counts() -> None:
    """Straight on is green; the left turn beside it, and a line of the other direction, are red."""
    rows = ((40.0, 55.0, 0.0, 0.0, GREEN), (40.0, 48.0, 9.0, 0.0, RED), (45.0, 30.0, 0.0, math.pi, RED))
    found = SignalWatch(CAR).step(seen(0.0, 0.0, 10.0, *rows), 0.0)
    assert found is not None
    assert found.phase == GREEN
    assert found.s == pytest.approx(BUMPER + 40.0, abs=1e-6)


def test_a_way_that_cannot_be_told_counts_as_the_strictest() -> None:
    rows = ((40.0, 48.0, 9.0, 0.0, GREEN), (40.0, 48.0, -9.0, 0.0, RED))
    found = SignalWatch(CAR).step(seen(0.0, 0.0, 10.0, *rows), 0.0)
    assert found is not None
    assert found.phase == RED


def test_a_signal_that_is_not_known_any_more_is_red() -> None:
    law = SignalStop(CAR, PERIOD)
    assert law.goal(seen(0.0, 0.0, 10.0, (60.0, 75.0, 0.0, 0.0, GREEN)), 0.0) is NOWHERE
    assert law.goal(seen(LOST - 0.1, 5.0, 10.0), 5.0) is NOWHERE
    assert law.goal(seen(LOST + 0.1, 5.0, 10.0), 5.0).distance == pytest.approx(55.0 - MARGIN)


@given(speed=st.floats(1.0, 25.0), distance=st.floats(10.0, 200.0), after=st.floats(0.5, 60.0))
def test_the_advised_speed_arrives_at_the_time(speed: float, distance: float, after: float) -> None:
    """Integrated: slow by the deceleration to the advised speed, then keep it."""
    advised = advised_speed(distance, speed, after)
    if advised is None:
        # At the least speed that is advised, reached at once by the deceleration, it would be there too early.
        slowing = min(max(speed - LEAST_SPEED, 0.0) / DECELERATION, after)
        least = speed - DECELERATION * slowing
        assert 0.5 * (speed + least) * slowing + least * (after - slowing) >= distance - 1e-6
        return
    if advised >= speed:
        assert advised * after == pytest.approx(distance)
        return
    assert advised >= LEAST_SPEED
    slowing = (speed - advised) / DECELERATION
    assert 0.5 * (speed + advised) * slowing + advised * (after - slowing) == pytest.approx(distance, rel=1e-6)
