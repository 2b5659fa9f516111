"""What rows come to: intervals against closed forms and scipy's own."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from vve_sumo.analysis.groups import grouped, numbered, repeated_by_seed
from vve_sumo.statistics import wilson
from vve_sumo.sweep.conclusion import outcome


@given(st.integers(1, 500), st.data())
def test_wilsons_interval_is_scipys(judged: int, data: st.DataObject) -> None:
    passed = data.draw(st.integers(0, judged))
    found = stats.binomtest(passed, judged).proportion_ci(0.95, method="wilson")
    assert wilson(passed, judged) == pytest.approx((found.low, found.high), abs=1e-12)


def test_nothing_judged_says_nothing() -> None:
    assert wilson(0, 0) == (0.0, 1.0)


def row(speed: float, passed: bool | None, gap: float | None, error: str = "") -> dict[str, Any]:
    hit = None if passed is None else not passed
    return {"speed": speed, "passed": passed, "stop_gap_m": gap, "error": error, "collision": hit, "outcome": None}


def table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    frame = pd.DataFrame(rows).assign(seed=range(1, len(rows) + 1))
    return frame.astype({"passed": "boolean", "collision": "boolean", "stop_gap_m": float})


def groups(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    frame = table(rows)
    by_chance = repeated_by_seed(frame, numbered(frame, ["speed"]), ["speed"])
    return grouped(frame, ["speed"], ["stop_gap_m"], by_chance).to_dict("records")


def test_runs_are_grouped_and_faults_and_collisions_stand_beside() -> None:
    rows = [row(1.0, True, 5.0), row(2.0, False, None), row(1.0, None, None, "timed_out"), row(1.0, True, 6.0)]
    first, second = groups(rows)
    counts = ("speed", "runs", "judged", "passed", "errors", "collisions", "stop_gap_m_count")
    assert [first[name] for name in counts] == [1.0, 3, 2, 2, 1, 0, 2]
    assert [second[name] for name in counts] == [2.0, 1, 1, 0, 0, 1, 0]
    assert (first["mean_stop_gap_m"], first["worst_stop_gap_m"]) == (5.5, 5.0)
    came = outcome(table(rows).assign(failed=None), pd.DataFrame())
    assert [came.all[name] for name in ("runs", "judged", "passed", "errors")] == [4, 3, 2, 1]
    assert list(came.lines()) == ["1 x timed_out"]


def test_a_contact_is_in_no_mean_of_gaps_and_is_the_worst() -> None:
    rows = [row(1.0, True, 5.0), row(1.0, False, -0.4), row(1.0, False, 30.0), row(1.0, False, None)]
    (group,) = groups(rows)
    assert (group["mean_stop_gap_m"], group["stop_gap_m_count"], group["collisions"]) == (5.0, 1, 3)
    assert group["worst_stop_gap_m"] == 0.0


def test_what_runs_did_not_meet_is_counted_by_criterion_the_most_frequent_first() -> None:
    gap, hit = "stop_gap_m is 4.100, expected 4.5 to 5.5", "collision is True, expected False"
    missed = [f"{gap}; {hit}", f"{hit}", "", None]
    rows = table([row(1.0, not line, 5.0) | {"failed": line} for line in missed])
    assert list(outcome(rows, pd.DataFrame()).unmet_lines()) == [
        f"collision not met by 2 of 4, as: {hit}",
        f"gap at rest not met by 1 of 4, as: {gap}",
    ]


@pytest.mark.parametrize(
    ("gaps", "by_chance"), [([5.0, 5.0, 5.0], False), ([5.0, 5.0, 5.1], True), ([5.0], False), ([5.0, None], True)]
)
def test_there_is_an_interval_where_seeds_made_the_runs_differ(gaps: list[float | None], by_chance: bool) -> None:
    (group,) = groups([row(1.0, True, gap) for gap in gaps])
    nothing = (math.nan, math.nan)
    interval = wilson(len(gaps), len(gaps)) if by_chance else nothing
    assert (group["passed_low_share"], group["passed_high_share"]) == pytest.approx(interval, nan_ok=True)
    known = [gap for gap in gaps if gap is not None]
    spread = stats.sem(known) * stats.t.ppf(0.975, len(known) - 1) if by_chance and len(known) > 1 else math.nan
    assert group["half_width_stop_gap_m"] == pytest.approx(spread, nan_ok=True)


def test_a_run_with_an_error_does_not_make_the_others_differ_by_chance() -> None:
    rows = [row(1.0, True, 5.0), row(1.0, None, None, "killed"), row(1.0, True, 5.0)]
    for order in (rows, rows[::-1], [rows[1], rows[0], rows[2]]):
        (group,) = groups(order)
        assert (group["runs"], group["judged"], group["errors"]) == (3, 2, 1)
        assert math.isnan(group["passed_low_share"])
        assert math.isnan(group["half_width_stop_gap_m"])
