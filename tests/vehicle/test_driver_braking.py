"""A foot shows in brake torque that nobody commanded: how much of it, for how long, and how soon after a command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from tests import vehicles
from vve_sumo.vehicle.driver_braking import DriverBrakingDetector

#: its torque is explained for 0.15 s, the delay and three lags after a command: 0.395 s
BRAKES = replace(vehicles.FUSION.vehicle, brake_delay=0.095, brake_lag=0.05)


def seen(steps: Sequence[tuple[float, float, float, float]]) -> list[tuple[bool, bool, bool]]:
    """Whether a foot shows, the brakes are taken to be latched, and the report repeats itself, after each step.

    A step is the time [s], the torque commanded, reported, and the foot's [N m].
    """
    compared, then, found = DriverBrakingDetector(BRAKES), steps[0][0], []
    for now, commanded, reported, foot in steps:
        shown = compared.step(now, now - then, commanded, reported, foot)
        found.append((shown, compared.brakes_latched, compared.repeated))
        then = now
    return found


def signs(*steps: tuple[float, float, float, float]) -> list[bool]:
    """Whether a foot shows at each of several steps."""
    return [shown for shown, _, _ in seen(steps)]


def latches(*steps: tuple[float, float, float, float]) -> list[bool]:
    """Whether the brakes are taken to be latched after each of several steps."""
    return [latched for _, latched, _ in seen(steps)]


def repeats(*steps: tuple[float, float, float, float]) -> list[bool]:
    """Whether each of several reports is the last one that the commands explained."""
    return [repeated for _, _, repeated in seen(steps)]


@pytest.mark.parametrize(("torque", "foot"), [(150.0, False), (150.4, True), (290.0, True)])
def test_a_foot_is_more_than_150_newton_metres(torque: float, foot: bool) -> None:
    assert signs((0.0, 0.0, torque, 0.0), (0.03, 0.0, torque, 0.0)) == [False, foot]


def test_a_foot_lasts_for_two_reports() -> None:
    assert signs((0.0, 0.0, 200.0, 0.0), (0.028, 0.0, 200.0, 0.0), (0.03, 0.0, 200.0, 0.0)) == [False, False, True]


def test_a_car_that_reports_no_torque_shows_none() -> None:
    assert signs(*((0.02 * step, 0.0, float("nan"), float("nan")) for step in range(50))) == [False] * 50


@pytest.mark.parametrize(("excess", "foot"), [(149.5, False), (150.5, True)])
def test_a_commanded_torque_explains_as_much_and_15_percent_until_it_could_be_released(
    excess: float, foot: bool
) -> None:
    """2000 N m until 0 s, then none: explained for the delay, 0.395 s, and from then on 8000 N m less each second."""
    steps = []
    for step in range(-10, 81):
        since = max(step - 39, 0)  # steps of 10 ms beyond the delay
        explained = max(2000.0 - 80.0 * since, 0.0)
        steps.append((0.01 * step, 2000.0 if step <= 0 else 0.0, 1.15 * explained + excess, 0.0))
    assert signs(*steps) == [False] * 3 + [foot] * (len(steps) - 3)


def test_a_smaller_command_does_not_end_what_a_larger_one_explains() -> None:
    steps = [(0.0, 1000.0, 0.0, 0.0), (0.1, 300.0, 1200.0, 0.0), (0.2, 500.0, 1200.0, 0.0), (0.3, 0.0, 1200.0, 0.0)]
    assert signs(*steps) == [False] * 4


def test_of_smaller_commands_the_largest_explains_once_the_larger_one_is_too_old() -> None:
    """500 N m explain 575 and 150; the 1000 are forgotten after 0.395 s, and the 300 count for nothing."""
    commands = [(0.0, 1000.0, 0.0, 0.0), (0.1, 300.0, 0.0, 0.0), (0.15, 500.0, 0.0, 0.0)]
    for torque, foot in ((724.0, False), (726.0, True)):
        assert signs(*commands, (0.4, 0.0, torque, 0.0), (0.44, 0.0, torque, 0.0)) == [False] * 4 + [foot]


@pytest.mark.parametrize("reported", [True, False])
@pytest.mark.parametrize(("torque", "latched"), [(450.0, False), (455.0, True), (800.0, True)])
def test_a_foot_of_450_newton_metres_latches_the_brakes_after_80_milliseconds(
    torque: float, latched: bool, reported: bool
) -> None:
    shown = (0.0, torque, 0.0) if reported else (0.0, 0.0, torque)
    assert latches((0.0, *shown), (0.079, *shown), (0.08, *shown), (0.09, 0.0, 0.0, 0.0)) == [
        False, False, latched, latched
    ]  # fmt: skip


@pytest.mark.parametrize(("changed", "repeated"), [(0.0, True), (0.5, False), (-0.5, False)])
def test_a_report_that_stays_the_same_while_the_command_falls_below_it_is_told_from_others(
    changed: float, repeated: bool
) -> None:
    """1400 N m explain the report, 900 do not; the report after a second is another to the last bit, or is not."""
    braked = [(0.02 * step, 1400.0, 1400.0, 0.0) for step in range(10)]
    held = [(0.2 + 0.02 * step, 900.0, 1400.0, 0.0) for step in range(50)]
    after = (1.2, 900.0, 1400.0 + changed, 0.0)
    assert signs(*braked, *held, after)[-1]
    assert repeats(*braked, *held, after)[-1] == repeated


def test_a_torque_that_no_command_ever_explained_is_no_repeated_one() -> None:
    assert repeats(*((0.02 * step, 0.0, 800.0, 0.0) for step in range(50))) == [False] * 50


def test_a_report_that_is_missing_for_a_while_and_comes_again_is_still_a_repeated_one() -> None:
    braked = [(0.02 * step, 1400.0, 1400.0, 0.0) for step in range(10)]
    held = [(0.2 + 0.02 * step, 900.0, 1400.0, 0.0) for step in range(50)]
    missing = [(1.2 + 0.02 * step, 900.0, float("nan"), 0.0) for step in range(15)]
    again = [(1.5 + 0.02 * step, 900.0, 1400.0, 0.0) for step in range(5)]
    assert signs(*braked, *held, *missing, *again)[-1]
    assert repeats(*braked, *held, *missing, *again)[-20:] == [False] * 15 + [True] * 5


def test_a_torque_that_is_not_reported_is_no_repeated_one() -> None:
    assert repeats(*((0.02 * step, 0.0, float("nan"), 0.0) for step in range(5))) == [False] * 5


def test_nothing_is_explained_before_the_first_command() -> None:
    assert signs((0.0, 0.0, 150.5, 0.0), (0.03, 0.0, 150.5, 0.0)) == [False, True]


def test_what_was_before_a_reset_does_not_count() -> None:
    compared = DriverBrakingDetector(BRAKES)
    compared.step(0.0, 0.0, 0.0, 800.0, 0.0)
    compared.reset()
    assert not compared.step(0.08, 0.08, 0.0, 800.0, 0.0)
    assert not compared.brakes_latched
    assert compared.step(0.16, 0.08, 0.0, 800.0, 0.0)
    assert compared.brakes_latched
    compared.reset()
    assert not compared.brakes_latched
