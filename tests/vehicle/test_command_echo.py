"""A report that should repeat a command and does not: from which change on, and after which time."""

from __future__ import annotations

import math

import pytest

from vve_sumo.vehicle.command_echo import OPENING_CHANGE, TORQUE_CHANGE, CommandEcho

TORQUE = TORQUE_CHANGE
CHANGES = {"torque": TORQUE_CHANGE, "opening": OPENING_CHANGE}


def frozen(change: float, *steps: tuple[float, float, float]) -> list[bool]:
    """Whether a report is frozen at each of several steps: time [s], command, and the command that is reported."""
    compared = CommandEcho(change)
    return [compared.step(*step) for step in steps]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("of", "differs", "found"),
    [
        ("torque", 249.0, False),
        ("torque", 250.0, False),
        ("torque", 251.0, True),
        ("opening", 0.0399, False),
        ("opening", 0.0401, True),
    ],
)
def test_a_report_that_does_not_follow_a_command_up_or_down_is_frozen(
    of: str, differs: float, found: bool, sign: float
) -> None:
    change = CHANGES[of]
    before, after = 1000.0 * change, 1000.0 * change + sign * differs
    assert frozen(change, (0.0, before, before), (0.02, after, before), (0.12, after, before)) == [False, False, found]


def test_a_report_has_a_tenth_of_a_second_to_follow() -> None:
    steps = [(0.0, 0.0, 0.0), (0.1, 900.0, 0.0), (0.199, 900.0, 0.0), (0.2, 900.0, 0.0), (0.22, 900.0, 900.0)]
    assert frozen(TORQUE, *steps) == [False, False, False, True, False]


def test_a_report_that_moves_at_all_is_not_frozen() -> None:
    assert not any(frozen(TORQUE, *((0.02 * step, 100.0 * step, 1e-3 * step) for step in range(100))))


def test_no_report_is_not_frozen() -> None:
    assert not any(frozen(TORQUE, *((0.02 * step, 100.0 * step, math.nan) for step in range(100))))


def test_what_was_before_a_reset_does_not_count() -> None:
    compared = CommandEcho(TORQUE)
    compared.step(0.0, 0.0, 0.0)
    compared.step(0.02, 900.0, 0.0)
    compared.reset()
    assert not compared.step(0.12, 900.0, 0.0), "the command of now is what the report stands for"
    compared.step(0.14, 0.0, 0.0)
    compared.reset()
    compared.step(0.22, 900.0, 0.0)
    assert not compared.step(0.24, 0.0, 0.0), "the time counts from the reset on"
    assert not compared.step(0.33, 0.0, 0.0)
    assert compared.step(0.34, 0.0, 0.0)
