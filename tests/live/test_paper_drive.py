"""The paper's drive live: the whole stack in real time with 200 vehicles on the streets of Linden."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import tomlkit

from benchmarks.tick import demand
from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from tests.live.command_line import own_rig, vve_sumo
from tests.live.witness import stalls, witness
from vve_sumo.analysis import Run, latency_breakdown
from vve_sumo.record.reader import read_table

pytestmark = [pytest.mark.live, pytest.mark.alone]

VEHICLES = 200
#: a machine that stands still for longer than the gateway's timer may is no machine for this test; so many may not
TRIES = 3


def scenario(folder: Path, at: float) -> Path:
    """Write the shipped scenario with much more traffic, and the parked car at an s of the path [m]."""
    table: Any = tomlkit.parse((REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8"))
    table["road"]["demand"] = [str(demand(folder, VEHICLES))]
    table["obstacles"][0]["at_m"] = at
    file = folder / "paper.toml"
    file.write_text(tomlkit.dumps(table), encoding="utf-8")
    return file


@pytest.mark.parametrize(("at", "least"), with_slow([(200.0, 20.0), (639.0, 60.0)], lambda drive: drive[0] == 200.0))
def test_it_stops_as_in_lockstep_and_says_how_late_it_was(tmp_path: Path, at: float, least: float) -> None:
    for number in range(TRIES):
        folder = tmp_path / str(number)
        folder.mkdir()
        record = folder / "record"
        with witness(folder / "witness.txt"):
            done = vve_sumo(
                "drive", str(scenario(folder, at)), "--rig", str(own_rig(folder)), "--out", str(record), cwd=folder
            )
        summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
        if summary["reasons"] != ["timer_gap"] or not stalls(folder / "witness.txt", 0.0, float("inf")):
            break
    assert done.returncode == 0, done.stdout + done.stderr
    assert summary["outcome"] == "stopped"
    assert summary["stop_gap_m"] == pytest.approx(5.0, abs=0.7)
    assert summary["duration_s"] > least
    assert not summary["collision"]
    latency = summary["latency"]
    assert latency["ticks"] == pytest.approx(summary["ticks"], abs=5)
    assert 0.0 < latency["legs_ms"]["total"]["p50"] < latency["legs_ms"]["total"]["p99"] < 40.0
    breakdown = latency_breakdown(Run(record))
    for leg, figures in latency["legs_ms"].items():
        assert {name: breakdown.loc[leg, f"{name}_ms"] for name in figures} == figures
    # The first row counts the ticks that went by while the virtual road was still being loaded: nobody drove yet.
    missed = read_table(record, "latency")["missed"].to_pylist()
    assert sum(missed) == latency["missed"]
    assert sum(missed[1:]) < 0.02 * latency["ticks"]
    assert summary["step_time"]["fits"]
    speeds = read_table(record, "ticks")["speed_mps"].to_pylist()
    assert max(speed for speed in speeds if speed == speed) == pytest.approx(11.176, abs=0.5)
