"""What new hashes do not hide: a summary that its tables contradict, a hash that is not there, another controller."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.drive.forge import change_json, cut_off, seal_again
from tests.drive.street import REPOSITORY, recorded
from vve_sumo import cli
from vve_sumo.analysis.comparison import compare
from vve_sumo.analysis.run import Run
from vve_sumo.drive.verify import alterations, altered_parts
from vve_sumo.record.hashes import hash_parts

DRIVES: dict[str, dict[str, Any]] = {
    "contact": {
        "obstacles": [{"id": "parked_car", "at_m": 90.0}],
        "radar.range_limit_m": 10.0,
        "controller.tuning": {"emergency": False},
    },
    "stopped": {"obstacles": [{"id": "parked_car", "at_m": 90.0}]},
    "timeout": {"duration_s": 3.0},
    "completed": {
        "obstacles": [{"id": "parked_car", "at_m": 90.0}],
        "radar.range_limit_m": 10.0,
        "controller.tuning": {"emergency": False},
        "end_trigger": {"ego_at_m": 60.0},
    },
}


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Records by the outcome of their drives."""
    folder = tmp_path_factory.mktemp("records")
    records = {name: recorded(tmp_path_factory, changes, folder / name) for name, changes in DRIVES.items()}
    for name, record in records.items():
        assert json.loads((record / "summary.json").read_text(encoding="utf-8"))["outcome"] == name
    return records


@pytest.mark.thorough
@pytest.mark.parametrize("name", DRIVES)
def test_what_a_drive_left_is_whole(records: dict[str, Path], name: str, tmp_path: Path) -> None:
    assert alterations(records[name]) == []
    folder = Path(shutil.copytree(records[name], tmp_path / "r"))
    seal_again(folder)
    assert alterations(folder) == [], "to write the same hashes again is no alteration"


@pytest.mark.thorough(witnesses=8)
@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize("outcome", [*DRIVES, "arrived", "fault", "interrupted", "broken", "played", "nonsense"])
def test_an_outcome_that_the_rows_do_not_show(
    records: dict[str, Path], name: str, outcome: str, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(records[name], tmp_path / "r"))
    seal_again(folder, outcome=outcome)
    assert altered_parts(folder) == ([] if outcome == name else ["summary.json"])


CHANGES: dict[str, Any] = {
    "reasons": ["driver_override"],
    "collision": False,
    "emergency_used": True,
    "stop_gap_m": 4.5,
    "min_ttc_s": 3.0,
    "max_speed_mps": 5.0,
    "impact_speed_mps": 0.0,
    "passed": True,
    "failed": [],
    "ticks": 1000,
    "duration_s": 1000.0,
    "scenario": "another",
    "title": "Another",
    "seed": 77,
    "controller": "another",
    "versions": {"vve-sumo": "9"},
}


@pytest.mark.thorough
@pytest.mark.parametrize("key", CHANGES)
def test_a_figure_that_the_rows_do_not_come_to(
    records: dict[str, Path], key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(records["contact"], tmp_path / "r"))
    seal_again(folder, **{key: CHANGES[key]})
    found = alterations(folder)
    # What a drive failed for names its reasons: with those, it no longer comes to it either.
    assert len(found) == (2 if key == "reasons" else 1)
    assert all(each.part == "summary.json" for each in found)
    (about,) = (each for each in found if each.why.startswith(key))
    assert cli.main(["replay", str(folder)]) == 1
    assert str(about) in capsys.readouterr().out


def test_a_figure_that_is_gone_is_found(records: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(records["contact"], tmp_path / "r"))
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    del summary["collision"]
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    seal_again(folder)
    assert altered_parts(folder) == ["summary.json"]


PARTS = ("scenario.json", "pose.bin", "can.log", "ticks", "readings", "actors", "sensor_radar")


@pytest.mark.parametrize("part", PARTS)
def test_a_part_without_a_hash_is_named(records: dict[str, Path], part: str, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(records["timeout"], tmp_path / "r"))
    parts = hash_parts(folder)
    seal_again(folder, record_parts_sha256={name: digest for name, digest in parts.items() if name != part})
    assert part in (altered_parts(folder) or [])


def test_all_hashes_gone_is_no_drive_that_was_cut_off(records: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(records["timeout"], tmp_path / "r"))
    seal_again(folder, record_parts_sha256={}, record_files_sha256={})
    assert set(PARTS) | {"provenance.json"} <= set(altered_parts(folder) or [])
    (folder / "summary.json").unlink()
    assert altered_parts(folder) == ["summary.json"]


def test_a_provenance_that_is_gone_is_named(records: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(records["timeout"], tmp_path / "r"))
    (folder / "provenance.json").unlink()
    seal_again(folder)
    assert altered_parts(folder) == ["provenance.json"]


def test_another_version_does_not_judge_the_figures(records: dict[str, Path], tmp_path: Path) -> None:
    """It may reckon them otherwise; that it is another one is told."""
    folder = Path(shutil.copytree(records["timeout"], tmp_path / "r"))
    change_json(folder / "provenance.json", "code", "sha256", value="0" * 64)
    seal_again(folder, max_speed_mps=1.0)
    assert alterations(folder) == []


EVIL = """
from pathlib import Path

Path(__file__).with_name("ran").touch()


def make(vehicle, tuning):
    raise SystemExit
"""


@pytest.mark.parametrize("kind", ["sealed again", "cut off"])
def test_another_controller_in_the_record_is_not_run(
    records: dict[str, Path], kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(records["timeout"], tmp_path / "r"))
    (tmp_path / "evil.py").write_text(EVIL, encoding="utf-8")
    change_json(folder / "scenario.json", "settings", "controller", "name", value=f"{tmp_path / 'evil.py'}:make")
    if kind == "cut off":
        cut_off(folder)
    else:
        seal_again(folder, controller=f"{tmp_path / 'evil.py'}:make")
    assert cli.main(["replay", str(folder)]) == 1
    assert "there is no hash of its code" in capsys.readouterr().out
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("command", ["replay", "redrive", "report"])
def test_a_record_of_another_layout_is_refused_by_name(
    records: dict[str, Path], command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(records["timeout"], tmp_path / "r"))
    change_json(folder / "scenario.json", "layout", value=2)
    more = ("--controller", "follow_and_stop") if command == "redrive" else ()
    assert cli.main([command, str(folder), *more]) == 2
    said = capsys.readouterr().err
    assert "layout 2 of a record, expected 7 or 8 or 9 or 10: another vve-sumo wrote it" in said
    assert said.count("\n") == 1


def test_a_redrive_says_what_was_altered(
    records: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(records["timeout"], tmp_path / "r"))
    change_json(folder / "summary.json", "outcome", value="stopped")
    assert (
        cli.main(["redrive", str(folder), "--controller", str(REPOSITORY / "controllers/follow_and_stop.py:make")]) == 0
    )
    assert "summary.json is not as the drive left it" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_comparison_notes_what_was_altered(
    records: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Hashes are compared for whoever compares; the command also notes a summary that contradicts its tables."""
    resealed, damaged = (Path(shutil.copytree(records["stopped"], tmp_path / name)) for name in ("resealed", "damaged"))
    seal_again(resealed, outcome="arrived")
    with (damaged / "can.log").open("a") as log:
        log.write("\n")
    as_left = f"{damaged}: changed since the drive: can.log"
    assert [note for note in compare(Run(resealed), Run(damaged)).notes if "changed" in note] == [as_left]
    assert cli.main(["compare", str(resealed), str(damaged)]) == 0
    said = "".join(capsys.readouterr().out.split())
    for note in (as_left, f"{resealed}: changed since the drive: summary.json"):
        assert "".join(note.split()) in said
