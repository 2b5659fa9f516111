"""Tables of the analysis that carry units, labels and meanings of their columns with them.

Knows names only, nothing of what a column is about.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from vve_sumo.metrics.metric import Metric, unit_of
from vve_sumo.metrics.table import label_of

if TYPE_CHECKING:
    import pandas as pd


def described(frame: pd.DataFrame, columns: Mapping[str, Metric | str]) -> pd.DataFrame:
    """Return a table whose `attrs` say of every column its unit, its label and what it is (`meanings`).

    `columns` are rows of a table of metrics, or meanings alone.
    """
    known = {str(name): columns.get(str(name), "") for name in frame.columns}
    frame.attrs["units"] = {name: unit_of(name) for name in known}
    frame.attrs["labels"] = {
        name: column.label if isinstance(column, Metric) else label_of(name) for name, column in known.items()
    }
    frame.attrs["meanings"] = {
        name: column.meaning if isinstance(column, Metric) else column for name, column in known.items()
    }
    return frame
