"""When a drive is over."""

from __future__ import annotations

import math

from vve_sumo.drive.termination import START_TIMEOUT, Outcome, TerminationMonitor
from vve_sumo.values import ArmingState

ENGAGED, STOPPED = ArmingState.ENGAGED, ArmingState.STOPPED


def ending() -> TerminationMonitor:
    return TerminationMonitor(path_length=100.0, rest=2.0)


def test_rest_counts_only_after_the_car_was_under_way_and_only_in_one_piece() -> None:
    watch = ending()
    assert watch.step(0.0, 0.0, 0.0, ENGAGED, contact=False) is None
    assert watch.step(5.0, 0.0, 0.0, ENGAGED, contact=False) is None
    assert watch.step(6.0, 3.0, 5.0, ENGAGED, contact=False) is None
    assert watch.step(7.0, 0.01, 40.0, ENGAGED, contact=False) is None
    assert watch.step(8.0, 0.2, 40.1, ENGAGED, contact=False) is None
    assert watch.step(9.0, 0.0, 40.1, ENGAGED, contact=False) is None
    assert watch.step(10.9, 0.0, 40.1, ENGAGED, contact=False) is None
    assert watch.step(11.0, 0.0, 40.1, ENGAGED, contact=False) is Outcome.STOPPED


def at_rest(station: float, state: ArmingState, contact: bool) -> Outcome | None:
    watch = ending()
    watch.step(0.0, 3.0, 0.0, ENGAGED, contact=contact)
    watch.step(1.0, 0.0, station, state, contact=False)
    return watch.step(3.5, 0.0, station, state, contact=False)


def test_the_name_of_the_ending() -> None:
    assert at_rest(99.0, ENGAGED, contact=False) is Outcome.ARRIVED
    assert at_rest(90.1, ENGAGED, contact=False) is Outcome.ARRIVED
    assert at_rest(89.9, ENGAGED, contact=False) is Outcome.STOPPED
    assert at_rest(50.0, ENGAGED, contact=False) is Outcome.STOPPED
    assert at_rest(50.0, STOPPED, contact=False) is Outcome.FAULT
    assert at_rest(50.0, STOPPED, contact=True) is Outcome.CONTACT


def test_rolling_back_is_no_rest() -> None:
    watch = ending()
    watch.step(0.0, 3.0, 0.0, ENGAGED, contact=False)
    assert all(watch.step(1.0 + t, -0.2, 50.0, ENGAGED, contact=False) is None for t in range(10))


def test_a_car_that_never_starts_is_a_fault_unless_its_controller_stands_by_choice() -> None:
    watch = ending()
    assert watch.step(START_TIMEOUT, 0.0, math.nan, ArmingState.DISARMED, contact=False) is None
    assert watch.step(START_TIMEOUT + 1.0, 0.0, math.nan, ArmingState.DISARMED, contact=False) is Outcome.FAULT
    assert ending().step(START_TIMEOUT + 1.0, 0.0, 0.0, ENGAGED, contact=False) is Outcome.STOPPED
    assert ending().step(1.0, 0.0, 0.0, ArmingState.FAULT, contact=False) is Outcome.FAULT
