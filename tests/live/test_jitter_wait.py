"""The wait for a calm second: what a second's wake-ups say, against the whole list of them; and what is told of it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.live.jitter_wait import CALM_TIME, CALM_TIMEOUT, MAX_WAKE_UP_LATENESS, JitterWait, gateway_lateness

UNIT = 2.0**-10  #: of time [s]; a power of two, so that sums and differences are exact
#: time since the wake-up before [UNIT], and how late it was [ms]
WAKE_UPS = st.lists(st.tuples(st.integers(0, 700), st.integers(0, 10)), min_size=1, max_size=200)


@given(WAKE_UPS)
def test_the_wait_is_over_after_a_second_without_a_late_wake_up_or_its_patience(
    wake_ups: list[tuple[int, int]],
) -> None:
    calm, seen, now = JitterWait(), [], 0
    waits, given_up = True, False
    for elapsed, late in wake_ups:
        now += elapsed
        seen.append((now, late))
        calm.observe(now * UNIT, late / 1000.0)
        within = [late for when, late in seen if when * UNIT > now * UNIT - CALM_TIME]
        if (now - seen[0][0]) * UNIT >= CALM_TIME and max(within) <= 1000.0 * MAX_WAKE_UP_LATENESS:
            waits = False
        elif waits and (now - seen[0][0]) * UNIT >= CALM_TIMEOUT:
            waits, given_up = False, True
        assert calm.worst == max(within) / 1000.0
        assert (calm.waits, calm.given_up) == (waits, given_up)


@pytest.mark.parametrize(
    ("step", "handed", "late"),
    [
        (1.0205, 1.020, 0.0005),  # woken by a setpoint
        (1.0285, 1.028, 0.0005),  # by one that was late, for which it waited
        (1.0360, 1.028, 0.0080),
        (1.0100, 1.002, 0.0000),  # not sooner than half a period after the step before
        (1.0120, 1.002, 0.0020),
        (1.0300, 0.995, 0.0000),  # without one it has waited for one and a half periods
        (1.0370, 0.995, 0.0070),
        (1.0370, float("nan"), 0.0070),
        (1.0301, 1.0302, 0.0001),  # a setpoint that was sent later has not woken it
    ],
)
def test_a_gateway_is_late_from_when_it_no_longer_waits(step: float, handed: float, late: float) -> None:
    """After a step at 1 s; of a period of 20 ms."""
    assert gateway_lateness(1.0, step, handed) == pytest.approx(late, abs=1e-9)


def test_nothing_is_known_before_the_first_wake_up() -> None:
    calm = JitterWait()
    assert calm.waits
    assert calm.worst == 0.0
    assert calm.news() == ""


def lines(late: float, seconds: float) -> list[str]:
    """Return what the operator is told while every wake-up is `late` [s] for so long."""
    calm, reported = JitterWait(), []
    for tick in range(round(seconds / 0.02)):
        calm.observe(0.02 * tick, late)
        reported += filter(None, [calm.news()])
    return reported


def test_the_operator_is_told_once_what_is_waited_for_and_once_that_it_is_given_up() -> None:
    assert lines(0.001, 100.0) == []
    waiting = "waiting for a calm second: worst wake-up 14 ms in the last second; close other programs"
    assert lines(0.014, CALM_TIMEOUT - 1.0) == [waiting]
    assert lines(0.014, 3.0 * CALM_TIMEOUT) == [
        waiting,
        "no calm second in 30 s: the simulated vehicle drives all the same",
    ]
