"""The doctor's last word as a later drive finds it: whose it was, how old it is, and none where there is none."""

from __future__ import annotations

import datetime
from pathlib import Path

import pytest

from tests.live.command_line import own_rig
from vve_sumo.commissioning.doctor_result import file_of, keep, last
from vve_sumo.commissioning.findings import Check, CheckResult

NOW = datetime.datetime(2026, 5, 1, 12, 0, 0, tzinfo=datetime.UTC)
HOUR = datetime.timedelta(hours=1)
CHECKS = [Check("bus", "1 Mbit/s"), Check("fixes", "none", CheckResult.NO_GO, "look at pose.port")]
NONE = {"verdict": "none", "caveats": []}


def test_what_was_kept_is_found_with_its_checks(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    assert last(rig, tmp_path, NOW) == NONE
    keep(rig, CHECKS, "seen_late", tmp_path, NOW)
    reported = last(rig, tmp_path, NOW + HOUR)
    assert (reported["verdict"], reported["caveats"], reported["scenario"]) == ("NO-GO", [], "seen_late")
    assert reported["checks"][1] == {"name": "fixes", "finding": "NO-GO", "found": "none"}
    keep(rig, CHECKS[:1], "seen_late", tmp_path, NOW)
    assert last(rig, tmp_path, NOW)["verdict"] == "GO"
    assert [file.name for file in file_of(rig, tmp_path).parent.iterdir()] == ["mine.json"]


def test_an_old_verdict_and_one_of_another_rig_file_say_so(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    keep(rig, CHECKS, "seen_late", tmp_path, NOW)
    assert last(rig, tmp_path, NOW + 24 * HOUR)["caveats"] == []
    assert last(rig, tmp_path, NOW + 25 * HOUR)["caveats"] == ["older than a day"]
    assert last(rig, tmp_path, NOW - HOUR)["caveats"] == ["from the future: a clock was set"]
    rig.write_text(rig.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert last(rig, tmp_path, NOW)["caveats"] == ["of another version of the rig file"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "7",
        "{}",
        '{"verdict": "GO", "date_utc": 5}',
        '{"verdict": "GO", "date_utc": "2026-05-01T12:00:00"}',
    ],
)
def test_what_is_no_verdict_is_none(tmp_path: Path, text: str) -> None:
    rig = own_rig(tmp_path)
    file_of(rig, tmp_path).parent.mkdir(parents=True)
    file_of(rig, tmp_path).write_text(text, encoding="utf-8")
    assert last(rig, tmp_path, NOW) == NONE
