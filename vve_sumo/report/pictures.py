"""Which plots a report shows, and what one sees in each.

Chooses and says; draws nothing itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.run import Run
from vve_sumo.metrics.table import label_of
from vve_sumo.report.asked import varied_criteria
from vve_sumo.report.picture import Picture, drawn

if TYPE_CHECKING:
    import pandas as pd

SHEET = (
    "Left: the street from above with the path, where the car went and what was around it, and beneath it the place "
    "where the drive ended, seen driving to the right. Right: the drive over time."
)
SAFETY = (
    "From above: the gap to what was ahead beside the distance that Responsibility-Sensitive Safety asks for, the time "
    "to collision, the deceleration that it took to avoid a contact, and the headway, while something was ahead."
)
APPROACH = (
    "Every point of the line is a moment of the drive: its speed to the right, its gap upwards; it begins at the ring "
    "and ends at the dot. In the grey under the dotted line the car as declared can no longer stop before what stands "
    "still ahead."
)
LEDGER = (
    "Above: the slowest ticks over drive time, each column made of its legs, with the rig's budget. Below: the "
    "percentiles of every leg."
)
AT_REST = "Each run's gap at rest over its speed. Crosses touched something; runs that have no gap stand at the edge."
#: runs whose speeds spread less were all driven at one speed [m/s]
LEAST_SPREAD = 0.5
STOPS = (
    "Above: the distance from the onset of braking to rest over the speed at the onset, beside the closed form. Below: "
    "how far each stop lies from its own bound; above the line it was longer than the car as declared would need."
)
BOUNDARY = "Every run of the search where it was driven, whether it met the criterion, and where that flips."
WORST = (
    "The figure of every run in the order of the search with the worst so far, and where among the parameters the "
    "search looked."
)


#: of a map
LACKING = (
    "Runs without that figure, such as the gap of one that drove through what was ahead, are in no mean; a cell that "
    "has no other runs is hatched."
)


def of_drive(run: Run) -> tuple[Picture, ...]:
    """Return the plots of a drive."""
    from vve_sumo import plotting

    told = [drawn(plotting.drive_sheet(run), "drive_sheet", "the drive from above and over time", SHEET)]
    if np.isfinite(run.lead.gap).any():  # else there is nothing to be seen in them
        told.append(drawn(plotting.safety_over_time(run), "safety_over_time", "safety over drive time", SAFETY))
        told.append(drawn(plotting.gap_against_speed(run), "gap_against_speed", "gap over speed", APPROACH))
    if run.holds("latency"):
        told.append(
            drawn(plotting.latency_ledger(run), "latency_ledger", "latency of the legs over drive time", LEDGER)
        )
    return tuple(told)


def of_sweep(sweep: Sweep, rows: pd.DataFrame, figures: Sequence[str]) -> tuple[Picture, ...]:
    """Return the plots of a sweep; `figures` are those that matter, the most important one first."""
    from vve_sumo import plotting

    searched = bool(sweep.plan["spec"].get("search"))
    told = [*_search(sweep)] if searched else [*_maps(sweep, rows, figures), *_curves(sweep, rows, figures)]
    if rows["stop_gap_m"].notna().any() and _differ(rows):
        told.append(drawn(plotting.gap_against_speed(rows), "gap_against_speed", "gap at rest over speed", AT_REST))
    if rows["stop_distance_m"].notna().any():
        told.append(drawn(plotting.stopping_distance(rows), "stopping_distance", "stopping distance over speed", STOPS))
    return tuple(told)


def _differ(rows: pd.DataFrame) -> bool:
    """Whether the runs were driven at speeds that differ: a plot over a single one says nothing."""
    speed = rows["stop_onset_speed_mps"]
    return bool(speed.max() - speed.min() > LEAST_SPREAD)


def _search(sweep: Sweep) -> Iterator[Picture]:
    from vve_sumo import plotting

    along = "along" in sweep.plan["spec"]["search"]
    alt = "where the criterion flips" if along else "what the search came to"
    yield drawn(plotting.boundary(sweep), "search", alt, BOUNDARY if along else WORST)


def _maps(sweep: Sweep, rows: pd.DataFrame, figures: Sequence[str]) -> Iterator[Picture]:
    """Heat maps over the first two parameters that were varied, where there are two."""
    from vve_sumo import plotting

    varied = [name for name in sweep.parameters if rows[name].nunique() > 1]
    if len(varied) < 2:
        return
    x, y, *others = varied
    over = f" Every cell holds the runs of all values of {', '.join(others)}." if others else ""
    for figure in ("passed", *figures[:2]):
        if not rows[figure].notna().any():
            continue
        what = "share of runs that passed" if figure == "passed" else f"mean {label_of(figure)}"
        caption = f"The {what} over {x} to the right and {y} upwards.{over} {LACKING}"
        yield drawn(plotting.heat_map(rows, x, y, figure), f"map_{figure}", f"{what} over {x} and {y}", caption)


def _curves(sweep: Sweep, rows: pd.DataFrame, figures: Sequence[str]) -> Iterator[Picture]:
    """Distribution of the figure that matters most, of every value of the first parameter on its own."""
    from vve_sumo import plotting

    figure = next((name for name in figures if rows[name].notna().any()), None)
    if figure is None:
        return
    by = next((name for name in sweep.parameters if rows[name].nunique() > 1), None)
    what = f"distribution of {label_of(figure)}"
    apart = f", some values of {by} each on its own" if by else ""
    band = _band(sweep, figure)
    caption = f"What share of the runs has a {label_of(figure)} of at most so much{apart}."
    caption += " The shaded part does not pass." if band else ""
    yield drawn(plotting.distribution(rows, figure, by, band), f"distribution_{figure}", what, caption)


def _band(sweep: Sweep, figure: str) -> tuple[float, float] | None:
    """Return what a figure is to be; None where that is not the same for every run, or nothing is asked."""
    table = sweep.plan["table"]
    wanted = (table.get("criteria") or {}).get(figure)
    if not isinstance(wanted, dict) or figure in varied_criteria(table, sweep.parameters):
        return None
    low, high = wanted.get("min"), wanted.get("max")
    return -math.inf if low is None else float(low), math.inf if high is None else float(high)
