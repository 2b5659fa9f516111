"""Plots of one drive or two: what is drawn equals the data of the record."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from tests.analysis.made import BOX, CAR, PERIOD, put, write
from tests.plotting.reading import labelled, lines
from tests.plotting.runs_and_sweeps import BRAKING, GAP, LEGS, SPEED, STILL, TIME, WORST, stopping, timed
from vve_sumo import plotting
from vve_sumo.analysis.run import Run
from vve_sumo.plotting import latencies
from vve_sumo.plotting.page import SIZE
from vve_sumo.record.latencies import LEGS as LEG_NAMES
from vve_sumo.report import write_report


@pytest.mark.thorough
@pytest.mark.parametrize("rig", [{}, {"latency": {}}, {"latency": {"breaches": 5}}])
def test_a_rig_without_a_budget_has_the_default_one(tmp_path: Path, rig: dict[str, Any]) -> None:
    """So its drive kept to it; the record holds what the rig file says and no more."""
    folder = stopping(tmp_path / "record", rig=rig).folder
    put(folder, "latency", (dataclasses.asdict(timed(tick)) for tick in range(len(TIME))))
    figure = plotting.latency_over_time(Run(folder))
    assert "budget 40 ms" in [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "Latency" in write_report(folder).read_text(encoding="utf-8")


@pytest.mark.thorough
def test_safety_is_the_closed_form_over_time(figures: dict[str, Figure]) -> None:
    moving_then = TIME < SPEED / BRAKING - 0.1
    v = SPEED - BRAKING * TIME[moving_then]
    gap = GAP - SPEED * TIME[moving_then] + 0.5 * BRAKING * TIME[moving_then] ** 2
    figure = figures["safety"]
    for word, expected in (("gap", gap), ("on the path", gap / v), ("boxes", gap / v), ("DRAC", v * v / (2.0 * gap)),
                           ("bumper to bumper", gap / v), ("front to front", (gap + 4.0) / v)):  # fmt: skip
        (drawn_line,) = lines(figure, word)
        assert drawn_line[0] == pytest.approx(TIME)
        # What is more than 10 s away is no conflict.
        known = gap / v < 9.99 if word in ("on the path", "DRAC") else v > 0.0
        assert drawn_line[1][moving_then][known] == pytest.approx(expected[known], abs=1e-6), word
    assert lines(figure, "asked: at least 1 s")[0][1].tolist() == [1.0, 1.0]
    assert lines(figure, "asked: at most 4 m/s²")[0][1].tolist() == [4.0, 4.0]
    assert lines(figure, f"declared {CAR.deceleration_limit:g} m/s²")[0][1][0] == CAR.deceleration_limit


def test_the_approach_runs_down_to_rest_over_the_parabola(figures: dict[str, Figure], run: Run) -> None:
    (way,) = lines(figures["approach"], "the drive")
    assert way[0] == pytest.approx(run.motion.speed)
    assert way[1] == pytest.approx(run.lead.gap)
    v, needed = labelled(figures["approach"], "needed to stop")
    delay = CAR.brake_delay + CAR.brake_lag
    assert needed == pytest.approx(v * delay + v * v / (2.0 * CAR.deceleration_limit))
    assert labelled(figures["approach"], "^end: 16.00 m$")[:, 0] == pytest.approx([0.0, 16.0], abs=1e-6)


def test_an_approach_that_ends_above_the_axis_is_marked_at_its_edge(tmp_path: Path) -> None:
    run = stopping(tmp_path / "record", speed=6.0)
    boxes = [BOX | {"actor": "parked", "x_m": 140.0 + 0.2 * tick, "tick": tick} for tick in range(len(TIME))]
    put(run.folder, "actors", boxes)  # it drives away from a car that never comes near
    axes = plotting.gap_against_speed(Run(run.folder)).axes[0]
    (end,) = (line for line in axes.lines if str(line.get_label()).startswith("end: "))
    assert float(np.asarray(end.get_ydata())[0]) <= axes.get_ylim()[1]
    assert str(end.get_label()).endswith("above the axis")


@pytest.mark.parametrize(("gap", "mark"), [(40.0, "o"), (140.0, "^")])
def test_an_approach_that_begins_above_the_axis_has_a_triangle_at_its_edge(
    tmp_path: Path, gap: float, mark: str
) -> None:
    run = stopping(tmp_path / "record", speed=6.0)
    box = BOX | {"actor": "parked", "x_m": CAR.rear_axle_to_bumper + gap + 2.0}
    put(run.folder, "actors", [box | {"tick": tick} for tick in range(len(TIME))])
    axes = plotting.gap_against_speed(Run(run.folder)).axes[0]
    (first,) = (line for line in axes.lines if str(line.get_label()).startswith(f"first ahead: {gap:.0f} m"))
    assert first.get_marker() == mark
    assert float(np.asarray(first.get_ydata())[0]) <= axes.get_ylim()[1]
    assert str(first.get_label()).endswith("above the axis") == (mark == "^")


def test_the_latency_plot_stacks_the_legs_of_the_slowest_ticks(figures: dict[str, Figure]) -> None:
    figure = figures["latency"]
    names = ("wake", "decode", "sensors", "control", "hand over", "frame")
    stacked = {one.get_label(): one.get_paths()[0].vertices for one in figure.axes[0].collections}
    at = WORST * PERIOD
    for leg, usual, slow in zip(names, np.cumsum(LEGS), np.cumsum(LEGS) + 20.0 * (np.arange(6) > 0), strict=True):
        time, top = stacked[leg].T
        assert top[(time < 10.0)].max() == pytest.approx(usual, abs=1e-6)
        assert top[np.abs(time - at) < 0.3].max() == pytest.approx(slow, abs=1e-6)
    assert lines(figure, "budget 15 ms")[0][1].tolist() == [15.0, 15.0]
    assert lines(figure, "3 ticks missed")[0][0] == pytest.approx([400 * PERIOD])
    medians, _places = lines(figure, "median")[0]
    legs = [text.get_text() for text in figure.axes[1].get_yticklabels()]
    assert dict(zip(legs, medians, strict=True))["decode"] == pytest.approx(1.0)
    assert dict(zip(legs, lines(figure, "greatest")[0][0], strict=True))["total"] == pytest.approx(26.0)


def test_a_comparison_shows_the_second_less_the_first(figures: dict[str, Figure]) -> None:
    first, second = (lines(figures["comparison"], word)[0] for word in ("first", "second"))
    assert first[1][:100] == pytest.approx(SPEED - BRAKING * first[0][:100])
    difference = np.array(figures["comparison"].axes[1].lines[1].get_data())
    assert difference[1] == pytest.approx(second[1] - first[1])
    assert difference[1][:100] == pytest.approx(-1.0)


def test_a_contact_from_the_side_is_in_the_picture(tmp_path: Path) -> None:
    """Long after the last that was ahead."""
    rows = [{"time_s": float(tick), "contacts": "parked" * (tick > 25)} for tick in range(30)]
    folder = write(tmp_path / "record", rows)
    put(folder, "actors", [BOX | {"tick": tick, "actor": "parked", "x_m": 12.0} for tick in range(5)])
    gap = plotting.safety_over_time(Run(folder)).axes[0]
    left, right = gap.get_xlim()
    assert left < 0.0 < 26.0 < right < 28.0
    # It stood, and 2 m would have been safe: the gap is shown all the same.
    assert gap.get_ylim()[1] > 12.0 - 2.0 - CAR.rear_axle_to_bumper


def test_a_leg_that_did_not_happen_is_not_another_ticks() -> None:
    """Of a portion's slowest tick nothing is known of the radar; the others took 1 ms for it."""
    legs = {f"{leg}_ms": [1.0, 1.0] for leg in LEG_NAMES} | {"total_ms": [6.0, 9.0], "time_s": [0.0, 0.0]}
    _edges, shown = latencies.slowest(pd.DataFrame(legs | {"sensors_ms": [1.0, math.nan]}))
    assert shown["total_ms"].dropna().tolist() == [9.0]
    assert not shown["sensors_ms"].notna().any()


def test_the_overview_is_of_the_drives_own_size_and_says_what_came_of_it(tmp_path: Path, run: Run) -> None:
    summary = {"outcome": "stopped", "stop_gap_m": 16.0, "seed": 1, "passed": False}
    (tmp_path / "summary.json").write_text("", encoding="utf-8")
    folder = write(tmp_path / "record", STILL, summary)
    words = [text.get_text() for text in plotting.drive_overview(Run(folder)).texts]
    assert words == ["by hand", "came to rest 16.00 m before what was ahead · criteria NOT met · seed 1"]
    overview = plotting.drive_overview(run)
    assert overview.texts[1].get_text() == f"killed: the record ends at {TIME[-1]:.2f} s"
    assert overview.get_size_inches().tolist() == list(SIZE)
