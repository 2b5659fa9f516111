"""The computer's worst wake-up: its measurement on a clock that is made up, and the verdict on it."""

from __future__ import annotations

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.commissioning.findings import CheckResult
from vve_sumo.commissioning.wake_up import judged_wake_up, lateness, wake_up

PERIOD = 0.02


class LateClock:
    """A clock that only sleeping moves, each time by a known time too far."""

    def __init__(self, overslept: list[float]) -> None:
        self.now, self._overslept = 1000.0, iter(overslept)

    def clock(self) -> float:
        return self.now

    def sleep(self, duration: float) -> None:
        assert duration >= 0.0
        self.now += duration + next(self._overslept)


@given(st.lists(st.floats(0.0, 0.015), min_size=1, max_size=50))
def test_a_wake_up_is_as_late_as_the_sleep_was_too_long(overslept: list[float]) -> None:
    clock = LateClock(overslept)
    assert lateness(len(overslept), clock.clock, clock.sleep) == pytest.approx(overslept, abs=1e-9)


def test_a_computer_that_stands_still_is_late_until_it_has_caught_up() -> None:
    clock = LateClock([0.050, 0.0, 0.0, 0.0])
    assert lateness(4, clock.clock, clock.sleep) == pytest.approx([0.050, 0.030, 0.010, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    ("worst", "finding"),
    [
        (0.0, CheckResult.GO),
        (0.005, CheckResult.GO),
        (0.006, CheckResult.NOTE),
        (0.02, CheckResult.NOTE),
        (0.021, CheckResult.NO_GO),
    ],
)
def test_the_verdict_names_the_next_step_where_it_is_not_go(worst: float, finding: CheckResult) -> None:
    check = judged_wake_up(worst)
    assert check.finding is finding
    assert f"at worst {1e3 * worst:.1f} ms late" in check.observed
    assert ("close other programs" in check.advice) is (finding is not CheckResult.GO)


@pytest.mark.thorough
def test_the_measurement_leaves_no_priority_behind() -> None:
    before = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)
    assert wake_up().name == "wake-up"
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)) == before
