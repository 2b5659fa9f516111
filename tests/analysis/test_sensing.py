"""Radar statistics of records written by hand: what is seen, missed, measured wrongly, or not there at all."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.analysis.made import BOX, CAR, PERIOD, moving, put, put_scans, write
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.sensing import braked_for_nothing, drop_outs, sensor_statistics

SPEED = 10.0
TICKS = 500
PARKED = 200.0  #: its centre
#: a scan every other tick
SCANS = range(0, TICKS, 2)
MISSED = (*range(260, 268, 2), 300)


def flags(text: str) -> np.ndarray:
    return np.array([letter == "x" for letter in text], bool)


@pytest.mark.parametrize(
    ("detected", "visible", "count", "hidden", "longest"),
    [
        ("..xxx..", "xxxxxxx", 0, 0, 0.0),
        (".x..x.x", ".x..xxx", 2, 1, 0.3),
        ("x.x....x", "xxx..x.x", 2, 0, 0.5),
        ("..x....", "xxxxxxx", 0, 0, 0.0),
        (".......", "xxxxxxx", 0, 0, math.nan),
    ],
)
def test_drop_outs_lie_between_detections(detected: str, visible: str, count: int, hidden: int, longest: float) -> None:
    time = 5.0 + 0.1 * np.arange(len(detected))
    out = drop_outs(flags(detected), flags(visible), time)
    assert (out.number, out.hidden) == (count, hidden)
    assert out.longest == pytest.approx(longest, abs=1e-9, nan_ok=True)


def bumper_gap(tick: int) -> float:
    """From the bumper to the parked car's near face."""
    return PARKED - 2.0 - SPEED * PERIOD * tick - CAR.rear_axle_to_bumper


@pytest.fixture
def record(tmp_path: Path) -> Path:
    """10 m/s towards a parked car, another exactly behind it, one beside the antenna's field; one false alarm."""
    ticks = np.arange(TICKS)
    rows = moving(ticks * PERIOD, SPEED * PERIOD * ticks, np.full(TICKS, SPEED))
    for row in rows:
        row["actors"] = 3
    folder = write(tmp_path / "record", rows)
    places = {"parked": (PARKED, 0.0), "behind": (PARKED + 20.0, 0.0), "aside": (60.0, 150.0)}
    put(folder, "actors", (
        {"tick": tick, "actor": actor, **BOX, "x_m": x, "y_m": y}
        for tick in range(TICKS) for actor, (x, y) in places.items()
    ))  # fmt: skip
    found = [tick for tick in SCANS if bumper_gap(tick) < 150.0 and tick not in MISSED]
    error = {tick: 0.3 + (0.1 if i % 2 else -0.1) for i, tick in enumerate(found)}
    put_scans(folder, SCANS, [
        {"tick": tick, "actor": "parked", "range_m": bumper_gap(tick) + error[tick], "range_rate_mps": -SPEED - 0.2}
        for tick in found
    ] + [{"tick": 400, "actor": "", "range_m": 12.0, "range_rate_mps": 0.0}])  # fmt: skip
    return folder


def test_first_detection_drop_outs_and_errors_are_the_closed_form(record: Path) -> None:
    table = sensor_statistics(Run(record))
    parked = table.loc["parked"]
    first = next(tick for tick in SCANS if bumper_gap(tick) < 150.0)
    found = sum(bumper_gap(tick) < 150.0 for tick in SCANS) - len(MISSED)
    in_range = sum(bumper_gap(tick) + 0.1 <= 174.0 for tick in SCANS)
    assert parked["first_tick"] == first
    assert parked["first_s"] == pytest.approx(first * PERIOD, abs=1e-9)
    assert parked["first_ttc_s"] == pytest.approx(bumper_gap(first) / SPEED, abs=1e-9)
    assert parked["first_range_m"] == pytest.approx(bumper_gap(first) + 0.2, abs=1e-9)
    assert (parked["scans_visible"], parked["scans_detected"]) == (in_range, found)
    assert parked["detected_share"] == pytest.approx(found / in_range)
    assert (parked["dropouts"], parked["dropouts_hidden"]) == (2, 0)
    assert parked["longest_dropout_s"] == pytest.approx(10 * PERIOD, abs=1e-9)
    spread = np.where(np.arange(found) % 2, 0.1, -0.1)
    assert parked["range_error_mean_m"] == pytest.approx(0.3 + spread.mean(), abs=1e-9)
    assert parked["range_error_std_m"] == pytest.approx(spread.std(ddof=1), abs=1e-9)
    assert parked["range_rate_error_mean_mps"] == pytest.approx(-0.2, abs=1e-9)
    assert parked["range_rate_error_std_mps"] == pytest.approx(0.0, abs=1e-9)
    assert table.attrs["units"]["longest_dropout_s"] == "s"


def test_what_is_hidden_or_out_of_the_field_is_no_row_and_a_ghost_is_one(record: Path) -> None:
    table = sensor_statistics(Run(record))
    assert list(table.index) == ["parked", ""]
    assert table["ghosts"].to_dict() == {"parked": 0, "": 1}
    ghost = table.loc[""]
    assert (ghost["scans_visible"], ghost["scans_detected"]) == (0, 1)
    assert math.isnan(ghost["range_error_mean_m"])
    assert math.isnan(ghost["detected_share"])


def test_where_a_killed_drives_actors_end_nobody_is_a_ghost(record: Path) -> None:
    actors = Run(record).actors
    put(record, "actors", actors[actors["tick"] < 300].to_dict("records"))
    table = sensor_statistics(Run(record))
    assert list(table.index) == ["parked"]
    assert table.loc["parked", "ghosts"] == 0
    (record / "summary.json").write_text('{"outcome": "stopped"}', encoding="utf-8")
    assert sensor_statistics(Run(record)).loc["parked", "ghosts"] > 50


def test_a_blinder_radar_has_less_to_see(record: Path) -> None:
    run = Run(record)
    run.resolved["settings"]["radar"]["range_limit_m"] = 120.0
    assert sensor_statistics(run).loc["parked", "scans_visible"] == sum(bumper_gap(t) + 0.1 <= 120.0 for t in SCANS)


def test_a_street_without_anybody_is_an_empty_table(tmp_path: Path) -> None:
    rows = moving(np.arange(5) * PERIOD, np.arange(5.0), np.ones(5))
    folder = write(tmp_path / "record", rows)
    put_scans(folder, range(5))
    run = Run(folder)
    assert sensor_statistics(run).empty
    assert braked_for_nothing(run).empty


def test_braking_with_a_free_way_ahead_is_listed_and_braking_for_somebody_is_not(tmp_path: Path) -> None:
    """Of three equal brakings: one with nothing in any scan, one for a ghost, one for a car in the way."""
    count = 60
    rows = moving(np.arange(count) * PERIOD, np.arange(count) * 0.2, np.full(count, SPEED))
    for tick, row in enumerate(rows):
        row |= {"state": "engaged", "note": "cruise"}
        if tick % 20 in range(10, 15):
            row |= {"acceleration_setpoint_mps2": -3.0 - 0.1 * (tick % 20), "note": "brake"}
    folder = write(tmp_path / "record", rows)
    ghost = {"actor": "ghost", "range_m": 30.0, "range_rate_mps": -10.0}
    put_scans(folder, range(0, 60, 2), [ghost | {"tick": tick} for tick in range(20, 60, 2)])
    put(folder, "actors", [{"tick": t, "actor": "car", **BOX, "x_m": 80.0} for t in range(40, 60)])
    table = braked_for_nothing(Run(folder))
    assert table.to_dict("records") == [
        {
            "begin_s": pytest.approx(30 * PERIOD),
            "duration_s": pytest.approx(5 * PERIOD),
            "hardest_mps2": pytest.approx(-4.4),
            "emergency": False,
            "notes": "brake",
            "detected": "ghost",
        }
    ]
