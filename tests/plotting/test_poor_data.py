"""Rows and records with little or nothing in them make plots that say so."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from tests.analysis.made import BOX, CAR, put, write
from tests.plotting.runs_and_sweeps import STILL, rows_of
from vve_sumo import plotting
from vve_sumo.analysis.run import Run


def just_draw(figure: Figure) -> None:
    """Draw it without arranging it, which takes most of the time."""
    figure.set_layout_engine("none")
    figure.canvas.draw()


def nobody() -> pd.DataFrame:
    frame = rows_of(3)
    frame[[name for name in frame if name.startswith("stop_")]] = np.nan
    return frame


ROWS: dict[str, Callable[[], pd.DataFrame]] = {
    "none": lambda: rows_of(20).iloc[:0],
    "one": lambda: rows_of(1),
    "one with an error": lambda: rows_of(4).iloc[3:],
    "without a figure": nobody,
    "alike": lambda: pd.concat([rows_of(1)] * 5, ignore_index=True),
}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("poor", ROWS)
def test_poor_rows_make_a_plot_that_says_so(poor: str) -> None:
    rows = ROWS[poor]()
    for figure in (
        plotting.gap_against_speed(rows),
        plotting.stopping_distance(rows),
        plotting.heat_map(rows, "ego.speed_mps", "delay", "passed"),
        plotting.distribution(rows, "stop_gap_m", "delay"),
        plotting.response(rows, "delay", "stop_gap_m", facet="seed"),
        plotting.heat_map(rows, "seed", "delay", "stop_gap_m", by="seed", facet="delay"),
        plotting.stopping_distance(rows, by="delay", facet="seed"),
    ):
        just_draw(figure)


NOWHERE = dict.fromkeys(("x_m", "y_m", "true_x_m", "true_y_m", "speed_mps", "true_speed_mps", "s_m"), math.nan)


RECORDS: dict[str, list[dict[str, Any]]] = {
    "one tick": STILL[:1],
    "at rest": STILL,
    "no pose": [row | NOWHERE for row in STILL],
    "no truth": [row | {"true_x_m": math.nan, "x_m": 0.1 * row["tick"], "speed_mps": 5.0} for row in STILL],
    "a contact": [row | {"contacts": "parked" if row["tick"] > 20 else ""} for row in STILL],
    "touching": [row | {"x_m": 12.0 - 2.0 - CAR.rear_axle_to_bumper, "true_x_m": math.nan} for row in STILL],
}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("poor", RECORDS)
def test_a_poor_record_makes_plots_that_say_so(poor: str, tmp_path: Path) -> None:
    """Also of a killed drive, which has no summary."""
    folder = write(tmp_path / "record", RECORDS[poor])
    if poor != "at rest":
        put(folder, "actors", [BOX | {"tick": row["tick"], "actor": "parked", "x_m": 12.0} for row in STILL])
    run = Run(folder)
    per_run = (
        plotting.drive_overview, plotting.safety_over_time, plotting.gap_against_speed, plotting.latency_over_time,
        plotting.string_stability, plotting.headways,
    )  # fmt: skip
    for plot in per_run:
        figure = plot(run)
        just_draw(figure)
        for axes in figure.axes:
            assert axes.get_ylim()[0] < axes.get_ylim()[1] or plot is plotting.latency_over_time
