"""The five figures at the top, and the numbers behind the curves and points of the page."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.report.made import Folders
from vve_sumo.analysis.over_time import over_time
from vve_sumo.analysis.run import Run
from vve_sumo.report import curves, key_figures, points

DRIVE: dict[str, Any] = {
    "passed": False,
    "collision": True,
    "failed": ["min_gap_m is -0.500 (lead vehicle x), expected at least 1"],
    "impact_speed_mps": 3.0,
    "min_gap_m": -0.5,
    "min_ttc_s": None,
    "max_deceleration_mps2": 4.0,
    "max_speed_mps": 12.0,
    "duration_s": 30.0,
}


def test_a_contact_comes_first_then_what_was_asked_then_what_always_matters() -> None:
    wanted = {"duration_s": {"max": 60.0}, "collision": False, "max_deceleration_mps2": {"max": 5.0}}
    shown = key_figures.of_drive(DRIVE, wanted | {"min_gap_m": {"min": 1.0}})
    assert [(one.label, one.value.replace("\u00a0", " "), one.kind) for one in shown] == [
        ("impact speed", "3.00 m/s", "no"),
        ("maximum deceleration", "4.00 m/s²", "yes"),
        ("minimum gap", "\u22120.50 m", "no"),
        ("maximum speed", "12.00 m/s", ""),
        ("drive time", "30.00 s", "yes"),
    ]
    assert shown[2].note.replace("\u00a0", " ") == "asked: at least 1 m"


def test_a_drive_that_was_not_judged_met_nothing_and_missed_nothing() -> None:
    shown = key_figures.of_drive(DRIVE | {"passed": None, "collision": False}, {"min_gap_m": {"min": 1.0}})
    assert {one.kind for one in shown} == {""}


def test_the_worst_of_a_sweep_names_its_run_and_how_many_have_the_figure() -> None:
    figures: dict[str, Any] = {
        "min_gap_m": [3.0, 1.0, np.nan],
        "min_ttc_s": [np.nan] * 3,
        "max_deceleration_mps2": [2.0, 5.0, 6.0],
    }
    rows = pd.DataFrame(
        {"key": ["a", "b", "c"], "collision": [False, True, None], "impact_speed_mps": [0.0, 7.0, np.nan]}
    )
    rows = rows.assign(**figures)
    shown = key_figures.of_sweep(rows, 1, 2, [])
    assert [one.value.replace("\u00a0", " ") for one in shown] == ["1 of 2", "1 of 2", "3.00 m", "6.00 m/s²"]
    assert shown[1].note.replace("\u00a0", " ") == "at 7.00 m/s at most"
    assert [one.note for one in shown[2:]] == [
        "run a; 1 of 3 runs have one, 1 had a contact instead",
        "run c; 3 of 3 runs have one",
    ]


def test_curves_of_a_long_drive_are_some_of_its_ticks_with_the_extremes(
    folders: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(folders.drive)
    frame = over_time(run)
    monkeypatch.setattr(curves, "MAX_TICKS", (len(frame) - 1) // 3)
    drawn = curves.curves(run)
    time, ticks = np.array(drawn["time"]), frame["time_s"].to_numpy()
    assert len(time) <= curves.MAX_TICKS
    assert (np.diff(time) > 0.0).all()
    (speed,) = (panel["series"][0]["values"] for panel in drawn["panels"] if panel["series"][0]["label"] == "speed")
    at = np.searchsorted(ticks, time - 1e-3)
    assert speed == pytest.approx(frame["speed_mps"].to_numpy()[at], abs=6e-4)
    assert (max(speed), min(speed)) == pytest.approx((frame["speed_mps"].max(), frame["speed_mps"].min()), abs=6e-4)
    assert drawn["leaders"][drawn["leader"][-1]] == "parked_car"


def test_words_among_parameters_are_places_on_an_axis() -> None:
    rows = pd.DataFrame(
        {
            "key": ["a", "b", "c"],
            "seed": [1, 1, 1],
            "passed": [True, False, None],
            "error": ["", "", "timed_out"],
            "outcome": ["stopped", "contact", None],
            "failed": ["", "collision is True, expected False", None],
            "controller.name": ["one", "two", "one"],
            "speed": [5.0, 5.0, 5.0],
            "stop_gap_m": [2.0, np.nan, np.nan],
        }
    )
    drawn = points.points(rows, ["controller.name", "speed"], ["stop_gap_m"])
    assert drawn is not None
    assert [(one["values"], one["names"]) for one in drawn["x"]] == [([0, 1, 0], ["one", "two"])]
    assert drawn["passed"] == [True, False, None]
    assert drawn["text"] == ["stopped", "contact; collision is True, expected False", "error: timed_out"]
    assert drawn["y"][0]["values"] == [2.0, None, None]
    assert points.points(rows, ["speed"], ["stop_gap_m"]) is None
