"""A simulated phone: it walks where it is told, errs as much as it says, and is the same with the same seed."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from tests.people.persons import FRAME, SETUP
from vve_sumo.people.person import Person
from vve_sumo.people.reports import PositionReport
from vve_sumo.people.simulated_phone import MAX_DELAY, PERIOD_JITTER, PhoneErrors, SimulatedPhone
from vve_sumo.people.walk import Walk, WalkPoint

STRAIGHT = Walk([WalkPoint(2.0, 0.0, 0.0), WalkPoint(12.0, 14.0, 0.0), WalkPoint(22.0, 14.0, 10.0)], heading=0.0)
STANDING = Walk([WalkPoint(0.0, 0.0, 0.0)], heading=0.7)


def phone(seed: int, walk: Walk = STANDING, accuracy: float = 5.0) -> SimulatedPhone:
    return SimulatedPhone("anna", walk, FRAME, PhoneErrors(accuracy, 1.0), np.random.SeedSequence(seed))


@pytest.mark.parametrize(
    ("time", "x", "y", "heading", "speed"),
    [
        (0.0, 0.0, 0.0, 0.0, 0.0),
        (7.0, 7.0, 0.0, 0.0, 1.4),
        (17.0, 14.0, 5.0, math.pi / 2, 1.0),
        (30.0, 14.0, 10.0, math.pi / 2, 0.0),
    ],
)
def test_a_walk_by_hand(time: float, x: float, y: float, heading: float, speed: float) -> None:
    assert STRAIGHT.at(time) == pytest.approx((x, y, heading, speed))


def test_a_walk_counts_from_the_anchors_heading() -> None:
    north = Walk([WalkPoint(0.0, 10.0, 0.0), WalkPoint(1.0, 10.0, 2.0)], heading=math.pi / 2)
    assert north.at(0.0)[:2] == pytest.approx((0.0, 10.0))
    assert north.at(1.0)[:2] == pytest.approx((-2.0, 10.0))
    assert STANDING.at(5.0) == pytest.approx((0.0, 0.0, 0.7, 0.0))


def test_it_is_wrong_by_as_much_as_it_says() -> None:
    """Of many phones, each at one moment, 95 % of the places lie within the accuracy that they report."""
    errors = []
    for seed in range(3000):
        _, report = phone(seed).until(2.0)[0]
        assert report.accuracy == 5.0
        errors.append(math.hypot(*FRAME.to_map(report.latitude, report.longitude)))
    inside = np.mean(np.array(errors) <= 5.0)
    assert inside == pytest.approx(0.95, abs=0.015)  # three standard deviations of the share: 0.012


def test_its_error_holds_for_a_while() -> None:
    apart = {1: [], 60: []}
    for seed in range(60):
        places = [FRAME.to_map(r.latitude, r.longitude) for _, r in phone(seed).until(100.0)]
        for lag, found in apart.items():
            found += [math.dist(places[k], places[k + lag]) for k in range(0, 30, 10)]
    assert np.median(apart[1]) < 0.6 * np.median(apart[60])


def test_it_comes_once_a_second_and_late() -> None:
    came = phone(3).until(200.0)
    times = [report.measured for _, report in came]
    steps = np.diff(times)
    assert len(came) == pytest.approx(200, abs=4)
    assert steps.min() >= 1.0 - PERIOD_JITTER
    assert steps.max() <= 1.0 + PERIOD_JITTER
    assert all(0.1 <= received - report.measured <= MAX_DELAY for received, report in came)
    assert [received for received, _ in came] == sorted(received for received, _ in came)


def test_the_same_seed_says_the_same_however_often_it_is_asked() -> None:
    whole = phone(5, STRAIGHT).until(30.0)
    one = phone(5, STRAIGHT)
    pieces = [report for k in range(1501) for report in one.until(0.02 * k)]
    assert pieces == whole
    assert phone(6, STRAIGHT).until(30.0) != whole


@pytest.mark.thorough
@pytest.mark.parametrize("accuracy", [3.0, 5.0, 9.0])
def test_the_circle_of_the_estimate_holds_the_true_place(accuracy: float) -> None:
    """Gate, filter and circle together, on walks with turns: 95 % asked for, of 200 walks' ticks."""
    held, counted = 0, 0
    for seed in range(200):
        person, one = Person(SETUP), phone(seed, STRAIGHT, accuracy)
        for k in range(0, 1250, 25):
            now = 0.02 * k
            for received, report in one.until(now):
                assert isinstance(report, PositionReport)
                person.receive(received, report)
            state = person.step(now)
            if now > 3.0 and state.body is not None:
                true = STRAIGHT.at(now)
                # The alignment of the tests turns by 90 degrees about 1000, 2000.
                off = math.hypot(state.x - (1000.0 - true.y), state.y - (2000.0 + true.x))
                held += off <= state.radius
                counted += 1
    assert counted > 5000
    assert held / counted > 0.93


def test_walks_rise_in_time() -> None:
    assert all(a.measured < b.measured for (_, a), (_, b) in pairwise(phone(9).until(50.0)))
