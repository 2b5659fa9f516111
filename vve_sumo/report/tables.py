"""Tables of the analysis as tables of the page: heads with units, numbers to be read, what is missing said.

Knows pandas' tables and their `attrs`; not what they are about.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of, meaning_of
from vve_sumo.report.html import Column, Html, escaped, join, table, tag
from vve_sumo.report.words import NONE, number, short

if TYPE_CHECKING:
    import pandas as pd

#: of a number that has a unit; those of less than a tenth of it have one more
DIGITS = 2


def head_of(column: str, units: Mapping[str, str] | None = None, labels: Mapping[str, str] | None = None) -> str:
    """Return what stands over a column: what it is, and its unit."""
    unit, label = (units or {}).get(column) or unit_of(column), (labels or {}).get(column) or label_of(column)
    return f"{label} [{unit}]" if unit else label


def about(name: str, meaning: str) -> Html:
    """Return what something is called with what it is beneath."""
    return join(name, tag("span", meaning, class_="about")) if meaning else escaped(name)


def named(key: str) -> Html:
    """Return what a figure is called with what it is beneath."""
    return about(label_of(key), meaning_of(key))


def of_frame(frame: pd.DataFrame, name: str, first: str = "", keep: Sequence[str] | None = None) -> Html:
    """Return a table as it is, with its index as first column under the head `first` if it has one.

    `keep` chooses columns, in their order; those that the table has not are left out.
    """
    shown = frame if keep is None else frame[[column for column in keep if column in frame.columns]]
    numeric = [kind.kind in "iuf" for kind in shown.dtypes]
    columns = [Column(_head(frame, str(column)), right) for column, right in zip(shown.columns, numeric, strict=True)]
    rows = [list(map(cell, row)) for row in shown.astype(object).itertuples(index=False, name=None)]
    if first:
        columns = [Column(first), *columns]
        rows = [
            [key if isinstance(key, str) else short(key), *row]
            for key, row in zip(shown.index.tolist(), rows, strict=True)
        ]
    return table(columns, rows, name)


def meanings(frame: pd.DataFrame, keep: Sequence[str] | None = None) -> Html:
    """Return what the columns of a table are, as a list of words."""
    told = frame.attrs.get("meanings", {})
    columns = [str(column) for column in (frame.columns if keep is None else keep) if told.get(str(column))]
    parts = [part for column in columns for part in (tag("dt", _head(frame, column)), tag("dd", str(told[column])))]
    return tag("dl", *parts) if parts else Html("")


def _head(frame: pd.DataFrame, column: str) -> str:
    return head_of(column, frame.attrs.get("units"), frame.attrs.get("labels"))


def cell(value: Any) -> str:
    """Return what stands in a cell."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return number(float(value))
    return short(int(value)) if isinstance(value, np.integer) else short(value)
