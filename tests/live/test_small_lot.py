"""A drive in a lot of 150 m x 80 m, live, inside the geofence that is checked at every tick."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.live.command_line import free_port, vve_sumo
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.live.assembly import scenario_with_rig
from vve_sumo.rig.load import load

RIG = REPOSITORY / "rigs" / "small_lot.toml"


@pytest.mark.parametrize(
    ("scenario", "outcome"), [("cut_in", "arrived"), ("pedestrian", "arrived"), ("lead_braking", "stopped")]
)
def test_a_drive_that_no_end_trigger_ends_shall_arrive(scenario: str, outcome: str) -> None:
    resolved = resolve_by_name(f"small_lot_{scenario}", REPOSITORY)
    live = scenario_with_rig(resolved, load(RIG, REPOSITORY), REPOSITORY)
    assert live.scenario.criteria.outcome == outcome
    assert live.scenario.criteria.collision == resolved.scenario.criteria.collision


@pytest.mark.thorough
@pytest.mark.live
@pytest.mark.parametrize("scenario", ["cut_in", "lead_braking", "pedestrian"])
def test_the_other_meetings_live(tmp_path: Path, scenario: str) -> None:
    rig, record = tmp_path / "yard.toml", tmp_path / "record"
    text = RIG.read_text(encoding="utf-8")
    rig.write_text(text.replace("port = 3000", f"port = {free_port()}"), encoding="utf-8")
    done = vve_sumo("drive", f"small_lot_{scenario}", "--rig", str(rig), "--out", str(record), cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    assert summary["passed"]
    assert summary["reasons"] == []


@pytest.mark.thorough
@pytest.mark.live
def test_the_meeting_with_the_parked_car_live(tmp_path: Path) -> None:
    text = RIG.read_text(encoding="utf-8")
    rig, record = tmp_path / "yard.toml", tmp_path / "record"
    rig.write_text(text.replace("port = 3000", f"port = {free_port()}"), encoding="utf-8")
    done = vve_sumo("drive", "small_lot_parked_car", "--rig", str(rig), "--out", str(record), cwd=tmp_path)
    assert (record / "summary.json").exists(), done.stdout + done.stderr
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    assert summary["reasons"] == []
    assert summary["outcome"] == "stopped"
    assert summary["max_speed_mps"] == pytest.approx(8.333, abs=0.5)
    assert summary["stop_gap_m"] == pytest.approx(5.0, abs=0.7)
