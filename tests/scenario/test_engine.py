"""Actors against closed forms, brute integration and a table of triggers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.world.streets import FUSION, pose
from vve_sumo.body_kinds import TYPICAL
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.engine import RecordedSpeed, ScenarioEngine, Sidestep, SpeedChange
from vve_sumo.scenario.road_users import Actor, ActorEvent
from vve_sumo.values import ActorState, Pose

TICK = 0.02
LONG = ReferencePath.from_points([0.0, 2000.0], [0.0, 0.0])
EAST = ReferencePath.from_points([0.0, 250.0, 500.0], [0.0, 0.0, 0.0])
RADIUS = 40.0
#: a circle to the left about (0, 40), two thirds round
ROUND = ReferencePath.from_points(
    [RADIUS * math.sin(a) for a in np.linspace(0.0, 4.0, 200)],
    [RADIUS - RADIUS * math.cos(a) for a in np.linspace(0.0, 4.0, 200)],
)


def actor(**table: Any) -> Actor:
    return Actor.model_validate({"id": "one", **table})


def cast(
    *actors: Actor, path: ReferencePath = EAST, lines: dict[str, ReferencePath] | None = None, **recordings: Any
) -> ScenarioEngine:
    return ScenarioEngine(actors, path, lines or {}, recordings, FUSION)


def ego(x: float, speed: float = 0.0, y: float = 0.0) -> Pose:
    return pose(0.0, x, y, 0.0, speed)


def alone(one: Actor, times: Sequence[float], path: ReferencePath = EAST, **recordings: Any) -> list[ActorState]:
    """Where an actor is that no ego touches."""
    played = cast(one, path=path, **recordings)
    return [state for time in times for state in played.step(time, ego(0.0))]


def ticks(seconds: float) -> list[float]:
    return [k * TICK for k in range(round(seconds / TICK) + 1)]


# Motion.


def test_constant_deceleration_is_exact_at_every_tick():
    one = actor(
        at_m=50.0, speed_mps=15.0, events=[{"when": {"drive_s": 2.0}, "speed_mps": 0.0, "acceleration_mps2": 4.0}]
    )
    for time, state in zip(ticks(8.0), alone(one, ticks(8.0)), strict=True):
        braking = min(max(time - 2.0, 0.0), 15.0 / 4.0)
        assert state.x == pytest.approx(50.0 + 15.0 * min(time, 2.0) + 15.0 * braking - 2.0 * braking**2, abs=1e-9)
        assert state.speed == pytest.approx(15.0 - 4.0 * braking, abs=1e-9)
        assert (state.y, state.heading, state.length, state.width) == (0.0, 0.0, *TYPICAL["car"][:2])


@pytest.mark.parametrize("kind", ["pedestrian", "child"])
def test_people_on_foot_reach_their_speed_as_people_were_seen_to_and_not_in_a_tick(kind):
    """288 people at crosswalks: 0.14 g up to 1.36 m/s, which is a second (Fugger et al., 2000)."""
    events = [{"when": {"drive_s": 1.0}, "speed_mps": 1.36}]
    walking = alone(actor(kind=kind, at_m=50.0, events=events), ticks(4.0))
    at_once = alone(actor(kind=kind, at_m=50.0, fidelity="ideal", events=events), ticks(4.0))
    for time, one in zip(ticks(4.0), walking, strict=True):
        assert one.speed == pytest.approx(min(1.4 * max(time - 1.0, 0.0), 1.36), abs=1e-9)
    assert walking[-1].x == pytest.approx(at_once[-1].x - 0.5 * 1.36**2 / 1.4, abs=1e-9)
    assert next(one.speed for one in at_once if one.speed) == 1.36


def test_an_acceleration_that_is_stated_goes_before_what_was_measured():
    events = [{"speed_mps": 2.0, "acceleration_mps2": 0.5}]
    stated, measured = (
        alone(actor(kind="pedestrian", at_m=50.0, fidelity=name, events=events), ticks(6.0))
        for name in ("ideal", "measured")
    )
    assert stated == measured


def test_measured_walking_is_for_those_who_walk():
    events = [{"speed_mps": 9.0}]
    bicycles = (
        alone(actor(kind="bicycle", at_m=50.0, fidelity=name, events=events), ticks(2.0))
        for name in ("ideal", "measured")
    )
    assert next(bicycles) == next(bicycles)


@pytest.mark.parametrize(("before", "after"), [(20.0, 5.0), (3.0, 14.0), (20.0, 19.6), (1.0, 1.3)])
def test_an_acceleration_that_builds_up_has_its_jerk_and_its_way(before, after):
    """Fine steps of the jerk, summed up: the ramp may or may not end before the speed is reached."""
    rate, build_up, fine = 4.0, 0.6, 1e-3
    sign = math.copysign(1.0, after - before)
    change = SpeedChange(before, after, rate, build_up)
    speed, way, time = before, 0.0, 0.0
    while (after - speed) * sign > 1e-9 and time < 10.0:
        middle = min((time + 0.5 * fine) / build_up, 1.0) * rate * sign
        way += fine * (speed + 0.5 * fine * middle)
        speed += fine * middle
        time += fine
        assert change.at(time) == pytest.approx((way, speed), abs=5e-3)
    assert change.duration == pytest.approx(time, abs=2e-3)
    assert change.at(time + 1.0) == pytest.approx((way + after, after), abs=2e-2)


def test_a_sidestep_has_the_least_jerk_form():
    """At a half, a quarter and the ends by hand; the rate is its slope; it begins and ends without acceleration."""
    step = Sidestep(3.5, 0.0, 4.0)
    assert step.at(0.0) == (3.5, 0.0)
    assert step.at(2.0) == (pytest.approx(1.75), pytest.approx(-3.5 * 1.875 / 4.0))
    assert step.at(1.0)[0] == pytest.approx(3.5 * (1.0 - 106.0 / 1024.0))
    assert step.at(4.0) == step.at(9.0) == (0.0, 0.0)
    for time in (0.3, 1.1, 3.7):
        slope = (step.at(time + 1e-6)[0] - step.at(time - 1e-6)[0]) / 2e-6
        assert step.at(time)[1] == pytest.approx(slope, abs=1e-6)
    assert abs(step.at(1e-3)[1]) < 1e-5
    assert abs(step.at(4.0 - 1e-3)[1]) < 1e-5


def test_a_car_that_cuts_in_points_where_it_goes():
    one = actor(at_m=50.0, offset_m=3.5, speed_mps=12.0, events=[{"offset_m": 0.0, "over_s": 3.0}])
    states = alone(one, ticks(5.0))
    for last, now in pairwise(states):
        way = math.hypot(now.x - last.x, now.y - last.y)
        assert way / TICK == pytest.approx(0.5 * (last.speed + now.speed), abs=1e-3)
        if way > 0.0:
            going = math.atan2(now.y - last.y, now.x - last.x)
            assert going == pytest.approx(0.5 * (last.heading + now.heading), abs=1e-3)
    assert states[-1].y == 0.0
    assert states[-1].heading == 0.0
    assert states[-1].x == pytest.approx(110.0)


@pytest.mark.parametrize(("turned", "sense"), [(0.0, 1.0), (180.0, -1.0), (-180.0, -1.0)])
@pytest.mark.parametrize("offset", [0.0, 3.5, -6.0])
def test_beside_a_bend_the_way_gone_is_the_actors_own(turned, sense, offset):
    """On a circle of radius R an actor at the offset o drives one of R - o, at its own speed, left positive."""
    one = actor(at_m=70.0, offset_m=offset, turned_deg=turned, speed_mps=8.0)
    states = alone(one, ticks(5.0), path=ROUND)
    for time, state in zip(ticks(5.0), states, strict=True):
        angle = 70.0 / RADIUS + sense * 8.0 * time / (RADIUS - offset)
        x, y = (RADIUS - offset) * math.sin(angle), RADIUS - (RADIUS - offset) * math.cos(angle)
        assert math.hypot(state.x - x, state.y - y) < 2e-3
        facing = angle if sense > 0 else angle + math.pi
        assert abs(math.remainder(state.heading - facing, math.tau)) < 1e-3
        assert state.speed == 8.0


@pytest.mark.parametrize(("turned", "offset"), [(0.0, 40.0), (0.0, 50.0), (180.0, 50.0), (180.0, 39.9)])
def test_inside_a_bend_that_is_too_tight_for_its_line_it_still_comes_through(turned, offset):
    """No driver gets there; but no sweep's value may send an actor to the ends of the Earth or hold it for ever."""
    states = alone(actor(at_m=80.0, offset_m=offset, turned_deg=turned, speed_mps=8.0), ticks(25.0), path=ROUND)
    assert 80.0 / 8.0 / 5.0 / TICK <= len(states) < 25.0 / TICK
    for last, now in pairwise(states):
        assert math.hypot(now.x - last.x, now.y - last.y) < 5.0 * 8.0 * TICK


@pytest.mark.parametrize("turned", [90.0, -90.0, 30.0, -135.0, 179.0])
def test_any_other_angle_is_a_straight_line_from_where_it_enters(turned):
    events = [{"when": {"drive_s": 2.0}, "offset_m": 1.0}]
    one = actor(kind="pedestrian", at_m=200.0, offset_m=-6.0, turned_deg=turned, speed_mps=1.4, events=events)
    along = math.radians(turned)
    for time, state in zip(ticks(4.0), alone(one, ticks(4.0)), strict=True):
        left = 1.0 if time > 2.0 - 1e-9 else 0.0
        assert state.x == pytest.approx(200.0 + 1.4 * time * math.cos(along) - left * math.sin(along), abs=1e-9)
        assert state.y == pytest.approx(-6.0 + 1.4 * time * math.sin(along) + left * math.cos(along), abs=1e-9)
        assert state.heading == pytest.approx(along)


def test_a_recorded_speed_is_replayed_exactly_and_its_last_value_holds():
    times, speeds = [100.0, 101.0, 103.5, 104.0], [10.0, 6.0, 8.0, 3.0]
    one = actor(at_m=20.0, events=[{"when": {"drive_s": 1.0}, "speeds": "leader"}])
    fine = np.linspace(0.0, 6.0, 600001)
    speed = np.interp(fine, np.array(times) - times[0], speeds)
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 1e-5)))
    states = alone(one, ticks(6.0), leader=(times, speeds))
    for time, state in zip(ticks(6.0), states, strict=True):
        since = max(time - 1.0, 0.0)
        assert state.speed == pytest.approx(np.interp(since, fine, speed) if time > 1.0 - 1e-9 else 0.0, abs=1e-6)
        assert state.x == pytest.approx(20.0 + np.interp(since, fine, way), abs=1e-6)


changes = st.tuples(st.floats(0.0, 40.0), st.floats(0.05, 12.0), st.floats(0.0, 3.0), st.integers(1, 150))
acts_drawn = st.lists(changes, min_size=1, max_size=4)


@pytest.mark.thorough
@settings(deadline=None, max_examples=50)
@given(st.floats(0.0, 40.0), acts_drawn, st.floats(-5.0, 5.0), st.lists(st.integers(1, 40), min_size=5, max_size=60))
def test_speed_is_never_negative_the_way_is_its_integral_and_steps_do_not_matter(speed, drawn, offset, chunks):
    """The same events at the same times: every tick, or now and then as long as no event is skipped over."""
    events, begins, begin = [], [], 0
    for target, rate, build_up, wait in drawn:
        begin += wait
        begins.append(begin)
        when = {"drive_s": begin * TICK}
        events.append({"when": when, "speed_mps": target, "acceleration_mps2": rate, "build_up_s": build_up})
    events[-1] |= {"offset_m": offset, "over_s": 2.0}
    one = actor(at_m=0.0, speed_mps=speed, turned_deg=45.0, events=events)
    last = begin + 400
    every = dict(enumerate(alone(one, [k * TICK for k in range(last + 1)])))
    speeds = np.array([every[k].speed for k in range(last + 1)])
    assert speeds.min() >= 0.0
    stops = sorted({0, *begins, *(int(at) for at in np.cumsum(chunks) if at <= last)})
    for k, state in zip(stops, alone(one, [k * TICK for k in stops]), strict=True):
        assert tuple(state[2:]) == pytest.approx(tuple(every[k][2:]), abs=1e-8)
    quiet = range(begins[-1])  # beyond, it also goes sidewards
    way = [math.hypot(every[k].x, every[k].y) for k in quiet]
    steps = np.diff(way) - 0.5 * TICK * (speeds[: len(way) - 1] + speeds[1 : len(way)])
    assert np.abs(steps).max(initial=0.0) <= 12.0 * TICK * TICK  # trapezes, at 12 m/s2 and a kink at most


def test_at_the_end_of_its_path_it_leaves_for_good():
    for turned, at, seconds in ((0.0, 480.0, 2.0), (180.0, 20.0, 2.0), (90.0, 490.0, 99.0)):
        states = alone(actor(at_m=at, turned_deg=turned, speed_mps=10.0), ticks(10.0))
        assert len(states) == pytest.approx(min(seconds, 10.0) / TICK + 1, abs=1)


def test_it_can_be_taken_off_and_is_then_gone():
    events = [{"when": {"drive_s": 1.0}, "leaves": True}, {"speed_mps": 5.0}]
    assert len(alone(actor(at_m=20.0, events=events), ticks(3.0))) == 50


def test_a_path_of_its_own_is_followed_at_its_own_stations():
    north = ReferencePath.from_points([100.0, 100.0], [-50.0, 50.0])
    played = cast(actor(path="north", at_m=10.0, offset_m=2.0, speed_mps=10.0), lines={"north": north})
    played.step(0.0, ego(0.0))
    (state,) = played.step(3.0, ego(0.0))
    assert (state.x, state.y, state.heading) == pytest.approx((98.0, -10.0, math.pi / 2))


def test_time_that_stands_or_is_no_number_moves_nobody():
    played = cast(actor(at_m=20.0, speed_mps=10.0))
    played.step(1.0, ego(0.0))
    there = played.step(2.0, ego(0.0))
    assert there[0].x == pytest.approx(30.0)
    for now in (2.0, 1.0, math.nan, math.inf, -math.inf):
        assert played.step(now, ego(0.0)) == there


# Entering.


def first(one: Actor, poses: Callable[[float], Pose | None], seconds: float = 10.0) -> tuple[float, ActorState] | None:
    """When an actor enters, and where."""
    played = cast(one)
    for time in ticks(seconds):
        if states := played.step(time, poses(time)):
            return time, states[0]
    return None


@pytest.mark.parametrize(
    ("table", "x"),
    [
        ({"ahead_m": 20.0}, 100.0 + 20.0 + 2.25),
        ({"ahead_m": 20.0, "turned_deg": 180.0}, 100.0 + 20.0 + 2.25),
        ({"ahead_m": 20.0, "turned_deg": 90.0}, 100.0 + 20.0 + 0.9),
        ({"ahead_m": 20.0, "length_m": 8.0}, 100.0 + 20.0 + 4.0),
        ({"ahead_m": -15.0}, 100.0 - 15.0 - 2.25),
        ({"ahead_m": 0.0}, 102.25),
        ({"at_m": 130.0}, 130.0),
    ],
)
def test_ahead_is_the_clear_distance_to_the_nearest_face_when_it_enters(table, x):
    entered = first(actor(**table, enters={"ego_at_m": 100.0}), lambda time: ego(80.0 + 10.0 * time, 10.0))
    assert entered is not None
    assert entered[0] == pytest.approx(2.0)
    assert entered[1].x == pytest.approx(x)


def test_until_it_enters_it_does_not_exist_and_its_acts_wait():
    events = [{"when": {"after_s": 1.0}, "speed_mps": 4.0}]
    one = actor(at_m=50.0, speed_mps=2.0, enters={"drive_s": 3.0}, events=events)
    states = alone(one, ticks(5.0))
    assert len(states) == 101
    assert [state.speed for state in states] == [2.0] * 50 + [4.0] * 51
    assert states[-1].x == pytest.approx(50.0 + 2.0 + 4.0)


# Triggers: an ego at 20 m/s whose bumper is at 20 t m, and an actor whose faces are at 197.75 and 202.25 m.

NEAR = {"at_m": 200.0}
FIRES = [
    ({}, NEAR, 0.0),
    ({"drive_s": 3.0}, NEAR, 3.0),
    ({"after_s": 2.5}, NEAR, 2.5),
    ({"ego_at_m": 90.0}, NEAR, 4.5),
    ({"ego_within_m": 47.75}, NEAR, 7.5),
    ({"ttc_s": 2.0}, NEAR, (197.75 - 40.0) / 20.0),
    ({"ttc_s": 2.0}, NEAR | {"speed_mps": 10.0}, (197.75 - 20.0) / 10.0),
    ({"ttc_s": 2.0}, NEAR | {"speed_mps": 5.0, "turned_deg": 180.0}, (197.75 - 50.0) / 25.0),
    ({"ttc_s": 2.0}, NEAR | {"speed_mps": 20.0}, None),
    ({"ttc_s": 2.0}, {"kind": "pedestrian", "at_m": 200.0, "turned_deg": 90.0, "offset_m": -40.0, "speed_mps": 3.0},
     (199.75 - 40.0) / 20.0),
    ({"ego_arrives_in_s": 3.0}, NEAR, 7.0),
    ({"ego_arrives_in_s": 0.0}, NEAR, 10.0),
    ({"ego_speed_mps": 20.0}, NEAR, 0.0),
    ({"ego_speed_mps": 20.1}, NEAR, None),
    ({"ego_within_m": 47.75, "drive_s": 8.0}, NEAR, 8.0),
    ({"ego_within_m": 47.75, "drive_s": 2.0}, NEAR, 7.5),
    ({"ego_within_m": 5.0, "drive_s": 10.6}, NEAR, 10.6),  # 212 m: the ego's tail is 4.9 m past its front
    ({"ego_within_m": 0.0}, NEAR, 197.75 / 20.0),
    ({"ttc_s": 1.0, "drive_s": 10.0}, NEAR, None),  # beside the ego and behind it nothing closes in
    ({"ttc_s": 1.0}, {"at_m": 0.0, "speed_mps": 30.0, "enters": {"drive_s": 5.0}}, 5.0 + 82.878 / 10.0),
]  # fmt: skip


@pytest.mark.parametrize(("when", "table", "due"), FIRES)
def test_a_trigger_fires_at_the_first_tick_at_which_all_that_it_states_holds(when, table, due):
    played = cast(actor(**table, events=[{"when": when, "leaves": True}]), path=LONG)
    there = [bool(played.step(time, ego(20.0 * time, 20.0))) for time in ticks(20.0)]
    begun = round(table.get("enters", {}).get("drive_s", 0.0) / TICK)
    assert not any(there[:begun])
    left = there.index(False, begun) if False in there[begun:] else None
    assert (left is None) == (due is None)
    if left is not None:
        assert due - 1e-9 <= left * TICK < due + TICK - 1e-9


ASK_FOR_THE_EGO = [
    {"ego_at_m": 0.0},
    {"ego_within_m": 1e3},
    {"ttc_s": 1e3},
    {"ego_arrives_in_s": 1e3},
    {"ego_speed_mps": 0.0},
]


@pytest.mark.parametrize("when", ASK_FOR_THE_EGO)
@pytest.mark.parametrize("spoilt", [None, ego(math.nan), ego(10.0, math.nan), ego(math.inf), ego(10.0, 9.0, math.nan)])
def test_no_trigger_that_asks_for_the_ego_fires_on_a_pose_that_is_none(when, spoilt):
    played = cast(actor(**NEAR, speed_mps=1.0, events=[{"when": when, "leaves": True}]))
    for time in ticks(4.0):
        (state,) = played.step(time, spoilt)
    assert state.x == pytest.approx(204.0)
    assert played.step(4.02, ego(10.0, 9.0)) == ()


def test_acts_wait_for_the_one_before_them_and_several_may_begin_at_once():
    events = [
        {"when": {"ego_at_m": 40.0}, "speed_mps": 6.0},
        {"when": {"drive_s": 1.0}, "offset_m": 2.0},
        {"when": {"after_s": 0.5}, "speed_mps": 9.0},
    ]
    played = cast(actor(at_m=100.0, speed_mps=3.0, events=events))
    seen = [played.step(time, ego(20.0 * time, 20.0))[0] for time in ticks(4.0)]
    assert [state.speed for state in seen] == [3.0] * 100 + [6.0] * 25 + [9.0] * 76
    assert [state.y for state in seen] == [0.0] * 100 + [2.0] * 101


def test_on_a_path_of_its_own_the_ego_is_seen_from_where_it_is():
    """It comes along a side street to x = 100; the gap is measured along the ego's path."""
    north = ReferencePath.from_points([100.0, 100.0], [-50.0, 50.0])
    events = [{"when": {"ego_within_m": 20.0}, "leaves": True}]
    played = cast(actor(path="north", at_m=10.0, speed_mps=1.0, events=events), lines={"north": north})
    there = [bool(played.step(time, ego(10.0 * time, 10.0))) for time in ticks(9.0)]
    assert there.index(False) * TICK == pytest.approx((100.0 - 0.9 - 20.0) / 10.0, abs=TICK)


# What cannot be.


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, "one of at_m and ahead_m"),
        ({"at_m": 1.0, "ahead_m": 1.0}, "one of at_m and ahead_m"),
        ({"path": "p", "ahead_m": 1.0}, "at_m beside path"),
        ({"at_m": 1.0, "speed_mps": 101.0}, "less than or equal to 100"),
    ],
)
def test_actors_that_cannot_be_are_refused(table, words):
    with pytest.raises(ValidationError, match=words):
        actor(**table)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"speed_mps": 1.0, "speeds": "x"}, "one of speed_mps and speeds"),
        ({"acceleration_mps2": 1.0}, "expected speed_mps beside it"),
        ({"speed_mps": 1.0, "build_up_s": 1.0}, "expected acceleration_mps2 beside it"),
        ({"over_s": 1.0}, "expected offset_m beside it"),
    ],
)
def test_acts_that_say_half_are_refused(table, words):
    with pytest.raises(ValidationError, match=words):
        ActorEvent.model_validate(table)


def test_a_single_row_is_a_steady_speed():
    assert RecordedSpeed([7.0], [4.0]).at(2.5) == (10.0, 4.0)
