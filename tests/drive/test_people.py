"""Real people in whole drives, simulated: the car meets them, the record holds them and comes out again bit for bit."""

from __future__ import annotations

import json
import math
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import shapely

from tests.drive.forge import cut_off
from tests.drive.street import REPOSITORY, altered, drive_once, recorded
from tests.isolated import isolated
from tests.rig.test_load import SIMULATED, simulated
from vve_sumo.drive.lockstep import Lockstep
from vve_sumo.drive.persons import read_walk
from vve_sumo.drive.replay import replay_people
from vve_sumo.drive.verify import altered_parts
from vve_sumo.errors import ConfigError
from vve_sumo.live import review
from vve_sumo.people.reports import PositionReport, decode
from vve_sumo.people.simulated_phone import MAX_DELAY
from vve_sumo.record.reader import read_table
from vve_sumo.rig.load import parse as parse_rig

AT = 150.0  #: s of the field's anchor [m]
FIELD = {"latitude_deg": 40.0065, "longitude_deg": -83.019, "heading_deg": 90.0, "least_distance_m": 50.0}


def walk_file(folder: Path, *rows: tuple[float, float, float]) -> str:
    file = folder / "walk.csv"
    lines = "\n".join(",".join(map(str, row)) for row in rows)
    file.write_text(f"time_s,forward_m,left_m\n{lines}\n", encoding="utf-8")
    return str(file)


def anna(walk: str, **others: Any) -> dict[str, Any]:
    """Somebody whose field's anchor is 12 m to the right of the path, facing it."""
    simulated = {"walk": walk, "accuracy_m": 4.0}
    return {"id": "anna", "at_m": AT, "offset_m": -12.0, "turned_deg": 90.0, "simulated": simulated} | others


def changes(*people: dict[str, Any], **others: Any) -> dict[str, Any]:
    table = {"road.demand": [], "obstacles": [], "ego.speed_mps": 8.0, "duration_s": 60.0, "seed": 3, "criteria": {}}
    return table | {"people": list(people)} | others


@pytest.fixture(scope="module")
def stood(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The record of a drive towards somebody who stands in the middle of the path all the time."""
    above = tmp_path_factory.mktemp("people")
    walk = walk_file(above, (0.0, 12.0, 0.0))
    return above / "record", isolated(drive_once, changes(anna(walk)), str(above / "record"))


@pytest.mark.thorough
def test_the_car_stops_before_the_area_of_a_person(stood: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = stood
    assert summary["outcome"] == "stopped"
    assert not summary["collision"]
    people = read_table(folder, "people")
    assert set(people["presence"].to_pylist()) == {"gone", "area"}
    assert people["faults"].to_pylist()[-1] == ""
    last = read_table(folder, "ticks").to_pylist()[-1]
    # The area is at most 4 m and what is added to it; the car is at rest on this side of the person.
    assert AT - 25.0 < last["s_m"] < AT - 4.0
    assert summary["braked_for"] == "anna"


def test_the_bodies_on_the_road_are_those_of_the_people_table(stood: tuple[Path, dict[str, Any]]) -> None:
    folder, _summary = stood
    people, actors = read_table(folder, "people").to_pylist(), read_table(folder, "actors").to_pylist()
    shown = {row["tick"]: row for row in actors if row["actor"] == "anna"}
    ticks = {row["tick"]: row["time_s"] for row in read_table(folder, "ticks").to_pylist()}
    by_time = {round(row["time_s"], 6): row for row in people}
    assert len(shown) > 500
    for tick, body in shown.items():
        if tick not in ticks:
            continue  # the snapshot after the last tick
        person = by_time[round(ticks[tick], 6)]
        assert (body["x_m"], body["y_m"]) == (person["x_m"], person["y_m"])
        assert body["length_m"] == body["width_m"] == pytest.approx(math.hypot(0.6, 0.5) + 2.0 * person["radius_m"])
        assert math.hypot(body["speed_mps"], body["lateral_speed_mps"]) == pytest.approx(person["speed_mps"])


def test_the_area_holds_the_true_place(stood: tuple[Path, dict[str, Any]]) -> None:
    """The person stands on the path at AT; 95 % of the circles are to hold that place."""
    folder, _summary = stood
    people = [row for row in read_table(folder, "people").to_pylist() if row["presence"] == "area"]
    at = altered(changes()).path.at(AT)
    off = np.hypot([row["x_m"] - at.x for row in people], [row["y_m"] - at.y for row in people])
    assert np.mean(off <= np.array([row["radius_m"] for row in people])) > 0.9


@pytest.mark.thorough
def test_before_somebody_is_seen_nothing_drives(tmp_path: Path) -> None:
    """A phone that comes every ten seconds, and its first position late: until then the car does not get ready."""
    walk = walk_file(tmp_path, (0.0, 0.0, 0.0))
    person = anna(walk, simulated={"walk": walk, "period_s": 10.0}, limits={"warning_age_s": 20.0, "lost_age_s": 30.0})
    person["limits"] |= {"warning_m": 300.0, "lost_m": 500.0}
    folder = tmp_path / "record"
    isolated(drive_once, changes(person, duration_s=14.0, seed=1), str(folder))
    first = read_table(folder, "people_reports")["received_s"].to_pylist()[0]
    ticks = read_table(folder, "ticks")
    engaged = [
        t for t, s in zip(ticks["time_s"].to_pylist(), ticks["state"].to_pylist(), strict=True) if s == "engaged"
    ]
    assert 1.0 < first < engaged[0]
    waits = [
        f for t, f in zip(ticks["time_s"].to_pylist(), ticks["faults"].to_pylist(), strict=True) if 0.1 < t < first
    ]
    assert set(waits) == {"person_absent"}


@pytest.mark.thorough
def test_somebody_who_is_lost_stops_the_car(tmp_path: Path) -> None:
    """A phone that is so bad that its circle is beyond the limit after a while: positions every five seconds."""
    walk = walk_file(tmp_path, (0.0, -100.0, 0.0))
    person = anna(walk, simulated={"walk": walk, "period_s": 7.0, "accuracy_m": 3.0})
    person["limits"] = {"warning_m": 90.0, "lost_m": 100.0, "warning_age_s": 4.0, "lost_age_s": 5.0}
    folder = tmp_path / "record"
    summary = isolated(drive_once, changes(person, duration_s=60.0), str(folder))
    assert (summary["outcome"], summary["reasons"][0]) == ("fault", "person_lost")
    rows = read_table(folder, "people").to_pylist()
    lost = next(row for row in rows if "person_lost" in row["faults"])
    assert lost["age_s"] == pytest.approx(5.0, abs=0.03)


@pytest.mark.thorough
def test_the_same_drive_twice_is_the_same_to_the_byte_and_another_seed_is_not(
    stood: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    folder, summary = stood
    walk = json.loads((folder / "scenario.json").read_text())["settings"]["people"][0]["simulated"]["walk"]
    again = isolated(drive_once, changes(anna(walk)), str(tmp_path / "again"))
    other = isolated(drive_once, changes(anna(walk), seed=4), str(tmp_path / "other"))
    assert again["record_sha256"] == summary["record_sha256"]
    parts = [one["record_parts_sha256"]["people_reports"] for one in (summary, again, other)]
    assert parts[0] == parts[1] != parts[2]


@pytest.mark.thorough
def test_a_record_comes_out_again(stood: tuple[Path, dict[str, Any]]) -> None:
    folder, _summary = stood
    inspected = review.inspect(folder, REPOSITORY)
    assert inspected.altered == []
    assert review.replay(inspected, REPOSITORY).differences == []


def test_a_report_that_is_changed_is_found_by_its_hash_and_by_the_replay(
    stood: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    folder = tmp_path / "record"
    shutil.copytree(stood[0], folder)
    table = pq.read_table(folder / "people_reports.parquet")
    rows = table.to_pylist()
    report = decode(rows[10]["datagram"])
    assert isinstance(report, PositionReport)
    rows[10]["received_s"] += 30.0
    pq.write_table(type(table).from_pylist(rows, table.schema), folder / "people_reports.parquet")
    assert altered_parts(folder) == ["people_reports"]
    difference = replay_people(folder)
    assert difference is not None
    assert difference.item.startswith("person anna: ")


def test_the_record_of_a_killed_drive_comes_out_again_too(stood: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    folder = tmp_path / "record"
    shutil.copytree(stood[0], folder)
    cut_off(folder)
    assert replay_people(folder) is None


def test_a_drive_without_people_has_no_tables_of_theirs(
    tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    folder = recorded(tmp_path_factory, {"road.demand": [], "duration_s": 4.0}, tmp_path / "record")
    assert not list(folder.glob("people*"))
    assert "people" not in (folder / "scenario.json").read_text(encoding="utf-8")


def test_reports_are_old_when_they_come_and_say_when_they_were_measured(stood: tuple[Path, dict[str, Any]]) -> None:
    rows = read_table(stood[0], "people_reports").to_pylist()
    ages = [row["received_s"] - report.measured for row in rows if (report := decode(row["datagram"]))]
    assert 0.0 < min(ages) <= max(ages) <= MAX_DELAY


# Rigs.


def rig(**person: Any) -> Any:
    table = simulated() | {"people": [{"id": "anna", "source": "simulated"} | FIELD | person]}
    return parse_rig(table, SIMULATED)


def test_a_rig_says_where_the_field_is_and_where_the_car_may_be(tmp_path: Path) -> None:
    walk = walk_file(tmp_path, (0.0, 0.0, 0.0))
    resolved = altered(changes(anna(walk)))
    alone, ruled = resolved.people[0], resolved.with_rig(rig(), REPOSITORY).people[0]
    assert (alone.fence, alone.least_distance) == ((), 0.0)
    assert ruled.least_distance == 50.0
    assert np.array(ruled.fence) == pytest.approx(lot_by_hand(), abs=1.0)
    assert replace(ruled, fence=(), least_distance=0.0, latitude=0.0, longitude=0.0, heading=0.0, alignment=None) == (
        replace(alone, latitude=0.0, longitude=0.0, heading=0.0, alignment=None)
    )


def lot_by_hand() -> Any:
    """The rig's lot about the anchor [m]: at 40 degrees a degree of latitude has 111,035 m, of longitude 85,394 m."""
    lot = tomllib.loads(SIMULATED.read_text(encoding="utf-8"))["lot"]["outline"]
    return np.array([((lon + 83.019) * 85_394.0, (lat - 40.0065) * 111_035.0) for lat, lon in lot])


def test_only_a_live_drive_asks_for_a_page(tmp_path: Path) -> None:
    resolved = altered(changes(anna(walk_file(tmp_path, (0.0, 0.0, 0.0)))))
    assert not resolved.with_rig(rig(source="phone"), REPOSITORY).people[0].pages
    assert resolved.with_rig(rig(source="phone"), REPOSITORY, live=True).people[0].pages
    assert not resolved.with_rig(rig(), REPOSITORY, live=True).people[0].pages


@pytest.mark.thorough
def test_walking_to_the_lot_of_a_rig_stops_the_car_in_lockstep_too(tmp_path: Path) -> None:
    """The anchor's heading is east, so they walk south, where the lot is; 50 m are to be kept."""
    walk = walk_file(tmp_path, (8.0, 0.0, 0.0), (60.0, 0.0, -104.0))
    folder = tmp_path / "record"
    summary = isolated(_with_rig, changes(anna(walk, offset_m=100.0)), str(folder))
    assert (summary["outcome"], summary["reasons"][0]) == ("fault", "person_near_lot")
    rows = read_table(folder, "people").to_pylist()
    stopped = next(row for row in rows if "person_near_lot" in row["faults"])
    true_place = shapely.Point(0.0, -2.0 * (stopped["time_s"] - 8.0))
    true_distance = shapely.distance(shapely.Polygon(lot_by_hand()), true_place)
    # The circle and the phone's error, 4 m each, and what is added and walked while a position gets 1.5 s old.
    assert 50.0 - 4.0 < true_distance < 50.0 + 4.0 + 4.0 + 1.5 * (3.0 + 2.0)


def _with_rig(altered_keys: dict[str, Any], folder: str) -> dict[str, Any]:
    from vve_sumo.drive import run as drives

    resolved = altered(altered_keys).with_rig(rig(), REPOSITORY)
    return drives.run(resolved, Path(folder), REPOSITORY).summary


# What is refused.


def message(function: Callable[[], object]) -> str:
    with pytest.raises(ConfigError) as caught:
        function()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,forward_m\n0,0\n", "no column left_m"),
        ("time_s,forward_m,left_m\n", "expected at least one row"),
        ("time_s,forward_m,left_m\n0,0,nan\n", "line 2: expected finite numbers"),
        ("time_s,forward_m,left_m\n0,0,0\n0,1,0\n", "line 3: expected a time after 0 s, got 0"),
        ("time_s,forward_m,left_m\n0,0,0\n1,9,0\n", "line 3: 9.0 m/s since the row before, expected at most 3 m/s"),
    ],
)
def test_walks_that_are_none(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "walk.csv"
    file.write_text(text, encoding="utf-8")
    assert words in message(lambda: read_walk(file, 3.0))


def test_people_who_cannot_be_there(tmp_path: Path) -> None:
    walk = walk_file(tmp_path, (0.0, 0.0, 0.0))
    nobody = {name: value for name, value in anna(walk).items() if name != "simulated"}
    assert "people.anna: at_m 99999 lies beyond" in message(lambda: altered(changes(anna(walk, at_m=99999.0))))
    assert "id 'anna' stands twice" in message(lambda: altered(changes(anna(walk), anna(walk))))
    assert "'people.anna.simulated' is missing" in message(lambda: Lockstep(altered(changes(nobody)), REPOSITORY))
    resolved = altered(changes(anna(walk)))
    other = parse_rig(simulated(), SIMULATED)
    assert "people: the rig has no table [[people]] with the id 'anna'" in message(
        lambda: resolved.with_rig(other, REPOSITORY)
    )
    live = altered(changes(nobody))
    assert "the scenario says no walk" in message(lambda: live.with_rig(rig(), REPOSITORY, live=True))


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"exact_m": 12.0}, "expected exact_m below warning_m below lost_m"),
        ({"lost_age_s": 3.0}, "expected warning_age_s below lost_age_s"),
        ({"lost_m": float("nan")}, "people.0.limits.lost_m"),
    ],
)
def test_limits_that_contradict(tmp_path: Path, limits: dict[str, float], words: str) -> None:
    walk = walk_file(tmp_path, (0.0, 0.0, 0.0))
    assert words in message(lambda: altered(changes(anna(walk, limits=limits))))


@pytest.mark.parametrize(
    ("person", "words"),
    [
        ({"latitude_deg": 40.0058}, "expected at least least_distance_m, 50 m"),
        ({"latitude_deg": 40.0045}, "the field's anchor is 0.0 m from the lot's outline"),
        ({"least_distance_m": 5.0}, "people.0.least_distance_m"),
        ({"source": "phone", "port": 4000}, "port says nothing for source 'phone'"),
        ({"source": "nmea_udp"}, "port is missing"),
        ({"source": "nmea_udp", "port": 4000, "address": "192.168.1.5"}, "sender is missing"),
        ({"source": "carrier_pigeon"}, "people.0.source"),
    ],
)
def test_fields_that_are_refused(person: dict[str, Any], words: str) -> None:
    assert words in message(lambda: rig(**person))


def test_a_page_over_a_network_without_https_is_refused() -> None:
    table = simulated() | {"people_page": {"address": "192.168.1.5"}}
    assert "certificate_file is missing" in message(lambda: parse_rig(table, SIMULATED))


def test_nobody_simulated_walks_beside_a_real_car() -> None:
    from tests.rig.test_load import EXAMPLE, real

    table = real() | {"people": [{"id": "anna", "source": "simulated"} | FIELD]}
    assert "nobody simulated walks beside a real car" in message(lambda: parse_rig(table, EXAMPLE))


EXAMPLE_SCENARIO = REPOSITORY / "examples" / "people" / "person_crossing.toml"


def _example(folder: str) -> dict[str, Any]:
    from vve_sumo.drive import run as drives

    resolved = drives.resolve_by_name(str(EXAMPLE_SCENARIO), REPOSITORY)
    return drives.run(resolved, Path(folder), REPOSITORY).summary


@pytest.mark.thorough
def test_the_example_lets_the_person_cross_and_drives_on(tmp_path: Path) -> None:
    summary = isolated(_example, str(tmp_path / "record"))
    assert summary["failed"] == []
    speeds = read_table(tmp_path / "record", "ticks")["speed_mps"].to_pylist()
    moved = next(number for number, speed in enumerate(speeds) if speed > 5.0)
    waited = next(number for number, speed in enumerate(speeds) if number > moved and speed < 3.0)
    assert max(speeds[waited:]) > 5.0, "it has slowed down for the person, and gone on"
