"""How the car closed in and stopped: gap over speed, of one drive or of many, and stopping distance over speed.

Knows a record and rows of a sweep; it must not know how either was driven.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vve_sumo.analysis.effects import controller_of
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.stopping_bound import stopping_bound_checks
from vve_sumo.laws import stopping_distance as closed_form
from vve_sumo.metrics.table import axis_of
from vve_sumo.plotting.columns import cautions, errors, holds, numbers, runs
from vve_sumo.plotting.crowd import MAX_POINTS, bands, crowd, thinned
from vve_sumo.plotting.page import INK, PAPER, QUIET, contact
from vve_sumo.plotting.parts import RowSubset, outer, panels, parts_of, tall
from vve_sumo.plotting.style import BAD, FIRST, LIMIT, SECOND, blank, explain, finite, name, page, plain, widened
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: what is on the axis of speeds, the first that the rows have
SPEEDS: Final = ("ego.speed_mps", "stop_onset_speed_mps", "max_speed_mps")
#: shares of a drive's approach at which an arrow says where it goes
ARROWS: Final = (0.35, 0.7)
#: the panel is so many times as high as the longest distance that is needed to stop, and at least so high [m]
ENOUGH, LEAST = 4.0, 60.0
#: pairs of panels of a figure at most
MAX_PAIRS: Final = 2
#: colour of runs that hunted on their approach
HUNTING: Final = "#9a5fb4"
#: points of a curve
STEPS: Final = 100


def gap_against_speed(of: Run | pd.DataFrame, *, by: str | None = None, facet: str | None = None) -> Figure:
    """Draw gap over speed.

    Of a drive: how it closed in on what was ahead, beside the distance that the car as declared needs to stop from each
    speed. Of rows, a run each: the gap at rest over the speed; runs that touched something are marked, and at the
    edge those that have no gap. Of rows, `by` is a column whose values have looks of their own, the controller if not
    said and there are several, and `facet` one whose values have a panel each.
    """
    return _approach(of) if isinstance(of, Run) else _gaps_at_rest(of, by, facet)


def _approach(run: Run) -> Figure:
    with page() as figure:
        axes = figure.subplots()
        plain(axes)
        name(figure, f"Gap over speed · {run.title}")
        speed, gap = run.motion.speed, run.lead.gap.copy()
        if not finite(speed, gap).any():
            blank(axes, "nothing was ahead")
            return figure
        changed = [other not in (one, "") for one, other in pairwise(run.lead.actor)]
        gap[:-1][np.array(changed, bool)] = np.nan
        fastest = 1.05 * max(1.0, float(np.nanmax(speed[finite(gap)])))
        needed = _needed(axes, run, fastest)
        axes.plot(speed, gap, color=FIRST.colour, linewidth=2.0, label="the drive")
        most = 1.05 * max(1.0, min(float(np.nanmax(gap)), max(LEAST, ENOUGH * needed)))
        _ends(axes, run, speed, gap, most)
        axes.set(
            xlabel=axis_of("speed_mps"), ylabel=axis_of("gap_m"), xlim=(min(0.0, float(np.nanmin(speed))), fastest)
        )
        axes.set_ylim(min(0.0, float(np.nanmin(gap))), most)
        explain(axes, 2)
        return figure


def _needed(axes: Axes, run: Run, fastest: float) -> float:
    """Draw the distance that the declared car needs to stop and return the longest [m].

    Less is shaded: there only what moves on is not hit.
    """
    car = run.vehicle
    delay = car.brake_delay + car.brake_lag
    speeds = np.linspace(0.0, fastest, STEPS)
    needed = [closed_form(speed, car.deceleration_limit, delay) for speed in speeds.tolist()]
    word = f"needed to stop: {car.deceleration_limit:g} m/s² after {1000.0 * delay:.0f} ms"
    axes.plot(speeds, needed, label=word, **LIMIT)
    axes.fill_between(speeds, 0.0, needed, color=QUIET, alpha=0.15, linewidth=0.0)
    return needed[-1]


def _ends(axes: Axes, run: Run, speed: Floats, gap: Floats, most: float) -> None:
    """Mark where the approach began and ended, which way it went, and the first contact.

    Where it began or ended above the axis, whose end is at `most` [m], a triangle marks the place on the axis's edge.
    """
    known = np.flatnonzero(finite(speed, gap))
    first, last = known[0], known[-1]
    ends: dict[str, Any] = {"markersize": 7.0, "markeredgecolor": FIRST.colour, "markeredgewidth": 1.8, "linestyle": ""}
    word = f"first ahead: {gap[first]:.0f} m"
    if gap[first] <= most:
        axes.plot(speed[first], gap[first], "o", markerfacecolor=PAPER, label=word, **ends)
    else:
        entered = next((row for row in known if gap[row] <= most), first)
        above: dict[str, Any] = {"clip_on": False, "label": f"{word}, above the axis"}
        axes.plot(speed[entered], most, "^", markerfacecolor=PAPER, **above, **ends)
    shown, sign, beyond = (gap[last], "o", "") if gap[last] <= most else (most, "^", ", above the axis")
    label = f"end: {gap[last]:.2f} m{beyond}"
    axes.plot(speed[last], shown, sign, color=FIRST.colour, label=label, clip_on=False, zorder=5, **ends)
    for share in ARROWS if len(known) > STEPS else ():
        at = known[int(share * (len(known) - 1))]
        ahead = min(at + 10, last)
        way: dict[str, Any] = {"arrowstyle": "-|>", "color": FIRST.colour, "mutation_scale": 16.0}
        if finite(gap[at], gap[ahead]) and (speed[at], gap[at]) != (speed[ahead], gap[ahead]):
            axes.annotate("", (speed[ahead], gap[ahead]), (speed[at], gap[at]), arrowprops=way)
    touched = contact(run.arrow("ticks"))
    if touched is not None:
        axes.plot(speed[touched], gap[touched], label="first contact", clip_on=False, zorder=6, **BAD)


def _gaps_at_rest(rows: pd.DataFrame, by: str | None, facet: str | None) -> Figure:
    by = by or controller_of(rows, facet)
    with page(height=tall(rows, facet, 4.2, 3.6)) as figure:
        drawn = panels(figure, rows, facet)
        name(figure, f"Gap at rest over speed, {len(rows):,} runs", *cautions(rows, "stop_gap_m"))
        column = next((one for one in SPEEDS if one in rows and rows[one].notna().any()), None)
        for axes, _panel in drawn:
            plain(axes)
            if column is None:
                blank(axes, "no run has a speed")
        if column is None:
            return figure
        speed, gap = numbers(rows, column), numbers(rows, "stop_gap_m")
        stood = np.where(holds(rows, "collision"), np.nan, gap)
        for axes, panel in drawn:
            for place, part in enumerate(parts_of(rows, by)):
                both = panel.which & part.which
                crowd(axes, speed[both], stood[both], part.style, part.legend_label("gap at rest"))
                _without(axes, rows[both], speed[both], gap[both], part, place)
            axes.axhline(0.0, color=INK, linewidth=1.0)
            explain(axes, 2, panel.word)
        known = speed[np.isfinite(speed)]
        drawn[0][0].set_xlim(*widened(float(known.min()), float(known.max())))
        outer(drawn, axis_of(column), axis_of("stop_gap_m"))
        return figure


def _without(axes: Axes, rows: pd.DataFrame, speed: Floats, gap: Floats, part: RowSubset, place: int) -> None:
    """Mark runs with a collision, and along the edge those that have no gap: with a collision, an error or no rest.

    The marks of each part of the rows stand in a line of their own, the number `place` from the edge.
    """
    hit, error = holds(rows, "collision"), errors(rows)
    gone, moving = hit & ~np.isfinite(gap), ~hit & ~error & ~np.isfinite(gap)
    deep = hit & ~gone
    if deep.any():
        at, depth = speed[deep], gap[deep]
        if len(at) > MAX_POINTS:
            at, (deepest, _low, middle, _high, _most) = bands(at[np.isfinite(at)], depth[np.isfinite(at)])
            at, depth = np.tile(at, 2), np.concatenate([middle, deepest])
        own = {"color": part.style.colour} if part.word else {}
        word = part.legend_label(f"collision ({runs(deep)})")
        axes.plot(at, depth, label=word, zorder=4, clip_on=False, **BAD | own)
    across = axes.get_xaxis_transform()
    edge = (
        (gone, "x", "collision, no gap at rest"),
        (error, "s", "error"),
        (moving, "|", "no rest, or nothing ahead at rest"),
    )
    axes.margins(y=0.12)  # that no cross at the bottom hides them
    colour = part.style.colour if part.word else QUIET
    for which, mark, word in edge:
        if which.any():
            x = thinned(speed[which])
            style: dict[str, Any] = {"color": colour, "markersize": 6.0, "fillstyle": "none", "transform": across}
            height = np.full(len(x), 0.025 + 0.045 * place)
            axes.plot(x, height, mark, label=part.legend_label(f"{word} ({runs(which)})"), **style)


def stopping_distance(rows: pd.DataFrame, *, by: str | None = None, facet: str | None = None) -> Figure:
    """Draw the distance from onset to rest over the onset's speed, and below how far it is from each run's own bound.

    The curve is v tau + v^2 / 2 a with the median demand a and the median reaction tau of the runs; the band goes from
    the 5th to the 95th percentile of the demand. The bound is the run's own: its speed and demand, the declared delay.
    Runs that stopped beyond their bound and tolerance are marked. Runs that hunted on their approach are marked apart,
    and are left out of the curve and of the lower panel: neither is of anything but a single braking. `by` is a column
    whose values have curves and looks of their own, the controller if not said and there are several, for a median over
    controllers is that of none; `facet` is a column whose values have a pair of panels each.
    """
    columns = ("stop_onset_speed_mps", "stop_distance_m", "stop_bound_m", "stop_demand_mps2", "stop_reaction_s")
    parts, beside = parts_of(rows, by or controller_of(rows, facet)), parts_of(rows, facet, MAX_PAIRS)
    with page(height=5.6 + 0.3 * (len(parts) - 1) * len(beside)) as figure:
        pairs = figure.subplots(2, len(beside), sharex=True, sharey="row", height_ratios=(1.7, 1.0), squeeze=False)
        speed, distance, bound, demand, reaction = (numbers(rows, one) for one in columns)
        known = finite(speed, distance, demand) & (demand > 0.0)
        curves = "; curves: v τ + v²/2a" if parts[0].word else ""
        name(figure, f"Stopping distance: {known.sum():,} stops of {len(rows):,} runs{curves}")
        for axes in pairs.ravel():
            plain(axes)
        if not known.any():
            for axes in pairs.ravel():
                blank(axes, "no run has a stop")
            return figure
        checks, hunting = stopping_bound_checks(rows), holds(rows, "hunting") & known
        flagged, tolerance = checks["broken"].to_numpy(bool) & known, checks["tolerance_m"].to_numpy(float)
        clean = known & ~hunting
        fastest = float(speed[known].max())
        for (upper, lower), panel in zip(pairs.T, beside, strict=True):
            for part in parts:
                both = clean & panel.which & part.which
                if both.any():
                    _law(upper, fastest, demand[both], reaction[both], part)
                for axes, values in ((upper, distance), (lower, distance - bound)):
                    crowd(axes, np.where(both, speed, np.nan), values, part.style, part.legend_label("stops"))
            _hunting(upper, speed, distance, hunting & panel.which)
            _tolerated(lower, speed, tolerance, clean & panel.which)
            _broken(upper, lower, speed, distance, bound, flagged & panel.which)
            explain(upper, 2, panel.word)
        pairs[0, 0].set(ylabel="onset to rest [m]", xlim=(0.0, 1.05 * fastest), ylim=(0.0, None))
        pairs[1, 0].set_ylabel("beyond own\nbound [m]")
        for lower in pairs[1]:
            lower.set_xlabel(axis_of(columns[0]))
        return figure


def _hunting(axes: Axes, speed: Floats, distance: Floats, which: Any) -> None:
    """Mark the runs whose stop was no single braking, by squares."""
    if which.any():
        word = f"hunting, not in the curve ({runs(which)})"
        axes.plot(speed[which], distance[which], "s", color=HUNTING, markersize=6.0, fillstyle="none", label=word)


def _tolerated(axes: Axes, speed: Floats, tolerance: Floats, which: Any) -> None:
    """Mark what each run may exceed its bound by, and say so."""
    if not (known := which & np.isfinite(tolerance)).any():
        return
    order = np.argsort(speed[known], kind="stable")
    at, most = speed[known][order], tolerance[known][order]
    some = np.searchsorted(at, thinned(at))
    axes.plot(at[some], most[some], "_", color=LIMIT["color"], markersize=7.0)
    place: dict[str, Any] = {"fontsize": 9.5, "ha": "right", "va": "bottom", "color": LIMIT["color"]}
    axes.annotate("dashes: own tolerance, broken above", (0.995, 0.03), xycoords="axes fraction", **place)


def _broken(upper: Axes, lower: Axes, speed: Floats, distance: Floats, bound: Floats, flagged: Any) -> None:
    """Mark the runs that stopped beyond their bound and tolerance."""
    for axes, values in ((upper, distance), (lower, distance - bound)):
        if flagged.any():
            axes.plot(speed[flagged], values[flagged], label=f"bound broken ({runs(flagged)})", **BAD)
    lower.axhline(0.0, color=INK, linewidth=1.0)
    lower.margins(y=0.15)


def _law(axes: Axes, fastest: float, demand: Floats, reaction: Floats, part: RowSubset) -> None:
    """Draw the closed form for the demands that there are."""
    speeds = np.linspace(0.0, 1.05 * fastest, STEPS)
    delay = float(np.nanmedian(reaction)) if np.isfinite(reaction).any() else 0.0
    hard, middle, soft = np.quantile(demand, (0.95, 0.5, 0.05))
    look = part.style if part.word else SECOND
    law = f"τ = {1000.0 * delay:.0f} ms, a = {middle:.2f} m/s²"
    word = f"{part.word}: {law}" if part.word else f"v τ + v²/2a, {law}"
    distance = speeds * delay + speeds**2 / (2.0 * middle)
    axes.plot(speeds, distance, color=look.colour, linestyle=look.stroke, label=word)
    if hard > 1.01 * soft:
        low, high = (speeds * delay + speeds**2 / (2.0 * one) for one in (hard, soft))
        word = "_its band" if part.word else f"a = {soft:.2f} to {hard:.2f} m/s²"
        axes.fill_between(speeds, low, high, color=look.colour, alpha=0.15, linewidth=0.0, label=word)
