"""Commands of ROS 2 as setpoints: what they ask for by a closed form, and every reason for which one is not taken."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
from vve_sumo.bridges.ros2.commands import (
    AHEAD,
    LATE,
    MALFORMED,
    NO_TICK,
    NOT_FINITE,
    SECOND,
    Answers,
    Beat,
    Command,
    command_of,
)
from vve_sumo.wire.datagrams import decode_setpoint, encode_setpoint
from vve_sumo.wire.ros2.messages import unix_nanoseconds

WHEELBASE, TIME_CONSTANT = 2.85, 0.5
EPOCH = 1_451_260_818.0


def _answers(ticks: int = 3, speed: float = 8.0) -> Answers:
    answers = Answers(WHEELBASE, TIME_CONSTANT)
    for tick in range(1, ticks + 1):
        answers.ticked(_beat(tick, speed))
    return answers


def _beat(tick: int, speed: float = 8.0) -> Beat:
    return Beat(tick, EPOCH + 0.02 * tick, speed)


def _command(tick: int, speed: float = 8.0, yaw_rate: float = 0.0, late_ns: int = 0) -> Command:
    return Command(unix_nanoseconds(EPOCH + 0.02 * tick) + late_ns, speed, yaw_rate)


@given(st.floats(0.6, 30.0), st.floats(-5.0, 40.0), st.floats(-1.0, 1.0))
def test_a_twist_is_an_acceleration_and_a_circle(speed: float, wanted: float, yaw_rate: float) -> None:
    setpoint = _answers(speed=speed).take(1, _command(3, wanted, yaw_rate))
    assert setpoint is not None
    expected = (max(wanted, 0.0) - speed) / TIME_CONSTANT
    assert setpoint.acceleration == pytest.approx(max(-10.0, min(10.0, expected)))
    # On the circle of this steering the car turns at the yaw rate: speed times tan(steering) over the wheelbase.
    assert speed * math.tan(setpoint.steering) / WHEELBASE == pytest.approx(yaw_rate, abs=1e-9)
    assert isinstance(decode_setpoint(encode_setpoint(setpoint)), type(setpoint))


def test_a_standing_car_keeps_its_steering() -> None:
    answers = _answers(speed=5.0)
    turned = answers.take(1, _command(3, yaw_rate=0.3))
    answers.ticked(_beat(4, 0.1))
    standing = answers.take(1, _command(4, yaw_rate=-0.3))
    assert turned is not None
    assert standing is not None
    assert standing.steering == turned.steering != 0.0


def test_a_command_answers_the_newest_tick_that_its_stamp_is_not_before() -> None:
    for late, tick in ((0, 2), (19_999_000, 2), (20_000_000, 3)):
        setpoint = _answers().take(1, _command(2, late_ns=late))
        assert setpoint is not None
        assert (setpoint.answers, setpoint.time) == (tick, EPOCH + 0.02 * tick)
    unstamped = _answers().take(1, Command(None, 1.0, 0.0))
    assert unstamped is not None
    assert unstamped.answers == 3


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (_command(0), LATE),
        (_command(6), AHEAD),
        (Command(0, 1.0, 0.0), LATE),
        (_command(3, math.nan), NOT_FINITE),
        (_command(3, 1.0, math.inf), NOT_FINITE),
        (Command(None, 1.0, None, math.nan), NOT_FINITE),
        (Command(None, 1.0, 0.0, None, math.nan), NOT_FINITE),
        (None, MALFORMED),
    ],
)
def test_a_command_that_is_not_taken_has_a_reason_and_changes_nothing(command: Command | None, reason: str) -> None:
    answers = _answers()
    assert answers.take(1, command) is None
    assert (dict(answers.refused), answers.taken) == ({reason: 1}, 0)
    after = answers.take(2, _command(3))  # who sent it is not the brain for that
    assert after is not None
    assert after.sequence == 1


def test_no_tick_is_answered_that_was_not_valid() -> None:
    answers = _answers()
    answers.forget()
    assert answers.take(1, _command(3)) is None
    assert dict(answers.refused) == {NO_TICK: 1}


def test_only_the_last_ten_ticks_are_answered() -> None:
    answers = _answers(30)
    assert answers.take(1, _command(20)) is None
    assert answers.take(1, _command(21)) is not None
    assert dict(answers.refused) == {LATE: 1}


@given(st.lists(st.sampled_from([1, 2]), min_size=1, max_size=12))
def test_from_a_second_publisher_on_nobody_drives(writers: list[int]) -> None:
    answers, first = _answers(), writers[0]
    for at, writer in enumerate(writers):
        taken = answers.take(writer, _command(3)) is not None
        assert taken == all(before == first for before in writers[: at + 1])
    assert answers.silenced == (len(set(writers)) > 1)
    assert answers.refused[SECOND] == sum(w is not None for w in writers) - answers.taken


def test_setpoints_count_up() -> None:
    answers = _answers()
    sequences = [setpoint.sequence for _ in range(3) if (setpoint := answers.take(1, _command(3)))]
    assert sequences == [1, 2, 3]


def _message(**fields: Any) -> SimpleNamespace:
    return SimpleNamespace(**fields)


def test_each_type_says_what_it_says() -> None:
    header = _message(stamp=_message(sec=5, nanosec=7))
    twist = _message(linear=_message(x=3.0), angular=_message(z=0.25))
    assert command_of("twist_stamped", _message(header=header, twist=twist)) == Command(5_000_000_007, 3.0, 0.25)
    assert command_of("twist", twist) == Command(None, 3.0, 0.25)
    drive = _message(steering_angle=0.1, speed=4.0, acceleration=-1.5)
    got = command_of("ackermann", _message(header=header, drive=drive))
    assert (got.stamp, got.speed, got.steering, got.limit) == (5_000_000_007, 4.0, 0.1, 1.5)
    drive.acceleration = 0.0  # as quickly as possible
    assert command_of("ackermann", _message(header=header, drive=drive)).limit == 10.0


def test_an_ackermann_command_keeps_to_its_acceleration_and_steering() -> None:
    setpoint = _answers(speed=8.0).take(1, Command(None, 0.0, None, 0.2, 1.5))
    assert setpoint is not None
    assert (setpoint.acceleration, setpoint.steering) == (-1.5, 0.2)
