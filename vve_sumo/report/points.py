"""The runs of a sweep as numbers, for the plot that names the run that the reader points at.

Reads rows of a sweep; knows nothing of the page or of how points are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.report.formatting import short

if TYPE_CHECKING:
    import pandas as pd

#: runs on the page at most; of more every second, third … is shown
MAX_RUNS = 2000
#: figures that a reader can choose beside those that matter most
FIGURES = ("stop_gap_m", "min_gap_m", "min_ttc_s", "max_drac_mps2", "impact_speed_mps", "max_deceleration_mps2")


def points(rows: pd.DataFrame, parameters: Sequence[str], figures: Sequence[str]) -> dict[str, Any] | None:
    """Return the runs for `page.js`; None where they have no figure or nothing to draw it over."""
    shown = rows.iloc[:: 1 + (len(rows) - 1) // MAX_RUNS] if len(rows) else rows
    wanted = dict.fromkeys([*figures, *FIGURES])
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
        "passed": [{1.0: True, 0.0: False}.get(value) for value in _numbers(shown, "passed")],
        "text": [
            _text(row) for row in zip(*(shown[name].tolist() for name in ("fault", "outcome", "failed")), strict=True)
        ],
    }


def _numbers(rows: pd.DataFrame, name: str) -> list[float]:
    numbers: list[float] = rows[name].to_numpy(np.float64, na_value=np.nan).tolist()
    return numbers


def _text(row: tuple[Any, ...]) -> str:
    """Return how a run ended."""
    fault, outcome, failed = (str(part) if isinstance(part, str) else "" for part in row)
    return f"fault: {fault}" if fault else f"{outcome}; {failed}" if failed else outcome


def _column(rows: pd.DataFrame, name: str) -> dict[str, Any]:
    """Return a column: numbers, or words with the names that stand for their numbers."""
    unit = rows.attrs.get("units", {}).get(name) or unit_of(name)
    column: dict[str, Any] = {"label": label_of(name), "unit": unit}
    if rows[name].dtype.kind in "iuf":
        values = _numbers(rows, name)
        return column | {"values": [float(f"{one:.6g}") if math.isfinite(one) else None for one in values]}
    words = [short(value) for value in rows[name].tolist()]
    names = list(dict.fromkeys(words))
    return column | {"values": [names.index(word) for word in words], "names": names}
