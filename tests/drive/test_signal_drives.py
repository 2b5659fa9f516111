"""Drives before a signal: stopped for and gone on, replayed, run on purpose and counted, passed at green."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drive.forge import cut_off
from tests.drive.street import REPOSITORY
from tests.drive.test_replay import replayed
from tests.isolated import isolated
from vve_sumo.record.reader import read_table
from vve_sumo.record.signals import read_signals

#: the first signal of the street is red for the ego from 10 to 40 s of the drive; its line is 318.6 m from the begin
RED, WARM_UP = (10.0, 40.0), 20.0
LINE_X = 342.5  #: of the stop line before that signal, map [m], by the network file


def _drive(folder: str, values: dict[str, Any], controller: str | None = None) -> dict[str, Any]:
    from vve_sumo.drive.run import resolve_by_name, run

    changes = {"road.demand": [], "duration_s": 50.0, "road.warm_up_s": WARM_UP} | values
    resolved = resolve_by_name("signal_street", REPOSITORY, controller=controller, values=changes)
    return run(resolved, Path(folder), REPOSITORY).summary


def bumper(folder: Path) -> tuple[Any, Any]:
    """Return the times, and where the true front bumper was due east [m]."""
    from tests.vehicles import FUSION

    ticks = read_table(folder, "ticks")
    return ticks["time_s"].to_numpy(), ticks["true_x_m"].to_numpy() + FUSION.vehicle.rear_axle_to_bumper


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("by", ["v2x", "sight"])
def test_it_stops_at_the_line_goes_on_by_itself_at_green_and_replays(tmp_path: Path, by: str) -> None:
    folder = tmp_path / "drive"
    values = {"sensors": [{"name": "lights", "kind": "signals", "settings": {"by": by}}]}
    summary = isolated(_drive, str(folder), values)
    assert summary["red_lights_run"] == 0
    assert summary["max_deceleration_mps2"] < 3.3
    time, x = bumper(folder)
    waiting = x[(time > RED[1] - 1.0) & (time < RED[1])]
    assert np.ptp(waiting) < 0.01
    assert 0.5 < LINE_X - waiting[0] < 1.5
    assert time[np.flatnonzero(x > LINE_X)[0]] < RED[1] + 5.0
    assert replayed(folder) is None
    # What the sensor was handed is written as it comes: a kill loses no more of it than of the rest.
    cut_off(folder)
    assert replayed(folder) is None
    assert (folder / "signal_plans.arrows").exists()


def test_one_that_heeds_no_signal_runs_it_and_is_counted(tmp_path: Path) -> None:
    """By the record: where the true bumper was when the recorded state of the straight link was red."""
    folder = tmp_path / "drive"
    summary = isolated(_drive, str(folder), {"controller.tuning": {"signals": False}, "duration_s": 40.0})
    assert summary["red_lights_run"] == 1
    assert summary["passed"] is False
    time, x = bumper(folder)
    passed = float(time[np.flatnonzero(x > LINE_X)[0]])
    times, states = read_signals(folder)["signal1"]
    assert states[max(row for row, at in enumerate(times) if at <= passed)][10] == "r"
    ticks = read_table(folder, "ticks")
    row = ticks["red_light"].to_pylist().index("signal1")
    assert float(time[row]) == pytest.approx(passed, abs=0.05)


@pytest.mark.thorough
def test_pass_at_green_does_not_stop(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    summary = isolated(_drive, str(folder), {"duration_s": 45.0}, "pass_at_green")
    time, x = bumper(folder)
    assert summary["red_lights_run"] == 0
    passed = float(time[np.flatnonzero(x > LINE_X)[0]])
    assert RED[1] < passed < RED[1] + 3.0
    speed = read_table(folder, "ticks")["true_speed_mps"].to_numpy()
    assert speed[(time > 20.0) & (time < passed)].min() > 3.0
