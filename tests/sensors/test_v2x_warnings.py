"""What a V2X receiver hears beyond awareness messages: warnings, and what others perceive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.sensors.scenes import BUMPER, FUSION, actors, car, rear_axle
from tests.sensors.test_perception import both, child
from tests.sensors.test_v2x import COLUMBUS, IDEAL, LEANING, PERIOD, heard
from vve_sumo.body_kinds import number_of
from vve_sumo.sensors.guarded import GuardedSensor, NotFiniteError, WrongTypeError
from vve_sumo.sensors.port import configured
from vve_sumo.sensors.v2x import V2xConfig
from vve_sumo.sensors.v2x_messages import COLUMNS, CPM, DENM, MORE_COLUMNS
from vve_sumo.values import Actors, ReportedObjects, RoadEvents, Stations

WARNING = replace(IDEAL, warnings=True)
PERCEIVING = replace(IDEAL, perceiving=1.0)


def events_of(output: Stations) -> RoadEvents:
    assert output.events is not None
    return output.events


def objects_of(output: Stations) -> ReportedObjects:
    assert output.objects is not None
    return output.objects


# --- warnings ---------------------------------------------------------------------------------------------------------


def braking(time: float) -> Actors:
    """A car ahead that brakes at 8 m/s2 from 2 s on until it stands, at 3.875 s."""
    since = min(max(time - 2.0, 0.0), 15.0 / 8.0)
    return actors([car(60.0 + 15.0 * min(time, 2.0) + 15.0 * since - 4.0 * since**2, 0.0, 0.0, 15.0 - 8.0 * since)])


def test_hard_braking_is_heard_of_within_a_check_and_the_latency() -> None:
    outputs = heard(WARNING, braking, 8.0)
    first = next(one for one in outputs if len(events_of(one.output).cause))
    # A deceleration is told from two checks; then the latency and two ticks.
    assert 2.0 < first.time <= 2.0 + 2 * 0.1 + 0.05 + 3 * PERIOD
    event = events_of(first.output)
    assert (event.cause.tolist(), event.sub_cause.tolist(), event.ended.tolist()) == ([99], [1], [0])
    then = first.output.time - float(event.age[0])
    front = float(braking(then).x[0]) + 2.25 - BUMPER
    assert event.x.tolist() == pytest.approx([front], abs=0.02)
    assert event.speed.tolist() == pytest.approx([float(braking(then).speed[0])], abs=0.011)


def test_a_braking_event_lapses_two_seconds_after_the_last_message() -> None:
    outputs = heard(WARNING, braking, 8.0)
    there = [one.output.time for one in outputs if len(events_of(one.output).cause)]
    last = max(message.time for one in outputs for message in one.reading.messages if message.message == DENM)
    assert 3.7 <= last <= 4.0
    assert last + 1.4 < max(there) <= last + 2.0 + 1e-9


def test_only_those_whose_hazard_lights_are_on_warn_of_standing() -> None:
    scene = actors([car(30.0, 0.0), car(40.0, 3.0)], ["broken", "waiting"])
    config = replace(WARNING, hazard_lights=frozenset({"broken"}))
    outputs = heard(config, lambda time: scene, 5.0)
    denms = [one for output in outputs for one in output.reading.messages if one.message == DENM]
    assert {one.actor for one in denms} == {"broken"}
    assert np.diff([one.time for one in denms]) == pytest.approx([1.0] * (len(denms) - 1), abs=0.021)
    event = events_of(outputs[-1].output)
    assert (event.cause.tolist(), event.validity.tolist()) == ([94], [30.0])
    assert event.x.tolist() == pytest.approx([30.0 + 2.25 - BUMPER], abs=0.02)


def test_the_end_of_an_event_is_heard_and_then_forgotten() -> None:
    """A car that has stood drives off after 3 s: its event is called off at 8 s."""
    scene = lambda time: actors([car(30.0 + max(time - 3.0, 0.0), 0.0, 0.0, 1.0 if time > 3.0 else 0.0)], ["one"])  # noqa: E731
    config = replace(WARNING, hazard_lights=frozenset({"one"}))
    outputs = heard(config, scene, 60.0)
    ends = [one.time for one in outputs if 1 in events_of(one.output).ended]
    assert min(ends) == pytest.approx(8.2, abs=0.2)
    event = events_of(next(one.output for one in outputs if 1 in events_of(one.output).ended))
    assert (event.cause.tolist(), event.number.tolist()) == ([0], [0])
    assert len(events_of(outputs[-1].output).cause) == 0


# --- what others perceive ---------------------------------------------------------------------------------------------


def occluded(time: float) -> Actors:
    """A child behind a van beside the ego's way, whom an oncoming car sees: all on a map that leans."""
    x, y = COLUMBUS
    rows = [car(x + 60.0, y + 3.0, math.pi, 0.0), car(x + 20.0, y - 2.5, math.pi)]
    return both(actors(rows, ["oncoming", "parked"]), child(x + 24.0, y - 2.5 + 0.2 * time))


def perceived(
    config: V2xConfig = PERCEIVING, seconds: float = 3.0, scene: Callable[[float], Actors] = occluded
) -> Stations:
    x, y = COLUMBUS
    where = rear_axle(x, y)
    return heard(config, scene, seconds, ego=lambda time: where, frame=LEANING)[-1].output


def test_a_hidden_child_is_told_of_by_who_sees_it() -> None:
    """Nobody but the oncoming car sends: what is known of the child is what that car sees."""
    output = perceived(replace(PERCEIVING, equipped_vulnerable=0.0))
    objects, stations = objects_of(output), {n: row for row, n in enumerate(output.number.tolist())}
    people = np.flatnonzero(objects.kind == number_of("pedestrian"))
    assert len(people) == 1
    row = people[0]
    truth = occluded(output.time - float(objects.age[row]))
    off_x, off_y = float(truth.x[2]) - COLUMBUS[0], float(truth.y[2]) - COLUMBUS[1]
    assert objects.x[row] == pytest.approx(off_x - BUMPER, abs=0.03)
    assert objects.y[row] == pytest.approx(off_y, abs=0.03)
    assert LEANING.to_map(float(objects.latitude[row]), float(objects.longitude[row])) == pytest.approx(
        (float(truth.x[2]), float(truth.y[2])), abs=0.03
    )
    assert objects.speed[row] == pytest.approx(1.4, abs=0.015)
    assert abs(math.remainder(objects.heading[row], math.tau)) < math.radians(0.16)
    # Its sender is the oncoming car, whose place is that of its own CAM.
    sender = stations[int(objects.sender[row])]
    assert objects.sender_latitude[row] == pytest.approx(output.latitude[sender], abs=3e-9)
    assert objects.sender_longitude[row] == pytest.approx(output.longitude[sender], abs=3e-9)
    assert abs(objects.heading[row] - 0.0) < 0.01


def test_a_place_that_is_told_of_holds_the_sender_s_error_and_its_sensor_s() -> None:
    noisy = replace(
        PERCEIVING, position_sigma=1.0, sector=replace(PERCEIVING.sector, sigma=0.5), equipped_vulnerable=0.0
    )
    off, radius = [], 0.0
    rows = [car(60.0, 400.0 * n, math.pi) for n in range(200)]
    people = [child(40.0, 400.0 * n) for n in range(200)]
    scene = actors(rows, [f"car{n}" for n in range(200)])
    for n, one in enumerate(people):
        scene = both(scene, replace(one, ids=(f"child{n}",)))
    for output in heard(noisy, lambda time: scene, 0.5):
        for one in output.reading.messages:
            if one.message == CPM:
                off.append((one.x - 40.0, one.y - 400.0 * int(one.actor[5:])))
                radius = one.uncertainty
    assert len(off) >= 200
    assert np.std(off, axis=0) == pytest.approx([math.hypot(1.0, 0.5)] * 2, rel=0.12)
    assert np.mean(np.hypot(*np.transpose(off)) <= radius) == pytest.approx(0.95, abs=0.03)


def test_a_share_of_the_senders_perceives() -> None:
    rows = [car(60.0, 400.0 * n, math.pi) for n in range(300)]
    scene = actors(rows, [f"car{n}" for n in range(300)])
    people = both(scene, actors([(40.0, 400.0 * n, 0.0, 0.0, 0.5, 0.35, 1.0) for n in range(300)],
                                [f"child{n}" for n in range(300)], kind="child"))  # fmt: skip
    config = replace(PERCEIVING, perceiving=0.3)
    messages = [one for output in heard(config, lambda time: people, 0.4) for one in output.reading.messages]
    told = {one.station for one in messages if one.message == CPM}
    assert len(told) / 300 == pytest.approx(0.3, abs=0.07)


def test_who_perceives_nobody_sends_no_cpm_and_an_object_that_is_gone_is_forgotten() -> None:
    def scene(time: float) -> Actors:
        alone = actors([car(60.0, 3.0, math.pi)], ["oncoming"])
        return both(alone, child(30.0, 3.0)) if 1.0 < time < 2.0 else alone

    outputs = heard(replace(PERCEIVING, equipped_vulnerable=0.0), scene, 6.0)
    there = [one.output.time for one in outputs if len(objects_of(one.output).sender)]
    assert 1.0 < min(there) < 1.3
    assert 3.0 < max(there) <= 4.1


# --- the record and the guard -----------------------------------------------------------------------------------------


def test_what_is_off_leaves_no_trace() -> None:
    """Neither in the table nor in the output, and the awareness messages are the same."""
    for output in heard(IDEAL, occluded, 2.0, ego=lambda time: rear_axle(*COLUMBUS), frame=LEANING):
        assert output.output.objects is None
        assert output.output.events is None
        assert len(output.reading.columns()) == len(COLUMNS)
    on = heard(replace(PERCEIVING, warnings=True), occluded, 2.0, ego=lambda time: rear_axle(*COLUMBUS), frame=LEANING)
    off = heard(IDEAL, occluded, 2.0, ego=lambda time: rear_axle(*COLUMBUS), frame=LEANING)
    aware = [[one for one in output.reading.messages if one.message not in (CPM, DENM)] for output in on]
    assert [one for messages in aware for one in messages] == [one for o in off for one in o.reading.messages]


def test_a_guarded_receiver_gives_all_its_columns() -> None:
    settings = configured("v2x", {"ideal": True, "warnings": True, "perceiving": 1.0, "hazard_lights": "lamp oncoming"})
    assert settings.table() == COLUMNS + MORE_COLUMNS
    scene = both(actors([car(60.0, 3.0, math.pi)], ["oncoming"]), child(30.0, 3.0))
    sensor, kinds = GuardedSensor("obu", settings, FUSION, np.random.default_rng(1)), set[int]()
    for tick in range(60):
        columns = sensor.step(PERIOD * tick, rear_axle(), scene)
        sensor.prepare()
        assert sensor.faults == ()
        if columns is not None:
            kinds |= set(columns[1].tolist())  # type: ignore[union-attr]
            assert len(columns) == len(settings.table())
    assert kinds == {1, 2, 14, 16}


def test_a_number_that_is_none_in_a_table_of_the_output_is_refused() -> None:
    """The guard looks into the tables that an output holds."""
    settings = configured("v2x", {"ideal": True, "perceiving": 1.0})
    guard = GuardedSensor("obu", settings, FUSION, np.random.default_rng(1))
    output = perceived()
    guard._check(output)
    spoilt = replace(objects_of(output), x=objects_of(output).x * math.nan)
    with pytest.raises(NotFiniteError, match="x of its output"):
        guard._check(replace(output, objects=spoilt))
    with pytest.raises(WrongTypeError, match="speed of its output is a NoneType"):
        guard._check(replace(output, speed=None))
