"""Drives that end before their time: at the first tick at which a stated condition holds, and judged like any other."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from tests.drive.street import altered, drive_once
from tests.isolated import isolated
from vve_sumo.drive.termination import end_reason
from vve_sumo.drive.verify import alterations
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.record.reader import read_table
from vve_sumo.scenario.schema import EndTrigger
from vve_sumo.timing import PERIOD

NAN = math.nan
#: nearly blind, and without its emergency layer: drives into the obstacle
BLIND = {
    "road.demand": [],
    "ego.speed_mps": 8.0,
    "radar.range_limit_m": 8.0,
    "controller.tuning": {"emergency": False},
    "obstacles": [{"id": "parked", "at_m": 90.0}],
    "criteria": {"outcome": "completed", "collision": None},
}


@pytest.mark.parametrize(
    ("wanted", "holds", "does_not"),
    [
        ({"contact": True}, (True, 0.0, 0.0, NAN), (False, 900.0, 9.0, 0.1)),
        ({"ego_at_m": 50.0}, (False, 50.0, 0.0, NAN), (True, 49.9, 9.0, 0.1)),
        ({"lateral_deviation_m": 1.0}, (False, 0.0, -1.1, NAN), (True, 900.0, 1.0, 0.1)),
        ({"ttc_s": 1.5}, (False, 0.0, 0.0, 1.4), (True, 900.0, 9.0, 1.5)),
        ({"ttc_s": 1.5, "ego_at_m": 50.0}, (False, 60.0, 0.0, 3.0), (True, 40.0, 9.0, 3.0)),
        ({"ttc_s": 1.5, "ego_at_m": 50.0, "lateral_deviation_m": 1.0}, (False, 0.0, 2.0, 9.0), (True, NAN, NAN, NAN)),
        ({}, None, (True, 900.0, 9.0, 0.1)),
    ],
)
def test_each_condition_ends_a_drive_by_itself(
    wanted: dict[str, Any], holds: tuple[Any, ...] | None, does_not: tuple[Any, ...]
) -> None:
    assert end_reason(EndTrigger(**wanted), *does_not) == ""
    assert holds is None or end_reason(EndTrigger(**wanted), *holds).startswith("end_")


def ended(folder: str) -> dict[str, dict[str, Any]]:
    wanted = {"contact": {"contact": True}, "ttc": {"ttc_s": 2.0}, "place": {"ego_at_m": 20.0}}
    wanted["beyond"] = {"ego_at_m": 92.0}  # behind the face of the obstacle
    return {name: drive_once(BLIND | {"end_trigger": trigger}, f"{folder}/{name}") for name, trigger in wanted.items()}


@pytest.mark.thorough
def test_a_drive_ends_at_the_first_tick_at_which_it_shall(tmp_path: Path) -> None:
    """The tables say when that was, whatever the drive thought: contact, time to collision, and place."""
    summaries = isolated(ended, str(tmp_path))
    for name, code in (("contact", "end_contact"), ("ttc", "end_ttc"), ("place", "end_ego_at")):
        hit = name == "contact"
        assert summaries[name]["outcome"] == ("contact" if hit else "completed"), summaries[name]
        assert summaries[name]["passed"] is not hit
        assert summaries[name]["reasons"][0] == code
    ticks = read_table(tmp_path / "contact", "ticks")
    assert [row for row, touched in enumerate(ticks["contacts"].to_pylist()) if touched] == [ticks.num_rows - 1]
    # It stands, so what it was hit with is the car's own speed, a prediction of 20 ms aside.
    assert summaries["contact"]["impact_speed_mps"] == pytest.approx(ticks["true_speed_mps"][-1].as_py(), abs=0.15)
    assert summaries["contact"]["impact_speed_mps"] > 1.0

    ticks = read_table(tmp_path / "ttc", "ticks")
    ttc = _ttc(ticks, read_table(tmp_path / "ttc", "actors"))
    assert np.flatnonzero(ttc < 2.0).tolist() == [ticks.num_rows - 1]
    assert summaries["ttc"]["impact_speed_mps"] == 0.0

    assert summaries["beyond"]["reasons"][0] == "end_ego_at"
    assert (summaries["beyond"]["outcome"], summaries["beyond"]["collision"]) == ("contact", True)
    assert summaries["beyond"]["impact_speed_mps"] == summaries["contact"]["impact_speed_mps"]
    assert alterations(tmp_path / "beyond") == []

    car = altered({}).vehicle
    near = read_table(tmp_path / "place", "ticks")["s_m"].to_numpy() + car.rear_axle_to_bumper
    assert near[-2] - 0.1 < 20.0 < near[-1] + 0.1


def _ttc(ticks: pa.Table, actors: pa.Table) -> Any:
    resolved = altered(BLIND)
    return DriveData(ticks, actors, resolved.path, resolved.vehicle, PERIOD).lead.time_to_collision
