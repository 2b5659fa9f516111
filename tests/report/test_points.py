"""Which runs and which ticks the page shows of very many: whatever matters, and a fair draw of the rest."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.report.curves import thinned
from vve_sumo.report.points import MAX_RUNS, points


def rows_of(count: int, failing: int, chance: np.random.Generator) -> pd.DataFrame:
    """Runs over a grid of four speeds of which some fail, some of them without a gap, and some have an error."""
    failed = np.isin(np.arange(count), chance.choice(count, failing, replace=False))
    error = np.arange(count) % 4999 == 17
    gap = np.where(failed & (np.arange(count) % 2 == 0), np.nan, chance.normal(5.0, 1.0, count))
    gap[count // 3] = 77.0
    frame = pd.DataFrame({"speed": np.arange(count) % 4, "stop_gap_m": np.where(error, np.nan, gap)})
    frame = frame.assign(key=[f"{number:x}" for number in range(count)], seed=1, error=np.where(error, "timed_out", ""))
    passed = pd.array(np.where(error, None, ~failed), "boolean")
    return frame.assign(passed=passed, collision=pd.array([False] * count, "boolean"), outcome="stopped", failed="")


@pytest.mark.parametrize(("count", "failing"), [(100, 10), (4000, 400), (100_000, 37), (100_000, 5000)])
def test_every_failure_error_and_extreme_is_shown_and_the_rest_is_a_fair_draw(count: int, failing: int) -> None:
    rows = rows_of(count, failing, np.random.default_rng(5))
    reported = points(rows, ["speed"], ["stop_gap_m"])
    assert reported is not None
    shown = set(reported["key"])
    assert len(shown) == len(reported["key"])
    matters = rows[rows["passed"].eq(False).fillna(False) | rows["error"].ne("")]
    assert set(matters["key"]) <= shown
    assert reported["passed"].count(False) == len(rows[rows["passed"].eq(False)])
    assert rows["key"][rows["stop_gap_m"].idxmax()] in shown
    assert rows["key"][rows["stop_gap_m"].idxmin()] in shown
    assert len(shown) <= max(MAX_RUNS, len(matters) + MAX_RUNS // 2) + 4
    # Every k-th row of this grid would be of one speed: each of the four has about its share.
    (speeds,) = (column["values"] for column in reported["x"] if column["label"] == "speed")
    passing = [speed for speed, passed in zip(speeds, reported["passed"], strict=True) if passed]
    for speed in range(4):
        assert passing.count(speed) / len(passing) == pytest.approx(0.25, abs=0.06)
    assert points(rows, ["speed"], ["stop_gap_m"]) == reported, "the same whenever it is written"


VALUES = st.lists(st.one_of(st.floats(-100.0, 100.0), st.just(math.nan)), min_size=40, max_size=400)


@given(VALUES, st.integers(3, 30))
def test_thinned_curves_keep_the_extremes_of_every_stretch_and_the_edges_of_every_gap(
    values: list[float], most: int
) -> None:
    one, other = np.array(values), np.arange(float(len(values)))
    shown = thinned([one, other], most)
    assert np.all(np.diff(shown) > 0)
    if np.isfinite(one).any():
        assert np.nanmin(one[shown]) == np.nanmin(one)
        assert np.nanmax(one[shown]) == np.nanmax(one)
    edges = np.linspace(0, len(values), 1 + max(1, most // 5)).round().astype(int)
    for begin, end in itertools.pairwise(edges.tolist()):
        part, kept = one[begin:end], one[shown[(shown >= begin) & (shown < end)]]
        if np.isfinite(part).any():
            assert (np.nanmin(kept), np.nanmax(kept)) == (np.nanmin(part), np.nanmax(part))
    for before, after in itertools.pairwise(shown.tolist()):
        # What a line joins is known all the way between.
        if np.isfinite(one[[before, after]]).all():
            assert np.isfinite(one[before : after + 1]).all()


def test_few_ticks_are_all_shown_and_many_are_about_as_many_as_asked_for() -> None:
    time = np.linspace(0.0, 600.0, 30_000)
    columns = [np.sin(time * factor) for factor in range(1, 10)]
    columns[0][12_345] = 50.0  # a peak of one tick
    assert thinned([column[:3000] for column in columns], 3000).tolist() == list(range(3000))
    shown = thinned(columns, 3000)
    assert 1500 < len(shown) <= 3000 + 10
    assert 12_345 in shown
