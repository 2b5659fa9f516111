"""Plots of sweeps and searches: what is drawn equals the rows."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from tests.plotting.reading import labelled, lines
from tests.plotting.runs_and_sweeps import cliff_rows, rows_of, searched, survivors
from vve_sumo import plotting
from vve_sumo.analysis import latency_margin as study
from vve_sumo.analysis.paired import compare_rows
from vve_sumo.errors import ConfigError
from vve_sumo.plotting import crowd, parts


def test_gaps_at_rest_are_the_rows_and_what_has_none_is_marked(figures: dict[str, Figure]) -> None:
    rows = rows_of(300)
    hit, error = rows["collision"].eq(True).fillna(False), rows["error"] != ""
    at_rest = rows[~hit & ~error]
    x, y = labelled(figures["gaps"], f"gap at rest \\({len(at_rest)} runs")
    assert sorted(zip(x, y, strict=True)) == sorted(zip(at_rest["ego.speed_mps"], at_rest["stop_gap_m"], strict=True))
    x, y = labelled(figures["gaps"], f"collision \\({hit.sum()} runs")
    assert x.tolist() == rows[hit]["ego.speed_mps"].tolist()
    assert y.tolist() == rows[hit]["stop_gap_m"].tolist()
    assert labelled(figures["gaps"], f"error \\({error.sum()} runs")[0].tolist() == sorted(rows[error]["ego.speed_mps"])


def test_stops_lie_beside_the_closed_form_and_broken_bounds_are_marked(figures: dict[str, Figure]) -> None:
    rows = rows_of(300).dropna(subset="stop_distance_m")
    v, law = labelled(figures["stops"], "v τ")
    delay, demand = rows["stop_reaction_s"].median(), rows["stop_demand_mps2"].median()
    assert law == pytest.approx(v * delay + v * v / (2.0 * demand))
    above, below = lines(figures["stops"], f"stops ({len(rows)} runs)")
    assert above.tolist() == [rows["stop_onset_speed_mps"].tolist(), rows["stop_distance_m"].tolist()]
    assert below[1] == pytest.approx(np.where(rows["number"] % 7 == 1, 0.2, 0.0))
    broken = rows[rows["number"] % 7 == 1]
    marked = labelled(figures["stops"], f"bound broken \\({len(broken)} runs")
    assert marked.tolist() == [broken["stop_onset_speed_mps"].tolist(), broken["stop_distance_m"].tolist()]


def test_many_points_become_the_quantiles_of_their_portions() -> None:
    rows = rows_of(4 * crowd.MAX_POINTS)
    rows = rows[~rows["collision"]]
    figure = plotting.gap_against_speed(rows)
    x, middle = lines(figure, "gap at rest, median")[0]
    v, gap = rows["ego.speed_mps"].to_numpy(), rows["stop_gap_m"].to_numpy()
    half = (v.max() - v.min()) / crowd.PORTIONS / 2.0
    for n in (0, 17, 49):
        part = gap[(v >= x[n] - half) & (v <= x[n] + half) & np.isfinite(gap)]
        assert middle[n] == pytest.approx(np.median(part), abs=1e-9)
    band = next(one for one in figure.axes[0].collections if one.get_label() == "middle 90 %")
    n = int(np.argmin(np.abs(x - 10.0)))
    part = gap[(v >= x[n] - half) & (v <= x[n] + half) & np.isfinite(gap)]
    corners = band.get_paths()[0].vertices
    there = corners[np.isclose(corners[:, 0], x[n]), 1]
    assert [there.min(), there.max()] == pytest.approx(np.quantile(part, [0.05, 0.95]))


def test_a_heat_map_holds_the_means_and_misses_what_is_missing() -> None:
    rows = pd.DataFrame({"a": [1, 1, 2, 2, 3], "b": ["x", "x", "y", "y", "x"], "gap_m": [1.0, 3.0, 5.0, math.nan, 7.0]})
    figure = plotting.heat_map(rows, "a", "b", "gap_m")
    (mesh,) = [one for one in figure.axes[0].collections if one.get_array() is not None]
    wanted = rows.pivot_table(index="b", columns="a", values="gap_m").to_numpy()
    assert np.asarray(mesh.get_array().filled(np.nan)) == pytest.approx(wanted, nan_ok=True)
    # Beneath each mean how many runs it is of; there is one that lacks the figure.
    assert [text.get_text() for text in figure.axes[0].texts] == ["2", "n = 2", "7", "n = 1", "5", "1 of 2"]
    hatched = [patch.get_xy() for patch in figure.axes[0].patches if patch.get_hatch() == "..."]
    assert hatched == [(0.5, 0.5)]
    assert mesh.cmap.name == "cividis"
    assert [text.get_text() for text in figure.axes[0].get_xticklabels()] == ["1", "2", "3"]


def test_a_map_of_a_truth_value_holds_the_share_of_runs_that_came_to_an_end(figures: dict[str, Figure]) -> None:
    (mesh,) = [one for one in figures["shares"].axes[0].collections if one.get_array() is not None]
    share = rows_of(300).groupby("delay")["passed"].mean()
    assert np.asarray(mesh.get_array())[0] == pytest.approx(100.0 * share.to_numpy(float))
    assert mesh.get_clim() == (0.0, 100.0)


def test_a_drawn_parameter_is_cut_into_portions(figures: dict[str, Figure]) -> None:
    rows = rows_of(300)
    (mesh,) = [one for one in figures["map"].axes[0].collections if one.get_array() is not None]
    means = mesh.get_array().filled(np.nan)
    assert means.shape == (3, 24)
    v = rows["ego.speed_mps"]
    edges = np.linspace(v.min(), v.max(), 25)
    part = rows[(v >= edges[5]) & (v < edges[6]) & (rows["delay"] == 0.1)]
    assert means[1, 5] == pytest.approx(part["stop_gap_m"].mean())
    assert mesh.norm(0.0) == 0.5


def test_a_distribution_rises_by_the_share_of_the_runs(figures: dict[str, Figure]) -> None:
    rows = rows_of(300)
    every = rows[rows["delay"] == 0.1]
    part = np.sort(every["stop_gap_m"].dropna())
    x, share = labelled(figures["distribution"], f"^delay 0.1 s \\({len(part)} of {len(every)} runs")
    assert x[1:] == pytest.approx(part)
    assert share[1:] == pytest.approx(100.0 * np.arange(1, len(part) + 1) / len(every))  # it ends below 100 %
    assert lines(figures["distribution"], "limit")[0][0].tolist() == [0.5, 0.5]


def test_a_distribution_counts_who_drove_through_as_below_zero() -> None:
    figure = plotting.distribution(survivors(), "stop_gap_m", "controller.name")
    x, share = labelled(figure, r"^two \(8 of 10 runs, 2 collided\)")
    assert x.tolist() == [0.0, 0.0, *range(3, 11)]
    assert share.tolist() == [0.0, *range(20, 110, 10)]
    assert labelled(figure, r"^one \(10 runs\)")[1][-1] == 100.0
    rows = survivors()
    # Neither an overlap that was measured, nor a gap to what stood behind, is a gap.
    for measured in (-3.0, 40.0):
        rows.loc[rows["ego.speed_mps"].eq(14.0) & rows["collision"], "stop_gap_m"] = measured
        again = labelled(plotting.distribution(rows, "stop_gap_m", "controller.name"), r"^two \(8 of 10 runs, 2 coll")
        assert [part.tolist() for part in again] == [x.tolist(), share.tolist()]


@pytest.mark.parametrize("figure", ["stop_gap_m", "min_gap_m", "min_ttc_s", "max_drac_mps2"])
def test_every_plot_of_a_figure_counts_all_runs_with_a_contact(figure: str) -> None:
    """Whatever was measured of them: an overlap, what stands behind, or nothing."""
    rows = survivors()
    rows[figure] = np.where(rows["collision"], np.resize([-3.0, np.nan, 30.0], 20), rows["stop_gap_m"])
    hits = int(rows["collision"].sum())
    response = plotting.response(rows, "ego.speed_mps", figure)
    assert labelled(response, rf"^two: collided \({hits}\)")[0].tolist() == [13.0, 14.0]
    spread = plotting.distribution(rows, figure, "controller.name")
    assert labelled(spread, rf"^two \(8 of 10 runs, {hits} collided\)")[1][-1] == (80.0 if "drac" in figure else 100.0)
    map_ = plotting.heat_map(rows, "ego.speed_mps", "weather", figure)
    for drawn in (response, spread, map_):
        assert "18 of 20 runs" in drawn.get_suptitle()
        assert f"{hits} " in drawn.get_suptitle().partition("18 of 20 runs")[2]


def test_a_median_over_all_runs_counts_who_drove_through_and_ends_where_half_did() -> None:
    rows = survivors()
    rows["step"] = np.floor(rows["ego.speed_mps"] / 3.0)  # 5; 6, 7, 8; 9, 10, 11; 12, 13, 14
    figure = plotting.response(rows, "step", "stop_gap_m")
    x, middle = labelled(figure, r"^two: 8 of 10 runs")
    assert x.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert middle == pytest.approx([10.0, 8.0, 5.0, math.nan], nan_ok=True)
    assert labelled(figure, r"^two: collided \(2\)")[0].tolist() == [4.0]
    _x, share = labelled(plotting.response(rows, "step", "passed", facet="controller.name"), r"^10 runs")
    assert share.tolist() == [100.0] * 4
    with pytest.raises(ConfigError, match="expected a column of numbers, got 'weather'"):
        plotting.response(rows, "weather", "stop_gap_m")


def test_a_stopping_law_is_that_of_one_controller() -> None:
    figure = plotting.stopping_distance(survivors())
    for word, demand in (("one", 3.0), ("two", 2.0)):
        v, law = labelled(figure, f"^{word}: τ = 0 ms, a = {demand:.2f}")
        assert law == pytest.approx(v * v / 2.0 / demand)
    beside = plotting.stopping_distance(survivors(), facet="controller.name")
    assert len(beside.axes) == 4
    assert labelled(beside, "τ = 0 ms, a = 2.00").size  # each in a panel of its own


def test_gaps_of_controllers_have_looks_of_their_own_and_marks_of_their_own() -> None:
    figure = plotting.gap_against_speed(survivors())
    assert labelled(figure, r"^one: gap at rest \(10 runs\)")[1].tolist() == list(range(25, 15, -1))
    assert labelled(figure, r"^two: collision, no gap at rest \(2 runs\)")[0].tolist() == [13.0, 14.0]


def test_panels_hold_the_rows_of_their_value_on_the_same_axes_and_colours() -> None:
    figure = plotting.heat_map(survivors(), "ego.speed_mps", "weather", "stop_gap_m", by="controller.name")
    meshes = [one for axes in figure.axes[:2] for one in axes.collections if one.get_array() is not None]
    assert [axes.get_title("left") for axes in figure.axes[:2]] == ["one", "two"]
    assert meshes[0].get_clim() == meshes[1].get_clim() == (3.0, 25.0)
    assert meshes[1].get_array().compressed().tolist() == list(map(float, range(10, 2, -1)))
    # Text has neither unit nor number.
    assert figure.axes[0].get_ylabel() == "weather"
    both = plotting.heat_map(survivors(), "ego.speed_mps", "error", "passed", by="controller.name", facet="weather")
    assert [axes.get_title("left").replace("\n", " ") for axes in both.axes[:4]] == [
        "dry, one",
        "dry, two",
        "wet, one",
        "wet, two",
    ]


@pytest.mark.parametrize(
    ("by", "most"), [("ego.speed_mps", 3), ("ego.speed_mps", 20), ("controller.name", 6), (None, 6)]
)
def test_parts_hold_every_run_once(by: str | None, most: int) -> None:
    found = parts.parts_of(survivors(), by, most)
    assert len(found) <= most
    assert sum(part.which.astype(int) for part in found).tolist() == [1] * 20  # type: ignore[union-attr]


def test_rarer_texts_are_taken_together_and_missing_ones_apart() -> None:
    rows = pd.DataFrame({"kind": ["a", "b", "b", "c", "c", "c", "d", None]})
    found = {part.word: np.flatnonzero(part.which).tolist() for part in parts.parts_of(rows, "kind", 4)}
    assert found == {"c": [3, 4, 5], "b": [1, 2], "2 other values of kind": [0, 6], "without kind": [7]}


@pytest.mark.parametrize("ended", [0, 3])
def test_runs_that_the_gateway_stopped_are_told_of_beside_a_gap(ended: int) -> None:
    rows = survivors().assign(outcome=["fault"] * ended + ["stopped"] * (20 - ended))
    for figure in (
        plotting.heat_map(rows, "ego.speed_mps", "weather", "stop_gap_m"),
        plotting.distribution(rows, "stop_gap_m"),
        plotting.response(rows, "ego.speed_mps", "stop_gap_m"),
        plotting.gap_against_speed(rows),
    ):
        assert ("the gateway stopped 3 runs of these" in figure.get_suptitle()) == bool(ended)


@pytest.mark.thorough
def test_pairs_are_drawn_one_over_the_other_with_their_differences() -> None:
    one, two = (part.assign(seed=1) for _name, part in survivors().groupby("controller.name"))
    figure = plotting.paired(compare_rows(one, two, ["ego.speed_mps"], "first", "second"))
    assert "second minus first" in figure.get_suptitle()
    assert "95 % interval" in figure.get_suptitle()
    figure = plotting.paired(compare_rows(one, two, ["ego.speed_mps"], "one", "two"))
    assert labelled(figure, "^8 pairs")[:, :8].tolist() == [list(range(25, 17, -1)), list(range(10, 2, -1))]
    assert labelled(figure, r"^two has none \(2\)").tolist() == [[17.0, 16.0], [0.0, 0.0]]
    x, share = labelled(figure, "^median -15")
    assert set(x) == {-15.0}
    assert share[-1] == 80.0  # of ten pairs


@pytest.mark.parametrize(
    "plot",
    [
        lambda rows: plotting.heat_map(rows, "nix", "weather", "passed"),
        lambda rows: plotting.distribution(rows, "nix"),
        lambda rows: plotting.distribution(rows, "passed", "nix"),
        lambda rows: plotting.response(rows, "nix", "passed"),
        lambda rows: plotting.gap_against_speed(rows, by="nix"),
        lambda rows: plotting.stopping_distance(rows, facet="nix"),
    ],
)
def test_an_unknown_column_is_one_line(plot: Callable[[pd.DataFrame], Figure]) -> None:
    with pytest.raises(ConfigError, match=r"^the rows have no column 'nix'; there are ego\.speed_mps, controller"):
        plot(survivors())


def test_a_boundary_shows_every_run_and_where_it_flips(figures: dict[str, Figure]) -> None:
    figure = figures["boundary"]
    assert sorted(labelled(figure, r"^met \(5 runs")[0]) == [5.0, 5.0, 5.8, 5.8, 6.0]
    assert sorted(labelled(figure, r"^not met \(5 runs")[0]) == [6.0, 6.2, 6.2, 7.0, 7.0]
    assert lines(figure, "flip")[0][0] == pytest.approx([5.9, 5.9])
    assert lines(figure, "over the seeds")[0][0] == pytest.approx([5.9, 6.1])
    assert [text.get_text() for text in figure.axes[0].texts] == ["5.8 met, 6 not"]
    assert figure.axes[0].get_xlabel() == "pace [m/s]"


def test_a_search_for_the_worst_shows_the_best_so_far(figures: dict[str, Figure]) -> None:
    number, so_far = lines(figures["worst"], "worst so far")[0]
    assert number.tolist() == list(range(10))
    assert so_far == pytest.approx([-0.5, 0.3, 0.3, 0.7, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5])
    assert labelled(figures["worst"], "without")[0].tolist() == [2]
    assert lines(figures["worst"], "worst")[0].ravel().tolist() == [7.0, 0.5]


def test_a_search_that_goes_on_shows_its_runs_alone(tmp_path: Path) -> None:
    figure = plotting.boundary(searched(tmp_path / "s", {"along": "pace", "criterion": "collision"}, None))
    assert len(labelled(figure, "^met")[0]) == 5
    assert lines(figure, "flip") == []


def test_a_cliff_shows_means_closed_form_zero_and_design(figures: dict[str, Figure]) -> None:
    rows = cliff_rows()
    one = rows[rows[study.NOISE] == 1.0]
    means = one.groupby(study.DELAY)["stop_gap_m"].mean().clip(upper=None)
    delay, margin = labelled(figures["cliff"], "^noise x 1: zero at 34[4-7] ms")
    assert delay == pytest.approx(1000.0 * means.index.to_numpy())
    assert margin[:7] == pytest.approx(means.to_numpy()[:7])
    delay, closed = labelled(figures["cliff"], "closed form")
    assert closed == pytest.approx(means.iloc[0] - 11.0 * delay / 1000.0)
    assert labelled(figures["cliff"], "delay margin")[0].tolist() == [300.0, 300.0]
