"""A figure over the parameters of a sweep: its mean over two of them, its spread over one.

Knows rows, a run each; it must not know which parameters there are, nor what a figure means.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import CenteredNorm, Normalize
from matplotlib.figure import Figure

from vve_sumo.metrics.table import axis_of, label_of
from vve_sumo.plotting.columns import is_truth, numbers
from vve_sumo.plotting.page import INK, PAPER, QUIET
from vve_sumo.plotting.style import LIMIT, LINE_STYLES, WIDTH, blank, explain, name, page, plain
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: values of a parameter that have a row of cells each; of more, as of drawn ones, this many portions have
CELLS: Final = 24
#: cells, and cells in a line; in more, numbers could not be read
NUMBERED, IN_A_LINE = 120, 12
#: letters along an axis that do not run into each other; of more cells only some are named
MAX_LABEL_LETTERS: Final = 60
#: steps of a curve over the share of runs
STEPS: Final = 1000


class Grid(NamedTuple):
    """Means of a figure over two parameters."""

    x: list[str]  #: names of the columns
    y: list[str]  #: names of the rows
    mean: Floats  #: (y x x), NaN where no run has the figure
    runs: int  #: that have the figure


def grid(rows: pd.DataFrame, x: str, y: str, figure: str) -> Grid:
    """Return means of a figure over cells of two parameters; of a truth value the share that is true [%].

    A parameter with more than CELLS numbers, such as a drawn one, is cut into CELLS portions of equal width.
    """
    values = numbers(rows, figure)
    known = np.isfinite(values)
    (column, columns), (row, lines) = (_cells(rows[name]) for name in (x, y))
    known &= (column >= 0) & (row >= 0)
    place = row[known] * len(columns) + column[known]
    count = np.bincount(place, minlength=len(lines) * len(columns))
    total = np.bincount(place, weights=values[known], minlength=len(lines) * len(columns))
    mean = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return Grid(columns, lines, mean.reshape(len(lines), len(columns)), int(known.sum()))


def said(rows: pd.DataFrame, figure: str) -> str:
    """Return the label of a figure: of a truth value that of the share."""
    if is_truth(rows, figure):
        return f"{label_of(figure)} [% of runs]"
    return axis_of(figure, rows.attrs.get("units"))


def _cells(column: pd.Series[Any]) -> tuple[Any, list[str]]:
    """Return for every run the number of its cell, -1 for none, and the cells' names."""
    import pandas as pd

    codes, values = pd.factorize(column, sort=True)
    if len(values) <= CELLS or column.dtype.kind not in "if":
        return codes, [_short(value) for value in values]
    edges = np.linspace(float(values[0]), float(values[-1]), CELLS + 1)
    place = np.clip(np.searchsorted(edges, column.to_numpy(float), side="right") - 1, 0, CELLS - 1)
    return np.where(codes < 0, -1, place), [_short(float(middle)) for middle in (edges[1:] + edges[:-1]) / 2.0]


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, int | float) and not isinstance(value, bool) else str(value)


def heat_map(rows: pd.DataFrame, x: str, y: str, figure: str, zero: str | None = None) -> Figure:
    """Draw the mean of a figure over two parameters; of a truth value (`passed`) the share of runs.

    Cells have their number in them while they are few; a cell without a run that has the figure is hatched. `zero` says
    what the figure's zero means, and lets the colours part there.
    """
    means = grid(rows, x, y, figure)
    height = float(np.clip(1.9 + 0.34 * len(means.y), 3.0, 5.6))
    with page(WIDTH, height) as drawn:
        axes = drawn.subplots()
        kind = "Share" if is_truth(rows, figure) else "Mean"
        name(drawn, f"{kind} of {label_of(figure)} over {means.runs:,} of {len(rows):,} runs")
        if means.runs == 0:
            blank(axes, f"no run has a {label_of(figure)}")
            return drawn
        norm = _scale(is_truth(rows, figure), zero)
        _paint(drawn, axes, means, said(rows, figure), norm, zero)
        units = rows.attrs.get("units")
        for axis, column, names in ((axes.xaxis, x, means.x), (axes.yaxis, y, means.y)):
            longest = max(map(len, names)) + 2 if column == x else 4
            every = 1 + len(names) * longest // MAX_LABEL_LETTERS
            axis.set_ticks(range(0, len(names), every), names[::every])
            axis.set_label_text(axis_of(column, units))
        return drawn


def _scale(share: bool, zero: str | None) -> Normalize:
    """Return how numbers become colours: shares always alike, so that maps of them can be compared."""
    if zero is not None:
        return CenteredNorm(0.0)
    return Normalize(0.0, 100.0) if share else Normalize()


def _paint(drawn: Figure, axes: Axes, means: Grid, word: str, norm: Normalize, zero: str | None) -> None:
    """Draw the cells, what they mean, and their numbers."""
    lines, columns = means.mean.shape
    colours = "cividis" if zero is None else "PuOr"
    missing: dict[str, Any] = {"facecolor": PAPER, "edgecolor": QUIET, "hatch": "///", "linewidth": 0.0}
    axes.fill_between((-0.5, columns - 0.5), -0.5, lines - 0.5, **missing)
    edges = (np.arange(columns + 1) - 0.5, np.arange(lines + 1) - 0.5)
    cells = axes.pcolormesh(*edges, np.ma.masked_invalid(means.mean), cmap=colours, norm=norm)
    axes.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
    bar = drawn.colorbar(cells, ax=axes, label=word)
    if zero is not None:
        bar.ax.axhline(0.0, color=INK, linewidth=1.2)
        bar.ax.set_title(f"0: {zero}", fontsize=9)
    if means.mean.size <= NUMBERED and columns <= IN_A_LINE:
        _write(axes, means, cells)


def _write(axes: Axes, means: Grid, cells: Any) -> None:
    """Write into every cell its number, dark on light and light on dark."""
    size = 10 if means.mean.shape[1] <= 8 else 7.5
    for (row, column), mean in np.ndenumerate(means.mean):
        if np.isfinite(mean):
            red, green, blue, _ = cells.cmap(cells.norm(mean))
            colour = INK if 0.299 * red + 0.587 * green + 0.114 * blue > 0.5 else PAPER
            axes.text(column, row, f"{mean:.3g}", ha="center", va="center", fontsize=size, color=colour)


def distribution(
    rows: pd.DataFrame, figure: str, by: str | None = None, band: tuple[float, float] | None = None
) -> Figure:
    """Draw what share of the runs has a figure no greater than each value; of every value of a parameter on its own.

    Of more values than can be told apart the least, the greatest and some between are drawn. `band` is the least and
    the greatest value that passes.
    """
    with page() as drawn:
        axes = drawn.subplots()
        plain(axes)
        values = numbers(rows, figure)
        name(drawn, f"Distribution of {label_of(figure)} over {np.isfinite(values).sum():,} of {len(rows):,} runs")
        if not np.isfinite(values).any():
            blank(axes, f"no run has a {label_of(figure)}")
            return drawn
        for look, (word, chosen) in zip(LINE_STYLES, _portioned(rows, by), strict=False):
            part = np.sort(values[chosen & np.isfinite(values)])
            if len(part):
                _curve(axes, part, {"color": look.colour, "linestyle": look.stroke, "label": word})
        if band is not None:
            _pass_band(axes, band)
        axes.set(xlabel=said(rows, figure), ylabel="runs up to there [%]", ylim=(0.0, 102.0))
        explain(axes)
        return drawn


def _portioned(rows: pd.DataFrame, by: str | None) -> list[tuple[str, Any]]:
    """Return the parts of the rows that are drawn on their own: what they are called and which they are."""
    if by is None:
        return [("all runs", np.ones(len(rows), bool))]
    place, names = _cells(rows[by])
    shown = sorted({round(n) for n in np.linspace(0, len(names) - 1, min(len(LINE_STYLES), len(names)))})
    unit = axis_of(by, rows.attrs.get("units")).removeprefix(label_of(by)).strip(" []")
    return [(f"{label_of(by)} {names[n]} {unit}".removesuffix(" 1"), place == n) for n in shown]


def _curve(axes: Axes, ordered: Floats, style: dict[str, Any]) -> None:
    """Draw the share of values up to each of them; of very many some."""
    some = np.unique(np.linspace(0, len(ordered) - 1, min(STEPS, len(ordered))).round().astype(int))
    share = 100.0 * (some + 1) / len(ordered)
    axes.step(np.append(ordered[:1], ordered[some]), np.append(0.0, share), where="post", **style)


def _pass_band(axes: Axes, band: tuple[float, float]) -> None:
    """Shade what does not pass, as far as the curves go and a little farther."""
    least, greatest = axes.get_xlim()
    room = 0.05 * (greatest - least)
    low, high = min(least, band[0] - room), max(greatest, band[1] + room)
    low, high = low if math.isfinite(low) else least, high if math.isfinite(high) else greatest
    for begin, end, edge in ((low, band[0], band[0]), (band[1], high, band[1])):
        if math.isfinite(edge):
            axes.axvline(edge, label="limit", **LIMIT | {"linestyle": "-"})  # dotted is a curve's stroke, too
            axes.axvspan(begin, end, color=QUIET, alpha=0.15, linewidth=0.0, label="does not pass")
    axes.set_xlim(low, high)
