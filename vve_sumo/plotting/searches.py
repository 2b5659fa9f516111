"""What a search found: where along a parameter a verdict flips, or how bad it can get.

Reads `search.json` and the rows; it must not know how a search chooses its runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vve_sumo.analysis.survivors import contacts, with_contacts, without_contacts
from vve_sumo.metrics.table import axis_of, label_of
from vve_sumo.plotting.columns import errors, holds, numbers, runs
from vve_sumo.plotting.page import INK, OBSTACLE, PAPER, QUIET
from vve_sumo.plotting.style import BAD, FIRST, IN_A_LINE, WIDTH, blank, explain, finite, name, page, plain, widened
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

    from vve_sumo.analysis.dataset import Sweep

#: lines of a boundary plot that are named, and that say in numbers where they flip
MAX_LABELLED_LINES: Final = 24
Found = Mapping[str, Any]


def boundary(sweep: Sweep) -> Figure:
    """Draw what a search drove, what came of it, and what it found.

    Of a boundary: a line for each combination of the other parameters, on it every seed's runs, and where the verdict
    flips. Of a worst case: every run's figure in the order of the search, the worst so far, and where that is.
    A search that has not ended shows its runs alone.
    """
    found, rows = sweep.search_result, sweep.rows()
    search = sweep.plan["spec"].get("search")
    if search is None:
        with page() as figure:
            blank(figure.subplots(), "this sweep searched for nothing")
            return figure
    if "along" in search:
        return _boundary(sweep, rows, found or {"boundaries": []})
    return _worst(sweep, rows, found or {})


def met(rows: pd.DataFrame, criterion: str) -> NDArray[np.bool_]:
    """Return whether each run is known to have met a criterion of a search: `passed`, `collision` or a stated one."""
    stated = f"meets_{criterion}"
    if criterion == "passed" or stated in rows:
        column, wanted = (criterion if criterion == "passed" else stated), True
    else:
        column, wanted = criterion, False
    return holds(rows, column, wanted)


def _boundary(sweep: Sweep, rows: pd.DataFrame, result: Found) -> Figure:
    search = sweep.plan["spec"]["search"]
    along, criterion = search["along"], search.get("criterion", "passed")
    others = [parameter for parameter in sweep.parameters if parameter != along]
    lines = _lines(rows, others)
    seeds = sorted(rows["seed"].unique())
    height = min(9.0, 1.9 + 0.32 * len(lines) * max(1.6, 0.5 * len(seeds)))
    with page(WIDTH, height) as figure:
        axes = figure.subplots()
        plain(axes)
        name(figure, f"Where “{_criterion_text(criterion)}” flips along {label_of(along)} · {sweep.title}")
        if not len(rows):
            blank(axes, "no run is finished yet")
            return figure
        _runs(axes, rows, along, criterion, lines, others, seeds)
        flips = {tuple(line["values"].get(other) for other in others): line for line in result["boundaries"]}
        for place, values in enumerate(lines):
            _flips(axes, place, flips.get(values), labelled=len(lines) <= MAX_LABELLED_LINES)
        _name_lines(axes, lines, others, rows.attrs["units"])
        axes.set_xlabel(axis_of(along, rows.attrs["units"]))
        explain(axes)
        return figure


def _criterion_text(criterion: str) -> str:
    return {"collision": "no collision", "passed": "passed"}.get(criterion, label_of(criterion))


def _lines(rows: pd.DataFrame, others: list[str]) -> list[tuple[Any, ...]]:
    """Return the combinations of the other parameters that were driven, in their order."""
    if not others:
        return [()]
    return list(dict.fromkeys(_combinations(rows, others)))


def _combinations(rows: pd.DataFrame, others: list[str]) -> list[tuple[Any, ...]]:
    """Return the values of the other parameters of every row; None for a key of another controller's tuning."""
    return list(rows[others].astype(object).where(rows[others].notna(), None).itertuples(index=False, name=None))


def _runs(
    axes: Axes,
    rows: pd.DataFrame,
    along: str,
    criterion: str,
    lines: list[tuple[Any, ...]],
    others: list[str],
    seeds: list[Any],
) -> None:
    """Draw every run on its line, its seed a little beside the others."""
    of_line = {values: place for place, values in enumerate(lines)}
    place = np.array([of_line[values] for values in _combinations(rows, others)] if others else 0.0)
    beside = {seed: 0.5 * (n - (len(seeds) - 1) / 2.0) / max(len(seeds), 2) for n, seed in enumerate(seeds)}
    y = place + rows["seed"].map(beside).to_numpy(float)
    x, error = numbers(rows, along), errors(rows)
    good = met(rows, criterion) & ~error
    bad: dict[str, Any] = BAD | {"markersize": 6.0, "marker": "x", "markeredgecolor": OBSTACLE, "markeredgewidth": 1.6}
    size = {"markersize": 5.0, "linestyle": ""}
    kinds = ((good, {"marker": "o", "color": FIRST.colour, **size}, "met"), (~good & ~error, bad, "not met"))
    for chosen, style, word in (*kinds, (error, {"marker": "s", "color": QUIET, "fillstyle": "none", **size}, "error")):
        if chosen.any():
            axes.plot(x[chosen], y[chosen], label=f"{word} ({runs(chosen)})", zorder=3, **style)
    axes.set_xlim(*widened(float(x.min()), float(x.max())))
    axes.set_ylim(len(lines) - 0.4, -0.6)


def _flips(axes: Axes, place: int, line: Found | None, *, labelled: bool) -> None:
    """Draw the pooled flips of a line with the spread of its seeds, and say them."""
    if line is None:
        return
    spread = sorted(sum(flip.values()) / 2.0 for seed in line["seeds"] for flip in map(_ends, seed["flips"]))
    for flip in map(_ends, line["flips"]):
        ends = sorted(flip.values())
        high = (place - 0.38, place + 0.38)
        axes.fill_betweenx(high, ends[0], ends[1], color=INK, alpha=0.3, linewidth=0.0, zorder=2)
        axes.plot([sum(ends) / 2.0] * 2, high, color=INK, linewidth=1.4, zorder=2, label="flip")
        if labelled:
            words = f"{flip['meets']:g} met, {flip['fails']:g} not"
            at: dict[str, Any] = {"xytext": (0, 1), "textcoords": "offset points", "ha": "center", "va": "bottom"}
            axes.annotate(words, (sum(ends) / 2.0, place - 0.38), fontsize=9, zorder=4, **at)
    if len(line["flips"]) == 1 and len(spread) > 1:
        axes.plot((spread[0], spread[-1]), (place, place), color=INK, linewidth=1.0, zorder=2, label="over the seeds")


def _ends(flip: Found) -> dict[str, float]:
    return {end: float(flip[end]) for end in ("meets", "fails")}


def _name_lines(axes: Axes, lines: list[tuple[Any, ...]], others: list[str], units: dict[str, str]) -> None:
    if not others:
        axes.set_yticks(())
        axes.spines["left"].set_visible(False)
        return
    every = 1 + (len(lines) - 1) // MAX_LABELLED_LINES
    shown = range(0, len(lines), every)
    axes.set_yticks(list(shown), [", ".join(map(_short, lines[place])) for place in shown])
    axes.set_ylabel("\n".join(axis_of(other, units) for other in others))


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) and not isinstance(value, bool) else str(value)


def _worst(sweep: Sweep, rows: pd.DataFrame, result: Found) -> Figure:
    search = sweep.plan["spec"]["search"]
    figure_name, sign = (search["highest"], 1.0) if "highest" in search else (search["lowest"], -1.0)
    goal = "highest" if sign > 0.0 else "lowest"
    numeric = [parameter for parameter in sweep.parameters if rows[parameter].dtype.kind in "if"]
    with page(WIDTH, 3.8) as figure:
        name(figure, f"The {goal} {label_of(figure_name)} · {sweep.title}")
        panels = figure.subplots(1, 2 if len(numeric) > 1 else 1, squeeze=False)[0]
        values, hit = without_contacts(rows, figure_name), contacts(rows, figure_name)
        if not (np.isfinite(values).any() or hit.any()):
            for axes in panels:
                blank(axes, f"no run has a {label_of(figure_name)}")
            return figure
        _course(panels[0], rows["number"].to_numpy(float), values, hit, sign, figure_name)
        if len(numeric) > 1:
            worst = int(np.nanargmax(sign * with_contacts(rows, figure_name)))
            if case := result.get("worst"):  # of several contacts the hardest
                worst = int(np.flatnonzero(rows["key"] == case["key"])[0])
            _places(figure, panels[1], rows, numeric[:2], values, hit, figure_name, worst)
        return figure


def _course(axes: Axes, number: Floats, values: Floats, hit: NDArray[np.bool_], sign: float, figure_name: str) -> None:
    """Draw every run's figure in the order in which the search asked, and the worst so far; contacts at the edge."""
    plain(axes)
    so_far = sign * np.fmax.accumulate(sign * values)
    without = ~(np.isfinite(values) | hit)
    if hit.any():
        low: dict[str, Any] = BAD | {"transform": axes.get_xaxis_transform(), "clip_on": False}
        axes.plot(number[hit], np.full(hit.sum(), 0.02), label=f"collided ({runs(hit)})", zorder=4, **low)
    axes.plot(number, values, FIRST.mark, color=FIRST.colour, markersize=4.0, alpha=0.7, label="a run")
    axes.step(number, so_far, where="post", color=INK, linewidth=1.4, label="worst so far")
    if without.any():
        across = axes.get_xaxis_transform()
        word = f"without ({runs(without)})"
        axes.plot(number[without], np.full(without.sum(), 0.02), "|", color=QUIET, transform=across, label=word)
    axes.set(xlabel="run of the search [number]", ylabel=axis_of(figure_name))
    explain(axes, IN_A_LINE - 1)


def _places(
    figure: Figure,
    axes: Axes,
    rows: pd.DataFrame,
    both: list[str],
    values: Floats,
    hit: NDArray[np.bool_],
    figure_name: str,
    worst: int,
) -> None:
    """Draw where in two parameters the search looked, coloured by the figure, and where it is worst."""
    plain(axes)
    x, y = (numbers(rows, column) for column in both)
    known, units = finite(values), rows.attrs["units"]
    axes.plot(x[~known & ~hit], y[~known & ~hit], "|", color=QUIET, markersize=6.0)
    if hit.any():
        axes.plot(x[hit], y[hit], label=f"collided ({runs(hit)})", **BAD | {"markersize": 6.0})
    shown = axes.scatter(x[known], y[known], c=values[known], cmap="cividis", s=26, edgecolor=INK, linewidth=0.4)
    ring: dict[str, Any] = {"markersize": 13.0, "markerfacecolor": "none", "markeredgecolor": OBSTACLE}
    axes.plot(x[worst], y[worst], "o", markeredgewidth=2.0, label="worst", **ring)
    axes.set(xlabel=axis_of(both[0], units), ylabel=axis_of(both[1], units), facecolor=PAPER)
    figure.colorbar(shown, ax=axes, label=axis_of(figure_name))
    explain(axes)
