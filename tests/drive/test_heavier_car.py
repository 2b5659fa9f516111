"""A heavier car of one's own, on its own wire and on one that takes too little brake: the emergency layer knows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from tests.isolated import command, isolated
from tests.vehicle.van import DATASPEED, OWN_WIRE, van_file
from vve_sumo.commissioning.findings import CheckResult
from vve_sumo.commissioning.machine_checks import braking
from vve_sumo.drive.run import resolve_by_name

#: the comfortable stop is off: what brakes is the emergency layer alone, with all that the car has
EMERGENCY = {"controller.tuning.comfort": False, "ego.speed_mps": 12.0, "obstacles.parked_car.at_m": 130.0}


def drive(folder: str, vehicle: str) -> tuple[dict[str, Any], str]:
    """Drive up to the parked car; call it through `isolated`."""
    from vve_sumo.drive import run

    resolved = run.resolve_by_name("parked_car", REPOSITORY, seed=1, vehicle=vehicle, values=EMERGENCY)
    return run.run(resolved, Path(folder), REPOSITORY).summary, resolved.note


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("wire", "reached"),
    with_slow([(OWN_WIRE, 5.5), (DATASPEED, 3412.0 / 868.0)], lambda one: one[0] == OWN_WIRE),
    ids=["own", "dataspeed"],
)
def test_it_stops_with_room_to_spare_on_either_wire(wire: str, reached: float, tmp_path: Path) -> None:
    summary, note = isolated(drive, str(tmp_path / "record"), str(van_file(tmp_path, wire)))
    assert (summary["outcome"], summary["collision"]) == ("stopped", False)
    assert summary["emergency_used"]
    assert summary["stop_gap_m"] > 1.0
    assert summary["max_deceleration_mps2"] == pytest.approx(reached, rel=0.08)
    resolved = json.loads((tmp_path / "record" / "scenario.json").read_text(encoding="utf-8"))
    assert resolved["vehicle"]["deceleration_limit"] == pytest.approx(reached)
    assert (resolved.get("braking_note", "")) == note
    assert bool(note) == (wire == DATASPEED)


@pytest.mark.thorough
def test_the_command_says_so_before_it_drives(tmp_path: Path) -> None:
    van_file(tmp_path, DATASPEED)
    done = command("drive", "parked_car", "--vehicle", "van.toml", "--set", "duration_s=1.0", "--quiet", cwd=tmp_path)
    notes = [line for line in done.stderr.splitlines() if line.startswith("note: ")]
    assert len(notes) == 1
    assert "this car brakes with 3.93 m/s2 at most, not with the declared 5.5" in notes[0]


def test_the_doctor_notes_it(tmp_path: Path) -> None:
    resolved = resolve_by_name("parked_car", REPOSITORY, vehicle=str(van_file(tmp_path, DATASPEED)))
    noted = braking(resolved)
    assert (noted.name, noted.finding, noted.observed) == ("braking", CheckResult.NOTE, resolved.note)
    fine = braking(resolve_by_name("parked_car", REPOSITORY, vehicle=str(van_file(tmp_path, OWN_WIRE))))
    assert fine.finding is CheckResult.GO
    assert fine.observed.endswith("laden with 2800 kg 4.52 m/s2"), "5.5 m/s2 times 2300 over 2800"
