"""The drive over time as numbers, for the curves that show their values where the reader points.

Reads the columns of `over_time`; knows nothing of the page or of how curves are drawn.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo.analysis.over_time import over_time
from vve_sumo.analysis.run import Run
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of

if TYPE_CHECKING:
    import pandas as pd

#: ticks on the page at most; of a longer drive every second, third … is shown
MAX_TICKS = 3000
#: panels from above: the columns of each
PANELS = (
    ("speed_mps",),
    ("acceleration_mps2",),
    ("gap_m", "rss_distance_m"),
    ("ttc_s", "headway_s"),
    ("drac_mps2",),
    ("lateral_deviation_m",),
)
#: what is greater is no matter of safety, and would flatten what is
MAX_SHOWN = {"ttc_s": 10.0}
#: columns that are of the lead vehicle, whose curves break where another one takes its place
OF_LEADER = frozenset(("gap_m", "rss_distance_m", "ttc_s", "headway_s", "drac_mps2"))


def curves(run: Run) -> dict[str, Any]:
    """Return the drive over time for `page.js`: times, names of the lead vehicle, panels of series."""
    frame = over_time(run)
    every = 1 + (len(frame) - 1) // MAX_TICKS
    leader = frame["leader"].astype(str).tolist()
    changed = np.array([False, *(one not in (other, "") for one, other in pairwise(leader))], bool)
    names = list(dict.fromkeys(leader))
    panels = [_panel(frame, columns, changed, every) for columns in PANELS]
    return {
        "kind": "curves",
        "time": _rounded(frame["time_s"].to_numpy(np.float64)[::every]),
        "leaders": names,
        "leader": [names.index(name) for name in leader[::every]],
        "panels": [panel for panel in panels if panel["series"]],
    }


def _panel(frame: pd.DataFrame, columns: tuple[str, ...], changed: Any, every: int) -> dict[str, Any]:
    series = []
    for column in columns:
        values = frame[column].to_numpy(np.float64).copy()
        if column in OF_LEADER:
            values[changed] = np.nan
        if np.isfinite(values).any():
            series.append({"label": label_of(column), "values": _rounded(values[::every])})
    return {"unit": unit_of(columns[0]), "most": MAX_SHOWN.get(columns[0]), "series": series}


def _rounded(values: Any) -> list[float | None]:
    """Return numbers to a thousandth; None, which JSON has, for what is none."""
    return [round(value, 3) if math.isfinite(value) else None for value in values.tolist()]
