"""Pairs of runs: differences, signs and two-by-two tables against counting by hand; what cannot be paired."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from vve_sumo.analysis.paired import SEED, VERDICTS, compare_rows
from vve_sumo.analysis.resampling import bootstrap_median, sign_test
from vve_sumo.errors import ConfigError


def side(change: float, seeds: range = range(1, 4), **more: Any) -> pd.DataFrame:
    """Runs over speed and seed whose gap changes with both, and by so much everywhere; below zero they have none."""
    rows = pd.DataFrame(itertools.product((5.0, 10.0), seeds), columns=["speed", SEED])
    gap = 4.0 - 0.35 * rows["speed"] + 0.1 * rows[SEED] + change
    columns = {"passed": gap > 1.0, "collision": gap < 0.0, "stop_gap_m": gap.where(gap >= 0.0)}
    return rows.assign(**columns, **more).astype({"passed": "boolean", "collision": "boolean"})


def test_pairs_have_the_seed_and_the_parameters_in_common_in_whatever_order_they_come() -> None:
    one, other = side(0.0), side(0.25, range(2, 6)).iloc[::-1]
    compared = compare_rows(one, other, ["speed"], figures=["stop_gap_m"])
    assert len(compared.pairs) == 4
    assert compared.unpaired == (2, 4)
    assert compared.difference("stop_gap_m") == pytest.approx([0.25] * 4)
    row = compared.figures.loc["stop_gap_m"]
    assert (row["pairs"], row["lower"], row["same"], row["higher"]) == (4, 0, 0, 4)
    assert row["median_difference"] == pytest.approx(0.25)
    assert row["worse"] == "lower"


def test_who_has_no_gap_is_counted_and_in_no_difference() -> None:
    compared = compare_rows(side(0.0), side(-1.0), ["speed"], figures=["stop_gap_m"])
    row = compared.figures.loc["stop_gap_m"]
    # At 10 m/s gaps of 0.6 to 0.8 m become collisions.
    assert (row["pairs"], row["only_one"], row["only_other"], row["lower"]) == (3, 3, 0, 6)  # a contact is less
    assert row["sign_test_p"] == 2.0 / 2.0**6
    assert compared.verdicts.loc["collision"].tolist() == [0, 0, 3, 3, 0.25]
    assert compared.verdicts.loc["passed"].tolist() == [3, 0, 0, 3, 1.0]


@pytest.mark.parametrize("behind", [40.0, -2.0])
def test_what_was_measured_of_a_contact_is_in_no_difference(behind: float) -> None:
    """A car that drove through an obstacle has a gap to what stood behind, or the depth of an overlap."""
    one, other = side(0.0), side(-1.0)
    other["stop_gap_m"] = other["stop_gap_m"].fillna(behind)
    compared = compare_rows(one, other, ["speed"], figures=["stop_gap_m"])
    wanted = compare_rows(one, side(-1.0), ["speed"], figures=["stop_gap_m"])
    pd.testing.assert_frame_equal(compared.figures, wanted.figures)
    np.testing.assert_array_equal(compared.difference("stop_gap_m"), wanted.difference("stop_gap_m"))


def test_a_drive_without_a_conflict_is_better_than_any_with_one() -> None:
    """The other has no conflict in four of six pairs, and a little less time in the two that are left."""
    rows = {"seed": range(1, 8), "collision": [False] * 7, "error": ["", "", "", "", "", "", "killed"]}
    one = pd.DataFrame(rows | {"min_ttc_s": [1.0] * 7, "max_drac_mps2": [3.0] * 7, "error": ""})
    ttc = [math.nan] * 4 + [0.9, 0.9, math.nan]
    other = pd.DataFrame(rows | {"min_ttc_s": ttc, "max_drac_mps2": [math.nan] * 4 + [3.1, 3.1, math.nan]})
    figures = compare_rows(one, other, [], figures=["min_ttc_s", "max_drac_mps2"]).figures
    row = figures.loc["min_ttc_s"]
    assert (row["lower"], row["same"], row["higher"], row["pairs"], row["only_one"]) == (2, 0, 4, 2, 5)
    assert row["sign_test_p"] == pytest.approx(stats.binomtest(2, 6).pvalue)
    row = figures.loc["max_drac_mps2"]
    assert (row["lower"], row["same"], row["higher"]) == (4, 0, 2)
    none = compare_rows(other, other, [], figures=["min_ttc_s"])
    assert none.figures.loc["min_ttc_s", ["lower", "same", "higher"]].tolist() == [0, 6, 0]
    assert not [name for name in none.pairs if "error" in name]


@settings(deadline=None)
@given(st.integers(0, 60), st.integers(0, 60))
def test_the_sign_test_and_mcnemars_are_scipys_exact_binomial_test(fewer: int, more: int) -> None:
    wanted = stats.binomtest(fewer, fewer + more).pvalue if fewer + more else 1.0
    assert sign_test(fewer, more) == pytest.approx(wanted)


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize("count", [2, 3, 10, 41, 200])
def test_the_interval_of_a_median_is_the_percentile_bootstraps(count: int) -> None:
    values = np.random.default_rng(count).gamma(2.0, 3.0, count)
    resampled = np.random.default_rng(1).choice(values, (40_000, count))
    wanted = np.quantile(np.median(resampled, axis=1), (0.025, 0.975))
    found = bootstrap_median(values)
    # Of few values a quantile jumps between neighbours.
    near = 0.0 if count < 20 else 0.06 * float(values.std())
    assert found.low == pytest.approx(wanted[0], abs=1e-9 + near)
    assert found.high == pytest.approx(wanted[1], abs=1e-9 + near)
    assert bootstrap_median(values) == found, "the same pairs have the same interval"
    assert all(math.isnan(end) for end in bootstrap_median(values[:1]))


@pytest.mark.thorough
def test_the_interval_of_a_median_covers_it_about_as_often_as_it_says() -> None:
    chance = np.random.default_rng(7)
    samples = (chance.normal(1.0, 2.0, 30) for _ in range(400))
    covered = [found.low <= 1.0 <= found.high for found in map(bootstrap_median, samples)]
    assert 0.91 < np.mean(covered) < 0.985


@pytest.mark.thorough
@settings(deadline=None)
@given(st.lists(st.tuples(*[st.sampled_from([1.0, 2.0, math.nan])] * 2, *[st.sampled_from([True, False, None])] * 2)))
def test_every_pair_is_counted_once(pairs: list[tuple[float, float, bool | None, bool | None]]) -> None:
    if not pairs:
        return
    sides = []
    for number in range(2):
        verdicts = pd.array([pair[2 + number] for pair in pairs], "boolean")
        gaps = [pair[number] for pair in pairs]
        sides.append(pd.DataFrame({SEED: range(len(pairs)), "stop_gap_m": gaps, "passed": verdicts}))
    compared = compare_rows(*sides, [], figures=["stop_gap_m"])
    row = compared.figures.loc["stop_gap_m"]
    both = [(a, b) for a, b, *_ in pairs if a == a and b == b]
    signs = [int(np.sign(b - a)) for a, b in both]
    assert [row["lower"], row["same"], row["higher"]] == [signs.count(-1), signs.count(0), signs.count(1)]
    assert (row["only_one"], row["only_other"]) == (
        sum(a == a and b != b for a, b, *_ in pairs),
        sum(a != a and b == b for a, b, *_ in pairs),
    )
    wanted = np.median([b - a for a, b in both]) if both else math.nan
    assert row["median_difference"] == pytest.approx(wanted, nan_ok=True)
    verdicts = [pair[2:] for pair in pairs]
    kinds = [(True, True), (True, False), (False, True), (False, False)]
    found = compared.verdicts.loc["passed", list(VERDICTS)].tolist()
    counts = [verdicts.count(kind) for kind in kinds]
    assert found == [*counts, pytest.approx(sign_test(counts[1], counts[2]))]


def test_what_cannot_be_paired_is_one_line() -> None:
    with pytest.raises(ConfigError, match=r"one: several runs have seed = 1: pick one of each by its other parameters"):
        compare_rows(side(0.0), side(1.0), [])
    with pytest.raises(ConfigError, match="one and other have no pair: no run of both has the same speed, seed"):
        compare_rows(side(0.0), side(0.0).assign(speed=7.0).drop_duplicates("seed"), ["speed"])
    with pytest.raises(
        ConfigError, match=r"other: no column 'speed' to pair by; did you mean 'seed'\?; there are seed"
    ):
        compare_rows(side(0.0), side(0.0)[["seed"]], ["speed"])
    with pytest.raises(ConfigError, match="the pairs have no figure 'nix'; there are stop_gap_m"):
        compare_rows(side(0.0), side(1.0), ["speed"], figures=["stop_gap_m"]).difference("nix")
