"""A figure over the parameters of a sweep: its mean over two of them, its spread over one.

Knows rows, a run each; it must not know which parameters there are, nor what a figure means.
"""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import CenteredNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from vve_sumo.analysis.survivors import contacts, with_contacts
from vve_sumo.metrics.table import axis_of, label_of
from vve_sumo.plotting.columns import cautions, is_truth, need, numbers
from vve_sumo.plotting.page import INK, PAPER, QUIET
from vve_sumo.plotting.parts import ACROSS, MAX_PANELS, RowSubset, axis_label, outer, panels, parts_of, short, tall
from vve_sumo.plotting.style import LIMIT, WIDTH, blank, explain, name, page, plain
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: values of a parameter that have a row of cells each; of more, as of drawn ones, this many portions have
CELLS: Final = 24
#: cells, and cells in a line; in more, numbers could not be read
NUMBERED, IN_A_LINE = 120, 12
#: letters along an axis that do not run into each other; of more cells only some are named
MAX_LABEL_LETTERS: Final = 60
#: letters of the titles of panels side by side
PANEL_LETTERS: Final = 56
#: height of a row of cells with and without the count of runs in them [inch]
COUNTED_ROW, ROW = 0.46, 0.34
#: steps of a curve over the share of runs
STEPS: Final = 1000


class Cells(NamedTuple):
    """Which cell each run of some rows lies in."""

    x: list[str]  #: names of the columns
    y: list[str]  #: names of the rows
    place: NDArray[np.intp]  #: of every run (n), row by row; -1 of one in none


class Grid(NamedTuple):
    """Means of a figure over two parameters."""

    mean: Floats  #: (y x x), NaN where no run has the figure
    having: NDArray[np.intp]  #: runs that have the figure
    runs: NDArray[np.intp]  #: of all


def cells_of(rows: pd.DataFrame, x: str, y: str) -> Cells:
    """Return the cells of two parameters.

    A parameter with more than CELLS numbers, such as a drawn one, is cut into CELLS portions of equal width.
    """
    need(rows, x, y)
    (column, columns), (row, lines) = (_cells(rows[name]) for name in (x, y))
    place = np.where((column >= 0) & (row >= 0), row * len(columns) + column, -1)
    return Cells(columns, lines, place)


def grid(cells: Cells, values: Floats, which: NDArray[np.bool_]) -> Grid:
    """Return means of a figure's values (n) over cells, of some of the runs."""
    within = which & (cells.place >= 0)
    known = within & np.isfinite(values)
    size = len(cells.x) * len(cells.y)
    runs, count = (np.bincount(cells.place[those], minlength=size) for those in (within, known))
    total = np.bincount(cells.place[known], weights=values[known], minlength=size)
    mean = np.divide(total, count, out=np.full(size, np.nan), where=count > 0)
    shape = (len(cells.y), len(cells.x))
    return Grid(mean.reshape(shape), count.reshape(shape), runs.reshape(shape))


def figure_label(rows: pd.DataFrame, figure: str) -> str:
    """Return the label of a figure: of a truth value that of the share."""
    if is_truth(rows, figure):
        return f"{label_of(figure)} [% of runs]"
    return axis_of(figure, rows.attrs.get("units"))


def _cells(column: pd.Series[Any]) -> tuple[Any, list[str]]:
    """Return for every run the number of its cell, -1 for none, and the cells' names."""
    import pandas as pd

    codes, values = pd.factorize(column, sort=True)
    if len(values) <= CELLS or column.dtype.kind not in "if":
        return codes, [short(value) for value in values]
    edges = np.linspace(float(values[0]), float(values[-1]), CELLS + 1)
    place = np.clip(np.searchsorted(edges, column.to_numpy(float), side="right") - 1, 0, CELLS - 1)
    return np.where(codes < 0, -1, place), [short(float(middle)) for middle in (edges[1:] + edges[:-1]) / 2.0]


def heat_map(
    rows: pd.DataFrame,
    x: str,
    y: str,
    figure: str,
    zero: str | None = None,
    *,
    by: str | None = None,
    facet: str | None = None,
) -> Figure:
    """Draw the mean of a figure over two parameters; of a truth value (`passed`) the share of runs.

    Cells have their number in them while they are few, and beneath how many runs it is of; a cell of which some runs
    lack the figure is hatched finely, one in which none has it widely. A run with a contact is in no mean of gaps,
    times to collision and DRAC. `zero` says what the figure's zero means, and
    lets the colours part there. `by` and `facet` are columns that each have a panel for every value.
    """
    values, hit = numbers(rows, figure), contacts(rows, figure)
    values = np.where(hit, np.nan, values)
    cells, parts = cells_of(rows, x, y), _crossed(rows, by, facet)
    grids = [grid(cells, values, part.which) for part in parts]
    across = min(ACROSS, len(parts)) if by is None or facet is None else len(parts_of(rows, by, MAX_PANELS))
    look = _Look(rows, figure, zero, grids, across)
    down = -(-len(parts) // across)
    with page(WIDTH, 0.6 + down * look.height(len(cells.y))) as drawn:
        kind = "Share" if is_truth(rows, figure) else "Mean"
        known = sum(int(one.having.sum()) for one in grids)
        one_each = ", 1 in each cell" if look.single else ""
        one_each += f", {hit.sum():,} with a contact left out" if hit.any() else ""
        name(
            drawn,
            f"{kind} of {label_of(figure)} over {known:,} of {len(rows):,} runs{one_each}",
            *cautions(rows, figure),
        )
        if known == 0:
            blank(drawn.subplots(), f"no run has a {label_of(figure)}")
            return drawn
        every = drawn.subplots(down, across, sharex=True, sharey=True, squeeze=False).ravel().tolist()
        for empty in every[len(parts) :]:
            empty.remove()
        for axes, part, means in zip(every, parts, grids, strict=False):
            painted = _paint(axes, means, look)
            if part.word:
                word = textwrap.fill(part.word, PANEL_LETTERS // across)
                axes.set_title(word, loc="left", fontweight="bold", fontsize=10.5)
        _bar(drawn, painted, every[: len(parts)], look)
        _name_cells(every, len(parts), across, rows, (x, cells.x), (y, cells.y))
        return drawn


def _crossed(rows: pd.DataFrame, by: str | None, facet: str | None) -> list[RowSubset]:
    """Return a part for each panel, row by row."""
    if by is None or facet is None:
        return parts_of(rows, by or facet, MAX_PANELS)
    return [
        RowSubset(f"{down.word}, {across.word}", down.which & across.which, across.style)
        for down in parts_of(rows, facet, MAX_PANELS)
        for across in parts_of(rows, by, MAX_PANELS)
    ]


class _Look:
    """How the panels of a map are drawn, so that they can be compared."""

    def __init__(self, rows: pd.DataFrame, figure: str, zero: str | None, grids: list[Grid], across: int) -> None:
        self.word, self.zero = figure_label(rows, figure), zero
        self.colours = "cividis" if zero is None else "PuOr"
        share = is_truth(rows, figure)
        # Shares always have the same colours, so that maps of them can be compared.
        self.norm: Normalize = CenteredNorm(0.0) if zero else Normalize(0.0, 100.0) if share else Normalize()
        means = np.concatenate([one.mean.ravel() for one in grids])
        if np.isfinite(means).any():
            self.norm.autoscale_None(means[np.isfinite(means)])
        lines, columns = grids[0].mean.shape
        self.numbered = lines * columns <= NUMBERED and columns * across <= IN_A_LINE
        self.size = 10.0 if columns * across <= 8 else 7.5
        self.single = all((one.runs <= 1).all() for one in grids)  #: no cell holds several runs, so none says how many

    def height(self, lines: int) -> float:
        """Return the height of a panel of so many rows of cells [inch]."""
        row = COUNTED_ROW if self.numbered and not self.single else ROW
        return float(np.clip(1.3 + row * lines, 2.4, 5.0))


def _paint(axes: Axes, means: Grid, look: _Look) -> Any:
    """Draw the cells and what stands in them; return the mesh."""
    lines, columns = means.mean.shape
    missing: dict[str, Any] = {"facecolor": PAPER, "edgecolor": QUIET, "hatch": "///", "linewidth": 0.0}
    axes.fill_between((-0.5, columns - 0.5), -0.5, lines - 0.5, **missing)
    edges = (np.arange(columns + 1) - 0.5, np.arange(lines + 1) - 0.5)
    cells = axes.pcolormesh(*edges, np.ma.masked_invalid(means.mean), cmap=look.colours, norm=look.norm)
    axes.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
    for (row, column), mean in np.ndenumerate(means.mean):
        if np.isfinite(mean):
            _fill(axes, row, column, cells.to_rgba(np.array(mean)), means, look)
        elif look.numbered and means.runs[row, column]:
            word: dict[str, Any] = {"fontsize": min(7.5, look.size), "color": INK, "ha": "center", "va": "center"}
            none = f"0 of {means.runs[row, column]}"
            axes.text(column, row, none, bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.8}, **word)
    return cells


def _fill(axes: Axes, row: int, column: int, colour: Any, means: Grid, look: _Look) -> None:
    """Hatch a cell some of whose runs lack the figure, and write its number and how many runs it is of."""
    count, runs = int(means.having[row, column]), int(means.runs[row, column])
    red, green, blue, _ = colour
    ink = INK if 0.299 * red + 0.587 * green + 0.114 * blue > 0.5 else PAPER
    if count < runs:
        corner = (column - 0.5, row - 0.5)
        axes.add_patch(Rectangle(corner, 1.0, 1.0, fill=False, hatch="...", edgecolor=ink, linewidth=0.0, alpha=0.6))
    if not look.numbered:
        return
    box: dict[str, Any] = {"bbox": {"facecolor": colour, "edgecolor": "none", "pad": 0.8}} if count < runs else {}
    beside: dict[str, Any] = {"xycoords": "data", "textcoords": "offset points", "ha": "center", "va": "center"}
    beside |= {"color": ink, **box}
    mean_text = f"{means.mean[row, column]:.3g}"
    axes.annotate(mean_text, (column, row), (0.0, 0.0 if look.single else 5.5), fontsize=look.size, **beside)
    if not look.single:
        word = f"{count} of {runs}" if count < runs else f"n = {runs}"
        axes.annotate(word, (column, row), (0.0, -6.5), fontsize=min(7.5, look.size), **beside)


def _bar(drawn: Figure, cells: Any, every: list[Axes], look: _Look) -> None:
    """Draw what the colours mean."""
    bar = drawn.colorbar(cells, ax=every, label=look.word)
    if look.zero is not None:
        bar.ax.axhline(0.0, color=INK, linewidth=1.2)
        bar.ax.set_title(f"0: {look.zero}", fontsize=9)


def _name_cells(
    every: list[Axes], many: int, across: int, rows: pd.DataFrame, x: tuple[str, list[str]], y: tuple[str, list[str]]
) -> None:
    """Name the cells of the panels along the outer axes."""
    for number, axes in enumerate(every[:many]):
        for axis, (column, names) in ((axes.xaxis, x), (axes.yaxis, y)):
            longest = max(map(len, names)) + 2 if axis is axes.xaxis else 4 / across
            step = 1 + int(len(names) * longest * across // MAX_LABEL_LETTERS)
            axis.set_ticks(range(0, len(names), step), names[::step])
            if (number + across >= many) if axis is axes.xaxis else (number % across == 0):
                axis.set_label_text(axis_label(rows, column))
        axes.tick_params(labelbottom=number + across >= many, labelleft=number % across == 0)


def distribution(
    rows: pd.DataFrame,
    figure: str,
    by: str | None = None,
    band: tuple[float, float] | None = None,
    *,
    facet: str | None = None,
) -> Figure:
    """Draw what share of all runs has a figure no greater than each value; of every value of a parameter on its own.

    A curve ends at the share of the runs that have the figure. A collision is below every gap and time to collision, at
    whatever depth its overlap was measured, so that such a curve begins at 0 with the share of collisions; it is above
    every DRAC, so that such a curve ends below it. `band` is the least and the greatest value that passes; `facet` is a
    column that has a panel for every value.
    """
    values = numbers(rows, figure)
    values = values if is_truth(rows, figure) else with_contacts(rows, figure)
    with page(height=tall(rows, facet, 4.2, 3.4)) as drawn:
        drawn_panels = panels(drawn, rows, facet)
        title = f"Distribution of {label_of(figure)}: {np.isfinite(values).sum():,} of {len(rows):,} runs have it"
        title += f", {hits:,} collided" if (hits := int(np.isinf(values).sum())) else ""
        name(drawn, title, *cautions(rows, figure))
        for axes, panel in drawn_panels:
            plain(axes)
            if not np.isfinite(values[panel.which]).any():
                blank(axes, f"no run has a {label_of(figure)}")
                continue
            for part in parts_of(rows, by):
                _curve(axes, values[panel.which & part.which], part)
        for axes, panel in drawn_panels:
            if band is not None and np.isfinite(values[panel.which]).any():
                _pass_band(axes, band)
            axes.set_ylim(0.0, 102.0)
            explain(axes, title=panel.word)
        outer(drawn_panels, figure_label(rows, figure), "runs up to there [% of all]")
        return drawn


def _curve(axes: Axes, values: Floats, part: RowSubset) -> None:
    """Draw the share of values up to each of them; of very many some. An infinity is beyond all, NaN nowhere."""
    known = np.sort(values[~np.isnan(values)])
    ordered = known[np.isfinite(known)]
    if not len(values):
        return
    below, hits = int(np.isneginf(known).sum()), int(np.isinf(known).sum())
    some = np.unique(np.linspace(0, len(ordered) - 1, min(STEPS, len(ordered))).round().astype(int))
    share = 100.0 * (below + some + 1) / len(values)
    first = 0.0 if below else ordered[:1]
    begin, level = np.repeat(first, 1 + (below > 0)), [0.0, 100.0 * below / len(values)]
    x, y = np.append(begin, ordered[some]), np.append(level[: len(begin)], share)
    lacking = f"{len(ordered):,} of {len(values):,} runs" if len(ordered) < len(values) else f"{len(values):,} runs"
    lacking += f", {hits:,} collided" if hits else ""
    style: dict[str, Any] = {"color": part.style.colour, "linestyle": part.style.stroke}
    axes.step(x, y, where="post", label=f"{part.word or 'all'} ({lacking})", **style)
    if 0 < len(ordered) + below < len(values):
        axes.plot(x[-1], y[-1], "o", markerfacecolor=PAPER, markersize=5.0, color=part.style.colour)


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
