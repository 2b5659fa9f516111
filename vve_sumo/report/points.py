"""The runs of a sweep as numbers, for the plot that names the run that the reader points at.

Reads rows of a sweep; knows nothing of the page or of how points are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.report.formatting import short
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: runs on the page; of more, as many are shown, but all that matter, and at least half as many of the others
MAX_RUNS: Final = 2000
#: of the draw of the others, so that a report is the same whenever it is written
SEED: Final = 20240901
#: figures that a reader can choose beside those that matter most
FIGURES = ("stop_gap_m", "min_gap_m", "min_ttc_s", "max_drac_mps2", "impact_speed_mps", "max_deceleration_mps2")


def points(rows: pd.DataFrame, parameters: Sequence[str], figures: Sequence[str]) -> dict[str, Any] | None:
    """Return the runs for `page.js`; None where they have no figure or nothing to draw it over."""
    wanted = dict.fromkeys([*figures, *FIGURES])
    shown = rows.iloc[chosen(rows, [name for name in (*wanted, *parameters) if name in rows])]
    y = [_column(shown, name) for name in wanted if name in rows and shown[name].notna().any()]
    varied = [name for name in parameters if shown[name].nunique() > 1]
    if not y or not varied:
        return None
    return {
        "kind": "points",
        "runs": len(rows),
        "x": [_column(shown, name) for name in varied],
        "y": y,
        "key": shown["key"].astype(str).tolist(),
        "seed": [short(value) for value in shown["seed"].tolist()],
        "passed": [{1.0: True, 0.0: False}.get(value) for value in _numbers(shown, "passed").tolist()],
        "text": [
            _text(row) for row in zip(*(shown[name].tolist() for name in ("error", "outcome", "failed")), strict=True)
        ],
    }


def chosen(rows: pd.DataFrame, columns: Sequence[str]) -> NDArray[np.intp]:
    """Return the places, in order, of the runs that a plot of many shows.

    All that failed, collided or had an error, and those with the least and the greatest value of each of the `columns`;
    of the others a draw at random, for every k-th of a grid would be the same few values of a parameter.
    """
    if len(rows) <= MAX_RUNS:
        return np.arange(len(rows))
    matters = (_numbers(rows, "passed") == 0.0) | (_numbers(rows, "collision") == 1.0)
    matters |= rows["error"].fillna("").ne("").to_numpy(bool)
    for name in columns:
        if rows[name].dtype.kind in "iuf" and np.isfinite(values := _numbers(rows, name)).any():
            matters[[np.nanargmin(values), np.nanargmax(values)]] = True
    others = np.flatnonzero(~matters)
    many = min(len(others), max(MAX_RUNS - int(matters.sum()), MAX_RUNS // 2))
    drawn = np.random.default_rng(SEED).choice(others, many, replace=False)
    return np.sort(np.concatenate([np.flatnonzero(matters), drawn]))


def _numbers(rows: pd.DataFrame, name: str) -> Floats:
    numbers: Floats = rows[name].to_numpy(np.float64, na_value=np.nan)
    return numbers


def _text(row: tuple[Any, ...]) -> str:
    """Return how a run ended."""
    error, outcome, failed = (str(part) if isinstance(part, str) else "" for part in row)
    return f"error: {error}" if error else f"{outcome}; {failed}" if failed else outcome


def _column(rows: pd.DataFrame, name: str) -> dict[str, Any]:
    """Return a column: numbers, or words with the names that stand for their numbers."""
    unit = rows.attrs.get("units", {}).get(name) or unit_of(name)
    column: dict[str, Any] = {"label": label_of(name), "unit": unit}
    if rows[name].dtype.kind in "iuf":
        values = _numbers(rows, name).tolist()
        return column | {"values": [float(f"{one:.6g}") if math.isfinite(one) else None for one in values]}
    words = [short(value) for value in rows[name].tolist()]
    names = list(dict.fromkeys(words))
    return column | {"values": [names.index(word) for word in words], "names": names}
