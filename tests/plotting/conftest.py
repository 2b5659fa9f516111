"""Two records and one of every plot, made once for all tests that look at them."""

from __future__ import annotations

import dataclasses
import math

import pytest
from matplotlib.figure import Figure

from tests.analysis.made import PERIOD, put, write
from tests.plotting.runs_and_sweeps import BOUNDARY, TIMED, cliff_rows, rows_of, searched, stopping, timed
from vve_sumo import plotting
from vve_sumo.analysis import latency_margin as study
from vve_sumo.analysis.comparison import compare
from vve_sumo.analysis.paired import compare_rows
from vve_sumo.analysis.run import Run


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return stopping(tmp_path_factory.mktemp("run") / "record")


@pytest.fixture(scope="session")
def live(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A live record whose every tick takes LEGS; one takes 20 ms more to decode, and three ticks are skipped."""
    rows = [{"tick": tick, "time_s": tick * PERIOD, "pose_age_s": 0.02} for tick in range(TIMED)]
    rig = {"latency": {"budget_ms": 15.0}}
    folder = write(tmp_path_factory.mktemp("live") / "record", rows, rig=rig)
    put(folder, "latency", (dataclasses.asdict(timed(tick)) for tick in range(TIMED)))
    return Run(folder)


@pytest.fixture(scope="session")
def figures(run: Run, live: Run, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Figure]:
    """One of every plot."""
    folder = tmp_path_factory.mktemp("figures")
    steps = study.steps_of(cliff_rows(), 11.0)
    worst = {"highest": "impact_speed_mps", "points": 10}
    rows = rows_of(300)
    return {
        "overview": plotting.drive_overview(run),
        "safety": plotting.safety_over_time(run),
        "string": plotting.string_stability(run),
        "headways": plotting.headways(run),
        "approach": plotting.gap_against_speed(run),
        "gaps": plotting.gap_against_speed(rows),
        "stops": plotting.stopping_distance(rows),
        "map": plotting.heat_map(rows, "ego.speed_mps", "delay", "stop_gap_m", zero="contact"),
        "shares": plotting.heat_map(rows, "delay", "seed", "passed"),
        "distribution": plotting.distribution(rows, "stop_gap_m", "delay", (0.5, math.inf)),
        "response": plotting.response(rows, "ego.speed_mps", "stop_gap_m", by="delay"),
        "panels": plotting.distribution(rows, "stop_gap_m", "seed", facet="delay"),
        "laws": plotting.stopping_distance(rows, by="delay"),
        "pairs": plotting.paired(compare_rows(rows, rows.assign(stop_gap_m=2.0), ["number"])),
        "boundary": plotting.boundary(searched(folder / "b", {"along": "pace", "criterion": "collision"}, BOUNDARY)),
        "worst": plotting.boundary(searched(folder / "w", worst, worst | {"search": "worst", "worst": None})),
        "latency": plotting.latency_over_time(live),
        "comparison": plotting.comparison(compare(run, stopping(folder / "other", speed=11.0))),
        "cliff": plotting.latency_margin(study.LatencyMargin("t", "s", 11.0, steps, study.edges_of(steps, 11.0), 0.3)),
    }
