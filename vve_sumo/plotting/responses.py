"""A figure over one parameter of a sweep: every run, and the median of each value; beside them the runs that lack it.

Knows rows, a run each; it must not know which parameters there are, nor what a figure means.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vve_sumo.analysis.effects import LEVELS, controller_of, is_number
from vve_sumo.analysis.survivors import with_contacts
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.table import label_of
from vve_sumo.plotting.columns import cautions, is_truth, need, numbers
from vve_sumo.plotting.crowd import MAX_POINTS, portions, thinned
from vve_sumo.plotting.grids import figure_label
from vve_sumo.plotting.page import PAPER
from vve_sumo.plotting.parts import RowSubset, axis_label, outer, panels, parts_of, tall
from vve_sumo.plotting.style import blank, explain, name, page, plain, widened
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: by so much of the distance between two values the points of several parts stand beside each other
BESIDE = 0.12


def response(rows: pd.DataFrame, x: str, figure: str, *, by: str | None = None, facet: str | None = None) -> Figure:
    """Draw a figure over a parameter: a point a run and a line through the medians; of a truth value the share of runs.

    A median is over all runs of a value that have the figure or collided, where a collision is beyond every gap, time
    to collision and DRAC: there is none where half of them did. Runs that collided, and runs without the figure, are
    marked along the lower edge. `by` is a column whose values have lines of their own, the controller if not said and
    there are several; `facet` is one whose values have a panel each. Raises ConfigError for an `x` that is no number.
    """
    need(rows, x, figure)
    if not is_number(rows[x]):
        raise ConfigError(f"response: x: expected a column of numbers, got {x!r}; texts go with by or facet")
    parts, at = parts_of(rows, by or controller_of(rows, facet)), numbers(rows, x)
    share = is_truth(rows, figure)
    values = numbers(rows, figure)
    values = values if share else with_contacts(rows, figure)
    levels, level = portions(at, LEVELS)
    with page(height=tall(rows, facet, 4.2, 3.4)) as drawn:
        drawn_panels = panels(drawn, rows, facet)
        kind, known = "Share of" if share else "Median", np.isfinite(values)
        title = f"{kind} {label_of(figure)} over {label_of(x)}: {known.sum():,} of {len(rows):,} runs"
        title += f", {hits:,} collided" if (hits := int(np.isinf(values).sum())) else ""
        name(drawn, title, *cautions(rows, figure))
        for axes, panel in drawn_panels:
            plain(axes)
            if not known[panel.which].any():
                blank(axes, f"no run has a {label_of(figure)}")
                continue
            for place, part in enumerate(parts):
                both = panel.which & part.which
                line = np.array([_middle(values[both & (level == n)], share=share) for n in range(len(levels))])
                _line(axes, levels, line, values[both], part)
                if not share and known[both].sum() <= MAX_POINTS:
                    aside = _aside(levels, place, len(parts))
                    mark: dict[str, Any] = {"color": part.style.colour, "markersize": 3.0, "alpha": 0.45}
                    axes.plot(at[both] + aside, np.where(known, values, np.nan)[both], part.style.mark, **mark)
                _lacking(axes, at[both], values[both], part, place)
            axes.margins(y=0.12)
            explain(axes, 2, panel.word)
        if len(rows):
            drawn_panels[0][0].set_xlim(*widened(float(at.min()), float(at.max())))
        outer(drawn_panels, axis_label(rows, x), figure_label(rows, figure))
        return drawn


def _aside(levels: Floats, place: int, parts: int) -> float:
    """Return by how much the points of a part stand beside their value."""
    steps = np.diff(levels)
    return float(BESIDE * steps.min() * (place - (parts - 1) / 2.0)) if len(steps) else 0.0


def _line(axes: Axes, levels: Floats, line: Floats, values: Floats, part: RowSubset) -> None:
    """Draw the line of a part, and say how many of its runs have the figure."""
    known = int(np.isfinite(values).sum())
    count = f"{known:,} of {len(values):,} runs" if known < len(values) else f"{known:,} runs"
    look = part.style
    axes.plot(levels, line, look.mark, linestyle=look.stroke, color=look.colour, label=part.legend_label(count))


def _lacking(axes: Axes, at: Floats, values: Floats, part: RowSubset, place: int) -> None:
    """Mark the runs of a part that lack the figure along the lower edge, in the line number `place` from it."""
    low: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "linestyle": "", "markersize": 6.0, "zorder": 4}
    low |= {"color": part.style.colour, "markerfacecolor": PAPER, "clip_on": False}
    for which, mark, why in ((np.isinf(values), "x", "collided"), (np.isnan(values), "s", "without")):
        if which.any():
            there = thinned(at[which])
            height = np.full(len(there), 0.025 + 0.045 * place)
            axes.plot(there, height, mark, label=part.legend_label(f"{why} ({which.sum():,})"), **low)


def _middle(values: Floats, *, share: bool) -> float:
    """Return the median of the known values, the mean of shares; NaN where the middle one is a contact's."""
    known = values[~np.isnan(values)]
    if not len(known):
        return float("nan")
    middle = float(np.mean(known) if share else np.median(known))
    return middle if np.isfinite(middle) else float("nan")
