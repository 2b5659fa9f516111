"""The paper's drive with all the flaws that a radar may have: it stops where it shall, and for nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drive.street import REPOSITORY, drive_once
from tests.isolated import isolated
from vve_sumo.analysis import load, sensor_statistics
from vve_sumo.analysis.run import Run
from vve_sumo.drive.replay import read_car_frames, read_pipeline_inputs, recorded_scenario, replay
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
from vve_sumo.sensors.radar import NO_ACTOR

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "drive"

RATE, LATENCY = 0.1, 0.09


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """Return the summary and the record of the paper's drive with false alarms and errors that hold on."""
    folder = tmp_path_factory.mktemp("flaws") / "record"
    changes = {"radar.false_alarms": RATE, "radar.noise_correlation": 0.45}
    return isolated(drive_once, changes, str(folder)), folder


@pytest.fixture(scope="module")
def run(drive: tuple[dict[str, Any], Path]) -> Run:
    return load(drive[1])


@pytest.mark.thorough
def test_it_brakes_for_the_parked_car_alone(drive: tuple[dict[str, Any], Path]) -> None:
    summary, _folder = drive
    assert summary["passed"] is True
    assert summary["outcome"] == "stopped"
    assert summary["stop_gap_m"] == pytest.approx(5.0, abs=0.7)
    assert summary["emergency_used"] is False


def test_false_alarms_are_recorded_as_nobody(run: Run) -> None:
    """At the declared rate: within five standard deviations of a Poisson count."""
    scans = run.arrow("readings").num_rows
    names = run.detections["actor"].tolist()
    assert scans > 1000
    assert names.count(NO_ACTOR) == pytest.approx(RATE * scans, abs=5.0 * (RATE * scans) ** 0.5)
    assert sensor_statistics(run).loc[NO_ACTOR, "ghosts"] == names.count(NO_ACTOR)


def test_every_scan_came_out_at_the_first_tick_after_its_latency(run: Run) -> None:
    scans = run.table("readings").join(run.ticks.set_index("tick")["time_s"], on="tick")
    late = (scans["time_s"] - scans["measured_s"]).to_numpy()
    assert late == pytest.approx(0.10, abs=1e-9)
    assert np.all(np.diff(scans["measured_s"].to_numpy()) > 0.03)
    assert set(scans["sensor"]) == {"radar"}


def test_ranges_are_those_of_the_time_at_which_they_were_measured(run: Run) -> None:
    """Against where the car was when they came out, ranges to the parked car would be too long by a metre and more."""
    parked = sensor_statistics(run).loc["parked_car"]
    assert abs(parked["range_error_mean_m"]) < 0.1
    assert parked["ghosts"] == 0


@pytest.mark.thorough
def test_it_is_replayed_bit_for_bit(drive: tuple[dict[str, Any], Path]) -> None:
    _summary, folder = drive
    resolved = recorded_scenario(folder, REPOSITORY)
    assert replay(resolved, read_pipeline_inputs(folder), read_car_frames(folder, DEFAULT_EPOCH), REPOSITORY) is None
