"""The drive over time as numbers, for the curves that show their values where the reader points.

Reads the columns of `over_time`; knows nothing of the page or of how curves are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.over_time import over_time
from vve_sumo.analysis.run import Run
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: ticks on the page, about; of a longer drive those that hold the extremes of every curve are shown
MAX_TICKS: Final = 3000
#: panels from above: the columns of each; one of each of the user's metrics of the ticks follows
PANELS = (
    ("speed_mps",),
    ("acceleration_mps2",),
    ("weighted_acceleration_mps2",),
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
    leader = frame["leader"].astype(str).tolist()
    changed = np.array([False, *(one not in (other, "") for one, other in pairwise(leader))], bool)
    names = list(dict.fromkeys(leader))
    own = [(name,) for name, row in run.own_metrics.per_tick.items() if row.kind == "float" and name in frame]
    wanted = [*PANELS, *own]
    columns = {name: _column(frame, name, changed) for panel in wanted for name in panel}
    shown = thinned(list(columns.values()), MAX_TICKS)
    panels = [_panel({name: columns[name] for name in panel}, shown) for panel in wanted]
    return {
        "kind": "curves",
        "time": _rounded(frame["time_s"].to_numpy(np.float64)[shown]),
        "leaders": names,
        "leader": [names.index(leader[row]) for row in shown.tolist()],
        "panels": [panel for panel in panels if panel["series"]],
    }


def thinned(columns: Sequence[Floats], most: int) -> NDArray[np.intp]:
    """Return which rows of some columns (n each) to show, about `most` of them: all where there are no more.

    Every stretch of rows keeps the rows with each column's least and greatest value, so that no peak is lost, and every
    gap in a column its edges, so that no line is drawn across it.
    """
    rows = len(columns[0])
    if rows <= most:
        return np.arange(rows)
    edges = np.linspace(0, rows, 1 + max(1, most // (2 * len(columns) + 1))).round().astype(np.intp)
    kept = np.zeros(rows, bool)
    kept[edges[:-1]] = kept[-1] = True
    for values in columns:
        known = np.isfinite(values)
        flips = np.flatnonzero(known[1:] != known[:-1])
        kept[flips] = kept[flips + 1] = True
        for begin, end in pairwise(edges.tolist()):
            if known[begin:end].any():
                part = values[begin:end]
                kept[[begin + int(np.nanargmin(part)), begin + int(np.nanargmax(part))]] = True
    return np.flatnonzero(kept)


def _column(frame: pd.DataFrame, name: str, changed: NDArray[np.bool_]) -> Floats:
    """Return a column, broken where it is of another lead vehicle than before."""
    values: Floats = frame[name].to_numpy(np.float64).copy()
    if name in OF_LEADER:
        values[changed] = np.nan
    return values


def _panel(columns: Mapping[str, Floats], shown: NDArray[np.intp]) -> dict[str, Any]:
    series = [
        {"label": label_of(name), "values": _rounded(values[shown])}
        for name, values in columns.items()
        if np.isfinite(values).any()
    ]
    first = next(iter(columns))
    return {"unit": unit_of(first), "most": MAX_SHOWN.get(first), "series": series}


def _rounded(values: Any) -> list[float | None]:
    """Return numbers to a thousandth; None, which JSON has, for what is none."""
    return [round(value, 3) if math.isfinite(value) else None for value in values.tolist()]
