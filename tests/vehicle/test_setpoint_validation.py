"""Which setpoints are taken: each thing that may be wrong alone, and what is right to the last microsecond."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.setpoints import setpoint as complete
from vve_sumo.values import FallbackPath
from vve_sumo.vehicle.setpoint_validation import Debounce, Rejection, SetpointValidator

GOOD = complete(
    steering=0.1, acceleration=-1.0, sequence=5, time=2.0, expires=2.1, x=1.0, y=2.0, heading=0.3, speed=4.0,
    yaw_rate=0.1, grade=0.01,
)  # fmt: skip
NUMBERS = ("steering", "acceleration", "x", "y", "heading", "speed", "yaw_rate", "grade")


def taken(now: float = 2.05, **changes: object) -> Rejection | None:
    return SetpointValidator().take(now, replace(GOOD, **changes))


def test_a_good_one_is_taken_and_kept():
    admission = SetpointValidator()
    assert admission.setpoint is None
    assert admission.take(2.05, GOOD) is None
    assert admission.setpoint is GOOD


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_every_number_must_be_one(name, value):
    assert taken(**{name: value}) == Rejection("setpoint_not_finite", fatal=True)


@pytest.mark.parametrize(
    "missing", [{"sequence": -1}, {"time": math.nan}, {"expires": math.nan}, {"time": -math.inf}, {"expires": math.inf}]
)
def test_one_that_does_not_say_its_place_in_time_is_incomplete(missing):
    assert taken(**missing) == Rejection("setpoint_incomplete", fatal=True)


def test_a_sequence_begins_with_nought():
    assert taken(sequence=0) is None


def test_a_way_that_is_none_is_invalid():
    assert taken(fallback_path=FallbackPath(1.0, (0.0,))) is None
    assert taken(fallback_path=FallbackPath(0.0, (0.0,))) == Rejection("profile_invalid", fatal=True)


def test_a_sequence_counts_up_and_a_refused_one_does_not_count():
    admission = SetpointValidator()
    assert admission.take(2.05, GOOD) is None
    for sequence in (4, 5):
        old = admission.take(2.05, replace(GOOD, sequence=sequence))
        assert old == Rejection("setpoint_out_of_order", fatal=False)
    assert admission.take(2.05, replace(GOOD, sequence=100, steering=math.nan)).fatal
    assert admission.take(2.05, replace(GOOD, sequence=6, acceleration=1.0)) is None
    assert admission.setpoint.acceleration == 1.0


@pytest.mark.parametrize(("life", "refused"), [(0.1, False), (0.1 + 0.5e-6, False), (0.1 + 2e-6, True)])
def test_a_setpoint_lives_for_a_tenth_of_a_second_at_most(life, refused):
    answer = taken(time=0.0, expires=life, now=0.0)
    assert answer == (Rejection("setpoint_lifetime", fatal=False) if refused else None)


@pytest.mark.parametrize(("ahead", "refused"), [(0.0, False), (0.5e-6, False), (2e-6, True)])
def test_none_comes_from_the_future(ahead, refused):
    answer = taken(time=ahead, expires=0.05, now=0.0)
    assert answer == (Rejection("setpoint_from_future", fatal=False) if refused else None)


@pytest.mark.parametrize(
    ("late", "valid"), [(-0.1, True), (0.0, True), (0.5e-6, True), (2e-6, False), (math.nan, False)]
)
def test_one_counts_until_it_expires(late, valid):
    admission = SetpointValidator()
    assert not admission.valid(0.0)
    admission.take(2.05, replace(GOOD, faults=("pose_stale", "outside_geofence")))
    assert admission.valid(2.1 + late) is valid
    assert admission.faults(2.1 + late) == (["pose_stale", "outside_geofence"] if valid else [])


def test_without_a_setpoint_there_is_no_fault():
    assert SetpointValidator().faults(0.0) == []


# Persistence.


def test_what_is_bad_for_the_whole_time_persists_and_a_break_begins_anew():
    bad = Debounce(0.5)
    assert not bad.step(1.0, True)
    assert not bad.step(1.4999, True)
    assert bad.step(1.5, True)
    assert bad.step(1.6, True)
    assert not bad.step(1.7, False)
    assert not bad.step(1.8, True)
    assert not bad.step(2.2, True)
    bad.reset()
    assert not bad.step(2.4, True)
    assert bad.step(2.9, True)


def test_rounding_of_times_does_not_decide():
    """Half a microsecond short of the time is long enough, two are not."""
    assert [_after(short) for short in (0.5e-6, 2e-6)] == [True, False]


def _after(short: float) -> bool:
    bad = Debounce(0.5)
    bad.step(0.0, True)
    return bad.step(0.5 - short, True)


def test_time_that_runs_backwards_counts_from_the_earliest():
    bad = Debounce(0.5)
    assert not bad.step(2.0, True)
    assert not bad.step(1.0, True)
    assert bad.step(1.5, True)
