"""The plots: what is drawn equals the data, labels have units, words lie within the page and not upon each other."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from tests.analysis.made import BOX, CAR, PERIOD, moving, put, write
from tests.isolated import isolated
from vve_sumo import plotting
from vve_sumo.analysis import latency_margin as study
from vve_sumo.analysis.comparison import compare
from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.paired import compare_rows
from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.plotting import crowd, latencies, parts, style
from vve_sumo.plotting.page import SIZE
from vve_sumo.record.latencies import LEGS as LEG_NAMES
from vve_sumo.record.rows import LatencyRow
from vve_sumo.record.sweep_folder import SweepPlan
from vve_sumo.report import write_report

SPEED, BRAKING, GAP = 12.0, 3.0, 40.0
TIME = np.arange(0.0, 6.0, PERIOD)
CRITERIA = {"max_drac_mps2": {"min": None, "max": 4.0}, "min_ttc_s": {"min": 1.0, "max": None}}


def stopping(folder: Path, speed: float = SPEED, **changes: Any) -> Run:
    """A record of a car that brakes evenly to rest before a box, GAP metres ahead of its bumper at first."""
    moves = np.minimum(TIME, speed / BRAKING)
    x, v = speed * moves - 0.5 * BRAKING * moves**2, speed - BRAKING * moves
    settings = {"title": "by hand", "seed": 1, "controller": {"name": "nobody"}, "criteria": CRITERIA, "radar": {}}
    write(folder, moving(TIME, x, v), **{"settings": settings} | changes)
    box = BOX | {"actor": "parked", "x_m": CAR.rear_axle_to_bumper + GAP + 2.0}
    put(folder, "actors", [box | {"tick": tick} for tick in range(len(TIME))])
    return Run(folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return stopping(tmp_path_factory.mktemp("run") / "record")


TIMED, WORST = 2000, 1234
LEGS = np.array([2.0, 1.0, 0.5, 0.5, 1.5, 0.5])  #: [ms]


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A live record whose every tick takes LEGS; one takes 20 ms more to decode, and three ticks are skipped."""
    rows = [{"tick": tick, "time_s": tick * PERIOD, "pose_age_s": 0.02} for tick in range(TIMED)]
    rig = {"latency": {"budget_ms": 15.0}}
    folder = write(tmp_path_factory.mktemp("live") / "record", rows, rig=rig)
    put(folder, "latency", (dataclasses.asdict(timed(tick)) for tick in range(TIMED)))
    return Run(folder)


@pytest.mark.parametrize("rig", [{}, {"latency": {}}, {"latency": {"breaches": 5}}])
def test_a_rig_without_a_budget_has_the_default_one(tmp_path: Path, rig: dict[str, Any]) -> None:
    """So its drive kept to it; the record holds what the rig file says and no more."""
    folder = stopping(tmp_path / "record", rig=rig).folder
    put(folder, "latency", (dataclasses.asdict(timed(tick)) for tick in range(len(TIME))))
    figure = plotting.latency_over_time(Run(folder))
    assert "budget 40 ms" in [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "Latency" in write_report(folder).read_text(encoding="utf-8")


def timed(tick: int) -> LatencyRow:
    took = LEGS + np.array([0.0, 20.0, 0.0, 0.0, 0.0, 0.0]) * (tick == WORST)
    at = (tick * PERIOD + 1e-3 * np.cumsum(took)).tolist()
    due = tick * PERIOD
    return LatencyRow(tick, tick, due, due - 0.01, due, *at, due + 0.02, "datagram", 3 * (tick == 400))


def rows_of(count: int, seed: int = 1) -> pd.DataFrame:
    """Rows of a sweep over speed and delay: gaps fall with their product; some collide, some have an error."""
    random = np.random.default_rng(seed)
    speed, delay = random.uniform(5.0, 15.0, count), random.choice([0.0, 0.1, 0.2], count)
    demand, reaction = random.uniform(2.0, 3.0, count), random.uniform(0.03, 0.06, count)
    distance = speed * reaction + speed**2 / (2.0 * demand)
    gap = 2.0 - speed * delay + random.normal(0.0, 0.1, count)
    error = np.arange(count) % 10 == 3
    frame = pd.DataFrame(
        {
            "number": range(count),
            "ego.speed_mps": speed,
            "delay": delay,
            "seed": 1,
            "error": np.where(error, "timed_out", ""),
            "collision": gap < 0.0,
            "passed": gap > 0.5,
            "stop_gap_m": gap,
            "stop_onset_speed_mps": speed,
            "stop_distance_m": distance + np.where(np.arange(count) % 7 == 1, 0.2, 0.0),
            "stop_bound_m": distance,
            "stop_tolerance_m": 0.1,
            "stop_demand_mps2": demand,
            "stop_reaction_s": reaction,
            "hunting": False,
        }
    ).astype({"collision": "boolean", "passed": "boolean", "hunting": "boolean"})
    frame.loc[error, ["collision", "passed", "hunting"]] = pd.NA
    frame.loc[error, [name for name in frame if name.startswith("stop_")]] = np.nan
    frame.attrs["units"] = {"delay": "s"}
    return frame


FLIPS_AT = {1: 6.0, 2: 6.2}  #: by seed, the first speed at which there is a collision


def searched(folder: Path, search: dict[str, Any], found: dict[str, Any] | None) -> Sweep:
    """A search's folder: speeds with two seeds, a collision from FLIPS_AT on."""
    speeds = [5.0, 5.8, 6.0, 6.2, 7.0]
    plan = SweepPlan(
        spec={"title": "a search", "scenario": "s", "search": search},
        scenario="s",
        table={"title": "t", "parameters": {"pace": {"sets": ["ego.speed_mps"]}}},
        file="s.toml",
        working="/",
        cells=10,
        parameters={"pace": "float", "offset": "float"},
        criteria=[],
        files_sha256={},
        versions={"vve-sumo": "0"},
    )
    folder.mkdir()
    (folder / "sweep.json").write_text(plan.text(), encoding="utf-8")
    with (folder / "journal.jsonl").open("w", encoding="utf-8") as journal:
        for number, (seed, speed) in enumerate(itertools.product(FLIPS_AT, speeds)):
            hit = speed >= FLIPS_AT[seed]
            row = {"number": number, "key": f"{number:016x}", "pace": speed, "offset": 0.5, "seed": seed, "error": ""}
            row |= {"collision": hit, "passed": not hit, "impact_speed_mps": None if number == 2 else speed - 5.5}
            journal.write(json.dumps(dict.fromkeys(plan.columns()) | row) + "\n")
    if found is not None:
        (folder / "search.json").write_text(json.dumps(found), encoding="utf-8")
    return Sweep(folder)


BOUNDARY = {
    "search": "boundary",
    "along": "pace",
    "criterion": "collision",
    "boundaries": [
        {
            "values": {"offset": 0.5},
            "meets_first": True,
            "flips": [{"meets": 5.8, "fails": 6.0}],
            "seeds": [
                {"flips": [{"meets": 5.8, "fails": 6.0, "key_fails": f"{2:016x}"}]},
                {"flips": [{"meets": 6.0, "fails": 6.2, "key_fails": f"{8:016x}"}]},
            ],
        }
    ],
}


def cliff_rows() -> pd.DataFrame:
    random, rows = np.random.default_rng(3), []
    for noise, delay, seed in itertools.product((1.0, 2.0), np.arange(0.0, 0.45, 0.05), range(3)):
        gap = 4.0 - 0.2 * noise - 11.0 * delay + random.normal(0.0, 0.02)
        rows.append({study.DELAY: delay, study.NOISE: noise, "seed": seed, "error": "", "passed": gap > 1.0}
                    | {"collision": gap < 0.0, "outcome": "contact" if gap < 0.0 else "stopped", "stop_gap_m": gap}
                    | {"min_gap_m": gap, study.LATERAL: 0.1, "reasons": ""})  # fmt: skip
    return pd.DataFrame(rows)


@pytest.fixture(scope="module")
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


def lines(figure: Figure, label: str) -> list[np.ndarray]:
    """Return x and y (2 x n) of the lines of that label, panel by panel."""
    return [np.array(line.get_data()) for axes in figure.axes for line in axes.lines if line.get_label() == label]


def labelled(figure: Figure, pattern: str) -> np.ndarray:
    found = [np.array(line.get_data()) for axes in figure.axes for line in axes.lines
             if re.search(pattern, str(line.get_label()))]  # fmt: skip
    return found[0]


def shown(figure: Figure) -> list[tuple[Text, Any]]:
    """Return every text that is drawn, and its place on the page."""
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    texts = [text for text in figure.findobj(Text) if isinstance(text, Text) and text.get_visible()]
    kept = [text for text in texts if text.get_text().strip() and drawn(text, figure)]
    return [(text, text.get_window_extent(renderer)) for text in kept]


def drawn(text: Text, figure: Figure) -> bool:
    """Leave out labels of ticks that lie outside the limits, which matplotlib keeps but does not draw."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            inside = {id(one) for tick in axis._update_ticks() for one in (tick.label1, tick.label2)}  # type: ignore[attr-defined]
            every = axis.majorTicks + axis.minorTicks  # type: ignore[attr-defined]
            ticks = {id(one) for tick in every for one in (tick.label1, tick.label2)}
            if id(text) in ticks:
                return id(text) in inside
    return True


PLOTS = ("overview", "safety", "approach", "gaps", "stops", "map", "shares", "distribution", "boundary", "worst")
PLOTS += ("latency", "comparison", "cliff", "response", "panels", "laws", "pairs")


@pytest.mark.parametrize("name", PLOTS)
def test_words_lie_within_the_page_and_not_upon_each_other_and_numbers_have_units(
    figures: dict[str, Figure], name: str
) -> None:
    texts = shown(figures[name])
    page = figures[name].bbox
    assert len(texts) > 5
    for text, box in texts:
        assert page.x0 - 1.0 <= box.x0 <= box.x1 <= page.x1 + 1.0, text.get_text()
        assert page.y0 - 1.0 <= box.y0 <= box.y1 <= page.y1 + 1.0, text.get_text()
    for (one, box), (other, beside) in itertools.combinations(texts, 2):
        wide = min(box.x1, beside.x1) - max(box.x0, beside.x0)
        high = min(box.y1, beside.y1) - max(box.y0, beside.y0)
        assert wide <= 2.0 or high <= 2.0, (one.get_text(), other.get_text())
    for axes in figures[name].axes:
        # On a drive's page the titles of the panels say it; a list of names (legs, lines) has no unit.
        for axis, said in ((axes.xaxis, axes.get_xlabel()), (axes.yaxis, axes.get_ylabel() + axes.get_title("left"))):
            words = [text.get_text() for text in axis.get_ticklabels() if text.get_visible()]
            numbers = [word for word in words if re.fullmatch(r"[\u2212\-\d.]+", word)]
            assert re.search(r"\[.+\]", said) or not numbers, (name, said, words)


def test_safety_is_the_closed_form_over_time(figures: dict[str, Figure]) -> None:
    moving_then = TIME < SPEED / BRAKING - 0.1
    v = SPEED - BRAKING * TIME[moving_then]
    gap = GAP - SPEED * TIME[moving_then] + 0.5 * BRAKING * TIME[moving_then] ** 2
    figure = figures["safety"]
    for word, expected in (("gap", gap), ("on the path", gap / v), ("boxes", gap / v), ("DRAC", v * v / (2.0 * gap)),
                           ("bumper to bumper", gap / v), ("front to front", (gap + 4.0) / v)):  # fmt: skip
        (drawn_line,) = lines(figure, word)
        assert drawn_line[0] == pytest.approx(TIME)
        # What is more than 10 s away is no conflict.
        known = gap / v < 9.99 if word in ("on the path", "DRAC") else v > 0.0
        assert drawn_line[1][moving_then][known] == pytest.approx(expected[known], abs=1e-6), word
    assert lines(figure, "asked: at least 1 s")[0][1].tolist() == [1.0, 1.0]
    assert lines(figure, "asked: at most 4 m/s²")[0][1].tolist() == [4.0, 4.0]
    assert lines(figure, f"declared {CAR.deceleration_limit:g} m/s²")[0][1][0] == CAR.deceleration_limit


def test_the_approach_runs_down_to_rest_over_the_parabola(figures: dict[str, Figure], run: Run) -> None:
    (way,) = lines(figures["approach"], "the drive")
    assert way[0] == pytest.approx(run.motion.speed)
    assert way[1] == pytest.approx(run.lead.gap)
    v, needed = labelled(figures["approach"], "needed to stop")
    delay = CAR.brake_delay + CAR.brake_lag
    assert needed == pytest.approx(v * delay + v * v / (2.0 * CAR.deceleration_limit))
    assert labelled(figures["approach"], "^end: 16.00 m$")[:, 0] == pytest.approx([0.0, 16.0], abs=1e-6)


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


def survivors() -> pd.DataFrame:
    """Ten runs of each of two controllers; those of the second drive through the obstacle above 12 m/s."""
    speed = np.tile(np.arange(5.0, 15.0), 2)
    second = np.arange(20) >= 10
    hit = second & (speed > 12.0)
    gap = np.where(hit, np.nan, np.where(second, 15.0 - speed, 30.0 - speed))
    demand = np.where(second, 2.0, 3.0)
    frame = {"ego.speed_mps": speed, "controller.name": np.where(second, "two", "one"), "error": "", "collision": hit}
    frame |= {"stop_gap_m": gap, "passed": ~hit, "weather": np.where(speed > 9.0, "wet", "dry")}
    frame |= {"stop_onset_speed_mps": speed, "stop_demand_mps2": demand, "stop_reaction_s": 0.0}
    frame |= {"stop_distance_m": speed**2 / 2.0 / demand, "stop_bound_m": speed**2 / 2.0 / demand}
    frame |= {"stop_tolerance_m": 0.1, "hunting": False}
    return pd.DataFrame(frame)


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


def test_an_approach_that_ends_above_the_axis_is_marked_at_its_edge(tmp_path: Path) -> None:
    run = stopping(tmp_path / "record", speed=6.0)
    boxes = [BOX | {"actor": "parked", "x_m": 140.0 + 0.2 * tick, "tick": tick} for tick in range(len(TIME))]
    put(run.folder, "actors", boxes)  # it drives away from a car that never comes near
    axes = plotting.gap_against_speed(Run(run.folder)).axes[0]
    (end,) = (line for line in axes.lines if str(line.get_label()).startswith("end: "))
    assert float(np.asarray(end.get_ydata())[0]) <= axes.get_ylim()[1]
    assert str(end.get_label()).endswith("above the axis")


@pytest.mark.parametrize(("gap", "mark"), [(40.0, "o"), (140.0, "^")])
def test_an_approach_that_begins_above_the_axis_has_a_triangle_at_its_edge(
    tmp_path: Path, gap: float, mark: str
) -> None:
    run = stopping(tmp_path / "record", speed=6.0)
    box = BOX | {"actor": "parked", "x_m": CAR.rear_axle_to_bumper + gap + 2.0}
    put(run.folder, "actors", [box | {"tick": tick} for tick in range(len(TIME))])
    axes = plotting.gap_against_speed(Run(run.folder)).axes[0]
    (first,) = (line for line in axes.lines if str(line.get_label()).startswith(f"first ahead: {gap:.0f} m"))
    assert first.get_marker() == mark
    assert float(np.asarray(first.get_ydata())[0]) <= axes.get_ylim()[1]
    assert str(first.get_label()).endswith("above the axis") == (mark == "^")


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


def test_the_latency_plot_stacks_the_legs_of_the_slowest_ticks(figures: dict[str, Figure]) -> None:
    figure = figures["latency"]
    names = ("wake", "decode", "sensors", "control", "hand over", "frame")
    stacked = {one.get_label(): one.get_paths()[0].vertices for one in figure.axes[0].collections}
    at = WORST * PERIOD
    for leg, usual, slow in zip(names, np.cumsum(LEGS), np.cumsum(LEGS) + 20.0 * (np.arange(6) > 0), strict=True):
        time, top = stacked[leg].T
        assert top[(time < 10.0)].max() == pytest.approx(usual, abs=1e-6)
        assert top[np.abs(time - at) < 0.3].max() == pytest.approx(slow, abs=1e-6)
    assert lines(figure, "budget 15 ms")[0][1].tolist() == [15.0, 15.0]
    assert lines(figure, "3 ticks missed")[0][0] == pytest.approx([400 * PERIOD])
    medians, _places = lines(figure, "median")[0]
    legs = [text.get_text() for text in figure.axes[1].get_yticklabels()]
    assert dict(zip(legs, medians, strict=True))["decode"] == pytest.approx(1.0)
    assert dict(zip(legs, lines(figure, "greatest")[0][0], strict=True))["total"] == pytest.approx(26.0)


def test_a_comparison_shows_the_second_less_the_first(figures: dict[str, Figure]) -> None:
    first, second = (lines(figures["comparison"], word)[0] for word in ("first", "second"))
    assert first[1][:100] == pytest.approx(SPEED - BRAKING * first[0][:100])
    difference = np.array(figures["comparison"].axes[1].lines[1].get_data())
    assert difference[1] == pytest.approx(second[1] - first[1])
    assert difference[1][:100] == pytest.approx(-1.0)


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


def just_draw(figure: Figure) -> None:
    """Draw it without arranging it, which takes most of the time."""
    figure.set_layout_engine("none")
    figure.canvas.draw()


def nobody() -> pd.DataFrame:
    frame = rows_of(3)
    frame[[name for name in frame if name.startswith("stop_")]] = np.nan
    return frame


ROWS: dict[str, Callable[[], pd.DataFrame]] = {
    "none": lambda: rows_of(20).iloc[:0],
    "one": lambda: rows_of(1),
    "one with an error": lambda: rows_of(4).iloc[3:],
    "without a figure": nobody,
    "alike": lambda: pd.concat([rows_of(1)] * 5, ignore_index=True),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("poor", ROWS)
def test_poor_rows_make_a_plot_that_says_so(poor: str) -> None:
    rows = ROWS[poor]()
    for figure in (
        plotting.gap_against_speed(rows),
        plotting.stopping_distance(rows),
        plotting.heat_map(rows, "ego.speed_mps", "delay", "passed"),
        plotting.distribution(rows, "stop_gap_m", "delay"),
        plotting.response(rows, "delay", "stop_gap_m", facet="seed"),
        plotting.heat_map(rows, "seed", "delay", "stop_gap_m", by="seed", facet="delay"),
        plotting.stopping_distance(rows, by="delay", facet="seed"),
    ):
        just_draw(figure)


NOWHERE = dict.fromkeys(("x_m", "y_m", "true_x_m", "true_y_m", "speed_mps", "true_speed_mps", "s_m"), math.nan)
STILL = [{"tick": tick, "time_s": tick * PERIOD} for tick in range(30)]
RECORDS: dict[str, list[dict[str, Any]]] = {
    "one tick": STILL[:1],
    "at rest": STILL,
    "no pose": [row | NOWHERE for row in STILL],
    "no truth": [row | {"true_x_m": math.nan, "x_m": 0.1 * row["tick"], "speed_mps": 5.0} for row in STILL],
    "a contact": [row | {"contacts": "parked" if row["tick"] > 20 else ""} for row in STILL],
    "touching": [row | {"x_m": 12.0 - 2.0 - CAR.rear_axle_to_bumper, "true_x_m": math.nan} for row in STILL],
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("poor", RECORDS)
def test_a_poor_record_makes_plots_that_say_so(poor: str, tmp_path: Path) -> None:
    """Also of a killed drive, which has no summary."""
    folder = write(tmp_path / "record", RECORDS[poor])
    if poor != "at rest":
        put(folder, "actors", [BOX | {"tick": row["tick"], "actor": "parked", "x_m": 12.0} for row in STILL])
    run = Run(folder)
    per_run = (
        plotting.drive_overview, plotting.safety_over_time, plotting.gap_against_speed, plotting.latency_over_time,
        plotting.string_stability, plotting.headways,
    )  # fmt: skip
    for plot in per_run:
        figure = plot(run)
        just_draw(figure)
        for axes in figure.axes:
            assert axes.get_ylim()[0] < axes.get_ylim()[1] or plot is plotting.latency_over_time


def test_a_contact_from_the_side_is_in_the_picture(tmp_path: Path) -> None:
    """Long after the last that was ahead."""
    rows = [{"time_s": float(tick), "contacts": "parked" * (tick > 25)} for tick in range(30)]
    folder = write(tmp_path / "record", rows)
    put(folder, "actors", [BOX | {"tick": tick, "actor": "parked", "x_m": 12.0} for tick in range(5)])
    gap = plotting.safety_over_time(Run(folder)).axes[0]
    left, right = gap.get_xlim()
    assert left < 0.0 < 26.0 < right < 28.0
    # It stood, and 2 m would have been safe: the gap is shown all the same.
    assert gap.get_ylim()[1] > 12.0 - 2.0 - CAR.rear_axle_to_bumper


def test_a_leg_that_did_not_happen_is_not_another_ticks() -> None:
    """Of a portion's slowest tick nothing is known of the radar; the others took 1 ms for it."""
    legs = {f"{leg}_ms": [1.0, 1.0] for leg in LEG_NAMES} | {"total_ms": [6.0, 9.0], "time_s": [0.0, 0.0]}
    _edges, shown = latencies.slowest(pd.DataFrame(legs | {"sensors_ms": [1.0, math.nan]}))
    assert shown["total_ms"].dropna().tolist() == [9.0]
    assert not shown["sensors_ms"].notna().any()


def test_the_overview_is_of_the_drives_own_size_and_says_what_came_of_it(tmp_path: Path, run: Run) -> None:
    summary = {"outcome": "stopped", "stop_gap_m": 16.0, "seed": 1, "passed": False}
    (tmp_path / "summary.json").write_text("", encoding="utf-8")
    folder = write(tmp_path / "record", STILL, summary)
    words = [text.get_text() for text in plotting.drive_overview(Run(folder)).texts]
    assert words == ["by hand", "came to rest 16.00 m before what was ahead · criteria NOT met · seed 1"]
    overview = plotting.drive_overview(run)
    assert overview.texts[1].get_text() == f"killed: the record ends at {TIME[-1]:.2f} s"
    assert overview.get_size_inches().tolist() == list(SIZE)


def test_a_plot_shows_itself_in_a_notebook_in_the_house_style(figures: dict[str, Figure], tmp_path: Path) -> None:
    figure = figures["gaps"]
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    sizes = {text.get_fontsize() for text in figure.axes[0].get_xticklabels()}
    assert sizes == {float(style.STYLE["font.size"])}
    plotting.save(figure, tmp_path / "plot.svg")
    assert (tmp_path / "plot.svg").read_text(encoding="utf-8").startswith("<?xml")


def has_pyplot() -> bool:
    import vve_sumo.plotting  # noqa: F401

    return "matplotlib.pyplot" in sys.modules


def test_plots_need_no_pyplot() -> None:
    assert not isolated(has_pyplot)


@pytest.mark.parametrize("form", ["pdf", "ps"])
def test_a_plot_for_a_paper_has_no_type_3_fonts(form: str, tmp_path: Path) -> None:
    """Publishers refuse them; fonts of a PDF are named in its text, those of PostScript by their type."""
    file = tmp_path / f"plot.{form}"
    plotting.distribution(survivors(), "stop_gap_m", "controller.name").savefig(file)
    content = file.read_bytes()
    assert b"/Subtype /Type3" not in content
    assert b"/FontType 3" not in content
    assert (b"/Subtype /CIDFontType2" if form == "pdf" else b"/FontType 42") in content
