"""A person through a drive: what each thing that can go wrong leads to, and that no report does anything else."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from tests.people.persons import FENCE, FENCED, LATITUDE, LIMITS, LONGITUDE, SETUP, report
from vve_sumo.geometry import Box
from vve_sumo.people.person import PAGE_TIMEOUT, REASONS, People, Person, PersonState
from vve_sumo.people.presence import Presence, classify
from vve_sumo.people.reports import FieldEntered, PageAlive, PersonStop, PositionReport, Report
from vve_sumo.people.setup import PersonSetup

CONSENT = "0" * 64
STEP = 0.02
NUMBERS = st.floats(allow_nan=True, allow_infinity=True)

#: arrival and report
Sent = tuple[float, Report]


def states(setup: PersonSetup, reports: Iterable[Sent], until: float) -> list[tuple[float, PersonState]]:
    """The person at every tick, each report taken at the first tick after its arrival."""
    person, waiting, found = Person(setup), sorted(reports, key=lambda one: one[0]), []
    for k in range(round(until / STEP) + 1):
        while waiting and waiting[0][0] <= k * STEP:
            person.receive(*waiting.pop(0))
        found.append((k * STEP, person.step(k * STEP)))
    return found


def walk(
    until: float, place: Callable[[float], tuple[float, float]] = lambda time: (0.0, 0.0), accuracy: float = 4.0
) -> list[Sent]:
    """Positions once a second, each 0.2 s old on arrival."""
    return [(k + 0.2, report(float(k), *place(float(k)), accuracy=accuracy)) for k in range(round(until) + 1)]


def first(found: list[tuple[float, PersonState]], code: str, after: float = 0.0) -> float:
    """The first time at which a reason code is given; inf for never."""
    return next((time for time, state in found if time > after and code in state.faults), math.inf)


def test_nobody_is_there_before_a_position_has_come() -> None:
    found = states(FENCED, [], 1.0)
    assert {state.faults for _, state in found} == {("person_absent",)}
    assert {(state.presence, state.body) for _, state in found} == {(Presence.GONE, None)}


def test_a_phone_is_an_area_and_a_receiver_a_body() -> None:
    by_phone = states(FENCED, walk(10.0), 10.0)
    assert {state.presence for time, state in by_phone if time > 3.0} == {Presence.AREA}
    assert {state.faults for time, state in by_phone if time > 3.0} == {()}
    often = [(0.1 * k + 0.05, report(0.1 * k, accuracy=0.05)) for k in range(100)]
    by_receiver = states(FENCED, often, 9.0)
    assert {state.presence for time, state in by_receiver if time > 3.0} == {Presence.EXACT}
    body = by_receiver[-1][1].body
    assert body is not None
    assert (body.length, body.width) == (0.6, 0.5)


@given(st.floats(1.5, 9.0))
def test_the_area_reaches_as_far_as_the_person_may(accuracy: float) -> None:
    """Wherever within the circle the person is, their body lies inside the box that sensors and traffic meet."""
    state = states(SETUP, walk(6.0, accuracy=accuracy), 6.5)[-1][1]
    assert state.body is not None
    box = Box(state.body.x, state.body.y, state.body.heading, state.body.length, state.body.width)
    area = shapely.Polygon(box.corners()).buffer(1e-9)
    for k in range(16):
        turn = k * math.pi / 8.0
        x, y = state.x + state.radius * math.cos(turn), state.y + state.radius * math.sin(turn)
        assert all(
            area.contains(shapely.Polygon(Box(x, y, facing, SETUP.length, SETUP.width).corners()))
            for facing in (0.0, 0.5, 1.1, turn)
        )
    assert (box.x, box.y) == (state.x, state.y)


@pytest.mark.thorough
@given(st.floats(0.0, math.tau))
def test_the_area_lies_across_the_road_and_moves_as_the_person_does(direction: float) -> None:
    """They walk at 1.4 m/s in any direction; the velocity of the box is theirs, and its sides are the road's."""
    towards = (1.4 * math.cos(direction), 1.4 * math.sin(direction))
    walked = [(k + 0.2, report(float(k), towards[0] * k, towards[1] * k, 3.0)) for k in range(40)]
    state = states(SETUP, walked, 39.3)[-1][1]
    assert state.body is not None
    body = state.body
    assert math.sin(2.0 * (body.heading - SETUP.road_heading)) == pytest.approx(0.0, abs=1e-9)
    assert body.speed >= 0.0
    ahead, left = (math.cos(body.heading), math.sin(body.heading)), (-math.sin(body.heading), math.cos(body.heading))
    velocity = [body.speed * a + body.lateral_speed * b for a, b in zip(ahead, left, strict=True)]
    # The alignment turns the field by 90 degrees.
    assert velocity == pytest.approx([-towards[1], towards[0]], abs=0.02)


def test_the_field_lies_on_the_road_as_it_is_declared() -> None:
    """The alignment turns by 90 degrees: 10 m east in the field are 10 m to +y on the road, and so is facing."""
    state = states(SETUP, [(k + 0.2, report(float(k), 10.0, 0.0, 0.5, heading=0.0)) for k in range(8)], 7.5)[-1][1]
    assert (state.x, state.y) == pytest.approx((1000.0, 2010.0), abs=0.01)
    assert state.heading == pytest.approx(math.pi / 2, abs=1e-5)


# What each thing that can go wrong leads to, as docs/people.md has it.


def test_gps_lost() -> None:
    found = states(FENCED, walk(10.0), 20.0)
    warned = next(time for time, state in found if time > 10.0 and state.presence is Presence.WARNING)
    assert warned == pytest.approx(10.0 + LIMITS.warning_age, abs=0.03)
    assert first(found, "person_lost", 5.0) == pytest.approx(10.0 + LIMITS.lost_age, abs=0.03)
    assert all(state.body is None for time, state in found if time > 15.1)


def test_reports_five_seconds_old() -> None:
    """From 10 s on the network holds every position back: none is believed, and the newest is of 9 s."""
    late = [(received + (5.0 if received > 10.0 else 0.0), sent) for received, sent in walk(30.0)]
    found = states(FENCED, late, 25.0)
    assert first(found, "person_lost", 5.0) == pytest.approx(9.0 + LIMITS.lost_age, abs=0.03)
    assert {state.refused for time, state in found if time > 16.0} == {"report_old"}


def test_one_position_thirty_metres_off_moves_nobody() -> None:
    """It is away from the car's ground; where it is towards it, the next test says what happens."""
    jumped = walk(20.0, lambda time: (-30.0, 0.0) if time == 10.0 else (0.0, 0.0))
    found = states(FENCED, jumped, 20.0)
    assert {state.faults for time, state in found if time > 3.0} == {()}
    assert all(abs(state.y - 2000.0) < 0.5 for time, state in found if time > 3.0)
    assert "report_jumped" in {state.refused for _, state in found}


def test_thirty_metres_off_towards_the_lot_is_taken_for_true_at_once() -> None:
    jumped = walk(20.0, lambda time: (39.0, 0.0) if time == 10.0 else (0.0, 0.0))
    found = states(FENCED, jumped, 20.0)
    assert first(found, "person_near_lot", 3.0) == pytest.approx(10.2, abs=0.03)
    assert all(abs(state.y - 2000.0) < 0.5 for time, state in found if time > 3.0), "and moves no body"


def test_who_stays_thirty_metres_off_is_lost_and_found_again() -> None:
    jumped = walk(30.0, lambda time: (-30.0, 0.0) if time >= 10.0 else (0.0, 0.0))
    found = states(FENCED, jumped, 30.0)
    assert first(found, "person_lost", 5.0) == pytest.approx(9.0 + LIMITS.lost_age, abs=0.03)
    assert found[-1][1].y == pytest.approx(1970.0, abs=0.5)
    assert found[-1][1].presence is Presence.AREA


def test_walking_into_the_fence() -> None:
    """At 1.5 m/s towards the ground 60 m away, 20 m to be kept: the stop comes before the person is 20 m from it."""
    found = states(FENCED, walk(60.0, lambda time: (1.5 * time, 0.0)), 40.0)
    stopped = first(found, "person_near_lot", 3.0)
    true_distance = 60.0 - 1.5 * stopped
    assert true_distance > 20.0
    # Circle of the position, and what a person can go in 1.2 s, the age of the newest at most.
    assert true_distance < 20.0 + 4.0 + 3.0 * 1.2 + 1.5 * 1.2
    assert all("person_near_lot" in state.faults for time, state in found if time > stopped + 2.0)


def test_page_killed() -> None:
    setup = replace(FENCED, pages=True)
    alive = [(0.5 * k, PageAlive("anna")) for k in range(21)]
    entered = (1.0, FieldEntered("anna", CONSENT))
    found = states(setup, [*walk(10.0), *alive, entered], 20.0)
    assert {state.faults for time, state in found if 3.0 < time < 10.0} == {()}
    assert first(found, "person_unreachable") == pytest.approx(10.0 + PAGE_TIMEOUT, abs=0.03)


def test_a_receiver_that_goes_on_does_not_stand_in_for_a_page_that_is_closed() -> None:
    """Positions ten times a second to the end; the page was last heard of when its person entered."""
    setup = replace(FENCED, pages=True)
    positions = [(0.1 * k + 0.02, report(0.1 * k, accuracy=0.05)) for k in range(200)]
    found = states(setup, [*positions, (1.0, FieldEntered("anna", CONSENT))], 19.0)
    assert first(found, "person_unreachable", 1.1) == pytest.approx(1.0 + PAGE_TIMEOUT, abs=0.03)
    assert all("person_unreachable" in state.faults for time, state in found if time > 4.1)


def test_of_several_places_that_nobody_can_have_reached_the_one_nearest_to_the_ground_counts() -> None:
    """The next position, as far off the other way, does not take back that they may be near the ground."""
    near, far = (10.2, report(10.0, 45.0, 0.0, 4.0)), (10.4, report(10.2, -45.0, 0.0, 4.0))
    for jumps in ([near, far], [far, near]):
        found = states(FENCED, [*walk(9.0), *jumps], 12.0)
        assert min(state.distance for time, state in found if time > 10.5) < 15.0
        assert all("person_near_lot" in state.faults for time, state in found if time > 10.5)


def test_a_vague_place_that_nobody_can_have_reached_counts_too() -> None:
    """With the radius that it has: worse than the scenario takes, and 50 m off."""
    found = states(FENCED, [*walk(9.0), (10.2, report(10.0, 50.0, 0.0, 25.0))], 11.0)
    told = [state for time, state in found if time > 10.3]
    assert {state.refused for state in told} == {"report_jumped"}
    assert all(state.distance < 60.0 - 50.0 - 25.0 for state in told)


def test_who_has_not_said_that_they_are_in_their_field() -> None:
    setup = replace(FENCED, pages=True)
    found = states(setup, walk(10.0), 10.0)
    assert all("person_not_in_field" in state.faults for _, state in found)


def test_the_stop_button_stays_pressed() -> None:
    found = states(FENCED, [*walk(20.0), (8.0, PersonStop("anna"))], 20.0)
    assert first(found, "person_stop") == pytest.approx(8.0, abs=0.03)
    assert all("person_stop" in state.faults for time, state in found if time > 8.02)


def test_an_inaccurate_position_is_none() -> None:
    """The mast of a telephone network is no place of a person; it does not bring anybody near the lot, either."""
    coarse = [(k + 0.2, report(float(k), accuracy=800.0 if k >= 10 else 4.0)) for k in range(20)]
    found = states(FENCED, coarse, 12.0)
    assert {state.faults for time, state in found if time > 3.0} == {()}
    assert {state.refused for time, state in found if time > 10.3} == {"report_inaccurate"}


REPORTS = st.one_of(
    st.builds(PositionReport, st.just("anna"), NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS),
    st.builds(
        lambda time, x, y, accuracy: report(time, x, y, accuracy),
        st.floats(-10.0, 60.0),
        st.floats(-100.0, 200.0),
        st.floats(-100.0, 100.0),
        st.floats(0.0, 50.0),
    ),
    st.just(FieldEntered("anna", CONSENT)),
    st.just(PageAlive("anna")),
    st.just(PersonStop("anna")),
)


@given(st.lists(st.tuples(st.floats(0.0, 3.0), NUMBERS, REPORTS), max_size=30), st.booleans())
def test_whatever_comes_nothing_that_is_no_number_goes_out(
    steps: list[tuple[float, float, Report]], pages: bool
) -> None:
    person, now = Person(replace(FENCED, pages=pages)), 0.0
    for step, received, sent in steps:
        now += step
        person.receive(received if math.isfinite(received) else now, sent)
        state = person.step(now)
        assert set(state.faults) <= set(REASONS)
        assert state.presence >= classify(LIMITS, state.age, state.radius)
        assert (state.body is None) == (state.presence is Presence.GONE)
        if state.body is not None:
            body = state.body
            assert all(map(math.isfinite, (body.x, body.y, body.heading, body.speed, body.length, body.width)))
            assert body.speed <= FENCED.max_speed + 1e-9
            assert body.length <= math.hypot(FENCED.length, FENCED.width) + 2.0 * LIMITS.lost + 1e-9
        else:
            assert "person_lost" in state.faults or "person_absent" in state.faults
        if state.faults == ():
            assert state.distance >= FENCED.least_distance


@pytest.mark.thorough
@given(st.lists(st.tuples(st.floats(-90.0, 90.0), st.floats(0.5, 14.0)), min_size=1, max_size=12))
def test_the_distance_is_a_lower_bound_of_the_true_one(walked: list[tuple[float, float]]) -> None:
    """A person goes anywhere at 3 m/s, and every position is wrong by its whole circle, away from the car's ground."""
    person, x = Person(FENCED), 0.0
    for k, (wish, accuracy) in enumerate(walked):
        person.receive(k + 0.2, report(float(k), x - accuracy, 0.0, accuracy))
        for tick in range(50):
            now = k + 0.2 + tick * STEP
            there = x + max(-3.0, min(3.0, wish - x)) * (now - k)
            distance = person.step(now).distance
            if math.isfinite(distance):
                true = max(FENCE[0][0] - there, 0.0)
                assert distance <= true + 1e-3
        x += max(-3.0, min(3.0, wish - x))


def test_people_hear_of_themselves_alone() -> None:
    bob = replace(SETUP, id="bob")
    people = People((SETUP, bob))
    people.receive(0.2, report(0.0))
    people.receive(0.3, PersonStop("bob"))
    people.receive(0.3, PersonStop("nobody"))
    anna, other = people.step(0.4)
    assert (anna.id, other.id) == ("anna", "bob")
    assert "person_stop" not in anna.faults
    assert "person_stop" in other.faults
    assert math.isnan(other.x)
    assert not math.isnan(anna.x)


def test_a_setup_survives_the_record() -> None:
    assert PersonSetup.from_dict(FENCED.to_dict()) == FENCED
    assert (FENCED.latitude, FENCED.longitude) == (LATITUDE, LONGITUDE)
