"""What the metrics of the ticks add up to over a drive or a stretch of it: exposure to risk, and comfort.

To add one, write its row here with its function. Each tick holds until the next. A tick at which nothing
closes in, or nothing is known, counts as time without exposure. Knows columns of ticks; nothing of their origin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from vve_sumo.metrics import following
from vve_sumo.metrics.metric import MetricTable
from vve_sumo.values import Floats


class Stretch(NamedTuple):
    """A stretch of a drive."""

    columns: Mapping[str, Floats]  #: those of `PER_TICK`, an entry a tick
    deceleration_limit: float  #: that is declared of the car [m/s2]


EXPOSURE: MetricTable[Stretch] = MetricTable()
metric = EXPOSURE.add


def _of_ttc(function: Callable[[Floats, Floats], float], stretch: Stretch) -> float:
    return function(stretch.columns["time_s"], stretch.columns["ttc_s"])


BELOW = f"below {following.TTC_THRESHOLD} s"
for name, label, meaning, function in (
    ("tet_s", "time exposed (TET)", f"time with ttc_s {BELOW}", following.time_exposed),
    ("tit_s2", "time integrated (TIT)", f"by how much ttc_s lay {BELOW}, summed over time", following.time_integrated),
):
    source = "Minderhoud and Bovy 2001"
    metric(name, label, meaning, partial(_of_ttc, function), worse="higher", source=source)


def _crash_potential(stretch: Stretch) -> float:
    columns = stretch.columns
    return following.crash_potential_index(columns["time_s"], columns["drac_mps2"], stretch.deceleration_limit)


metric(
    "cpi_share",
    "crash potential index (CPI)",
    "share of the time with drac_mps2 above the declared deceleration limit",
    _crash_potential,
    worse="higher",
    source="Cunto and Saccomanno 2007",
)


def _share_below(distance: str, stretch: Stretch) -> float:
    columns = stretch.columns
    return following.crash_potential_index(columns["time_s"], columns[distance] - columns["gap_m"], 0.0)


for name, label, distance in (
    ("rss_share", "gap below RSS", "rss_distance_m"),
    ("rss_following_share", "gap below RSS, ordinary following", "rss_following_distance_m"),
):
    meaning = f"share of the time with gap_m below {distance}"
    metric(name, label, meaning, partial(_share_below, distance), worse="higher")
metric(
    "max_jerk_mps3",
    "maximum jerk",
    "greatest size of jerk_mps3",
    lambda stretch: float(np.fmax.reduce(np.abs(stretch.columns["jerk_mps3"]), initial=np.nan)),
    worse="higher",
)


def _rms(column: str, stretch: Stretch) -> float:
    """Return the root mean square of what is known of a column; NaN of nothing."""
    values = stretch.columns[column]
    known = values[~np.isnan(values)]
    return float(np.mean(known**2) ** 0.5) if len(known) else float("nan")


for column, label in (("jerk_mps3", "RMS jerk"), ("acceleration_mps2", "RMS acceleration")):
    metric(f"rms_{column}", label, f"root mean square of {column}", partial(_rms, column), worse="higher")
