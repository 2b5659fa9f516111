"""Actors in whole drives: the controller meets them, the record holds them, their files are found and hashed."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drive.street import REPOSITORY, altered, drive_once
from tests.isolated import isolated
from vve_sumo.drive.replay import changed_since, read_car_frames, read_pipeline_inputs, recorded_scenario, replay
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.record.reader import read_table

LEAD = {
    "id": "lead",
    "ahead_m": 30.0,
    "speed_mps": 10.0,
    "events": [{"when": {"drive_s": 8.0}, "speed_mps": 0.0, "acceleration_mps2": 4.0, "build_up_s": 0.5}],
}
WALKER = {
    "id": "walker",
    "kind": "pedestrian",
    "at_m": 100.0,
    "offset_m": -7.0,
    "turned_deg": -90.0,
    "speed_mps": 1.4,
    "enters": {"ego_arrives_in_s": 6.0},
}


def changes(**others: Any) -> dict[str, Any]:
    """A drive without traffic and without anything parked."""
    return {"road.demand": [], "obstacles": [], "ego.speed_mps": 10.0, "duration_s": 60.0, "seed": 3} | others


@pytest.fixture(scope="module")
def braked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The record of a drive behind a lead that brakes while somebody walks beside the road."""
    folder = tmp_path_factory.mktemp("actors") / "record"
    return folder, isolated(drive_once, changes(actors=[LEAD, WALKER]), str(folder))


def track(folder: Path, name: str) -> dict[str, np.ndarray[Any, Any]]:
    """The rows of an actor, by column."""
    table = read_table(folder, "actors")
    mine = np.array(table["actor"].to_pylist()) == name
    return {column: table[column].to_numpy()[mine] for column in table.column_names if column != "actor"}


@pytest.mark.thorough
def test_the_car_stops_behind_a_lead_that_brakes_to_a_stand(braked: tuple[Path, dict[str, Any]]) -> None:
    _folder, summary = braked
    assert summary["outcome"] == "stopped"
    assert summary["collision"] is False
    assert summary["stop_gap_m"] == pytest.approx(5.0, abs=0.7)
    assert summary["ego_sync_position_error_m"] <= 1e-6


def test_the_record_holds_the_lead_as_its_closed_form_says(braked: tuple[Path, dict[str, Any]]) -> None:
    """Speed and way from the tick on at which it entered; built up in T, the acceleration costs a T / 2 of speed."""
    lead = track(braked[0], "lead")
    time = 0.02 * (lead["tick"] - lead["tick"][0])
    since = np.clip(time - 8.0, 0.0, None)
    ramp = np.minimum(since, 0.5)
    speed = np.clip(10.0 - 4.0 * ramp * ramp - 4.0 * (since - ramp), 0.0, None)
    assert np.diff(lead["tick"]).tolist() == [1] * (len(time) - 1)
    assert lead["speed_mps"] == pytest.approx(speed, abs=1e-9)
    assert set(lead["length_m"]) == {4.5}
    way = np.hypot(np.diff(lead["x_m"]), np.diff(lead["y_m"]))
    assert way == pytest.approx(0.01 * (speed[1:] + speed[:-1]), abs=2e-4)
    assert time[-1] > 12.0


def test_whoever_enters_when_the_ego_comes_enters_then(braked: tuple[Path, dict[str, Any]]) -> None:
    """At the tick at which bumper and speed first put the ego no more than 6 s before s = 100 m."""
    folder, _summary = braked
    walker, resolved = track(folder, "walker"), altered(changes())
    front, due = resolved.vehicle.rear_axle_to_bumper, -1
    for row in read_table(folder, "ticks").to_pylist():
        if due < 0 and row["speed_mps"] > 0.1 and 100.0 - row["s_m"] - front <= 6.0 * row["speed_mps"]:
            due = row["tick"]
    assert due > 0
    assert abs(int(walker["tick"][0]) - due) <= 3
    here = resolved.path.at(100.0)
    heading = math.remainder(here.heading - 0.5 * math.pi, math.tau)
    assert walker["heading_rad"] == pytest.approx(heading)
    assert walker["x_m"][0] == pytest.approx(here.x + 7.0 * math.sin(here.heading))
    assert set(walker["radar_cross_section_m2"]) == {0.5}


@pytest.mark.thorough
def test_a_drive_with_actors_replays(braked: tuple[Path, dict[str, Any]]) -> None:
    folder, _summary = braked
    resolved = recorded_scenario(folder, REPOSITORY)
    assert changed_since(folder, resolved) == []
    assert replay(resolved, read_pipeline_inputs(folder), read_car_frames(folder, DEFAULT_EPOCH), REPOSITORY) is None


@pytest.mark.thorough
def test_the_same_drive_gives_the_same_record(braked: tuple[Path, dict[str, Any]]) -> None:
    again = isolated(drive_once, changes(actors=[LEAD, WALKER]))
    assert again["record_sha256"] == braked[1]["record_sha256"]


# Files.


def recorded(folder: Path, text: str = "time_s,speed_mps\n0,8\n2,6\n") -> str:
    """Write a recorded speed and return its name."""
    (folder / "leader.csv").write_text(text, encoding="utf-8")
    return str(folder / "leader.csv")


def test_paths_and_recorded_speeds_are_found_and_hashed(tmp_path: Path) -> None:
    speeds = recorded(tmp_path, "# a drive\nspeed_mps, time_s\n8,100\n\n6,102.5\n")
    other = {"id": "other", "path": "linden_loop", "at_m": 10.0}
    resolved = altered(changes(actors=[LEAD | {"events": [{}, {"speeds": speeds}]}, other]))
    assert resolved.recordings == {speeds: ((100.0, 102.5), (8.0, 6.0))}
    assert resolved.actor_paths.keys() == {"linden_loop"}
    assert isinstance(resolved.actor_paths["linden_loop"], ReferencePath)
    hashes = resolved.to_dict(REPOSITORY)["files_sha256"]
    loop = (REPOSITORY / "routes" / "linden_loop.csv").read_bytes()
    assert hashes["actors.other.path"] == hashlib.sha256(loop).hexdigest()
    assert hashes["actors.lead.events.1.speeds"] == hashlib.sha256(Path(speeds).read_bytes()).hexdigest()
    json.dumps(resolved.to_dict(REPOSITORY))


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"path": "nowhere", "at_m": 1.0}, ["parked_car.toml", "actors.one.path", "no path named 'nowhere'"]),
        ({"at_m": 9e4}, ["parked_car.toml", "actors.one", "at_m 90000", "beyond the path's"]),
        ({"path": "linden_loop", "at_m": 9e4}, ["actors.one", "at_m 90000", "beyond the path's"]),
        (
            {"at_m": 1.0, "events": [{}, {"speeds": "no/x.csv"}]},
            ["actors.one.events.1.speeds", "no/x.csv", "does not exist"],
        ),
    ],
)
def test_what_an_actor_names_and_nobody_finds_is_one_line(table: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        altered(changes(actors=[{"id": "one"} | table]))
    assert all(word in str(caught.value) for word in words), caught.value
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["no column time_s"]),
        ("time_s,speed\n0,1\n", ["no column speed_mps", "time_s, speed_mps"]),
        ("time_s,speed_mps\n", ["at least one row"]),
        ("time_s,speed_mps\n0,1\n0,2\n", ["line 3", "after 0 s", "got 0"]),
        ("time_s,speed_mps\n0,1\n1,-2\n", ["line 3", "0 to 100", "1, -2"]),
        ("time_s,speed_mps\n0,1\n# gap\n1,nan\n", ["line 4", "0 to 100"]),
        ("time_s,speed_mps\ninf,1\n", ["line 2", "expected a time"]),
        ("time_s,speed_mps\n0\n", ["line 2", "numbers under time_s, speed_mps"]),
        ("time_s,speed_mps\n0,fast\n", ["line 2", "numbers under time_s, speed_mps", "fast"]),
        ("time_s\0", ["binary"]),
    ],
)
def test_a_wrong_recording_is_one_line_that_names_file_and_line(tmp_path: Path, text: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        altered(changes(actors=[LEAD | {"events": [{"speeds": recorded(tmp_path, text)}]}]))
    assert all(word in str(caught.value) for word in ["leader.csv", *words]), caught.value
    assert "\n" not in str(caught.value)


# Live: who waits for the operator.


def _waited() -> list[tuple[str, ...]]:
    from vve_sumo.drive.virtual_road import VirtualRoad, open_world, pose_at_rest, scenario_engine
    from vve_sumo.values import EGO, Point

    resolved = altered(changes(actors=[LEAD, WALKER | {"enters": {"drive_s": 0.04}}]))
    here = resolved.path.at(5.0)
    street, seen = VirtualRoad(open_world(resolved), scenario_engine(resolved), waits=True), []
    for tick, (go, speed) in enumerate([(False, 0.0), (False, 0.1), (True, 0.0), (False, 0.0), (False, 0.0)]):
        if go:
            street.start_actors()
        asked = replace(pose_at_rest(here.x, here.y, here.heading), time=9.0 + 0.02 * tick, speed=speed)
        street.advance({EGO: replace(asked, point=Point.FRONT_BUMPER)})
        seen.append(street.around[EGO].actors.ids)
    street.close()
    return seen


@pytest.mark.thorough
def test_actors_wait_for_the_operators_go_and_their_time_counts_from_it() -> None:
    assert isolated(_waited) == [(), (), ("lead",), ("lead",), ("lead", "walker")]
