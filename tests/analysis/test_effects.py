"""Variance explained, against closed forms and scipy's analysis of variance; which axes a plot gets."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from vve_sumo.analysis import variance_explained
from vve_sumo.analysis.effects import LEVELS, Axes, chosen_axes
from vve_sumo.errors import ConfigError

LINEAR = {"a": 3.0, "b": 1.0, "c": 0.0}


def crossed() -> pd.DataFrame:
    """A full grid of three numbers, of which a figure is a sum with the weights of LINEAR."""
    rows = pd.DataFrame(itertools.product((-1.0, 0.0, 1.0), repeat=3), columns=list(LINEAR))
    return rows.assign(gap_m=sum(weight * rows[name] for name, weight in LINEAR.items()))


def test_a_sum_over_a_grid_is_shared_out_by_the_squares_of_its_weights() -> None:
    found = variance_explained(crossed(), "gap_m", ["c", "b", "a"])
    assert list(found.index) == ["a", "b", "c"]
    assert found["explained_share"].tolist() == pytest.approx([0.9, 0.1, 0.0])
    assert found["runs"].tolist() == [27] * 3
    assert found["levels"].tolist() == [3] * 3
    assert all(found.attrs["meanings"].values())


@settings(deadline=None)  # the first import of scipy's statistics takes a while
@given(st.lists(st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=6), min_size=2, max_size=5))
def test_the_shares_follow_from_scipys_rank_test(parts: list[list[float]]) -> None:
    values, level = np.concatenate(parts), np.repeat(range(len(parts)), [len(part) for part in parts])
    if len(values) == len(parts) or len(set(values.tolist())) < 2:
        return
    (row,) = variance_explained(pd.DataFrame({"level": level, "gap_m": values}), "gap_m", ["level"]).to_dict("records")
    h, runs, levels = stats.kruskal(*parts).statistic, len(values), len(parts)
    assert row["explained_share"] == pytest.approx(h / (runs - 1), abs=1e-9)
    assert row["adjusted_share"] == pytest.approx((h - levels + 1) / (runs - levels), abs=1e-9)


def study_of_delay() -> pd.DataFrame:
    """From half a second of delay on every run collides: what is left among the others comes of the paint alone."""
    rows = pd.DataFrame(
        itertools.product(np.linspace(0.0, 1.0, 11), (0.0, 1.0), range(5)), columns=["delay", "paint", "n"]
    )
    hit = rows["delay"] > 0.45
    gap = 5.0 + rows["paint"] + 0.01 * rows["n"] - 0.001 * rows["delay"]
    measured = np.resize([np.nan, -0.3, 25.0], len(rows))  # nothing, an overlap, what stands behind
    return rows.assign(collision=hit, error="", stop_gap_m=np.where(hit, measured, gap))


def test_runs_that_collided_take_part_and_rank_lowest() -> None:
    rows = study_of_delay()
    found = variance_explained(rows, "stop_gap_m", ["paint", "delay"])
    assert list(found.index) == ["delay", "paint"]
    assert found.loc["delay", ["runs", "contacts", "without"]].tolist() == [110, 60, 0]
    ordered = np.where(rows["collision"], -99.0, rows["stop_gap_m"])
    for name in ("delay", "paint"):
        h = stats.kruskal(*(ordered[rows[name] == value] for value in rows[name].unique())).statistic
        assert found.loc[name, "explained_share"] == pytest.approx(h / (len(rows) - 1))
    assert found.loc["delay", "explained_share"] > 0.5
    assert chosen_axes(rows, "stop_gap_m", ["paint", "delay"]) == Axes("delay", "paint", None)
    drac = variance_explained(rows.assign(max_drac_mps2=-rows["stop_gap_m"]), "max_drac_mps2", ["paint", "delay"])
    assert drac["explained_share"].tolist() == pytest.approx(found["explained_share"].tolist())


def test_a_run_without_any_conflict_ranks_as_one_with_an_endless_time_and_one_with_an_error_not_at_all() -> None:
    rows = pd.DataFrame({"speed": [1.0, 1.0, 2.0, 2.0, 3.0], "min_ttc_s": [math.nan, math.nan, 2.0, 1.0, math.nan]})
    rows = rows.assign(error=["", "", "", "", "timed_out"], collision=[False, False, False, False, None])
    (row,) = variance_explained(rows, "min_ttc_s", ["speed"]).to_dict("records")
    assert (row["runs"], row["without"], row["levels"]) == (4, 1, 2)
    assert row["explained_share"] == pytest.approx(stats.kruskal([9.0, 9.0], [2.0, 1.0]).statistic / 3.0)


def test_runs_without_the_figure_take_no_part_and_truth_values_do() -> None:
    rows = crossed()
    rows.loc[rows["a"] > 0.0, "gap_m"] = math.nan
    assert variance_explained(rows, "gap_m", ["a"]).loc["a", ["levels", "runs", "without"]].tolist() == [2, 18, 9]
    rows["passed"] = pd.array([value > 0.5 for value in rows["b"]], "boolean")
    assert variance_explained(rows, "passed", ["a", "b"])["explained_share"].tolist() == pytest.approx([1.0, 0.0])


def test_a_drawn_parameter_counts_by_portions_and_chance_explains_nothing() -> None:
    chance = np.random.default_rng(1)
    rows = pd.DataFrame({"speed": chance.uniform(5.0, 15.0, 2000), "other": chance.uniform(0.0, 1.0, 2000)})
    found = variance_explained(rows.assign(gap_m=2.0 * rows["speed"]), "gap_m", ["other", "speed"])
    assert found["levels"].tolist() == [LEVELS] * 2
    # Within a tenth of an even range, a tenth of the deviation is left.
    assert found["explained_share"].tolist() == pytest.approx([0.99, 0.0], abs=0.01)
    assert found.loc["other", "adjusted_share"] == pytest.approx(0.0, abs=0.005)


@pytest.mark.parametrize("rows", [crossed().assign(gap_m=0.3), crossed().assign(a=1.0), crossed().iloc[:0]])
def test_where_nothing_varies_nothing_is_explained(rows: pd.DataFrame) -> None:
    assert math.isnan(variance_explained(rows, "gap_m", ["a"]).loc["a", "explained_share"])


def test_numbers_that_matter_become_axes_and_the_controller_never_does() -> None:
    rows = pd.concat([crossed().assign(**{"controller.name": name, "road": "dry"}) for name in ("one", "other")])
    rows["gap_m"] += np.where(rows["controller.name"] == "one", 100.0, 0.0)
    parameters = ["controller.name", "road", "c", "b", "a"]
    assert chosen_axes(rows, "gap_m", parameters) == Axes("a", "b", "controller.name")
    assert chosen_axes(rows[rows["controller.name"] == "one"], "gap_m", parameters) == Axes("a", "b", None)
    rows["tuning"] = rows["b"].where(rows["controller.name"] == "one")  # of which the other has none
    assert chosen_axes(rows, "gap_m", ["controller.name", "tuning", "a"]) == Axes("a", None, "controller.name")
    assert chosen_axes(rows[rows["b"] == rows["c"]], "gap_m", ["road", "a"]) == Axes("a", None, None)


def test_a_second_axis_is_what_matters_where_the_first_is_the_same() -> None:
    """Over all runs neither of the other two explains much; at one speed the delay explains everything."""
    cells = itertools.product((1.0, 20.0, 40.0), (0.0, 1.0, 2.0), (1.0, 2.0), (1, 2))
    rows = pd.DataFrame(cells, columns=["speed", "delay", "lot", "seed"])
    rows["gap_m"] = 10.0 * rows["speed"] - 2.0 * rows["delay"] + 0.5 * rows["lot"]
    assert chosen_axes(rows, "gap_m", ["lot", "delay", "speed"]) == Axes("speed", "delay", None)


def test_a_column_that_is_not_there_is_one_line() -> None:
    with pytest.raises(ConfigError, match="no column 'nix'; there are a, b, c, gap_m"):
        variance_explained(crossed(), "gap_m", ["nix"])
