"""The judge of overlaps by closed forms; an ego that creeps through a junction, and a minute of odd driving."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.exhaustive import with_slow
from tests.isolated import isolated
from tests.odd.ego import Manoeuvre
from tests.odd.episode import Told, drive, odd
from tests.odd.judge import DECELERATION, REACTION, Moment, judge
from vve_sumo.geometry import Box, overlap

PERIOD = 0.02


def met(speed: float, ego_at: Callable[[float], Box], start: float) -> list[Moment]:
    """A driver comes from the west at a constant speed until it touches the ego."""
    moments: list[Moment] = []
    for k in range(2000):
        time = k * PERIOD
        moments.append(Moment(time, ego_at(time), Box(start + speed * time, 0.0, 0.0, 4.0, 2.0), speed))
        if overlap(moments[-1].ego, moments[-1].other):
            return moments
    raise AssertionError("they never met")


@pytest.mark.thorough
@settings(deadline=None, max_examples=40)
@given(st.floats(4.0, 20.0), st.floats(1.0, 60.0))
def test_who_drives_into_a_standing_ego_could_have_stopped_where_the_way_was_long_enough(speed, gap):
    """The ego lies across the way from the first moment on: the way to a stop is in every textbook."""
    needed = REACTION * speed + 0.5 * speed * speed / DECELERATION
    if abs(gap - needed) < 0.5 + speed * PERIOD:
        return
    across = Box(0.0, 0.0, 0.5 * math.pi, 5.0, 2.0)
    verdict = judge(met(speed, lambda _: across, -3.0 - gap))
    assert verdict.avoidable == (gap > needed)
    assert verdict.impact == speed


def test_an_ego_that_comes_from_the_side_a_moment_before_is_not_the_drivers_fault():
    def ego(time: float) -> Box:
        return Box(0.0, min(-12.0 + 4.0 * time, 0.0), 0.5 * math.pi, 5.0, 2.0)

    verdict = judge(met(10.0, ego, -32.0))
    assert not verdict.avoidable
    assert verdict.lay < 1.1


def test_an_ego_that_backs_into_a_standing_driver_is_not_the_drivers_fault():
    verdict = judge(met(0.0, lambda time: Box(8.0 - time, 0.0, 0.0, 5.0, 2.0), 0.0))
    assert not verdict.avoidable


@pytest.mark.slow
@pytest.mark.parametrize("seed", with_slow([6, 13], lambda seed: seed == 6))
def test_traffic_does_not_drive_through_an_ego_that_creeps_through_a_left_turn(seed: int) -> None:
    """On 17th Avenue into Joyce: its body lies on lanes of the junction that SUMO does not map it to."""
    reported = isolated(_creep, seed)
    assert reported.overlaps == []
    assert reported.driven > 35.0


def _creep(seed: int) -> Told:
    means = iter([Manoeuvre("creep", 1.0, math.inf)])
    return drive(seed, 50.0, "heavy", "linden_loop", 245.0 / 3551.0, means, 60.0 + 10.0 * seed)


@pytest.mark.thorough
def test_a_minute_of_odd_driving() -> None:
    """In it SUMO turns a body that changes lanes behind a junction by 0.3 rad in one step."""
    reported = isolated(odd, 22, 60.0, "heavy")
    assert (reported.avoidable, reported.jumps) == (0, [])
    assert reported.driven > 30.0
