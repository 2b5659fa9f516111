"""The command that a report prints drives the scenario again: the same record, whatever was driven otherwise."""

from __future__ import annotations

import json
import os
import shlex
from pathlib import Path
from typing import Any

import pytest

from tests.exhaustive import with_slow
from tests.isolated import REPOSITORY, isolated
from vve_sumo.analysis.run import Run
from vve_sumo.report import again


def driven(folder: str, options: dict[str, Any]) -> str:
    """Drive `parked_car` with options and return the hash of its record."""
    from vve_sumo.drive import run as drives

    resolved = drives.resolve_by_name("parked_car", REPOSITORY, **options)
    return str(drives.run(resolved, Path(folder), REPOSITORY).summary["record_sha256"])


def commanded(words: list[str], folder: str) -> None:
    """Run a printed command, its record going into another folder."""
    from vve_sumo.cli.dispatch import main

    os.chdir(REPOSITORY)
    assert main([*words[1:-1], folder, "--quiet"]) in (0, 1)


OTHERWISE: dict[str, dict[str, Any]] = {
    "as it stands": {},
    "seed and vehicle": {"seed": 7, "vehicle": "lincoln_mkz"},
    "settings": {
        "values": {
            "ego.speed_mps": 9.5,
            "controller.tuning.emergency": False,
            "title": 'my "car" $x ä',
            "obstacles": [{"id": "parked_car", "at_m": 77.5, "offset_m": 0.25}],
            "criteria.stop_gap_m": {"min": 1.0},
        }
    },
    "controller": {"controller": "idm", "values": {"controller.tuning.gap_m": 3.0}},
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", with_slow(OTHERWISE, lambda name: name in ("settings", "controller")))
def test_the_printed_command_makes_the_same_record(name: str, tmp_path: Path) -> None:
    options = OTHERWISE[name]
    options = options | {"values": options.get("values", {}) | {"duration_s": 3.0}}
    digest = isolated(driven, str(tmp_path / "first"), options)
    line = again.command(Run(tmp_path / "first"), REPOSITORY)
    assert line is not None
    words = shlex.split(line)
    assert words[-2:] == ["--out", "again"]
    isolated(commanded, words, str(tmp_path / "second"))
    summary = json.loads((tmp_path / "second" / "summary.json").read_text(encoding="utf-8"))
    assert summary["record_sha256"] == digest


@pytest.mark.thorough
def test_there_is_no_command_where_none_drives_the_same(tmp_path: Path) -> None:
    isolated(driven, str(tmp_path / "record"), {"values": {"duration_s": 1.0}})
    assert again.command(Run(tmp_path / "record"), REPOSITORY) is not None
    assert again.command(Run(tmp_path / "record"), tmp_path / "nowhere") is not None  # shipped
    file = tmp_path / "record" / "scenario.json"
    whole = json.loads(file.read_text(encoding="utf-8"))
    unsaid = whole["settings"]["criteria"] | {"collision": None}  # for which TOML has no word
    for changed in (
        {"scenario": "mine"},
        {"settings": whole["settings"] | {"criteria": unsaid}},
        {"vehicle_model": whole["vehicle_model"] | {"rig": "ours"}},
    ):
        file.write_text(json.dumps(whole | changed), encoding="utf-8")
        assert again.command(Run(tmp_path / "record"), REPOSITORY) is None
