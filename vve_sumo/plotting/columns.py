"""Columns of rows as plain arrays, whichever way pandas holds what is missing.

Knows no figure by name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vve_sumo.errors import ConfigError, hint
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd


def need(rows: pd.DataFrame, *columns: str) -> None:
    """Raise ConfigError in one line unless the rows have these columns."""
    missing = next((name for name in columns if name not in rows), None)
    if missing is not None:
        raise ConfigError(f"the rows have no column {missing!r}; {hint(missing, map(str, rows.columns))}")


def numbers(rows: pd.DataFrame, column: str) -> Floats:
    """Return a column (n), NaN where a run has none; a truth value as 0 or 100 %.

    Raises ConfigError for a column that the rows do not have, and for one of texts.
    """
    need(rows, column)
    if is_truth(rows, column):
        return np.select([holds(rows, column), holds(rows, column, False)], [100.0, 0.0], np.nan)
    try:
        values: Floats = rows[column].to_numpy(np.float64, na_value=np.nan)
    except (TypeError, ValueError):
        known = ", ".join(map(str, rows.select_dtypes("number").columns))
        raise ConfigError(f"column {column!r} holds texts, expected one of numbers; there are {known}") from None
    return values


def is_truth(rows: pd.DataFrame, column: str) -> bool:
    """Whether a column holds truth values, some of them perhaps missing."""
    import pandas as pd

    return bool(pd.api.types.infer_dtype(rows[column], skipna=True) == "boolean")


def holds(rows: pd.DataFrame, column: str, value: Any = True) -> NDArray[np.bool_]:
    """Return where a column is known to have a value (n)."""
    return rows[column].eq(value).fillna(False).to_numpy(bool)


def errors(rows: pd.DataFrame) -> NDArray[np.bool_]:
    """Return which runs came to an error (n)."""
    return rows["error"].fillna("").ne("").to_numpy(bool)


def cautions(rows: pd.DataFrame, figure: str) -> list[str]:
    """Return what must be known of a plot of a figure: that runs which the gateway stopped have a gap of no stop."""
    if figure != "stop_gap_m" or "outcome" not in rows:
        return []
    ended = holds(rows, "outcome", "fault") & np.isfinite(numbers(rows, figure))
    return (
        [f"the gateway stopped {runs(ended)} of these for a reason code, wherever the car was"] if ended.any() else []
    )


def runs(which: NDArray[np.bool_]) -> str:
    """Return in words how many runs are meant."""
    return f"{which.sum():,} run{'s' * bool(which.sum() != 1)}"
