"""What gateway and observer share: why a drive ends, which overrides count, and what operator's commands do."""

from __future__ import annotations

from functools import reduce

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import COMMANDING, REASONS, TRANSITIONS, ArmingEvent
from vve_sumo.vehicle.arming_machine import ENDS, STOPS, ArmingMachine, OperatorCommand

S, E, Act = ArmingState, ArmingEvent, OperatorCommand
PARKED_TIME = 1.0

#: Events that lead from DISARMED to each state.
WAYS = {
    S.DISARMED: (),
    S.READY: (E.CONDITIONS_MET,),
    S.ENGAGED: (E.CONDITIONS_MET, E.ENGAGE),
    S.STOPPING: (E.CONDITIONS_MET, E.ENGAGE, E.STOP),
    S.STOPPED: (E.CONDITIONS_MET, E.ENGAGE, E.STOP, E.AT_REST),
    S.FAULT: (E.FAULT,),
}
ONE = frozenset({"brake"})
TWO = frozenset({"brake", "steering"})
NONE: frozenset[str] = frozenset()


def at(state: ArmingState, overrides: frozenset[str] = NONE) -> ArmingMachine:
    """A machine in a state, at the begin of a step."""
    machine = ArmingMachine(PARKED_TIME)
    machine.begin_step([], overrides)
    for event in WAYS[state]:
        machine.apply(event)
    machine.begin_step([], overrides)
    assert machine.state is state
    return machine


def judge(machine: ArmingMachine, now: float = 0.0, *faults: str, **found: bool) -> None:
    machine.judge(now, faults, **({"expired": False, "at_rest": False, "parked": False} | found))


@given(st.lists(st.sampled_from(E), max_size=12))
def test_the_state_is_where_the_table_leads_and_every_change_is_told(events: list[ArmingEvent]) -> None:
    reported: list[tuple[ArmingState, ArmingEvent]] = []
    machine = ArmingMachine(PARKED_TIME, lambda event: reported.append((machine.state, event)))
    ways = [machine.state]
    for event in events:
        machine.apply(event)
        ways.append(TRANSITIONS[ways[-1]][event])
    assert machine.state is reduce(lambda state, event: TRANSITIONS[state][event], events, S.DISARMED)
    changes = [(after, event) for before, after, event in zip(ways, ways[1:], events, strict=False) if before != after]
    assert reported == changes
    assert machine.ended is (S.ENGAGED in ways and machine.state not in COMMANDING)


@pytest.mark.parametrize("state", S)
def test_a_drive_has_ended_once_a_car_that_was_engaged_is_commanded_no_more(state):
    assert not at(state).ended
    for end in ((E.STOP, E.AT_REST, E.PARKED), (E.OVERRIDE,)):
        machine = at(S.ENGAGED)
        for event in end:
            assert not machine.ended
            machine.apply(event)
        assert machine.ended


# Why a drive ends.


def test_a_drive_keeps_each_cause_once_and_the_first_one_first():
    machine = at(S.ENGAGED)
    judge(machine, 0.0, "bus_down", "brake_fault")
    judge(machine, 0.0, "brake_fault", "stop_input", at_rest=True)
    machine.begin_step(["shadow", "bus_down"], NONE)
    assert machine.reasons == ("bus_down", "brake_fault", "stop_input", "shadow")


def test_notes_are_of_one_step():
    machine = at(S.READY)
    assert machine.reasons == ()
    machine.notes.append("not_standing")
    assert machine.reasons == ("not_standing",)
    machine.begin_step([], NONE)
    assert machine.reasons == ()


def test_what_keeps_a_car_from_being_engaged_is_no_cause():
    machine = at(S.READY)
    machine.begin_step(["shadow"], NONE)
    machine.judge_idle(["no_setpoint"])
    assert (machine.state, machine.causes, machine.notes) == (S.DISARMED, {}, ["shadow", "no_setpoint"])
    machine.judge_idle([])
    assert machine.state is S.READY


@pytest.mark.parametrize("state", [S.DISARMED, S.READY])
def test_a_fault_that_latches_has_nothing_to_do_with_the_drive_before(state):
    machine = at(state)
    machine.causes["drive_over"] = None
    machine.apply(E.FAULT, ["timer_gap"])
    assert machine.reasons == ("timer_gap",)
    machine.apply(E.FAULT, ["another_writer"])
    assert machine.reasons == ("timer_gap", "another_writer")


def test_a_driver_who_takes_over_is_added_to_what_stopped_the_car():
    machine = at(S.ENGAGED)
    judge(machine, 0.0, "bus_down")
    machine.apply(E.OVERRIDE, ["driver_override"])
    assert (machine.state, machine.reasons) == (S.FAULT, ("bus_down", "driver_override"))


def test_engaging_and_disarming_forget_the_causes_and_parking_does_not():
    parked = at(S.STOPPED)
    parked.causes["drive_over"] = None
    parked.apply(E.PARKED)
    assert (parked.state, parked.reasons) == (S.DISARMED, ("drive_over",))
    parked.apply(E.CONDITIONS_MET)
    assert (parked.state, parked.reasons) == (S.READY, ("drive_over",))
    parked.apply(E.ENGAGE)
    assert parked.reasons == ()
    for state in (S.READY, S.FAULT):
        disarmed = at(state)
        disarmed.causes["drive_over"] = None
        disarmed.apply(E.DISARM, ["disarm_asked"])
        assert (disarmed.state, disarmed.reasons) == (S.DISARMED, ())


# What a step finds.


def test_a_setpoint_that_expires_stops_an_engaged_car_alone():
    for state in COMMANDING:
        machine = at(state)
        judge(machine)
        assert (machine.state, machine.reasons) == (state, ())
        judge(machine, expired=True)
        expired = state is S.ENGAGED
        assert (machine.state, machine.reasons) == (
            (S.STOPPING, ("setpoint_expired",)) if expired else (state, ())
        )  # fmt: skip


def test_a_fault_comes_before_an_expired_setpoint_and_a_car_at_rest_is_stopped_in_the_same_step():
    machine = at(S.ENGAGED)
    judge(machine, 0.0, "drive_gone", expired=True, at_rest=True)
    assert (machine.state, machine.reasons) == (S.STOPPED, ("drive_gone",))


def test_park_counts_once_it_was_reported_for_long_enough():
    machine = at(S.STOPPED)
    seen = []
    for now, parked in ((0.0, True), (0.9, True), (0.95, False), (1.5, True), (2.4, True), (2.5, True)):
        judge(machine, now, at_rest=True, parked=parked)
        seen.append(machine.state)
    assert seen == [S.STOPPED] * 5 + [S.DISARMED]
    assert machine.ended


def test_park_before_the_car_was_stopped_counts_for_nothing():
    machine = at(S.STOPPING)
    for now in (0.0, 0.5, 1.0, 1.5):
        judge(machine, now, parked=True)
    judge(machine, 1.6, at_rest=True, parked=True)
    judge(machine, 2.5, parked=True)
    assert machine.state is S.STOPPED
    judge(machine, 2.6, parked=True)
    assert machine.state is S.DISARMED


def test_a_drive_does_not_count_the_park_of_the_one_before():
    machine = at(S.STOPPED)
    judge(machine, 0.0, parked=True)
    machine.apply(E.OVERRIDE)
    for event in (E.DISARM, *WAYS[S.STOPPED]):
        machine.apply(event)
    judge(machine, 1.0, parked=True)
    assert machine.state is S.STOPPED


@pytest.mark.parametrize("state", sorted(COMMANDING))
@pytest.mark.parametrize("going", [False, True])
def test_a_foot_stops_a_car_that_moves(state, going):
    machine = at(S.ENGAGED)
    if going:
        machine.apply_command(Act.GO, may_go=True)
    for event in WAYS[state][2:]:
        machine.apply(event)
    machine.judge_pedals([])
    assert (machine.state, machine.reasons) == (state, ())
    machine.judge_pedals(["driver_on_brake"])
    moves = state is S.STOPPING or (state is S.ENGAGED and going)
    assert machine.reasons == (("driver_on_brake",) if moves else ())
    assert machine.state is (S.STOPPING if moves else state)


def test_an_override_from_before_the_drive_counts_once_it_was_reset_or_all_is_settled():
    machine = at(S.ENGAGED, ONE)
    assert machine.new_overrides() == NONE
    machine.begin_step([], TWO)
    assert machine.new_overrides() == {"steering"}
    machine.begin_step([], NONE)
    assert machine.new_overrides() == NONE
    machine.begin_step([], ONE)
    assert machine.new_overrides() == ONE

    settled = at(S.ENGAGED, TWO)
    assert settled.new_overrides(settled=True) == TWO
    assert settled.new_overrides() == TWO, "and from then on"


# What the operator's commands do.


def test_commands_have_the_names_that_records_hold():
    assert [command.value for command in Act] == ["engage", "go", "stop", "stop_by_page", "end", "disarm"]


@pytest.mark.parametrize("state", S)
def test_commands_lead_where_the_table_says_and_give_their_reasons(state):
    events = {Act.ENGAGE: E.ENGAGE, Act.GO: E.GO, Act.DISARM: E.DISARM} | dict.fromkeys(ENDS, E.STOP)
    assert set(events) == set(Act)
    for command, event in events.items():
        machine = at(state)
        machine.apply_command(command, may_go=True)
        assert machine.state is TRANSITIONS[state][event]
        kept = state in COMMANDING or machine.state is S.FAULT
        reason = {Act.DISARM: "disarm_asked", **ENDS}.get(command)
        if command is Act.GO and state is not S.ENGAGED:
            reason, kept = "go_too_early", True
        assert machine.reasons == ((reason,) if reason and kept else ())


def test_reasons_of_stops_have_plain_words_and_say_who_asked():
    assert set(ENDS.values()) <= set(REASONS)
    assert ENDS == {Act.STOP: "stop_asked", Act.STOP_BY_PAGE: "stop_asked_by_page", Act.END: "drive_over"}
    assert set(ENDS) - STOPS == {Act.END}


def test_a_go_counts_once_and_only_for_its_drive():
    machine = at(S.ENGAGED)
    machine.begin_step(["shadow"], NONE)
    machine.apply_command(Act.GO, may_go=False, obstacles=["driver_on_brake"])
    assert (machine.going, machine.notes) == (False, ["shadow", "go_too_early", "driver_on_brake"])
    machine.begin_step([], NONE)
    machine.apply_command(Act.GO, may_go=True, obstacles=["driver_on_brake"])
    assert (machine.going, machine.notes) == (True, [])
    machine.apply_command(Act.GO, may_go=False)
    assert (machine.going, machine.notes) == (True, []), "said twice is said"
    machine.apply_command(Act.STOP, may_go=True)
    assert machine.going is False
    machine.apply(E.OVERRIDE)
    for event in (E.DISARM, *WAYS[S.ENGAGED]):
        machine.apply(event)
    assert machine.going is False


@pytest.mark.parametrize("command", Act)
def test_no_command_acknowledges_a_fault_of_its_own_step(command):
    machine = at(S.READY)
    machine.apply(E.FAULT, ["timer_gap"])
    machine.apply_command(command, may_go=True)
    assert (machine.state, machine.reasons) == (S.FAULT, ("timer_gap",))
    machine.begin_step([], NONE)
    machine.apply_command(Act.DISARM, may_go=True)
    assert machine.state is S.DISARMED
