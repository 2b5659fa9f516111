"""When a vehicle warns, in closed form: of hard braking by its deceleration, of standing by time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.v2x import denm
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.denm import AwarenessDistance, Cause, Termination
from vve_sumo.v2x.events import EventTrigger, Notice, Warner, notification
from vve_sumo.v2x.triggering import CHECK_PERIOD

CHECK = 0.1
SECOND = 1_000_000
WARNER = Warner(7, StationType.BUS, 700_000_000_000, 40.0, -83.0, None, 1.0, 3.0)


class Sent(NamedTuple):
    """A notice, and when it was due [s]."""

    time: float
    notice: Notice


def sent(
    seconds: float,
    *,
    speed: Callable[[float], float] = lambda time: 10.0,
    acceleration: Callable[[float], float] = lambda time: 0.0,
    lights: Callable[[float], bool] = lambda time: False,
    trigger: EventTrigger | None = None,
) -> list[Sent]:
    """What a vehicle is to tell of, with a check each 0.1 s."""
    trigger, found = trigger or EventTrigger(), []
    for check in range(round(seconds / CHECK)):
        time = CHECK * check
        notices = trigger.due(CHECK_PERIOD * check, acceleration(time), speed(time), hazard_lights=lights(time))
        found += [Sent(time, notice) for notice in notices]
    return found


def test_hard_braking_is_told_of_from_6_until_less_than_2_5_mps2() -> None:
    """A deceleration that grows by 1 m/s2 in a second up to 8 and falls as fast; each check detects it anew."""
    found = sent(20.0, acceleration=lambda time: -min(time, 16.0 - time))
    assert [one.time for one in found] == pytest.approx([6.0 + CHECK * n for n in range(76)])  # to 13.5 s: 2.5 m/s2
    assert {one.notice.cause for one in found} == {Cause.DANGEROUS_SITUATION}
    assert all(one.notice.detected == round(one.time * SECOND) and not one.notice.ended for one in found)
    assert {one.notice.sequence for one in found} == {0}


def test_each_braking_is_an_event_of_its_own() -> None:
    found = sent(9.0, acceleration=lambda time: -7.0 if time % 3.0 < 1.0 - 1e-9 else 0.0)
    assert sorted({one.notice.sequence for one in found}) == [0, 1, 2]


@given(st.floats(-5.99, 12.0), st.floats(0.4, 60.0))
def test_nobody_warns_of_ordinary_driving(acceleration: float, speed: float) -> None:
    assert sent(3.0, speed=lambda time: speed, acceleration=lambda time: acceleration, lights=lambda time: True) == []


def test_who_stands_with_hazard_lights_tells_of_it_after_ten_seconds_and_each_second() -> None:
    """Comes to rest at 2 s; the event is detected anew each 15 s."""
    found = sent(40.0, speed=lambda time: max(2.0 - time, 0.0), lights=lambda time: True)
    stood = next(CHECK * n for n in range(100) if max(2.0 - CHECK * n, 0.0) < 0.3)
    assert [one.time for one in found] == pytest.approx([stood + 10.0 + n for n in range(29)])
    assert {one.notice.cause for one in found} == {Cause.STATIONARY_VEHICLE}
    detected = sorted({one.notice.detected / SECOND for one in found})
    assert detected == pytest.approx([stood + 10.0, stood + 25.0])


def test_a_queue_without_hazard_lights_is_no_event() -> None:
    assert sent(100.0, speed=lambda time: 0.0) == []


def test_who_stands_at_the_first_check_has_stood_long_enough() -> None:
    assert sent(0.1, speed=lambda time: 0.0, lights=lambda time: True)[0].time == 0.0


@pytest.mark.parametrize("how", ["drives off", "puts its lights out"])
def test_the_end_of_standing_is_told_of_for_15_seconds(how: str) -> None:
    """5 s after it has driven off, or when its lights go out."""
    moves = (lambda time: 3.0 if time >= 20.0 else 0.0) if how == "drives off" else lambda time: 0.0
    found = sent(60.0, speed=moves, lights=lambda time: how == "drives off" or time < 20.0)
    ended = [one.time for one in found if one.notice.ended]
    over = 25.0 if how == "drives off" else 20.0
    assert ended == pytest.approx([over + n for n in range(15)], abs=0.11)
    assert max(one.time for one in found if not one.notice.ended) < over
    assert len({one.notice.sequence for one in found}) == 1


def test_a_short_move_is_no_end() -> None:
    found = sent(40.0, speed=lambda time: 1.0 if 20.0 <= time < 24.0 else 0.0, lights=lambda time: True)
    assert not any(one.notice.ended for one in found)
    assert {one.notice.sequence for one in found} == {0}


@given(st.lists(st.tuples(st.floats(-9.0, 3.0), st.sampled_from((0.0, 2.0)), st.booleans()), max_size=400))
def test_whatever_happens_the_end_of_an_event_comes_after_it_and_only_once(
    checks: list[tuple[float, float, bool]],
) -> None:
    trigger, there, over = EventTrigger(standing_time=300_000), set[int](), set[int]()
    for number, (acceleration, speed, lights) in enumerate(checks):
        for notice in trigger.due(CHECK_PERIOD * number, acceleration, speed, hazard_lights=lights):
            assert notice.detected <= CHECK_PERIOD * number
            if notice.ended:
                assert notice.sequence in there
                over.add(notice.sequence)
            else:
                assert notice.sequence not in over
                there.add(notice.sequence)


def test_what_a_notification_says() -> None:
    braking = notification(Notice(Cause.DANGEROUS_SITUATION, 4, 0), WARNER, 700_000_000_000)
    assert (braking.cause, braking.sub_cause, braking.validity_s, braking.interval_ms) == (99, 1, 2, 100)
    assert (braking.originator, braking.sequence, braking.speed) == (7, 4, 3.0)
    assert braking.awareness_distance is AwarenessDistance.LESS_THAN_500_M
    standing = notification(Notice(Cause.STATIONARY_VEHICLE, 5, 0), WARNER, 699_999_999_000)
    assert (standing.cause, standing.sub_cause, standing.validity_s, standing.interval_ms) == (94, 2, 30, 1000)
    ended = notification(Notice(Cause.STATIONARY_VEHICLE, 5, 0, ended=True), WARNER, 699_999_999_000)
    assert (ended.cause, ended.termination, ended.speed) == (None, Termination.CANCELLATION, None)
    for one in (braking, standing, ended):
        assert denm.decode(denm.encode(one)) == denm.rounded(one)
