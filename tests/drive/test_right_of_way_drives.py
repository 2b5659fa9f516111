"""Drives at a stop sign: stopped at and gone on from, replayed, run on purpose and counted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drive.forge import cut_off
from tests.drive.street import REPOSITORY
from tests.drive.test_replay import replayed
from tests.isolated import isolated
from tests.vehicles import FUSION
from vve_sumo.record.reader import read_table

#: of the lane before the stop sign: where it ends, map [m], and its name, by the network file
LINE_Y, LANE = 138.9, "stop_south_to_stop_0"
COARSE = {"name": "roof", "kind": "lidar", "settings": {"azimuth_step_deg": 1.0}}
SENSORS = [{"name": "priorities", "kind": "right_of_way"}, COARSE]


def _drive(folder: str, values: dict[str, Any]) -> dict[str, Any]:
    from vve_sumo.drive.run import resolve_by_name, run

    changes = {"road.demand": [], "road.warm_up_s": 1.0, "sensors": SENSORS, "end_trigger.ego_at_m": 110.0} | values
    resolved = resolve_by_name("stop_sign", REPOSITORY, values=changes)
    return run(resolved, Path(folder), REPOSITORY).summary


def motion(folder: Path) -> tuple[Any, Any]:
    """Return where the true front bumper was along the side street, beyond the line [m], and the true speed [m/s]."""
    ticks = read_table(folder, "ticks")
    beyond = ticks["true_y_m"].to_numpy() + FUSION.vehicle.rear_axle_to_bumper - LINE_Y
    return beyond, ticks["true_speed_mps"].to_numpy()


@pytest.mark.thorough
def test_it_stops_before_the_line_goes_on_by_itself_and_replays(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    summary = isolated(_drive, str(folder), {})
    assert summary["stop_signs_run"] == 0
    assert summary["outcome"] == "completed"
    assert summary["max_deceleration_mps2"] < 3.3
    beyond, speed = motion(folder)
    stood = beyond[(speed < 0.01) & (beyond > -20.0)]
    assert -1.5 < stood.min() <= stood.max() < -0.5
    assert len(stood) < 5.0 / 0.02  # nobody comes
    assert replayed(folder) is None
    cut_off(folder)
    assert replayed(folder) is None


def test_one_that_gives_way_to_nobody_runs_the_sign_and_is_counted(tmp_path: Path) -> None:
    """By the record: the true bumper was beyond the line, and the car had not stood before."""
    folder = tmp_path / "drive"
    values = {"sensors": [], "controller.tuning": {"right_of_way": False}}
    summary = isolated(_drive, str(folder), values)
    assert summary["stop_signs_run"] == 1
    assert summary["passed"] is False
    beyond, speed = motion(folder)
    assert speed[(beyond > -5.0) & (beyond < 0.0)].min() > 1.0
    passed = read_table(folder, "ticks")["stop_sign"].to_pylist()
    assert np.flatnonzero([name == LANE for name in passed]) == pytest.approx(np.flatnonzero(beyond > 0.0)[:1], abs=2)
