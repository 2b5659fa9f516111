"""A controller that hunts on its way to a stop is flagged in its row, its report and its plots, and does not pass."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.conftest import REPOSITORY
from tests.isolated import isolated
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.stopping_bound import stopping_bound_check
from vve_sumo.plotting.drives import drive_overview
from vve_sumo.plotting.stops import stopping_distance
from vve_sumo.report import stops
from vve_sumo.report.verdict import figures_of, of_drive

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "driven"

SPEED = 14.0  #: [m/s]
#: an adaptive cruise control of gain 8 whose pose is 0.3 s older than it says
HUNTING = {"ego.speed_mps": SPEED, "controller": {"name": "tests/controllers/hunting.py:make"}}
LATE = {"ego.car.gnss_hidden_delay_s": 0.3}
#: the straight street on which no bend shows the delay to the gateway, the same without delay, and the paper's street
DRIVES = {
    "late": ("delay_probe", HUNTING | LATE),
    "in time": ("delay_probe", HUNTING),
    "late in bends": ("parked_car", HUNTING | LATE),
}


def _drive(folder: Path) -> None:
    """Drive all of them; call it through `isolated`."""
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.scenario.load import parse
    from vve_sumo.scenario.overrides import apply_overrides

    for name, (scenario, changes) in DRIVES.items():
        file = REPOSITORY / "scenarios" / f"{scenario}.toml"
        table = apply_overrides(tomllib.loads(file.read_text(encoding="utf-8")), changes)
        drives.run(resolve_scenario(scenario, parse(table, file), file, REPOSITORY), folder / name, REPOSITORY)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hunting")
    isolated(_drive, folder)
    return folder


@pytest.mark.thorough
def test_its_row_is_flagged_and_the_stop_is_the_whole_of_it(driven: Path) -> None:
    late, in_time = (Run(driven / name).summary or {} for name in ("late", "in time"))
    assert (late["hunting"], in_time["hunting"]) == (True, False)
    assert late["hunting_reversals"] >= 6
    assert late["passed"] is False
    assert any(line.startswith("hunting is True") for line in late["failed"])
    # From 14 m/s no comfortable stop, which 3.5 m/s2 is the limit of, is shorter than this.
    assert late["stop_onset_speed_mps"] > 0.9 * SPEED
    assert late["stop_distance_m"] > SPEED**2 / (2.0 * 3.5)
    assert late["approach_distance_m"] >= late["stop_distance_m"]
    assert in_time["passed"] is True
    assert (Run(driven / "late in bends").summary or {})["hunting"] is True


def test_its_report_says_so_and_judges_no_bound(driven: Path) -> None:
    run = Run(driven / "late")
    assert "HUNTING" in stops.stop(run)["stop_hunting"].text
    assert stops.status(run) == {"stop_status": "HUNTING", "stop_wrong": True}
    assert "It was hunting on its way to rest" in of_drive(run, figures_of(run)).line
    check = stopping_bound_check(run)
    assert np.isnan(check.tolerance)
    assert "distance" not in check.missed
    good = Run(driven / "in time")
    assert stops.stop(good)["stop_hunting"] is None
    assert "hunting" not in of_drive(good, figures_of(good)).line
    assert stopping_bound_check(good).held


@pytest.mark.thorough
def test_its_plots_mark_it_and_the_law_is_fitted_without_it(driven: Path) -> None:
    run = Run(driven / "late")
    texts = [text.get_text() for axes in drive_overview(run).axes for text in axes.texts]
    assert f"hunting: {(run.summary or {})['hunting_reversals']} reversals" in texts
    rows = pd.DataFrame([Run(driven / name).summary for name in ("in time", "late")])
    both, one = (stopping_distance(some).axes[0].get_legend_handles_labels()[1] for some in (rows, rows.iloc[:1]))
    assert "hunting, not in the curve (1 run)" in both
    assert [word for word in both if "τ" in word] == [word for word in one if "τ" in word]
