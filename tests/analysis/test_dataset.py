"""A sweep's rows: whole, in portions, by SQL and in groups they are the runs that were written, killed or not."""

from __future__ import annotations

import json
import math
import random
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tests.sweep.test_dataset import COUNT, ORDER, PLAN, cell, fill, result
from vve_sumo.analysis import Sweep
from vve_sumo.analysis.groups import grouped, numbered, repeated_by_seed
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.table import FIGURES
from vve_sumo.record.sweep_folder import COLUMNS, MACHINE
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.job import RunResult
from vve_sumo.sweep.run_specs import RunSpec

RUNS = 60


def row_of_result(number: int) -> dict[str, Any]:
    return dict(result(number).figures) | {"number": number, "key": cell(number).key, "speed": 0.1 * number}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("most", range(1, COUNT + 1))
def test_the_rows_are_the_finished_runs_in_order(tmp_path: Path, most: int) -> None:
    fill(tmp_path, most=most)
    sweep = Sweep(tmp_path)
    rows = sweep.rows()
    assert sweep.finished == most
    assert sweep.planned == COUNT
    assert list(rows["number"]) == sorted(ORDER[:most])
    for _index, row in rows.iterrows():
        for name, value in row_of_result(row["number"]).items():
            assert (pd.isna(row[name]) and value is None) or row[name] == value, name
    assert list(rows.columns) == sweep.columns
    pd.testing.assert_frame_equal(pd.concat(list(sweep.batches()), ignore_index=True), rows)
    pd.testing.assert_frame_equal(sweep.rows(["passed", "number"]), rows[["passed", "number"]])
    assert list(sweep.machine()["number"]) == sorted(ORDER[:most])
    assert sweep.sql("SELECT number FROM runs ORDER BY 1")["number"].tolist() == sorted(ORDER[:most])


def test_a_row_in_a_part_and_still_in_the_journal_is_one(tmp_path: Path) -> None:
    """What a kill between the part and the new journal leaves."""
    fill(tmp_path, most=2)
    noted = (tmp_path / "journal.jsonl").read_text(encoding="utf-8")
    fill(tmp_path / "later", most=3)
    (tmp_path / "later" / "journal.jsonl").write_text(noted + '{"number": 4, "torn', encoding="utf-8")
    assert [json.loads(line)["number"] for line in noted.splitlines()] == [2, 0]
    sweep = Sweep(tmp_path / "later")
    assert list(sweep.rows()["number"]) == [0, 2, 3]
    assert sweep.finished == 3
    assert sweep.sql("SELECT count(*) AS n FROM runs JOIN machine USING (number)")["n"].tolist() == [3]


def test_an_open_dataset_stays_as_it_was_while_the_sweep_goes_on(tmp_path: Path) -> None:
    dataset = fill(tmp_path, most=3)
    sweep = Sweep(tmp_path)
    before = sweep.rows()
    for number in ORDER[3:]:
        dataset.add(cell(number), result(number))
    dataset.close()
    pd.testing.assert_frame_equal(sweep.rows(), before)
    assert list(Sweep(tmp_path).rows()["number"]) == list(range(COUNT))


def test_a_column_says_its_unit_its_meaning_and_what_is_missing(tmp_path: Path) -> None:
    fill(tmp_path)
    rows = Sweep(tmp_path).rows()
    assert rows.attrs["units"]["stop_gap_m"] == "m"
    assert rows.attrs["meanings"]["speed"] == "the scenario's speed"
    assert all(rows.attrs["meanings"].values())
    assert set(COLUMNS) == {"number", "key", "seed", "error", "undisturbed", *FIGURES, *MACHINE}
    assert len(rows[~rows["passed"]]) == 1  # number 1; the run with an error has neither passed nor failed
    assert rows["passed"].isna().tolist() == [False, False, False, True, False]
    assert rows["ticks"].dtype == "Int64"


def made() -> Iterator[tuple[RunSpec, RunResult]]:
    chance = random.Random(5)
    for number in range(RUNS):
        values: dict[str, Any] = {"speed": float(number // 20), "kind": "ab"[number % 2]}
        passed = chance.random() < 0.6
        gap = chance.gauss(4.0, 1.0) if number % 7 else None
        figures: dict[str, Any] = {"outcome": "stopped", "passed": passed, "collision": not passed, "stop_gap_m": gap}
        error = "timed_out" if number % 11 == 0 else ""
        yield RunSpec(number, f"{number:016x}", values, number), RunResult("", {} if error else figures, error)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    folder = tmp_path_factory.mktemp("made") / "sweep"
    dataset = Dataset(folder, replace(PLAN, cells=RUNS), resume=False, rows_per_part=25)
    for one, came in made():
        dataset.add(one, came)
    dataset.close()
    return Sweep(folder)


def all_of(results: list[RunResult]) -> Iterator[tuple[bool, float]]:
    """Collision and gap of those runs that have a gap or collided."""
    for came in results:
        hit, gap = bool(came.figures.get("collision")), came.figures.get("stop_gap_m") or math.nan
        if hit or gap == gap:
            yield hit, gap


@pytest.mark.parametrize("by", [["speed", "kind"], ["kind"], []])
def test_groups_are_what_counting_by_hand_comes_to(sweep: Sweep, by: list[str]) -> None:
    groups = sweep.grouped(by, ["stop_gap_m", "collision"])
    by_hand: dict[tuple[Any, ...], list[RunResult]] = {}
    for one, came in made():
        by_hand.setdefault(tuple(one.values[name] for name in by), []).append(came)
    assert [tuple(values) for values in groups[by].to_numpy().tolist()] == list(by_hand)
    for (_index, row), results in zip(groups.iterrows(), by_hand.values(), strict=True):
        judged = [came.figures["passed"] for came in results if not came.error]
        assert (row["runs"], row["errors"]) == (len(results), len(results) - len(judged))
        assert (row["judged"], row["passed"]) == (len(judged), sum(map(bool, judged)))
        assert row["collisions"] == sum(bool(came.figures.get("collision")) for came in results)
        low, high = stats.binomtest(sum(map(bool, judged)), len(judged)).proportion_ci(0.95, "wilson")
        assert row["passed_share"] == np.mean(judged) == pytest.approx(1.0 - row["mean_collision"])
        wanted = (low, high) if len(by) == 2 else (np.nan, np.nan)  # else the runs differ by more than their seed
        assert (row["passed_low_share"], row["passed_high_share"]) == pytest.approx(wanted, nan_ok=True)
        hits = [bool(came.figures.get("collision")) for came in results]
        measured = [came.figures.get("stop_gap_m") or np.nan for came in results]
        gaps = np.array([gap for gap, hit in zip(measured, hits, strict=True) if not hit], float)
        gaps = gaps[np.isfinite(gaps)]
        names = ("mean", "least", "worst", "p05", "p50", "p95", "greatest")
        figures = (
            gaps.mean(),
            gaps.min(),
            0.0 if any(hits) else gaps.min(),
            *np.quantile(gaps, (0.05, 0.5, 0.95)),
            gaps.max(),
        )
        assert [row[f"{name}_stop_gap_m"] for name in names] == pytest.approx(figures)
        spread = stats.t.ppf(0.975, len(gaps) - 1) * stats.sem(gaps) if len(by) == 2 else np.nan
        assert (row["half_width_stop_gap_m"], row["stop_gap_m_count"]) == (
            pytest.approx(spread, nan_ok=True),
            len(gaps),
        )
        assert row["stop_gap_m_share"] == pytest.approx(len(gaps) / len(results))
        assert row["stop_gap_m_contacts"] == sum(hits)
        assert row["stop_gap_m_missing"] == len(results) - len(gaps) - sum(hits)
        assert (row["collision_contacts"], row["collision_missing"]) == (0, row["errors"])
        every = sorted(-math.inf if hit else gap for hit, gap in all_of(results))
        middle = (every[(len(every) - 1) // 2] + every[len(every) // 2]) / 2.0
        median = middle if math.isfinite(middle) else math.nan
        assert row["median_all_stop_gap_m"] == pytest.approx(median, nan_ok=True)
    assert groups.attrs["units"]["p05_stop_gap_m"] == "m"
    assert all(groups.attrs["meanings"].values())


def rows_of(seeds: list[int], gaps: list[float], hits: list[bool], **more: Any) -> pd.DataFrame:
    held = {"seed": seeds, "stop_gap_m": gaps, "collision": hits, "passed": [not hit for hit in hits]}
    return pd.DataFrame({"speed": 1.0, "error": "", "outcome": "stopped", **held, **more})


def test_runs_that_collided_are_below_the_median_of_all_and_not_in_the_mean() -> None:
    rows = rows_of([1, 2, 3, 4, 5], [4.0, math.nan, 2.0, 7.0, 3.0], [False, True, False, True, False])
    (row,) = grouped(rows, ["speed"], ["stop_gap_m"]).to_dict("records")
    assert row["mean_stop_gap_m"] == 3.0  # of 4, 2 and 3: the 7 m are behind an obstacle that was driven through
    assert row["median_all_stop_gap_m"] == 2.0  # of two below zero, 2, 3 and 4
    assert (row["stop_gap_m_count"], row["stop_gap_m_share"], row["collisions"]) == (3, 0.6, 2)
    assert (row["stop_gap_m_contacts"], row["stop_gap_m_missing"], row["worst_stop_gap_m"]) == (2, 0, 0.0)
    deep = rows.assign(stop_gap_m=rows["stop_gap_m"].replace(7.0, -2.0))  # an overlap
    assert grouped(deep, ["speed"], ["stop_gap_m"]).to_dict("records") == [row]
    half = grouped(rows.iloc[:4], ["speed"], ["stop_gap_m"])
    assert half["median_all_stop_gap_m"].isna().all()


@pytest.mark.parametrize(
    ("rows", "by_chance"),
    [
        (rows_of([1, 2, 3], [1.0, 1.5, 2.0], [False] * 3), True),
        (rows_of([1, 2, 3], [1.0, 1.0, 1.0], [False] * 3), False),  # the seeds change nothing
        (rows_of([1, 1, 1], [1.0, 1.5, 2.0], [False] * 3), False),
        (rows_of([1, 2, 3], [1.0, 1.5, 2.0], [False] * 3, speed=[1.0, 2.0, 3.0]), False),  # the mixture of a grid
        (rows_of([1], [1.0], [False]), False),
        # A run with an error, which has no gap, is nothing that the seeds changed.
        (rows_of([1, 2, 3], [1.0, 1.0, math.nan], [False] * 3, error=["", "", "killed"]), False),
        (rows_of([1, 2, 3], [1.0, 1.5, math.nan], [False] * 3, error=["", "", "killed"]), True),
    ],
)
def test_there_are_intervals_of_repetitions_alone(rows: pd.DataFrame, by_chance: bool) -> None:
    repeated = repeated_by_seed(rows, numbered(rows, []), ["speed"])
    assert repeated.tolist() == [by_chance] * len(rows)
    (row,) = grouped(rows, [], ["stop_gap_m"], repeated).to_dict("records")
    assert math.isfinite(row["passed_low_share"]) == by_chance
    assert math.isfinite(row["half_width_stop_gap_m"]) == by_chance


@pytest.mark.parametrize(
    ("spec", "by_chance"),
    [
        ({"design": "random", "samples": 5}, True),
        ({"design": "sobol", "samples": 5}, False),
        ({"search": {"along": "speed"}}, False),
    ],
)
def test_points_drawn_at_random_are_a_sample_and_those_of_a_search_are_none(
    tmp_path: Path, spec: dict[str, Any], by_chance: bool
) -> None:
    dataset = Dataset(tmp_path / "sweep", replace(PLAN, cells=5, spec=spec), resume=False)
    for number in range(5):
        figures: dict[str, Any] = {"passed": number < 3, "collision": False, "stop_gap_m": float(number)}
        dataset.add(
            RunSpec(number, f"{number:016x}", {"speed": 0.3 * number, "kind": "a"}, 1), RunResult("", figures, "")
        )
    dataset.close()
    low = Sweep(tmp_path / "sweep").grouped([], [])["passed_low_share"]
    assert low.notna().tolist() == [by_chance]


def test_sql_answers_as_the_rows_do(sweep: Sweep) -> None:
    answer = sweep.sql(
        "SELECT kind, avg(stop_gap_m) AS mean_stop_gap_m FROM runs WHERE passed GROUP BY kind ORDER BY kind"
    )
    rows = sweep.rows()
    wanted = rows[rows["passed"].eq(True)].groupby("kind")["stop_gap_m"].mean()
    assert answer["mean_stop_gap_m"].tolist() == pytest.approx(wanted.tolist())
    assert answer.attrs["units"]["mean_stop_gap_m"] == "m"


def test_what_cannot_be_asked_is_one_line(sweep: Sweep, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(said: str, ask: Any, *arguments: Any) -> None:
        with pytest.raises(ConfigError, match=said) as caught:
            ask(*arguments)
        assert "\n" not in str(caught.value)

    refused("no column 'nix'; there are number, key, speed", sweep.rows, ["nix"])
    refused("no column 'nix'", sweep.grouped, ["nix"])
    refused("outcome is a text", sweep.grouped, ["kind"], ["outcome"])
    refused("by: passed is a column of what comes out", sweep.grouped, ["passed"])
    refused('sql: .*Referenced column "nix" not found', sweep.sql, "SELECT nix FROM runs")
    refused("sql: expected a query", sweep.sql, " ")
    refused("no finished run has the key 'nix'", sweep.run, "nix")
    key = f"{3:016x}"
    refused(f"record of {key} was not kept; vve-sumo sweep --rerun {sweep.folder} {key} makes it", sweep.run, key)
    monkeypatch.setitem(sys.modules, "duckdb", None)
    refused(r"needs DuckDB: pip install 'vve-sumo\[sql\]'", sweep.sql, "SELECT 1")


def test_a_certificates_case_without_a_record_is_not_to_be_driven_again(tmp_path: Path) -> None:
    plan = replace(PLAN, design="certificate")
    dataset = Dataset(tmp_path, plan, resume=True)
    dataset.add(cell(0)._replace(key="radar_freeze_seed_1"), result(0))
    dataset.close()
    with pytest.raises(ConfigError) as caught:
        Sweep(tmp_path).run("radar_freeze_seed_1")
    assert "no record of radar_freeze_seed_1: its case was not driven" in str(caught.value)
    assert str(tmp_path / "records" / "radar_freeze_seed_1") in str(caught.value)
    assert "--rerun" not in str(caught.value)


def test_what_a_search_found(tmp_path: Path) -> None:
    fill(tmp_path)
    assert Sweep(tmp_path).search_result is None
    reported = {"search": "worst", "lowest": "stop_gap_m", "worst": None}
    (tmp_path / "search.json").write_text(json.dumps(reported), encoding="utf-8")
    assert Sweep(tmp_path).search_result == reported
    (tmp_path / "search.json").write_text("[]", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"search\.json: not what a search writes"):
        _ = Sweep(tmp_path).search_result
