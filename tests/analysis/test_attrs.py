"""Every table that the analysis returns says of each of its columns the unit, the label and the meaning."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import vve_sumo.analysis as public
from tests.analysis.made import BOX, PERIOD, moving, put, put_scans, write
from tests.sweep.test_dataset import COUNT, PLAN, cell, fill, result
from vve_sumo import analysis
from vve_sumo.analysis import LatencyMargin, Run, Sweep
from vve_sumo.analysis.latency_margin import DELAY, NOISE, edges_of, steps_of
from vve_sumo.analysis.steering_study import MARGINS
from vve_sumo.analysis.units import described
from vve_sumo.record.rows import GatewayRow, LatencyRow
from vve_sumo.sweep.dataset import Dataset

TICKS = 200
DECLARED = {"speed": {"sets": ["ego.speed_mps"], "meaning": "of the ego before it slows down"}}
KINDS = {"int": 0, "float": 0.0, "bool": False, "str": "", "bytes": b""}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A live drive towards somebody who stands on the path."""
    ticks = np.arange(TICKS)
    rows = moving(ticks * PERIOD, 8.0 * PERIOD * ticks, np.full(TICKS, 8.0))
    rows = [row | {"actors": 1, "readings": 1, "state": "engaged", "acceleration_setpoint_mps2": -2.0} for row in rows]
    folder = write(tmp_path_factory.mktemp("attrs") / "record", rows, {"outcome": "timeout"})
    put(folder, "actors", ({"tick": tick, "actor": "parked", **BOX, "x_m": 80.0} for tick in ticks.tolist()))
    seen = {"range_m": 40.0, "azimuth_rad": 0.0, "range_rate_mps": -8.0, "mode": 0, "actor": "parked"}
    put_scans(folder, ticks.tolist(), ({"tick": tick, **seen} for tick in ticks.tolist()))
    for name, kind in (("gateway", GatewayRow), ("latency", LatencyRow)):
        put(folder, name, [{field.name: KINDS[str(field.type)] for field in dataclasses.fields(kind)}])
    return Run(folder)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    """A parameter that the scenario declares, one of its keys, and one of the controller's."""
    folder = tmp_path_factory.mktemp("attrs") / "sweep"
    kinds = {"speed": "float", NOISE: "float", DELAY: "float", "controller.tuning.gain": "float"}
    plan = replace(PLAN, parameters=kinds, table={"title": "t", "parameters": DECLARED})
    dataset = Dataset(folder, plan, resume=False, rows_per_part=2)
    for number in range(COUNT - 1):  # the last is missing: so a part and the journal hold the runs
        values = {"speed": 5.0, NOISE: 1.0, DELAY: 0.1 * number, "controller.tuning.gain": 1.0}
        dataset.add(cell(number)._replace(values=values), result(number))
    dataset.close()
    return Sweep(folder)


#: what returns a table, by its name in `vve_sumo.analysis`, as a method of `Run` or of `Sweep`
OF_A_RUN: dict[str, Callable[[Run], Mapping[str, Any]]] = {
    "ticks": lambda run: {"ticks": run.ticks},
    "actors": lambda run: {"actors": run.actors},
    "detections": lambda run: {"detections": run.detections},
    "sensor": lambda run: {"radar": run.sensor("radar")},
    "table": lambda run: {name: run.table(name) for name in ("readings", "gateway", "latency")},
    "over_time": lambda run: {"over time": analysis.over_time(run)},
    "exposure": lambda run: {"exposure": analysis.exposure(analysis.over_time(run)).to_frame().T},
    "zone_times": lambda run: {"zone times": analysis.zone_times(run, "parked")},
    "latency_breakdown": lambda run: {"latencies": analysis.latency_breakdown(run)},
    "legs_over_time": lambda run: {"legs": analysis.legs_over_time(run)},
    "sensor_statistics": lambda run: {"radar statistics": analysis.sensor_statistics(run)},
    "braked_for_nothing": lambda run: {"braked for nothing": analysis.braked_for_nothing(run)},
    "string_stability": lambda run: {"string": analysis.string_stability(run)},
    "headway_distribution": lambda run: {"headways": analysis.headway_distribution(run)},
    "Comparison": lambda run: _of_comparison(analysis.compare(run, run)),
}
OF_A_SWEEP: dict[str, Callable[[Sweep], Mapping[str, Any]]] = {
    "rows": lambda sweep: {"rows": sweep.rows(), "two columns": sweep.rows(["speed", "passed"])},
    "batches": lambda sweep: {f"batch {number}": batch for number, batch in enumerate(sweep.batches())},
    "machine": lambda sweep: {"machine": sweep.machine()},
    "sql": lambda sweep: {
        "every column": sweep.sql("SELECT * FROM runs JOIN machine USING (key)"),
        "computed": sweep.sql("SELECT speed, avg(stop_gap_m) AS mean_stop_gap_m, 1 AS one FROM runs GROUP BY ALL"),
    },
    "grouped": lambda sweep: {"groups": sweep.grouped(), "of two": sweep.grouped(["speed"], ["stop_gap_m", "passed"])},
    "stopping_bound_checks": lambda sweep: {"bounds": analysis.stopping_bound_checks(sweep.rows())},
    "variance_explained": lambda sweep: {
        "variance": analysis.variance_explained(sweep.rows(), "stop_gap_m", sweep.parameters)
    },
    "PairedComparison": lambda sweep: _of_pairs(analysis.compare_sweeps(sweep, sweep)),
    "LatencyMargin": lambda sweep: _of_margin(sweep),
    "SteeringStudy": lambda sweep: _of_study(),
}


def _of_comparison(compared: analysis.Comparison) -> Mapping[str, pd.DataFrame]:
    return {"signals": compared.signals, "outcomes": compared.outcomes, **compared.series}


def _of_pairs(compared: analysis.PairedComparison) -> Mapping[str, pd.DataFrame]:
    return {"pairs": compared.pairs, "figures": compared.figures, "verdicts": compared.verdicts}


def _of_margin(sweep: Sweep) -> Mapping[str, pd.DataFrame]:
    rows = sweep.rows().assign(meets_outcome=True)
    steps = steps_of(rows, 8.0)
    margin = LatencyMargin("by hand", "by_hand", 8.0, steps, edges_of(steps, 8.0), math.nan)
    return {"steps": margin.steps, "edges": margin.edges}


def _of_study() -> Mapping[str, pd.DataFrame]:
    one = pd.DataFrame([[8.0, 1.0, 0.0, 0.4, 0.39, 0.38, 0.4, -2.5]], columns=list(MARGINS))
    return {"margins": analysis.SteeringStudy("by hand", described(one, MARGINS), 2.0).margins}


def assert_described(name: str, table: pd.DataFrame) -> None:
    columns = [str(column) for column in table.columns]
    assert columns, name
    for about in ("units", "labels", "meanings"):
        absent = [column for column in columns if column not in table.attrs.get(about, {})]
        assert not absent, f"{name}: attrs[{about!r}] knows nothing of {absent}"
    for about in ("labels", "meanings"):
        empty = [column for column in columns if not table.attrs[about][column].strip()]
        assert not empty, f"{name}: attrs[{about!r}] is empty of {empty}"


@pytest.mark.parametrize("name", OF_A_RUN)
def test_tables_of_a_run(run: Run, name: str) -> None:
    for which, table in OF_A_RUN[name](run).items():
        assert_described(which, table)


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize("name", OF_A_SWEEP)
def test_tables_of_a_sweep(sweep: Sweep, name: str) -> None:
    for which, table in OF_A_SWEEP[name](sweep).items():
        assert_described(which, table)


def _returns_a_table(of: object) -> bool:
    function = of.fget if isinstance(of, property) else of.func if isinstance(of, cached_property) else of
    said = str(getattr(function, "__annotations__", {}).get("return", ""))
    fields = map(str, getattr(of, "__annotations__", {}).values()) if dataclasses.is_dataclass(of) else ()
    return "pd.DataFrame" in said or "pd.Series" in said or any("pd.DataFrame" in field for field in fields)


def test_nothing_that_returns_a_table_is_left_out() -> None:
    named = {name: getattr(public, name) for name in public.__all__}
    named |= {name: of for kind in (Run, Sweep) for name, of in vars(kind).items() if not name.startswith("_")}
    missing = {name for name, of in named.items() if _returns_a_table(of)} - {*OF_A_RUN, *OF_A_SWEEP}
    assert not missing, f"enter {missing} above"


def test_a_parameter_means_what_the_scenario_or_its_key_says(sweep: Sweep) -> None:
    attrs = sweep.rows().attrs
    assert attrs["meanings"]["speed"] == "of the ego before it slows down"
    assert attrs["units"]["speed"] == "m/s"
    assert attrs["meanings"][NOISE] == "size of that noise over what the receiver says of itself"
    assert attrs["meanings"]["controller.tuning.gain"] == "the scenario's controller.tuning.gain"


def test_plain_parquet_files_carry_them_to_arrow_and_to_pandas(run: Run, sweep: Sweep) -> None:
    (part,) = sorted((sweep.folder / "rows").glob("*.parquet"))[:1]
    machine = sweep.folder / "machine" / part.name
    for file, attrs in (
        (run.folder / "ticks.parquet", run.ticks.attrs),
        (run.folder / "sensor_radar.parquet", run.detections.attrs),
        (part, sweep.rows().attrs),
        (machine, sweep.machine().attrs),
    ):
        table = pd.read_parquet(file)
        assert_described(file.name, table)
        assert {about: table.attrs[about] for about in ("units", "labels", "meanings")} == attrs
        for field in pq.read_schema(file):
            assert field.metadata[b"meaning"].decode() == attrs["meanings"][field.name]
            assert field.metadata[b"unit"].decode() == attrs["units"][field.name]


def test_parts_that_an_earlier_version_wrote_without_them_are_read(tmp_path: Path) -> None:
    fill(tmp_path)
    before = Sweep(tmp_path).rows()
    for file in (tmp_path / "rows").glob("*.parquet"):
        plain = pq.read_table(file)
        bare = plain.cast(plain.schema.remove_metadata()).replace_schema_metadata(None)
        pq.write_table(bare, file)
    pd.testing.assert_frame_equal(Sweep(tmp_path).rows(), before)
    assert Sweep(tmp_path).sql("SELECT count(*) AS runs FROM runs")["runs"].tolist() == [COUNT]
