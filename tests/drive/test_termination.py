"""When a drive is over."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from vve_sumo.drive.standstill_cause import StandstillCause
from vve_sumo.drive.termination import DRIVE_OFF_TIME, MAX_REST, START_TIMEOUT, Outcome, TerminationMonitor
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import DRIVER_REASONS

ENGAGED, STOPPED = ArmingState.ENGAGED, ArmingState.STOPPED


TICK = 0.02  #: [s]
#: of the car, when it brakes to rest [s]; it drives off once its controller lets it
AT_REST_FROM = 1.0


class Watch(TerminationMonitor):
    """A monitor of a car that stands before nothing, on a road without traffic, unless a test says otherwise."""

    def see(
        self,
        time: float,
        speed: float,
        s: float,
        state: ArmingState = ENGAGED,
        *,
        reasons: tuple[str, ...] = (),
        contact: bool = False,
    ) -> Outcome | None:
        return self.step(time, speed, s, state, reasons, contact, lambda: StandstillCause.CLEAR)


def ending() -> Watch:
    return Watch(path_length=100.0, rest=2.0)


def test_rest_counts_only_after_the_car_was_under_way_and_only_in_one_piece() -> None:
    watch = ending()
    assert watch.see(0.0, 0.0, 0.0) is None
    assert watch.see(5.0, 0.0, 0.0) is None
    assert watch.see(6.0, 3.0, 5.0) is None
    assert watch.see(7.0, 0.01, 40.0) is None
    assert watch.see(8.0, 0.2, 40.1) is None
    assert watch.see(9.0, 0.0, 40.1) is None
    assert watch.see(10.9, 0.0, 40.1) is None
    assert watch.see(11.0, 0.0, 40.1) is Outcome.STOPPED


def at_rest(s: float, state: ArmingState, contact: bool, reasons: tuple[str, ...] = ()) -> Outcome | None:
    watch = ending()
    watch.see(0.0, 3.0, 0.0, contact=contact)
    watch.see(1.0, 0.0, s, state, reasons=reasons)
    return watch.see(3.5, 0.0, s, state, reasons=reasons)


def test_the_name_of_the_ending() -> None:
    assert at_rest(99.0, ENGAGED, contact=False) is Outcome.ARRIVED
    assert at_rest(90.1, ENGAGED, contact=False) is Outcome.ARRIVED
    assert at_rest(89.9, ENGAGED, contact=False) is Outcome.STOPPED
    assert at_rest(50.0, ENGAGED, contact=False) is Outcome.STOPPED
    assert at_rest(50.0, STOPPED, contact=False) is Outcome.FAULT
    assert at_rest(50.0, STOPPED, contact=True) is Outcome.CONTACT


@pytest.mark.parametrize("sign", sorted(DRIVER_REASONS))
def test_a_car_at_rest_after_its_driver_stepped_in_ended_by_the_driver(sign: str) -> None:
    assert at_rest(50.0, STOPPED, contact=False, reasons=("pose_stale", sign)) is Outcome.DRIVER
    assert at_rest(50.0, ArmingState.FAULT, contact=False, reasons=(sign,)) is Outcome.DRIVER
    assert at_rest(50.0, STOPPED, contact=True, reasons=(sign,)) is Outcome.CONTACT


@pytest.mark.parametrize("outcome", [Outcome.COMPLETED, Outcome.TIMEOUT, Outcome.FAULT])
def test_a_contact_is_the_outcome_whatever_else_ends_the_drive(outcome: Outcome) -> None:
    watch = ending()
    watch.see(0.0, 3.0, 0.0)
    assert watch.unless_contact(outcome) is outcome
    watch.see(0.1, 3.0, 0.3, contact=True)
    watch.see(0.2, 3.0, 0.6)
    assert watch.unless_contact(outcome) is Outcome.CONTACT


def test_rolling_back_is_no_rest() -> None:
    watch = ending()
    watch.see(0.0, 3.0, 0.0)
    assert all(watch.see(1.0 + t, -0.2, 50.0) is None for t in range(10))


def test_a_car_that_never_starts_is_a_fault_unless_its_controller_stands_by_choice() -> None:
    watch = ending()
    assert watch.see(START_TIMEOUT, 0.0, math.nan, ArmingState.DISARMED) is None
    assert watch.see(START_TIMEOUT + 1.0, 0.0, math.nan, ArmingState.DISARMED) is Outcome.FAULT
    assert ending().see(START_TIMEOUT + 1.0, 0.0, 0.0) is Outcome.STOPPED
    assert ending().see(1.0, 0.0, 0.0, ArmingState.FAULT) is Outcome.FAULT


def ends(
    ahead: Callable[[float], StandstillCause],
    *,
    rest: float = 2.0,
    s: float = 50.0,
    state: ArmingState = ENGAGED,
    moving: Callable[[float], bool] = lambda rested: False,
) -> tuple[float, Outcome | None]:
    """Return how long after it came to rest a drive ends [s], and its outcome; None where it does not within 300 s.

    `ahead` is what the car stands before so long after it came to rest [s].
    """
    watch = Watch(path_length=100.0, rest=rest)
    watch.see(0.0, 3.0, s)
    for tick in range(round(300.0 / TICK)):
        rested = tick * TICK
        speed = 1.0 if moving(rested) else 0.0
        outcome = watch.step(AT_REST_FROM + rested, speed, s, state, (), False, lambda: ahead(rested))  # noqa: B023
        if outcome is not None:
            return rested, outcome
    return math.inf, None


@pytest.mark.parametrize(
    ("what", "lasts"),
    [
        (StandstillCause.PERMANENT, 2.0),
        (StandstillCause.CLEAR, 2.0),
        (StandstillCause.CLEAR_WITH_TRAFFIC, DRIVE_OFF_TIME),
    ],
)
def test_a_rest_before_what_stays_lasts_as_long_as_the_scenario_says(what: StandstillCause, lasts: float) -> None:
    assert ends(lambda _rested: what) == (pytest.approx(lasts, abs=1.5 * TICK), Outcome.STOPPED)


def test_a_rest_behind_traffic_is_not_the_end_and_the_car_has_time_to_drive_off() -> None:
    """As behind a queue at a signal: 40 s later the traffic is gone, and the controller lets go 3 s after that."""

    def behind(rested: float) -> StandstillCause:
        return StandstillCause.TEMPORARY if rested < 40.0 else StandstillCause.CLEAR_WITH_TRAFFIC

    assert ends(behind, moving=lambda rested: rested >= 43.0) == (math.inf, None)
    assert ends(behind) == (pytest.approx(40.0 + DRIVE_OFF_TIME, abs=1.5 * TICK), Outcome.STOPPED)


def test_what_traffic_leaves_free_is_driven_up_to_before_the_rest_counts() -> None:
    """The car behind which the ego waited changes lanes, and the obstacle behind it is what stays."""
    found, outcome = ends(lambda rested: StandstillCause.TEMPORARY if rested < 10.0 else StandstillCause.PERMANENT)
    assert (found, outcome) == (pytest.approx(10.0 + DRIVE_OFF_TIME, abs=1.5 * TICK), Outcome.STOPPED)


@pytest.mark.parametrize("rest", [2.0, 200.0])
def test_traffic_that_never_moves_again_is_the_end_at_last(rest: float) -> None:
    found, outcome = ends(lambda _rested: StandstillCause.TEMPORARY, rest=rest)
    assert (found, outcome) == (pytest.approx(max(rest, MAX_REST), abs=1.5 * TICK), Outcome.STOPPED)


@pytest.mark.parametrize(("s", "state", "outcome"), [(99.0, ENGAGED, Outcome.ARRIVED), (50.0, STOPPED, Outcome.FAULT)])
def test_at_the_end_of_its_path_or_held_by_its_gateway_the_car_waits_for_nobody(
    s: float, state: ArmingState, outcome: Outcome
) -> None:
    assert ends(lambda _rested: StandstillCause.TEMPORARY, s=s, state=state) == (
        pytest.approx(2.0, abs=0.03),
        outcome,
    )
