"""Studies of adaptive cruise control on one drive: what passes along the string, and which headways were kept.

Draws what the analysis says; computes nothing that is not drawn.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.string_stability import headway_distribution, string_of
from vve_sumo.analysis.string_stability import string_stability as passed_on
from vve_sumo.metrics.drive_data import MIN_FOLLOWED
from vve_sumo.metrics.table import axis_of
from vve_sumo.plotting.page import EGO as EGO_COLOUR
from vve_sumo.plotting.page import INK
from vve_sumo.plotting.style import LINE_STYLES, OVER, UNDER, WIDTH, blank, explain, name, page, plain

#: of the string's vehicles, the nearest to the ego; more curves could not be told apart
MAX_DRAWN: Final = len(LINE_STYLES)


def string_stability(run: Run) -> Figure:
    """Draw the speeds of the ego's string in the longest time behind one leader, and by how much each amplifies."""
    with page(WIDTH, 5.4) as figure:
        over_time, sizes = figure.subplots(2, 1, height_ratios=(3, 2))
        name(figure, f"String stability · {run.title}")
        for axes in (over_time, sizes):
            plain(axes)
        ticks, speeds = string_of(run)
        if not len(ticks):
            for axes in (over_time, sizes):
                blank(axes, f"the ego followed no moving leader for {MIN_FOLLOWED:g} s")
            return figure
        _speeds(over_time, run, _near_ego(list(speeds), run.data.ego))
        _amplifications(sizes, run)
        return figure


def _near_ego(names: list[str], ego: str) -> list[str]:
    """Return the names that are drawn, at most MAX_DRAWN around the ego."""
    first = min(max(0, names.index(ego) - MAX_DRAWN + 2), max(0, len(names) - MAX_DRAWN))
    return names[first : first + MAX_DRAWN]


def _speeds(axes: Axes, run: Run, drawn: list[str]) -> None:
    (ticks, speeds), ego = string_of(run), run.data.ego
    others = [vehicle for vehicle in drawn if vehicle != ego]
    looks = {ego: LINE_STYLES[0], **dict(zip(others, LINE_STYLES[1:], strict=False))}
    for vehicle in drawn:
        look = looks[vehicle]
        wide = UNDER if vehicle == ego else OVER
        axes.plot(
            run.time[ticks], speeds[vehicle], color=look.colour, linestyle=look.stroke, linewidth=wide, label=vehicle
        )
    axes.set(xlabel=axis_of("time_s"), ylabel=axis_of("speed_mps"))
    explain(axes, 4)


def _amplifications(axes: Axes, run: Run) -> None:
    table = passed_on(run)
    followers = table.iloc[1:]
    if not np.isfinite(followers[["amplification_l2"]].to_numpy()).any():
        blank(axes, "the string's head kept a steady speed: there was no disturbance to pass on")
        return
    place = np.arange(len(followers))
    for aside, column, look, word in (
        (-0.1, "amplification_l2", LINE_STYLES[0], "L2, over its predecessor"),
        (0.0, "amplification_linf", LINE_STYLES[1], "L∞, over its predecessor"),
        (0.1, "head_to_tail_l2", LINE_STYLES[3], "L2, over the head"),
    ):
        axes.plot(place + aside, followers[column], look.mark, color=look.colour, label=word, markersize=7)
    axes.axhline(1.0, color=INK, linewidth=1.1, linestyle=(0, (2, 2)), label="1: neither grows nor fades")
    axes.set_xticks(place, followers.index)
    axes.set(ylabel="amplification [1]", xlim=(-0.5, len(place) - 0.5))
    axes.set_ylim(0.0, 1.15 * max(1.0, float(np.nanmax(followers.iloc[:, 2:].to_numpy()))))
    explain(axes, 4)


def headways(run: Run) -> Figure:
    """Draw which share of the time behind a leader each bin of headways took."""
    with page(WIDTH, 3.6) as figure:
        axes = figure.subplots()
        plain(axes)
        name(figure, f"Time headways · {run.title}")
        table = headway_distribution(run)
        share = 100.0 * table["time_share"].to_numpy()
        if not np.isfinite(share).any():
            blank(axes, "the ego followed no moving leader")
            return figure
        place = np.arange(len(table))
        axes.bar(place, share, width=0.9, color=EGO_COLOUR)
        edges = zip(table["from_s"], table["to_s"], strict=True)
        axes.set_xticks(place, [f"{a:g} to {b:g}" if np.isfinite(b) else f"{a:g} +" for a, b in edges])
        axes.set(xlabel=axis_of("headway_s"), ylabel="share of the time behind a leader [%]")
        return figure
