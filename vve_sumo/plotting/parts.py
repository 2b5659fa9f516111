"""Rows told apart: by the values of a parameter within a plot, and by those of another over panels side by side.

Knows names of columns and looks; it must not know what is drawn of a part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vve_sumo.analysis.effects import is_number
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import axis_of, label_of
from vve_sumo.plotting.columns import need
from vve_sumo.plotting.style import LINE_STYLES, SeriesStyle

if TYPE_CHECKING:
    import pandas as pd

#: panels of a figure at most, and panels side by side; more could not be read on a page
MAX_PANELS, ACROSS = 6, 2


class RowSubset(NamedTuple):
    """Some of the rows."""

    word: str  #: what they have in common; empty of all rows
    which: NDArray[np.bool_]  #: of every row (n) whether it is one of them
    style: SeriesStyle

    def legend_label(self, word: str) -> str:
        """Return what a legend calls something that is drawn of this part."""
        return f"{self.word}: {word}" if self.word else word


def parts_of(rows: pd.DataFrame, by: str | None, most: int = len(LINE_STYLES)) -> list[RowSubset]:
    """Return the parts of the rows by the values of a column, every row in one of them; all rows where `by` is None.

    Of more than `most` values, numbers are cut into portions of equal width, and the rarer texts are taken together.
    Rows without a value are a part of their own.
    """
    if by is not None:
        need(rows, by)
    if by is None or not len(rows):
        return [RowSubset("", np.ones(len(rows), bool), LINE_STYLES[0])]
    place, words = _numbered(rows, by, most)
    if (place < 0).any():
        place, words = np.where(place < 0, len(words), place), [*words, f"without {label_of(by)}"]
    looks = (LINE_STYLES * (1 + len(words) // len(LINE_STYLES)))[: len(words)]
    return [RowSubset(word, place == n, style) for n, (word, style) in enumerate(zip(words, looks, strict=True))]


def _numbered(rows: pd.DataFrame, by: str, most: int) -> tuple[NDArray[np.intp], list[str]]:
    """Return for every row the number of its part, -1 for none, and what the parts are called."""
    import pandas as pd

    column, most = rows[by], most - int(rows[by].isna().any())
    codes, values = pd.factorize(column, sort=is_number(column))
    if not is_number(column):
        return _rarer_together(np.asarray(codes, np.intp), [*map(str, values)], label_of(by), most)
    unit = (rows.attrs.get("units") or {}).get(by) or unit_of(by)
    if len(values) <= most:
        return np.asarray(codes, np.intp), [f"{label_of(by)} {short(value)} {unit}".strip() for value in values]
    edges = np.linspace(float(values[0]), float(values[-1]), most + 1)
    numbers = column.to_numpy(np.float64, na_value=np.nan)
    place = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, most - 1)
    ends = zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    words = [f"{label_of(by)} {short(low)} to {short(high)} {unit}".strip() for low, high in ends]
    return np.where(codes < 0, -1, place), words


def _rarer_together(
    codes: NDArray[np.intp], words: list[str], label: str, most: int
) -> tuple[NDArray[np.intp], list[str]]:
    if len(words) <= most:
        return codes, words
    often = np.argsort(-np.bincount(codes[codes >= 0], minlength=len(words)), kind="stable")[: most - 1]
    place = np.full(len(words) + 1, most - 1)  # the last is of those without a value
    place[often], place[-1] = range(most - 1), -1
    others = f"{len(words) - most + 1} other values of {label}"
    return place[codes], [*(words[n] for n in often), others]


def short(value: Any) -> str:
    """Return a value of a parameter in few letters."""
    return f"{value:.3g}" if isinstance(value, int | float) and not isinstance(value, bool) else str(value)


def panels(figure: Figure, rows: pd.DataFrame, facet: str | None, **shared: Any) -> list[tuple[Axes, RowSubset]]:
    """Return a panel for every part of the rows by a column, with the same axes; one panel where `facet` is None."""
    parts = parts_of(rows, facet, MAX_PANELS)
    across = min(ACROSS, len(parts))
    down = -(-len(parts) // across)
    drawn = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False, **shared).ravel().tolist()
    for empty in drawn[len(parts) :]:
        empty.remove()
    return [*zip(drawn, parts, strict=False)]


def tall(rows: pd.DataFrame, facet: str | None, alone: float, row: float) -> float:
    """Return the height of a page [inch]: `alone` of one panel, else `row` for each row of panels."""
    count = len(parts_of(rows, facet, MAX_PANELS))
    return alone if count == 1 else 0.5 + row * -(-count // ACROSS)


def axis_label(rows: pd.DataFrame, column: str) -> str:
    """Return what an axis of a parameter says: its label, and the unit of a number."""
    return axis_of(column, rows.attrs.get("units")) if is_number(rows[column]) else label_of(column)


def outer(drawn: list[tuple[Axes, RowSubset]], x: str, y: str) -> None:
    """Name the axes of panels where they stand at the left and below."""
    across = min(ACROSS, len(drawn))
    for number, (axes, _part) in enumerate(drawn):
        if number % across == 0:
            axes.set_ylabel(y)
        below = number + across >= len(drawn)
        axes.tick_params(labelbottom=below)
        if below:
            axes.set_xlabel(x)
