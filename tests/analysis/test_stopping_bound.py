"""Stopping-bound checks: kept by the car as declared, broken where brakes or road give less, and by nothing else."""

from __future__ import annotations

import math
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.analysis import made
from tests.analysis.test_braking import record, stop_in
from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from tests.isolated import isolated
from tests.metrics.test_stopping import braked
from vve_sumo import laws
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.stopping_bound import MEANINGS, stopping_bound_check, stopping_bound_checks
from vve_sumo.errors import ConfigError

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "driven"

A, V = 5.0, 12.0
DECLARED = made.CAR.brake_delay, 2.0 * made.CAR.brake_lag

#: a gentle stop by the gateway, a hard one for a pedestrian; and what nobody declared of the car or the road
DRIVES: dict[str, tuple[str, dict[str, float]]] = {
    "gentle": ("leap_hard_stop", {}),
    "gentle, weak brakes": ("leap_hard_stop", {"ego.car.brake_gain_factor": 0.6}),
    "hard": ("pedestrian_750_crossing", {}),
    "hard, at once": ("occluded_pedestrian", {}),
    "hard, snow": ("pedestrian_750_crossing", {"weather.friction": 0.3}),
}


#: what is looked at each time
USUAL = ["gentle", "hard, at once"]


def _drive(folder: Path, names: list[str]) -> dict[str, dict[str, Any]]:
    """Drive them and return their summaries; call it through `isolated`."""
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.scenario.load import parse
    from vve_sumo.scenario.overrides import apply_overrides

    summaries = {}
    for name in names:
        scenario, changes = DRIVES[name]
        file = REPOSITORY / "scenarios" / f"{scenario}.toml"
        table = apply_overrides(tomllib.loads(file.read_text(encoding="utf-8")), changes)
        resolved = resolve_scenario(scenario, parse(table, file), file, REPOSITORY)
        summaries[name] = drives.run(resolved, folder / name, REPOSITORY).summary
    return summaries


@pytest.fixture(scope="module", params=with_slow([USUAL, list(DRIVES)], lambda names: names is USUAL), ids=len)
def driven(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> tuple[Path, pd.DataFrame]:
    """The folder of the drives' records, and their summaries as a sweep's rows."""
    folder = tmp_path_factory.mktemp("checks")
    return folder, pd.DataFrame.from_dict(isolated(_drive, folder, request.param), orient="index")


@pytest.mark.slow
def test_the_car_as_declared_keeps_its_bound_and_any_other_breaks_it(driven: tuple[Path, pd.DataFrame]) -> None:
    folder, rows = driven
    reported = stopping_bound_checks(rows)
    for name in rows.index:
        given, by_row = stopping_bound_check(Run(folder / name)), reported.loc[name]
        as_declared = not DRIVES[name][1]
        assert (given.held, given.broken) == (as_declared, not as_declared), name
        assert (by_row["held"], by_row["broken"]) == (given.held, given.broken)
        assert by_row["excess_m"] == pytest.approx(given.excess, abs=1e-12)
        assert by_row["tolerance_m"] == pytest.approx(given.tolerance, abs=1e-12)
        if as_declared:  # and it is no generous bound
            assert given.distance > 0.97 * given.bound
    if "hard, snow" in rows.index:
        assert reported.loc["hard, snow", "excess_m"] > 5.0


@pytest.mark.thorough
def test_the_summary_says_of_the_stop_what_the_analysis_does(driven: tuple[Path, pd.DataFrame]) -> None:
    folder, rows = driven
    for name in rows.index:
        stop, row = stop_in(Run(folder / name)), rows.loc[name]
        figures = [stop.onset_speed, stop.distance, stop.demand, stop.mfdd]
        figures += [stop.reaction.duration, stop.build_up.duration]
        names = ["stop_onset_speed_mps", "stop_distance_m", "stop_demand_mps2", "mfdd_mps2", "stop_reaction_s"]
        assert row[[*names, "stop_build_up_s"]].tolist() == figures


def test_the_declared_brakes_answer_within_a_tick_of_what_was_declared(driven: tuple[Path, pd.DataFrame]) -> None:
    """Dead time and a lag's first rise: the car's own parameters, which the analysis does not read for it.

    One who comes out from behind something is braked for fully at once; one who is seen for long, in two stages.
    """
    folder, _rows = driven
    stop = stop_in(Run(folder / "hard, at once"))
    assert stop.reaction.duration == pytest.approx(made.CAR.brake_delay, abs=made.PERIOD)
    assert stop.mfdd == pytest.approx(made.CAR.deceleration_limit, rel=0.05)


def live(folder: Path, latency: list[dict[str, Any]]) -> Run:
    """A live record of a stop from tick 50 on, with this latency table."""
    record(folder, braked(V, A), rig={"latency": {"budget_ms": 15.0}})
    made.put(folder, "latency", [{"due_s": made.PERIOD * row["tick"]} | row for row in latency])
    return Run(folder)


def row(tick: int, took: float) -> dict[str, Any]:
    return {"tick": tick, "framed_s": made.PERIOD * tick + took}


def test_a_live_runs_own_latency_is_in_its_bound(tmp_path: Path) -> None:
    """The worst of the stop, not of the drive, and not of ticks that sent nothing."""
    run = live(tmp_path / "live", [row(10, 0.5), row(60, 0.012), row(70, 0.03), row(80, math.nan)])
    given = stopping_bound_check(run)
    assert given.latency == pytest.approx(0.03)
    assert given.bound == pytest.approx(laws.stopping_distance(V, A, 0.03 + DECLARED[0], DECLARED[1]))
    lockstep = stopping_bound_check(Run(record(tmp_path / "lockstep", braked(V, A))))
    assert lockstep.latency == 0.0
    assert given.bound - lockstep.bound == pytest.approx(0.03 * V)


def test_a_live_run_without_a_latency_has_no_check(tmp_path: Path) -> None:
    given = stopping_bound_check(live(tmp_path / "none", [row(10, 0.02)]))
    assert math.isnan(given.bound)
    assert not given.held
    assert not given.broken


@pytest.mark.parametrize(("beyond", "broken"), [(-0.02, False), (0.02, True)])
def test_a_delay_that_nobody_declared_breaks_the_bound_beyond_the_tolerance(
    tmp_path: Path, beyond: float, broken: bool
) -> None:
    """A car that answers later than declared by what costs the tolerance, and a little less or more."""
    tolerance = stopping_bound_check(Run(record(tmp_path / "in_time", braked(V, A, DECLARED[0])))).tolerance
    undeclared = DECLARED[0] + 0.5 * DECLARED[1] + (tolerance + beyond) / V
    given = stopping_bound_check(Run(record(tmp_path / "late", braked(V, A, undeclared))))
    assert given.excess == pytest.approx(tolerance + beyond, abs=0.005)
    assert (given.broken, given.held) == (broken, not broken)


def test_a_drive_that_never_stops_has_no_check(tmp_path: Path) -> None:
    granted, speed, acceleration = braked(V, A)
    given = stopping_bound_check(Run(record(tmp_path / "goes_on", (granted[:90], speed[:90], acceleration[:90]))))
    assert all(math.isnan(value) for name, value in asdict(given).items() if name not in ("answer", "terms"))
    assert all(math.isnan(value) for part in (*given.answer, given.terms) for value in part)
    assert not given.held
    assert not given.broken


def test_rows_without_a_stop_or_a_tolerance_are_neither_held_nor_broken() -> None:
    rows = pd.DataFrame(
        {
            "stop_distance_m": [10.0, 10.2, np.nan, None, 11.0],
            "stop_bound_m": [10.0, 10.0, np.nan, None, 10.0],
            "stop_tolerance_m": [0.1, 0.1, np.nan, None, np.nan],
        },
        index=[7, 3, 5, 9, 4],
    )
    reported = stopping_bound_checks(rows)
    assert reported.index.tolist() == [7, 3, 5, 9, 4]
    assert reported["held"].tolist() == [True, False, False, False, False]
    assert reported["broken"].tolist() == [False, True, False, False, False]
    assert reported["broken"].dtype == bool
    assert list(reported.columns) == list(MEANINGS)
    assert reported.attrs["units"]["bound_m"] == "m"
    with pytest.raises(ConfigError, match="no column stop_bound_m"):
        stopping_bound_checks(rows[["stop_distance_m"]])
