"""The arming table, over all states and all events."""

from __future__ import annotations

import itertools
import re

import pytest

from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import COMMANDING, CRITICAL, DRIVER_REASONS, REASONS, TRANSITIONS, ArmingEvent, transition

EVERY = list(itertools.product(ArmingState, ArmingEvent))
S = ArmingState

#: Every arrow that leads elsewhere, written down a second time; all other pairs must stay where they are.
ARROWS = {
    (S.DISARMED, ArmingEvent.CONDITIONS_MET): S.READY,
    (S.DISARMED, ArmingEvent.FAULT): S.FAULT,
    (S.READY, ArmingEvent.CONDITIONS_LOST): S.DISARMED,
    (S.READY, ArmingEvent.ENGAGE): S.ENGAGED,
    (S.READY, ArmingEvent.EXPIRED): S.DISARMED,
    (S.READY, ArmingEvent.FAULT): S.FAULT,
    (S.READY, ArmingEvent.OVERRIDE): S.DISARMED,
    (S.READY, ArmingEvent.STOP): S.DISARMED,
    (S.READY, ArmingEvent.DISARM): S.DISARMED,
    (S.ENGAGED, ArmingEvent.EXPIRED): S.STOPPING,
    (S.ENGAGED, ArmingEvent.FAULT): S.STOPPING,
    (S.ENGAGED, ArmingEvent.OVERRIDE): S.FAULT,
    (S.ENGAGED, ArmingEvent.DRIVER): S.STOPPING,
    (S.ENGAGED, ArmingEvent.STOP): S.STOPPING,
    (S.ENGAGED, ArmingEvent.DISARM): S.STOPPING,
    (S.STOPPING, ArmingEvent.OVERRIDE): S.FAULT,
    (S.STOPPING, ArmingEvent.AT_REST): S.STOPPED,
    (S.STOPPED, ArmingEvent.OVERRIDE): S.FAULT,
    (S.STOPPED, ArmingEvent.PARKED): S.DISARMED,
    (S.FAULT, ArmingEvent.DISARM): S.DISARMED,
}


@pytest.mark.parametrize(("state", "event"), EVERY)
def test_every_pair_goes_where_the_second_list_says(state, event):
    assert transition(state, event) is ARROWS.get((state, event), state)


def test_the_table_is_complete_and_nothing_more():
    assert {(state, event) for state, row in TRANSITIONS.items() for event in row} == set(EVERY)


def test_engaged_is_entered_by_the_operators_act_alone():
    into = [(state, event) for state, event in EVERY if transition(state, event) is S.ENGAGED]
    assert [pair for pair in into if pair[0] is not S.ENGAGED] == [(S.READY, ArmingEvent.ENGAGE)]


def reachable(start: ArmingState, events: set[ArmingEvent]) -> set[ArmingState]:
    reached, frontier = set(), {start}
    while frontier:
        reached |= frontier
        frontier = {transition(s, e) for s in frontier for e in events} - reached
    return reached


def test_once_stopping_no_run_of_events_engages_without_parking_or_disarming_and_engaging_anew():
    assert reachable(S.STOPPING, set(ArmingEvent) - {ArmingEvent.DISARM, ArmingEvent.PARKED}) == {
        S.STOPPING,
        S.STOPPED,
        S.FAULT,
    }


@pytest.mark.parametrize("start", [state for state in S if state is not S.ENGAGED])
def test_no_cycle_engages_without_the_act(start):
    assert S.ENGAGED not in reachable(start, set(ArmingEvent) - {ArmingEvent.ENGAGE})
    assert S.ENGAGED in reachable(start, set(ArmingEvent))


@pytest.mark.parametrize("state", S)
def test_from_every_state_every_fault_leads_to_rest(state):
    for event in (ArmingEvent.FAULT, ArmingEvent.EXPIRED, ArmingEvent.STOP):
        after = transition(state, event)
        assert after is not S.ENGAGED
        assert transition(after, ArmingEvent.AT_REST) not in (S.ENGAGED, S.STOPPING)


def test_go_changes_no_state():
    assert all(transition(state, ArmingEvent.GO) is state for state in S)


def test_a_commanded_car_is_let_go_only_by_the_driver_or_at_rest():
    let_go = {(s, e) for s, e in EVERY if s in COMMANDING and transition(s, e) not in COMMANDING}
    assert let_go == {(s, ArmingEvent.OVERRIDE) for s in COMMANDING} | {(S.STOPPED, ArmingEvent.PARKED)}


def test_reasons_are_codes_with_plain_words():
    assert list(REASONS) == sorted(REASONS)
    assert all(re.fullmatch(r"[a-z]+(_[a-z]+)*", code) for code in REASONS)
    assert all(len(words.split()) >= 3 and words[-1] != "." for words in REASONS.values())
    assert set(REASONS) >= CRITICAL


def test_what_a_driver_does_is_a_sign_and_what_is_wanted_of_one_is_none():
    of_drivers = {code for code in REASONS if code.startswith("driver_")}
    assert of_drivers - {"driver_needed", "driver_not_on_brake"} == DRIVER_REASONS
