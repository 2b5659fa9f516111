"""Drives with a sensor of an invented make: it stops the car, stands in the record, replays and fails."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from shapely import affinity
from shapely.geometry import box

from tests.drive.forge import change_json, seal_again
from tests.drive.street import drive_once
from tests.isolated import isolated
from tests.ports.toy_sensors import AHEAD, TOY
from vve_sumo import cli
from vve_sumo.analysis.load import load as load_record

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "stopped"

GAP = 6.0


def stop_for_the_range(folder: str, changes: dict[str, Any]) -> dict[str, Any]:
    """Drive the paper's scenario with the toy's controller and sensor; call it through `isolated`."""
    controller = {"name": f"{TOY / 'range_stop.py'}:make", "tuning": {"gap_m": GAP}}
    return drive_once({"sensors": [AHEAD], "controller": controller, "criteria": {}} | changes, folder)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("range") / "record"
    summary = isolated(stop_for_the_range, str(folder), {})
    assert summary["outcome"] == "stopped"
    assert not summary["collision"]
    return folder


@pytest.mark.thorough
def test_a_controller_stops_the_car_for_somebody_s_own_sensor(stopped: Path) -> None:
    """The gap at rest by shapely, from the recorded boxes, is the one asked for: to its noise and the crawl's end."""
    last = pq.read_table(stopped / "ticks.parquet").to_pylist()[-1]
    rows = pq.read_table(stopped / "actors.parquet").to_pylist()
    parked = next(row for row in rows if row["actor"] == "parked_car" and row["tick"] == last["tick"])
    body = box(-0.5 * parked["length_m"], -0.5 * parked["width_m"], 0.5 * parked["length_m"], 0.5 * parked["width_m"])
    body = affinity.rotate(body, parked["heading_rad"], (0, 0), use_radians=True)
    vehicle = json.loads((stopped / "scenario.json").read_text(encoding="utf-8"))["vehicle"]
    front = vehicle["wheelbase"] + vehicle["front_overhang"]
    ego = box(front - vehicle["length"], -0.5 * vehicle["width"], front, 0.5 * vehicle["width"])
    ego = affinity.rotate(ego, last["true_heading_rad"], (0, 0), use_radians=True)
    gap = affinity.translate(ego, last["true_x_m"], last["true_y_m"]).distance(
        affinity.translate(body, parked["x_m"], parked["y_m"])
    )
    assert last["true_speed_mps"] == pytest.approx(0.0, abs=1e-6)
    assert gap == pytest.approx(GAP, abs=1.0)


def test_what_it_measured_stands_in_a_table_of_its_own(stopped: Path) -> None:
    run = load_record(stopped)
    ranges = run.sensor("ahead")  # type: ignore[union-attr]
    readings = run.table("readings")  # type: ignore[union-attr]
    assert set(readings["sensor"]) == {"radar", "ahead"}
    assert ranges.attrs["units"]["range_m"] == "m"
    own = readings[readings["sensor"] == "ahead"]
    assert np.diff(own["tick"]).tolist() == [2] * (len(own) - 1)
    assert own["rows"].sum() == len(ranges) > 100
    assert (own.set_index("tick")["measured_s"] == 0.02 * own.set_index("tick").index).all()


def test_the_hash_of_its_code_is_in_the_record(stopped: Path) -> None:
    files = json.loads((stopped / "scenario.json").read_text(encoding="utf-8"))["files_sha256"]
    assert {"sensor_ahead:range_finder", "controller_range_stop"} <= files.keys()
    # Both parts lie in one folder, and neither's code counts as the other's.
    assert [role for role in files if role.startswith(("sensor_", "controller_"))] == [
        "controller_range_stop", "sensor_ahead:range_finder"
    ]  # fmt: skip


@pytest.mark.thorough
def test_it_replays_bit_for_bit_and_a_changed_range_is_found(
    stopped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["replay", str(stopped)]) == 0
    assert "every setpoint and every frame is the same" in capsys.readouterr().out
    copy = Path(shutil.copytree(stopped, tmp_path / "copy"))
    table = pq.read_table(copy / "sensor_ahead.parquet").to_pandas()
    at = len(table) // 2
    table.loc[at, "range_m"] += 1e-12 * table.loc[at, "range_m"] + 1e-9
    schema = pq.read_schema(copy / "sensor_ahead.parquet")
    pq.write_table(pa.Table.from_pandas(table, schema, preserve_index=False), copy / "sensor_ahead.parquet")
    assert cli.main(["replay", str(copy)]) == 1
    assert "sensor_ahead is not as the drive left it" in capsys.readouterr().out
    seal_again(copy)
    assert cli.main(["replay", str(copy)]) == 1
    said = capsys.readouterr().out
    assert said.startswith(f"tick {table.loc[at, 'tick']} ")
    assert "differs in sensor ahead: row 0" in said


@pytest.mark.thorough
def test_one_whose_code_has_changed_is_not_run(
    stopped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = Path(shutil.copytree(stopped, tmp_path / "copy"))
    change_json(copy / "scenario.json", "files_sha256", "sensor_ahead:range_finder", value="0" * 64)
    seal_again(copy)
    assert cli.main(["replay", str(copy)]) == 1
    assert capsys.readouterr().out == "sensor_ahead:range_finder has changed since\nnot replayed\n"
    assert cli.main(["redrive", str(copy), "--controller", "follow_and_stop"]) == 2
    assert "sensor_ahead:range_finder has changed since: not run" in capsys.readouterr().err


SHORT = {"duration_s": 12.0, "obstacles.0.at_m": 60.0, "criteria": {}}


@pytest.mark.thorough
def test_another_sensor_changes_neither_the_radar_nor_the_car(tmp_path: Path) -> None:
    other = AHEAD | {"name": "second", "kind": "radar", "settings": {"false_alarms": 3.0}}
    hashes = []
    for name, sensors in (("plain", []), ("more", [AHEAD, other])):
        isolated(drive_once, SHORT | {"sensors": sensors}, str(tmp_path / name))
        summary = json.loads((tmp_path / name / "summary.json").read_text(encoding="utf-8"))
        hashes.append(summary["record_parts_sha256"])
    plain, more = hashes
    assert {"sensor_ahead", "sensor_second"} == more.keys() - plain.keys()
    assert {part for part in plain if plain[part] != more[part]} == {"scenario.json", "readings", "ticks"}
    radars = [pq.read_table(tmp_path / "more" / f"sensor_{name}.parquet").num_rows for name in ("radar", "second")]
    assert radars[1] > radars[0] > 0


BROKEN = """
from vve_sumo.sensors.port import SensorColumn, SensorSettings
from dataclasses import dataclass, replace
import math


@dataclass(frozen=True)
class Out:
    time: float
    number: float = 0.0

    def columns(self):
        return ([self.number],)


class Settings(SensorSettings):
    columns = (SensorColumn("a_m", "float", "a"),)
    observation = Out

    def max_age(self):
        return 0.1

    def sensor(self, vehicle, generator, /):
        return Sensor()


class Sensor:
    output, refused = Out(-math.inf), 0

    def step(self, time, pose, actors):
        if time > 6.0:
            FAILURE
        self.output = Out(time, 1.0)
        return self.output


def make():
    return Settings
"""
WAYS = {
    "sensor_raised": "raise RuntimeError('burnt out')",
    "sensor_not_finite": "self.output = Out(time, math.nan); return self.output",
    "sensor_late": "return None",
    "sensor_wrong_type": "return Out(time, 'far')",
}


@pytest.mark.thorough
@pytest.mark.parametrize("code", WAYS)
def test_a_sensor_that_fails_stops_the_car(code: str, tmp_path: Path) -> None:
    file = tmp_path / "broken.py"
    file.write_text(BROKEN.replace("FAILURE", WAYS[code]), encoding="utf-8")
    sensors = [{"name": "mine", "kind": f"{file}:make"}]
    summary = isolated(drive_once, {"sensors": sensors, "criteria": {}}, str(tmp_path / "record"))
    assert summary["outcome"] == "fault"
    assert code in summary["reasons"]
    assert summary["text"].startswith("sensor mine: ")
    assert not summary["collision"]
