"""What rows come to: intervals against closed forms and scipy's own."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from vve_sumo.statistics import Mean, wilson
from vve_sumo.sweep.statistics import outcome


@given(st.integers(1, 500), st.data())
def test_wilsons_interval_is_scipys(judged: int, data: st.DataObject) -> None:
    passed = data.draw(st.integers(0, judged))
    found = stats.binomtest(passed, judged).proportion_ci(0.95, method="wilson")
    assert wilson(passed, judged) == pytest.approx((found.low, found.high), abs=1e-12)


def test_nothing_judged_says_nothing() -> None:
    assert wilson(0, 0) == (0.0, 1.0)


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=30))
def test_a_mean_and_its_interval_are_scipys(values: list[float]) -> None:
    mean = Mean()
    for value in values:
        mean.add(value)
    assert mean.mean == pytest.approx(np.mean(values), abs=1e-9)
    assert (mean.least, mean.greatest) == (min(values), max(values))
    assert mean.half == pytest.approx(stats.sem(values) * stats.t.ppf(0.975, len(values) - 1), rel=1e-6, abs=1e-9)


def test_a_single_number_has_no_interval() -> None:
    mean = Mean()
    assert math.isnan(mean.mean)
    mean.add(4.0)
    assert mean.mean == 4.0
    assert math.isnan(mean.half)


def row(speed: float, passed: bool | None, gap: float | None, error: str = "") -> dict[str, Any]:
    hit = None if passed is None else not passed
    return {"speed": speed, "passed": passed, "stop_gap_m": gap, "error": error, "collision": hit, "outcome": None}


def test_runs_are_grouped_and_faults_and_collisions_stand_beside() -> None:
    rows = [row(1.0, True, 5.0), row(2.0, False, None), row(1.0, None, None, "timed_out"), row(1.0, True, 6.0)]
    came = outcome(rows, ["speed"], ["stop_gap_m"])
    first, second = came.groups[(1.0,)], came.groups[(2.0,)]
    assert list(came.groups) == [(1.0,), (2.0,)]
    assert (first.runs, first.judged, first.passed, first.means["stop_gap_m"].mean) == (3, 2, 2, 5.5)
    assert (first.errors, first.collisions, first.worst("stop_gap_m")) == (1, 0, 5.0)
    assert (second.runs, second.judged, second.passed, second.means["stop_gap_m"].count) == (1, 1, 0, 0)
    assert second.collisions == 1
    assert (came.all.runs, came.all.judged, came.all.passed) == (4, 3, 2)
    assert list(came.lines()) == ["1 x timed_out"]


def test_a_contact_is_in_no_mean_of_gaps_and_is_the_worst() -> None:
    rows = [row(1.0, True, 5.0), row(1.0, False, -0.4), row(1.0, False, 30.0), row(1.0, False, None)]
    (group,) = outcome(rows, ["speed"], ["stop_gap_m"]).groups.values()
    assert (group.means["stop_gap_m"].mean, group.means["stop_gap_m"].count, group.collisions) == (5.0, 1, 3)
    assert group.worst("stop_gap_m") == 0.0


def test_what_runs_did_not_meet_is_counted_by_criterion_the_most_frequent_first() -> None:
    gap, hit = "stop_gap_m is 4.100, expected 4.5 to 5.5", "collision is True, expected False"
    missed = [f"{gap}; {hit}", f"{hit}", "", None]
    came = outcome([row(1.0, not line, 5.0) | {"failed": line} for line in missed], ["speed"], [])
    assert list(came.unmet_lines()) == [
        f"collision not met by 2 of 4, as: {hit}",
        f"gap at rest not met by 1 of 4, as: {gap}",
    ]


@pytest.mark.parametrize(
    ("gaps", "by_chance"), [([5.0, 5.0, 5.0], False), ([5.0, 5.0, 5.1], True), ([5.0], False), ([5.0, None], True)]
)
def test_there_is_an_interval_where_seeds_made_the_runs_differ(gaps: list[float | None], by_chance: bool) -> None:
    group = outcome([row(1.0, True, gap) for gap in gaps], ["speed"], ["stop_gap_m"]).groups[(1.0,)]
    assert group.interval == (wilson(len(gaps), len(gaps)) if by_chance else None)
    known = [gap for gap in gaps if gap is not None]
    spread = stats.sem(known) * stats.t.ppf(0.975, len(known) - 1) if by_chance and len(known) > 1 else math.nan
    assert group.half("stop_gap_m") == pytest.approx(spread, nan_ok=True)


def test_a_run_with_an_error_does_not_make_the_others_differ_by_chance() -> None:
    rows = [row(1.0, True, 5.0), row(1.0, None, None, "killed"), row(1.0, True, 5.0)]
    for order in (rows, rows[::-1], [rows[1], rows[0], rows[2]]):
        group = outcome(order, ["speed"], ["stop_gap_m"]).groups[(1.0,)]
        assert (group.runs, group.judged, group.errors) == (3, 2, 1)
        assert group.interval is None
        assert math.isnan(group.half("stop_gap_m"))
