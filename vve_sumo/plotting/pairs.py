"""Runs of two sweeps or controllers, pair by pair: a figure of the other over that of the one, and the differences.

Knows a comparison of pairs; it must not know how the pairs were made.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.plotting.page import INK, PAPER, QUIET
from vve_sumo.plotting.parts import RowSubset, parts_of
from vve_sumo.plotting.style import LIMIT, WIDTH, blank, explain, finite, name, page, plain, widened
from vve_sumo.values import Floats

if TYPE_CHECKING:
    from vve_sumo.analysis.paired import PairedComparison


def paired(compared: PairedComparison, figure: str = "stop_gap_m", *, by: str | None = None) -> Figure:
    """Draw a figure of every pair: the other's over the one's, and the share of pairs up to each difference.

    On the diagonal both are the same; a difference is the vertical axis minus the horizontal one. Pairs of which one
    run lacks the figure stand at the edge of the other's axis. `by` is a parameter of the pairs whose values have a
    colour and curve each.
    """
    one, other = (compared.values(figure, side) for side in ("one", "other"))
    both, unit = finite(one, other), unit_of(figure)
    parts = parts_of(compared.pairs, by)
    with page(WIDTH, 4.1 + 0.3 * len(parts)) as drawn:  # the legend takes lines of its own
        left, right = drawn.subplots(1, 2)
        pair = f"{compared.other} minus {compared.one}"
        name(drawn, f"{label_of(figure).capitalize()}, {pair}: {both.sum():,} pairs", _counted(compared, figure))
        for axes in (left, right):
            plain(axes)
        if not both.any():
            for axes in (left, right):
                blank(axes, f"no pair has a {label_of(figure)}")
            return drawn
        for part in parts:
            look: dict[str, Any] = {"color": part.style.colour, "alpha": 0.75, "markersize": 4.5}
            word = part.legend_label(f"{(part.which & both).sum():,} pairs")
            left.plot(one[part.which], other[part.which], part.style.mark, linestyle="", label=word, **look)
            _differences(right, (other - one)[part.which], part)
        _diagonal(left, compared, one, other)
        right.axvline(0.0, **LIMIT)
        left.set(xlabel=f"{compared.one} [{unit or '1'}]", ylabel=f"{compared.other} [{unit or '1'}]")
        right.set(xlabel=f"{pair} [{unit or '1'}]", ylabel="pairs up to there [%]", ylim=(0.0, 102.0))
        for axes in (left, right):
            explain(axes, 1)
        return drawn


def _counted(compared: PairedComparison, figure: str) -> str:
    row = compared.figures.loc[figure]
    counted = f"{compared.other} less in {row['lower']}, same in {row['same']}, more in {row['higher']}"
    if not np.isfinite(row["low_difference"]):
        return counted
    low, high = (f"{row[f'{end}_difference']:.3g}" for end in ("low", "high"))
    return f"{counted}; median difference {row['median_difference']:.3g}, 95 % interval {low} to {high}"


def _differences(axes: Axes, difference: Floats, part: RowSubset) -> None:
    """Draw the share of pairs up to each difference, of all pairs of a part."""
    ordered = np.sort(difference[np.isfinite(difference)])
    if len(ordered):
        share = 100.0 * np.arange(len(ordered) + 1) / len(difference)
        middle = f"median {np.median(ordered):.3g}"
        style: dict[str, Any] = {"color": part.style.colour, "linestyle": part.style.stroke}
        axes.step(np.append(ordered[:1], ordered), share, where="post", label=part.legend_label(middle), **style)
        if len(ordered) < len(difference):
            axes.plot(ordered[-1], share[-1], "o", markerfacecolor=PAPER, markersize=5.0, color=part.style.colour)


def _diagonal(axes: Axes, compared: PairedComparison, one: Floats, other: Floats) -> None:
    """Draw where both are the same, and at the edges the pairs of which one run lacks the figure."""
    every = np.concatenate([one[np.isfinite(one)], other[np.isfinite(other)]])
    ends = widened(float(every.min()), float(every.max()))
    axes.set(xlim=ends, ylim=ends)
    axes.plot(ends, ends, color=INK, linewidth=1.0, label="the same")
    style: dict[str, Any] = {"color": QUIET, "markersize": 6.0, "linestyle": "", "clip_on": False, "zorder": 4}
    edge = axes.get_xaxis_transform(), axes.get_yaxis_transform()
    for known, at, mark, transform in ((one, other, "x", edge[0]), (other, one, "+", edge[1])):
        alone = np.isfinite(known) & ~np.isfinite(at)
        if alone.any():
            place, low = known[alone], np.zeros(alone.sum())
            x, y = (place, low) if mark == "x" else (low, place)
            lacking = compared.other if mark == "x" else compared.one
            axes.plot(x, y, mark, transform=transform, label=f"{lacking} has none ({alone.sum():,})", **style)
