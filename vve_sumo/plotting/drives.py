"""One drive: its page, and how safe it was over time.

Draws what a record and the measures say; computes nothing that is not drawn.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vve_sumo.analysis.over_time import over_time
from vve_sumo.analysis.run import Run
from vve_sumo.metrics.following import TTC_THRESHOLD
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.metrics.table import axis_of
from vve_sumo.plotting import drive_page
from vve_sumo.plotting.drive_record import page_of
from vve_sumo.plotting.page import INK, OBSTACLE, QUIET, SIZE, contact
from vve_sumo.plotting.style import (
    FIRST,
    LIMIT,
    OVER,
    SECOND,
    THIRD,
    UNDER,
    WIDTH,
    SeriesStyle,
    explain,
    name,
    page,
    plain,
)
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

#: a longer time to collision or headway is no matter of safety, and would flatten what is [s]
MAX_TIME_SHOWN: Final = 10.0
#: a greater deceleration, over what the car can do, is shown as out of the panel
MAX_DECELERATION_SHARE: Final = 1.5
#: so many times the safe gap and more is no matter of safety
MAX_SAFE_RATIO: Final = 2.0
#: drive time shown before and after something was ahead [s]
TIME_MARGIN: Final = 1.0
#: curves of a panel: column, how it is drawn, what it is called
Curves = tuple[tuple[str, SeriesStyle, str], ...]


def drive_overview(run: Run) -> Figure:
    """Draw the page of a drive from its record alone: the virtual road from above, the moment that matters, and curves.

    A drive that was killed is drawn up to its last tick. A record of layout 7 holds no lanes, so its
    virtual road is bare.
    """
    with page(*SIZE, arranged=False) as figure:
        drive_page.paint(figure, page_of(run))
        return figure


def safety_over_time(run: Run) -> Figure:
    """Draw gap, time to collision, needed deceleration and headway over drive time, while something was ahead.

    Beside the gap the distance of Responsibility-Sensitive Safety; thresholds are named where they are drawn: that of
    the exposure measures, the car's declared deceleration, and what the scenario asks for.
    """
    frame = over_time(run)
    with page(WIDTH, 8.2) as figure:
        panels = figure.subplots(4, 1, sharex=True)
        name(figure, f"Safety over time · {run.title}")
        for axes, paint in zip(panels, (_gap, _times, _decelerations, _headway), strict=True):
            plain(axes)
            paint(axes, run, frame)
            explain(axes, 4)
        panels[-1].set_xlabel(axis_of("time_s"))
        panels[0].set_xlim(*_while_ahead(frame, contact(run.arrow("ticks"))))
        _mark_contact(panels, run)
        figure.align_ylabels()
        return figure


def _while_ahead(frame: pd.DataFrame, touched: int | None) -> tuple[float, float]:
    """Return the times [s] that hold all that was ahead and the first contact, which may come from the side."""
    time = frame["time_s"].to_numpy()
    seen = time[np.isfinite(frame["gap_m"].to_numpy())]
    seen = seen if touched is None else np.sort(np.append(seen, time[touched]))
    first, last = (time[0], time[-1]) if not len(seen) else (seen[0], seen[-1])
    return max(float(time[0]), float(first) - TIME_MARGIN) - 1e-3, min(
        float(time[-1]), float(last) + TIME_MARGIN
    ) + 1e-3


def _curves(axes: Axes, frame: pd.DataFrame, curves: Curves, unit: str, why: str) -> bool:
    """Draw columns over time, or say why there is nothing; return whether there was anything.

    A curve breaks where something else becomes the nearest.
    """
    leader = frame["leader"].tolist()
    changed = np.array([False, *(one not in (other, "") for one, other in pairwise(leader))], bool)
    axes.set_ylabel(unit)
    if not any(np.isfinite(frame[column].to_numpy(np.float64)).any() for column, _look, _word in curves):
        axes.set_yticks(())
        axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", color=QUIET)
        return False
    for column, look, word in curves:
        values = frame[column].to_numpy(np.float64).copy()
        values[~np.isfinite(values)] = np.nan
        values[changed] = np.nan
        lonely = look.mark if np.isfinite(values).sum() == 1 else ""
        style: dict[str, Any] = {"color": look.colour, "linestyle": look.stroke, "label": word}
        axes.plot(frame["time_s"], values, marker=lonely, linewidth=UNDER if look is FIRST else OVER, **style)
    return True


def _gap(axes: Axes, run: Run, frame: pd.DataFrame) -> None:
    curves = (("gap_m", FIRST, "gap"), ("rss_distance_m", SECOND, "safe gap by RSS"))
    if not _curves(axes, frame, curves, axis_of("gap_m"), "nothing was ahead"):
        return
    gap, safe = frame["gap_m"].to_numpy(), frame["rss_distance_m"].to_numpy()
    style: dict[str, Any] = {"color": OBSTACLE, "alpha": 0.2, "linewidth": 0.0, "label": "gap too short"}
    axes.fill_between(frame["time_s"], gap, safe, where=gap < safe, **style)
    least, most = float(np.nanmin(gap)), float(np.nanmax(gap))
    # The nearest that it came is in the panel however far that was.
    axes.set_ylim(
        min(0.0, least), 1.05 * max(1.0, min(most, max(MAX_SAFE_RATIO * _most(safe), MAX_SAFE_RATIO * least)))
    )


def _most(values: Floats) -> float:
    """Return the greatest number, inf of none or nothing."""
    known = values[np.isfinite(values) & (values > 0.0)]
    return float(known.max()) if len(known) else math.inf


def _times(axes: Axes, run: Run, frame: pd.DataFrame) -> None:
    curves = (("ttc_s", FIRST, "on the path"), ("mttc_s", SECOND, "modified"), ("ttc_2d_s", THIRD, "boxes"))
    if _curves(axes, frame, curves, axis_of("ttc_s"), "nothing closed in"):
        _limit(axes, TTC_THRESHOLD, f"{TTC_THRESHOLD:g} s: exposure")
        _criterion_lines(axes, run, "min_ttc_s")
        axes.set_ylim(0.0, MAX_TIME_SHOWN)


def _decelerations(axes: Axes, run: Run, frame: pd.DataFrame) -> None:
    curves = (("drac_mps2", FIRST, "DRAC"), ("required_deceleration_mps2", SECOND, "with the brakes' dead time"))
    if not _curves(axes, frame, curves, "needed [m/s²]", "nothing closed in"):
        return
    able = run.vehicle.deceleration_limit
    _limit(axes, able, f"declared {able:g} m/s²")
    _criterion_lines(axes, run, "max_drac_mps2")
    axes.set_ylim(0.0, MAX_DECELERATION_SHARE * able)


def _headway(axes: Axes, run: Run, frame: pd.DataFrame) -> None:
    curves = (("headway_s", FIRST, "bumper to bumper"), ("headway_front_s", SECOND, "front to front"))
    if _curves(axes, frame, curves, axis_of("headway_s"), "nothing was ahead while it moved"):
        axes.set_ylim(0.0, MAX_TIME_SHOWN)


def _limit(axes: Axes, value: float, word: str) -> None:
    axes.axhline(value, label=word, **LIMIT)


def _criterion_lines(axes: Axes, run: Run, criterion: str) -> None:
    """Draw the bound that the scenario sets to a metric on the side on which it is worse, if it does."""
    metric = PER_DRIVE[criterion]
    end = "min" if metric.worse == "lower" else "max"
    bound = (run.resolved["settings"].get("criteria", {}).get(criterion) or {}).get(end)
    if bound is not None:
        words = "at least" if end == "min" else "at most"
        axes.axhline(
            bound, label=f"asked: {words} {bound:g} {metric.unit}", **LIMIT | {"linestyle": "-", "linewidth": 0.9}
        )


def _mark_contact(panels: Any, run: Run) -> None:
    row = contact(run.arrow("ticks"))
    if row is not None:
        for axes in panels:
            axes.axvline(float(run.time[row]), color=INK, linewidth=1.2, linestyle=(0, (1, 1.5)))
        panels[0].annotate(
            "first contact ", (float(run.time[row]), 0.95), xycoords=("data", "axes fraction"), ha="right", va="top"
        )
