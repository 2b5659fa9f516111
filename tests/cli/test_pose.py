"""`vve-sumo pose decode`: a log with the rig whose receiver sent it."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.pose import nmea_sentences
from vve_sumo.cli import pose

RIG = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
NMEA = """[pose]
kind = "nmea_serial"
device = "pty:gnss.pty"
velocity_sigma_mps = 0.05
heading_sigma_deg = 0.2
rate_hz = 10.0
minimum_delay_ms = 30.0

"""


def decoded(folder: Path, rig: str | None) -> list[dict[str, str]]:
    out = folder / "fixes.csv"
    assert pose.run(argparse.Namespace(file=folder / "drive.nmea", csv=out, rig=rig)) == 0
    with out.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_with_its_rig_a_car_could_drive_on_a_log_and_without_it_accuracies_are_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "drive.nmea").write_bytes(b"".join(data for _at, data in nmea_sentences.drive(40)))
    begin, end = RIG.index("[pose]"), RIG.index("[mounting]")
    (tmp_path / "ours.toml").write_text(RIG[:begin] + NMEA + RIG[end:], encoding="utf-8")
    without, with_rig = decoded(tmp_path, None), decoded(tmp_path, str(tmp_path / "ours.toml"))
    assert "a car could drive on 0 of" in capsys.readouterr().out
    assert {(row["velocity_sigma_mps"], row["heading_sigma_deg"]) for row in without} == {("", "")}
    assert {(row["velocity_sigma_mps"], row["heading_sigma_deg"]) for row in with_rig} == {("0.0500", "0.2000")}
    assert [row["latitude_deg"] for row in with_rig] == [row["latitude_deg"] for row in without]
    assert [row["trusted"] for row in with_rig[-10:]] == ["true"] * 10
