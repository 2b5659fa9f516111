"""When stations send, against the standards' sentences written out a check at a time, and in closed form."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.v2x.triggering import CHECK_PERIOD, CamTrigger, Motion, VamTrigger

SECOND = 1_000_000


def _times(trigger: CamTrigger | VamTrigger, motions: list[Motion]) -> list[float]:
    """Times of the messages [s], with a check each 0.1 s."""
    checks = enumerate(motions)
    return [CHECK_PERIOD * n / SECOND for n, motion in checks if trigger.due(CHECK_PERIOD * n, motion)]


def _steady(speed: float, checks: int) -> list[Motion]:
    return [Motion(speed * 0.1 * n, 0.0, 0.0, speed) for n in range(checks)]


def test_a_car_at_rest_sends_once_a_second() -> None:
    assert _times(CamTrigger(), _steady(0.0, 100)) == [float(n) for n in range(10)]


@pytest.mark.parametrize("speed", [3.0, 4.5, 9.0, 13.9, 25.0, 39.0, 45.0, 60.0])
def test_a_car_at_a_steady_speed_sends_whenever_it_has_gone_more_than_four_metres(speed: float) -> None:
    times = _times(CamTrigger(), _steady(speed, 200))
    checks = math.floor(4.0 / (speed * 0.1)) + 1  # the first check at which it has gone more than 4 m
    expected = min(checks * 0.1, 1.0)
    gaps = [after - before for before, after in pairwise(times)]
    assert gaps == pytest.approx([expected] * len(gaps))


@pytest.mark.parametrize("speed", [0.0, 13.9])
def test_a_shorter_longest_interval_is_kept_at_any_speed(speed: float) -> None:
    times = _times(CamTrigger(CHECK_PERIOD), _steady(speed, 50))
    assert times == pytest.approx([0.1 * n for n in range(50)])


def test_a_car_that_stops_sends_three_more_at_its_last_rate() -> None:
    """The interval of the last message that motion brought about holds for three, then it is a second again."""
    motions = _steady(20.0, 30)  # a message each 0.3 s
    at_rest = motions[-1]._replace(speed=20.0)
    times = _times(CamTrigger(), motions + [at_rest] * 60)
    last_moved = max(time for time in times if time < 3.0)
    after = [round(time - last_moved, 6) for time in times if time > last_moved]
    assert after[:5] == [0.3, 0.6, 0.9, 1.9, 2.9]


@pytest.mark.parametrize(
    ("changed", "due"),
    [
        (Motion(0.0, 0.0, math.radians(4.1), 5.0), True),
        (Motion(0.0, 0.0, math.radians(3.9), 5.0), False),
        (Motion(0.0, 0.0, math.radians(-4.1), 5.0), True),
        (Motion(2.9, 2.9, 0.0, 5.0), True),
        (Motion(2.8, 2.8, 0.0, 5.0), False),
        (Motion(0.0, 0.0, 0.0, 5.6), True),
        (Motion(0.0, 0.0, 0.0, 4.4), True),
        (Motion(0.0, 0.0, 0.0, 5.4), False),
    ],
)
@pytest.mark.parametrize("kind", [CamTrigger, VamTrigger])
def test_thresholds(kind: type[CamTrigger | VamTrigger], changed: Motion, due: bool) -> None:
    trigger = kind()
    assert trigger.due(0, Motion(0.0, 0.0, 0.0, 5.0))
    assert trigger.due(CHECK_PERIOD, changed) is due


def test_headings_are_compared_around_the_circle() -> None:
    trigger = CamTrigger()
    trigger.due(0, Motion(0.0, 0.0, math.radians(179.0), 5.0))
    assert not trigger.due(CHECK_PERIOD, Motion(0.0, 0.0, math.radians(-179.0), 5.0))


def test_nothing_is_sent_before_the_shortest_interval() -> None:
    for trigger in (CamTrigger(), VamTrigger()):
        trigger.due(0, Motion(0.0, 0.0, 0.0, 5.0))
        assert not trigger.due(CHECK_PERIOD - 1, Motion(50.0, 0.0, 1.0, 9.0))


def test_a_child_at_rest_is_heard_each_five_seconds_and_at_once_when_it_sets_out() -> None:
    standing, walking = [Motion(0.0, 0.0, 1.0, 0.0)] * 72, [Motion(0.0, 0.1389 * n, 1.0, 1.389) for n in range(1, 40)]
    times = _times(VamTrigger(), standing + walking)
    assert times[:3] == [0.0, 5.0, 7.2]
    # From there on whenever it has gone 4 m.
    assert times[3] == pytest.approx(7.2 + 0.1 * math.ceil(4.0 / 0.1389), abs=0.11)


def test_who_stands_and_turns_sends_nothing_of_it() -> None:
    """The standard compares directions of velocities, and who stands has none."""
    trigger = VamTrigger()
    trigger.due(0, Motion(0.0, 0.0, 0.0, 0.0))
    assert not trigger.due(SECOND, Motion(0.0, 0.0, 2.0, 0.0))


motion = st.builds(
    Motion,
    st.floats(-100.0, 100.0),
    st.floats(-100.0, 100.0),
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 40.0),
)


@given(st.lists(motion, min_size=2, max_size=60))
def test_intervals_are_between_shortest_and_longest(motions: list[Motion]) -> None:
    for trigger, longest in ((CamTrigger(), 1.0), (VamTrigger(), 5.0)):
        times = _times(trigger, motions)
        gaps = [after - before for before, after in pairwise(times)]
        assert all(0.1 - 1e-9 <= gap <= longest + 1e-9 for gap in gaps)
        assert 0.1 * (len(motions) - 1) - times[-1] < longest + 1e-9
