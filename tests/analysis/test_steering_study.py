"""A study of a steering loop: what its margins say in words and in a picture, and the whole study on one speed."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd
import pytest

from tests import isolated
from tests.sweep.test_dataset import fill
from vve_sumo.analysis import load, steering_study_of
from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.steering_study import MARGINS, SteeringStudy
from vve_sumo.errors import ConfigError
from vve_sumo.plotting import steering_margin

ROWS = [
    (4.0, 1.0, 0.0, 0.50, 0.49, 0.48, 0.50, -2.0),
    (10.0, 1.0, 0.0, 0.355, 0.36, 0.35, 0.37, 1.4),
    (4.0, 1.0, 0.1, math.inf, math.nan, 3.0, math.nan, math.nan),
    (10.0, 1.0, 0.1, 2.132, 2.1, 2.09, 2.11, -1.5),
]


def study(reason: str = "") -> SteeringStudy:
    return SteeringStudy("by hand", pd.DataFrame(ROWS, columns=list(MARGINS)), 3.0, reason)


def test_the_verdicts_say_what_the_rows_hold() -> None:
    without, observed, why = study("nothing is known").verdicts()
    assert without == "without an observer: 360 ms to 490 ms; at most 2.0 % from the closed form"
    assert observed.startswith("with the observer: 2100 ms to 2100 ms; stable at all delays up to 3000 ms in 1 of 2")
    assert why == "nothing is known"


def test_the_picture_has_a_line_predicted_and_marks_measured_for_each_kind() -> None:
    axes = steering_margin(study()).axes[0]
    heights = {str(line.get_label()): [float(y) for y in line.get_ydata()] for line in axes.lines}
    assert heights["without observer: predicted"] == pytest.approx([500.0, 355.0])
    assert heights["without observer: measured"] == pytest.approx([490.0, 360.0])
    assert heights["observer 0.1 s: stable at every delay"][0] == 3000.0
    assert math.isnan(heights["observer 0.1 s: predicted"][0])


def test_another_sweep_is_no_study_of_a_steering(tmp_path: Path) -> None:
    fill(tmp_path).close()
    with pytest.raises(
        ConfigError, match=r"not what a study of a steering loop writes|no finished study of a steering"
    ):
        steering_study_of(Sweep(tmp_path))


@pytest.mark.slow
def test_a_study_of_one_speed_is_within_five_percent(tmp_path: Path) -> None:
    """Some two dozen drives; what the closed form predicts, and what is measured, of both loops."""
    arguments = (
        "study",
        "latency",
        "steering_probe",
        "--out",
        "margins",
        "--steering",
        "--speeds-mps",
        "10",
        "--quiet",
    )
    done = isolated.command(*arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = steering_study_of(load(tmp_path / "margins"))
    assert len(found.margins) == 2
    assert found.margins["difference_percent"].abs().max() <= 5.0
    assert (tmp_path / "margins" / "steering_margin.png").stat().st_size > 20_000
    assert "at most" in done.stdout
