"""Tables of the page: what stands in their cells, and how a table of the analysis becomes one.

Knows pandas' tables and their `attrs`, labels, units and meanings; neither HTML nor what a table is about.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of, meaning_of
from vve_sumo.report.formatting import NONE, number, short

if TYPE_CHECKING:
    import pandas as pd


class Column(NamedTuple):
    """A column of a table."""

    head: str
    number: bool = False  #: whether it holds numbers, which are aligned to the right
    meaning: str = ""  #: what the head means


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell that is more than plain text."""

    text: str
    meaning: str = ""  #: what the text means, which the reader unfolds
    kind: Literal["", "code", "hash", "yes", "no", "quiet", "blank"] = ""  #: how the text is set


Row = Sequence[Cell | str]


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table; the first cell of a row is its head. One without rows is not shown."""

    name: str  #: read out to those who do not see the table
    columns: Sequence[Column | str]
    rows: Sequence[Row]
    total: int = 0  #: rows that there are, where the page shows only the first of them

    @property
    def heads(self) -> list[Column]:
        """The columns, each with whether it holds numbers."""
        return [Column(one) if isinstance(one, str) else one for one in self.columns]


def head_of(column: str, units: Mapping[str, str] | None = None, labels: Mapping[str, str] | None = None) -> str:
    """Return the head of a column: its label and its unit."""
    unit, label = (units or {}).get(column) or unit_of(column), (labels or {}).get(column) or label_of(column)
    return f"{label} [{unit}]" if unit else label


def named(key: str) -> Cell:
    """Return the label of a figure with its meaning."""
    return Cell(label_of(key), meaning_of(key))


def of_frame(
    frame: pd.DataFrame, name: str, first: str = "", keep: Sequence[str] = (), most: int = sys.maxsize
) -> ReportTable:
    """Return a data frame as a table, its index as the first column under the head `first` if that is given.

    `keep` chooses columns, in their order; those that the frame has not are left out. `most` limits the rows.
    """
    shown = frame[[column for column in keep if column in frame.columns]] if keep else frame
    stated = frame.attrs.get("meanings", {})
    columns = [
        Column(_head(frame, str(name)), kind.kind in "iuf", str(stated.get(str(name)) or ""))
        for name, kind in shown.dtypes.items()
    ]
    rows = [list(map(cell, row)) for row in shown.head(most).astype(object).itertuples(index=False, name=None)]
    if first:
        columns = [Column(first), *columns]
        rows = [[cell(key), *row] for key, row in zip(shown.index[:most].tolist(), rows, strict=True)]
    return ReportTable(name, columns, rows, len(frame))


def meanings(frame: pd.DataFrame) -> list[tuple[str, str]]:
    """Return the heads of a data frame's columns with their meanings, as far as it states them."""
    stated = frame.attrs.get("meanings", {})
    return [(_head(frame, str(name)), str(stated[str(name)])) for name in frame.columns if stated.get(str(name))]


def _head(frame: pd.DataFrame, column: str) -> str:
    return head_of(column, frame.attrs.get("units"), frame.attrs.get("labels"))


def cell(value: Any) -> str:
    """Return a value of a data frame as the text of a cell."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return number(float(value))
    return short(int(value)) if isinstance(value, np.integer) else short(value)
