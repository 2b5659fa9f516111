"""Which plots a report shows, and the caption of each.

Chooses and describes; draws nothing itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.effects import chosen_axes
from vve_sumo.analysis.run import Run
from vve_sumo.metrics.moment import MomentMeasure, moment_of
from vve_sumo.metrics.table import label_of
from vve_sumo.report.picture import DrawnPlot, picture_of
from vve_sumo.report.settings import varied_criteria

if TYPE_CHECKING:
    import pandas as pd

#: what the lower one of the two windows on the virtual road shows, by what the moment was chosen; None for no moment
WINDOW = {
    MomentMeasure.CONTACT: "the first contact",
    MomentMeasure.TIME_TO_COLLISION: "the moment of the least time to collision",
    MomentMeasure.GAP: "the moment of the least gap",
    MomentMeasure.DISTANCE: "the moment at which another actor was nearest",
    None: "the place where the drive ended",
}
DRIVE = (
    "Left: the road from above with the path, where the car went and what was around it, and beneath it {window}, with "
    "the driving direction to the right. Right: the drive over time."
)
SAFETY = (
    "From top to bottom: the gap to what was ahead beside the distance that Responsibility-Sensitive Safety asks for, "
    "the time to collision, the deceleration that it took to avoid a contact, and the headway, while something was "
    "ahead."
)
APPROACH = (
    "Every point of the line is a moment of the drive: its speed to the right, its gap upwards. The line begins at the "
    "ring, or above the axis where a triangle stands at its upper edge, and ends at the dot. In the grey area under "
    "the dotted line the car as declared can no longer stop before a standing obstacle ahead."
)
LATENCY = (
    "Above: the slowest ticks over drive time, each column made of its legs, with the rig's budget. Below: the "
    "percentiles of every leg."
)
AT_REST = "Each run's gap at rest over its speed. Crosses are collisions; runs that have no gap stand at the edge."
#: runs whose speeds spread less were all driven at one speed [m/s]
MIN_SPREAD = 0.5
STOPS = (
    "Above: the distance from the onset of braking to rest over the speed at the onset, beside the closed form. Below: "
    "how far each stop lies from its own bound; above the line it was longer than the car as declared would need."
)
BOUNDARY = "Every run of the search where it was driven, whether it met the criterion, and where that flips."
WORST = "The figure of every run in the order of the search with the worst so far, and the parameters of every run."
#: of a map
LACKING = (
    "Runs without that figure are in no mean, nor are runs that collided in one of gaps, times to collision or DRAC: a "
    "cell says how many of its runs have the figure, and is dotted where some lack it and hatched where all do."
)


def caption_of(run: Run) -> str:
    """Return the caption of a drive's overview, which says what its lower window shows."""
    moment = moment_of(run.data)
    return DRIVE.format(window=WINDOW[moment.measure if moment else None])


def of_drive(run: Run) -> tuple[DrawnPlot, ...]:
    """Return the plots of a drive."""
    from vve_sumo import plotting

    overview, alt = plotting.drive_overview(run), "the drive from above and over time"
    pictures = [picture_of(overview, "drive_overview", alt, caption_of(run))]
    if np.isfinite(run.lead.gap).any():  # else there is nothing to be seen in them
        pictures.append(
            picture_of(plotting.safety_over_time(run), "safety_over_time", "safety over drive time", SAFETY)
        )
        pictures.append(picture_of(plotting.gap_against_speed(run), "gap_against_speed", "gap over speed", APPROACH))
    if run.holds("latency"):
        pictures.append(
            picture_of(plotting.latency_over_time(run), "latency_over_time", "latencies over drive time", LATENCY)
        )
    return tuple(pictures)


def of_sweep(sweep: Sweep, rows: pd.DataFrame, figures: Sequence[str]) -> tuple[DrawnPlot, ...]:
    """Return the plots of a sweep; `figures` are those that matter, the most important one first."""
    from vve_sumo import plotting

    searched = bool(sweep.plan["spec"].get("search"))
    pictures = [*(_search(sweep) if searched else (*_maps(sweep, rows, figures), *_distribution(sweep, rows, figures)))]
    if rows["stop_gap_m"].notna().any() and _differ(rows):
        pictures.append(
            picture_of(plotting.gap_against_speed(rows), "gap_against_speed", "gap at rest over speed", AT_REST)
        )
    if rows["stop_distance_m"].notna().any():
        pictures.append(
            picture_of(plotting.stopping_distance(rows), "stopping_distance", "stopping distance over speed", STOPS)
        )
    return tuple(pictures)


def _differ(rows: pd.DataFrame) -> bool:
    """Return whether the runs were driven at speeds that differ: a plot over a single speed shows nothing."""
    speed = rows["stop_onset_speed_mps"]
    return bool(speed.max() - speed.min() > MIN_SPREAD)


def _search(sweep: Sweep) -> Iterator[DrawnPlot]:
    from vve_sumo import plotting

    along = "along" in sweep.plan["spec"]["search"]
    alt = "where the criterion flips" if along else "the runs of the search"
    yield picture_of(plotting.boundary(sweep), "search", alt, BOUNDARY if along else WORST)


def _maps(sweep: Sweep, rows: pd.DataFrame, figures: Sequence[str]) -> Iterator[DrawnPlot]:
    """Heat maps over the two numbers that explain most of a figure, where there are two; a panel each controller."""
    from vve_sumo import plotting

    for figure in ("passed", *figures[:2]):
        if not rows[figure].notna().any():
            continue
        x, y, by = chosen_axes(rows, figure, sweep.parameters)
        if x is None or y is None:
            continue
        others = [name for name in sweep.parameters if name not in (x, y, by) and rows[name].nunique() > 1]
        over = f" Every cell holds the runs of all values of {', '.join(others)}." if others else ""
        over += f" Each value of {by} has a panel." if by else ""
        what = "share of runs that passed" if figure == "passed" else f"mean {label_of(figure)}"
        caption = f"The {what} over {x} to the right and {y} upwards.{over} {LACKING}"
        picture = plotting.heat_map(rows, x, y, figure, by=by)
        yield picture_of(picture, f"map_{figure}", f"{what} over {x} and {y}", caption)


def _distribution(sweep: Sweep, rows: pd.DataFrame, figures: Sequence[str]) -> Iterator[DrawnPlot]:
    """Distribution of the figure that matters most, a line for each value of the first parameter."""
    from vve_sumo import plotting

    figure = next((name for name in figures if rows[name].notna().any()), None)
    if figure is None:
        return
    x, _y, text = chosen_axes(rows, figure, sweep.parameters)
    by = text or x
    what = f"distribution of {label_of(figure)}"
    apart = f", one line for each value of {by}, or each part of its range" if by else ""
    band = _band(sweep, figure)
    caption = (
        f"The share of all runs that have at most the {label_of(figure)} to the right{apart}. A curve ends at the "
    )
    caption += "share of the runs that have it; runs that collided are beyond every gap, time to collision and DRAC."
    caption += " The shaded part does not pass." if band else ""
    yield picture_of(plotting.distribution(rows, figure, by, band), f"distribution_{figure}", what, caption)


def _band(sweep: Sweep, figure: str) -> tuple[float, float] | None:
    """Return the band that a criterion requires; None where it differs from run to run, or there is none."""
    table = sweep.plan["table"]
    wanted = (table.get("criteria") or {}).get(figure)
    if not isinstance(wanted, dict) or figure in varied_criteria(table, sweep.parameters):
        return None
    low, high = wanted.get("min"), wanted.get("max")
    return -math.inf if low is None else float(low), math.inf if high is None else float(high)
