"""The latencies of a live drive: what every part of the way from a fix to its frames took.

Knows the legs by their table; it must not know how they were measured.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vve_sumo.analysis.latency import latency_breakdown, legs_over_time
from vve_sumo.analysis.run import Run
from vve_sumo.plotting.page import ACTOR, ALARM, EGO, EGO_PALE, INK, OBSTACLE, QUIET, ROAD
from vve_sumo.plotting.style import LIMIT, LINE_STYLES, WIDTH, blank, explain, name, page, plain
from vve_sumo.record.latencies import LEGS, TOTAL
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: of the upper panel; each shows the slowest of its ticks
COLUMNS: Final = 150
#: of the legs; in grey, neighbours differ by lightness
COLOURS: Final = (EGO, EGO_PALE, INK, ALARM, ACTOR, ROAD)
#: a latency below this is as good as none; the lower axis is even below and logarithmic above [ms]
NOTHING: Final = 0.1
MARKS: Final = (
    ("p50_ms", "o", "median"),
    ("p95_ms", "s", "95 %"),
    ("p99_ms", "^", "99 %"),
    ("max_ms", "X", "greatest"),
)


def latency_over_time(run: Run) -> Figure:
    """Draw the legs of the slowest ticks over drive time with the budget and missed ticks, and each leg's percentiles.

    Each column stands for a portion of the drive time and shows its slowest tick. A drive on a simulated clock has the
    age of the pose alone.
    """
    with page(WIDTH, 6.4) as figure:
        upper, lower = figure.subplots(2, 1, height_ratios=(1.0, 1.1))
        name(figure, f"Latency · {run.title}")
        plain(upper)
        plain(lower)
        table = legs_over_time(run)
        if np.isfinite(table[f"{TOTAL}_ms"].to_numpy()).any():
            _stacked(upper, table, _budget(run))
        else:
            blank(upper, "no tick was timed: a simulated clock takes no time")
        _percentiles(lower, latency_breakdown(run), _budget(run))
        return figure


def _budget(run: Run) -> float:
    """Return the budget that the drive kept to, the default where its rig declares none [ms]; NaN without a rig."""
    if not run.live:
        return math.nan
    declared = (run.resolved["rig"].get("latency") or {}).get("budget_ms")
    if declared is not None:
        return float(declared)
    from vve_sumo.rig.schema import Latency  # with all receivers that a rig can name

    return Latency().budget_ms


def slowest(table: pd.DataFrame) -> tuple[Floats, pd.DataFrame]:
    """Return the edges of portions of the drive time (n + 1) [s] and each one's slowest tick, a row of NaN of none."""
    timed = table[np.isfinite(table[f"{TOTAL}_ms"].to_numpy())].sort_values(f"{TOTAL}_ms", kind="stable")
    time = timed["time_s"].to_numpy()
    edges = np.linspace(time.min(), time.max() + 1e-3, min(COLUMNS, len(timed)) + 1)
    portion = np.searchsorted(edges, time, side="right") - 1
    # Of pandas' own `last` a leg that did not happen would be that of another tick.
    return edges, timed.set_index(portion).groupby(level=0).tail(1).reindex(range(len(edges) - 1))


def ends(table: pd.DataFrame) -> Floats:
    """Return when each leg of some ticks had ended (legs x ticks) [ms]; none later than the frame, which may overtake.

    The frame can be out before the hand-over to the gateway has returned.
    """
    legs = np.array([table[f"{leg}_ms"].to_numpy() for leg in LEGS])
    done: Floats = np.minimum(np.cumsum(legs, axis=0), table[f"{TOTAL}_ms"].to_numpy())
    return done


def _stacked(axes: Axes, table: pd.DataFrame, budget: float) -> None:
    edges, shown = slowest(table)
    tops = ends(shown)
    bottoms = np.vstack((np.zeros(tops.shape[1]), tops[:-1]))
    for leg, colour, low, high in zip(LEGS, COLOURS, bottoms, tops, strict=True):
        held: dict[str, Any] = {"y1": np.append(low, low[-1]), "y2": np.append(high, high[-1]), "step": "post"}
        axes.fill_between(edges, **held, color=colour, linewidth=0.0, label=_leg_label(leg))
    highest = float(np.nanmax(tops))
    if np.isfinite(budget):
        axes.axhline(budget, label=f"budget {budget:g} ms", **LIMIT)
        highest = max(highest, budget)
    _missed(axes, table)
    axes.set(
        xlabel="drive time [s]", ylabel="bytes to frame [ms]", xlim=(edges[0], edges[-1]), ylim=(0.0, 1.08 * highest)
    )
    explain(axes, 4)


def _leg_label(leg: str) -> str:
    return leg.replace("_", " ")


def _missed(axes: Axes, table: pd.DataFrame) -> None:
    """Mark at the upper edge where ticks were skipped because their time had passed."""
    missed = table[table["missed"] > 0]
    if len(missed):
        word = f"{missed['missed'].sum():,} ticks missed"
        style: dict[str, Any] = {"color": OBSTACLE, "markeredgecolor": INK, "markersize": 7.0, "clip_on": False}
        across = axes.get_xaxis_transform()
        axes.plot(missed["time_s"], np.full(len(missed), 0.97), "v", transform=across, label=word, **style)


def _percentiles(axes: Axes, breakdown: pd.DataFrame, budget: float) -> None:
    """Draw the percentiles of every leg that happened, a line each, the first leg on top."""
    shown = breakdown[breakdown["n"] > 0]
    if not len(shown):
        blank(axes, "no pose was ever trusted, and so none has an age")
        return
    places = np.arange(len(shown))
    axes.hlines(places, shown["p50_ms"], shown["max_ms"], color=QUIET, linewidth=1.2)
    for (column, mark, word), look in zip(MARKS, LINE_STYLES, strict=False):
        axes.plot(shown[column], places, mark, color=look.colour, markersize=6.0, label=word)
    if np.isfinite(budget):
        axes.axvline(budget, **LIMIT)
    axes.set_xscale("symlog", linthresh=NOTHING, linscale=0.5)
    axes.set_yticks(places, [_leg_label(str(leg)) for leg in shown.index])
    axes.set(xlabel="latency [ms]", ylim=(len(shown) - 0.5, -0.5))
    axes.xaxis.set_major_formatter("{x:g}")
    explain(axes, len(MARKS))
