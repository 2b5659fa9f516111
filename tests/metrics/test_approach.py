"""Braking episodes, the approach of a stop and hunting, in tables made piece by piece of constant accelerations."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.metrics.tables import actors_of, drive_of, ticks_of
from tests.metrics.test_stopping import PERIOD, Columns, find, found, joined, steady
from vve_sumo.metrics.approach import HUNTING, approach_of, brakings
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.metrics.stopping import MIN_RELEASE_TIME, REVERSED, braking_episodes, sign_changes

CRUISE = 1.0  #: before and after each made course [s]


def course(*pieces: tuple[float, float]) -> tuple[Columns, float]:
    """A drive of pieces (acceleration [m/s2], seconds) to rest, each granted and obeyed at once, and its distance.

    The first piece must start from 0 m/s at the end: the speeds are counted back from rest.
    """
    lost = -sum(a * round(seconds / PERIOD) * PERIOD for a, seconds in pieces)
    speeds = [lost]
    for a, seconds in pieces:
        speeds.append(speeds[-1] + a * round(seconds / PERIOD) * PERIOD)
    times = [round(seconds / PERIOD) * PERIOD for _a, seconds in pieces]
    distance = sum(0.5 * (v + w) * t for (v, w), t in zip(pairwise(speeds), times, strict=True))
    parts = [steady(0.0, lost, lost, CRUISE)]
    for (a, seconds), (v, w) in zip(pieces, pairwise(speeds), strict=True):
        ticks = round(seconds / PERIOD)
        parts.append((np.full(ticks, a), np.linspace(v, w, ticks, endpoint=False), np.full(ticks, a)))
    parts.append(steady(-1.0, 0.0, 0.0, CRUISE))
    return joined(*parts), distance


def episodes_in(columns: Columns) -> int:
    granted, speed, _acceleration = columns
    time = PERIOD * np.arange(len(speed))
    asked = np.maximum(-granted, 0.0)
    return len(brakings(time, asked, braking_episodes(time, asked, speed)))


def reversals_in(columns: Columns) -> int:
    _granted, speed, acceleration = columns
    time, nowhere = PERIOD * np.arange(len(speed)), np.zeros(len(speed), bool)
    stop = find(*columns)
    assert stop is not None
    return approach_of(stop, [stop.onset], time, speed, acceleration, nowhere).reversals


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(-9.0, -0.6), st.floats(0.2, 2.0)), min_size=1, max_size=8))
def test_any_single_braking_is_one_episode_whose_distance_is_the_closed_form(
    pieces: list[tuple[float, float]],
) -> None:
    assume(-sum(a * t for a, t in pieces) > 0.7)  # else it never moved
    columns, distance = course(*pieces)
    stop = found(*columns)
    assert episodes_in(columns) == 1
    assert reversals_in(columns) == 0
    assert stop.onset == round(CRUISE / PERIOD)
    assert stop.distance == pytest.approx(distance, abs=0.02)


lurches = st.lists(
    st.tuples(st.floats(0.4, 2.0), st.floats(0.3, 1.5), st.floats(-3.3, -1.0), st.floats(1.2, 3.0)),
    min_size=1,
    max_size=6,
)


@settings(deadline=None)
@given(lurches)
def test_a_stop_with_injected_lurches_is_one_episode_and_each_lurch_two_reversals(
    parts: list[tuple[float, float, float, float]],
) -> None:
    """Each lurch gains less than three quarters of what was lost by then, and lets go for less than two seconds."""
    pieces = [(-3.0, 2.0)]
    for push, for_s, brake, hold_s in parts:
        assume(push * for_s < 0.7 * -sum(a * t for a, t in pieces))
        pieces += [(push, for_s), (brake, hold_s)]
    assume(all(sum(a * t for a, t in pieces[i:]) < -0.4 for i in range(len(pieces))))  # it stands at the end alone
    columns, distance = course(*pieces)
    stop = found(*columns)
    assert episodes_in(columns) == 1
    assert reversals_in(columns) == 2 * len(parts)
    assert stop.onset == round(CRUISE / PERIOD)
    assert stop.distance == pytest.approx(distance, abs=0.02)


@pytest.mark.parametrize(
    ("pieces", "episodes", "onset_speed"),
    [
        ([(-3.0, 3.0), (1.0, 1.5), (-3.0, 1.5)], 1, 12.0),  # eased off
        ([(-3.0, 3.0), (0.5, MIN_RELEASE_TIME + 0.5), (-3.0, 1.5)], 2, 4.5),  # let go for long
        ([(-3.0, 3.0), (5.0, 1.5), (-3.0, 3.0)], 2, 9.0),  # drove on, at once: it regained 83 %
        ([(-3.0, 2.0), (2.0, 1.4), (-3.0, 2.0), (2.0, 1.9), (-3.0, 3.0)], 1, 14.4),
    ],
)
def test_a_real_release_parts_two_episodes_and_a_short_one_does_not(
    pieces: list[tuple[float, float]], episodes: int, onset_speed: float
) -> None:
    columns, _distance = course(*pieces)
    assert episodes_in(columns) == episodes
    assert found(*columns).onset_speed == pytest.approx(onset_speed, abs=1e-6)


def test_a_loop_that_hunts_in_cruise_has_not_begun_to_stop() -> None:
    """Braking and gaining it all back, ten times; then down to rest."""
    cruise = [(-2.0, 1.0), (2.0, 1.0)] * 10
    columns, _distance = course(*cruise, (-2.0, 3.0), (2.0, 1.0), (-2.0, 3.0), (2.0, 1.0), (-2.0, 2.0))
    assert episodes_in(columns) == 11
    assert found(*columns).onset == round((CRUISE + 20.0) / PERIOD)
    assert reversals_in(columns) == 4


def test_a_car_that_stood_for_long_begins_another_stop() -> None:
    first, _ = course((-3.0, 3.0))
    creep = steady(0.8, 0.0, 1.2, 1.5), steady(-2.0, 1.2, 0.0, 0.6), steady(-1.0, 0.0, 0.0, 1.0)
    short, long = (joined(first, steady(-1.0, 0.0, 0.0, seconds), *creep) for seconds in (0.5, 2.5))
    assert (episodes_in(short), episodes_in(long)) == (1, 2)
    assert found(*short).onset_speed == pytest.approx(9.0)
    assert found(*long).onset_speed == pytest.approx(1.2)


@settings(deadline=None)
@given(st.lists(st.floats(-5.0, 5.0), max_size=40))
def test_sign_changes_are_those_of_what_exceeds_the_threshold(values: list[float]) -> None:
    """Against a walk over the values, one by one."""
    sign, changes = 0, 0
    for value in values:
        if value < -REVERSED:
            changes += sign > 0
            sign = -1
        elif value > REVERSED and sign:
            changes += sign < 0
            sign = 1
    assert sign_changes(np.array(values)) == changes


def drive_to(target: float, moves: float, columns: Columns) -> dict[str, object]:
    """Metrics of a drive on a straight road whose car ahead stands at `target` [m], or moved until `moves` [s]."""
    granted, speed, acceleration = columns
    x = np.concatenate(([0.0], np.cumsum(0.5 * (speed[:-1] + speed[1:]) * PERIOD)))
    time = PERIOD * np.arange(len(speed))
    rows = [
        {
            "time_s": t,
            "true_x_m": at,
            "s_m": at,
            "true_speed_mps": v,
            "true_acceleration_mps2": a,
            "granted_acceleration_mps2": g,
            "state": "engaged",
        }
        for t, at, v, a, g in zip(time, x, speed, acceleration, granted, strict=True)
    ]
    car = [{"tick": i, "actor": "car", "x_m": target, "speed_mps": 3.0 * (time[i] < moves)} for i in range(len(rows))]
    return PER_DRIVE.measure(drive_of(ticks_of(rows), actors_of(car)))


def test_the_approach_begins_with_the_first_braking_for_what_stood_ahead() -> None:
    """A braking, a long release and the stop: the target stood all the time, or moved until the release."""
    columns, distance = course((-2.0, 2.0), (0.5, 4.0), (-3.0, 3.0))
    stood, moved = drive_to(130.0, 0.0, columns), drive_to(130.0, CRUISE + 3.0, columns)
    assert stood["stop_episodes"] == moved["stop_episodes"] == 2
    assert stood["stop_distance_m"] == moved["stop_distance_m"] == pytest.approx(9.0**2 / 6.0, abs=0.02)
    assert stood["approach_distance_m"] == pytest.approx(distance, abs=0.02)
    assert stood["approach_duration_s"] == pytest.approx(9.0, abs=2 * PERIOD)
    assert moved["approach_distance_m"] == moved["stop_distance_m"]
    assert (stood["hunting_reversals"], moved["hunting_reversals"]) == (2, 0)
    assert not stood["hunting"]


def test_a_drive_that_lurches_twice_is_hunting_and_one_without_a_stop_is_not() -> None:
    columns, distance = course((-3.0, 3.0), (1.5, 1.0), (-3.0, 1.5), (1.5, 1.0), (-3.0, 1.0))
    measured = drive_to(140.0, 0.0, columns)
    assert (measured["hunting_reversals"], measured["hunting"]) == (HUNTING, True)
    assert measured["stop_distance_m"] == pytest.approx(distance, abs=0.02)
    granted, speed, acceleration = (column[:150] for column in columns)
    none = drive_to(140.0, 0.0, (granted, speed, acceleration))
    assert (none["hunting"], none["hunting_reversals"], none["stop_episodes"]) == (False, 0, 0)
