"""The latency margin: what margin is left over hidden delay, and where nothing is.

Draws what a study came to; computes nothing that is not drawn.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vve_sumo.plotting.page import INK, PAPER, QUIET
from vve_sumo.plotting.style import LIMIT, LINE_STYLES, OVER, WIDTH, SeriesStyle, blank, explain, name, page, plain

if TYPE_CHECKING:
    import pandas as pd

    from vve_sumo.analysis.latency_margin import LatencyMargin

#: from seconds to what the axis shows
MS: Final = 1000.0
#: least and greatest on an axis of deviations, which grows by factors; what is less stands at its foot [m]
DEVIATIONS: Final = (1e-2, 1.0)


def latency_margin(study: LatencyMargin) -> Figure:
    """Draw over hidden delay, for each noise factor, the margin, how far the car left its path, and who passed.

    Lines are means, their shade reaches down to the least of the runs. One thin line is the closed form for the least
    noise: the margin at the least delay minus speed times the delay beyond it. A delay margin of the design is a
    vertical line. Of more noise factors than can be told apart some between the least and the greatest are drawn.
    """
    with page(WIDTH, 6.8) as figure:
        panels = upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=(2.4, 1.2, 0.9))
        name(figure, study.title)
        for axes in panels:
            plain(axes)
        if not np.isfinite(study.steps["mean_margin_m"]).any():
            blank(upper, "no run has a margin")
        upper.axhline(0.0, color=INK, linewidth=1.0)
        edges = study.edges.iloc[_spread(len(study.edges))]
        for look, factor, zero in zip(LINE_STYLES, edges["noise_factor"], edges["zero_s"], strict=False):
            steps = study.steps[study.steps["noise_factor"] == factor]
            _factor(upper, lower, steps, look, float(zero))
            _lateral(middle, steps, look)
        _closed_form(upper, study.steps[study.steps["noise_factor"] == study.steps["noise_factor"].min()])
        if math.isfinite(study.design_margin):
            margin = MS * study.design_margin
            for axes in panels:
                axes.axvline(margin, label=f"steering's delay margin {margin:.0f} ms", **LIMIT)
        upper.set_ylabel("margin: gap left [m]")
        most = float(np.nanmax([*study.steps["lateral_deviation_m"], DEVIATIONS[1]]))
        middle.set(ylabel="greatest lateral\ndeviation [m]", yscale="log", ylim=(0.8 * DEVIATIONS[0], 1.5 * most))
        middle.yaxis.set_major_formatter("{x:g}")
        lower.set(xlabel="hidden delay of the receiver [ms]", ylabel="passed [%]", ylim=(-4.0, 104.0))
        explain(upper, 2)
        return figure


def _spread(count: int) -> list[int]:
    """Return which of a number of things are drawn, each in a look of its own."""
    return sorted({round(place) for place in np.linspace(0, count - 1, min(count, len(LINE_STYLES)))})


def _factor(upper: Axes, lower: Axes, steps: pd.DataFrame, look: SeriesStyle, zero: float) -> None:
    """Draw what one noise factor comes to, and mark where its margin is zero [s], NaN for nowhere."""
    delay = MS * steps["delay_s"].to_numpy(np.float64)
    mean, least = (steps[f"{which}_margin_m"].to_numpy(np.float64) for which in ("mean", "least"))
    style: dict[str, Any] = {"color": look.colour, "linestyle": look.stroke, "marker": look.mark, "markersize": 5.0}
    word = f"noise x {steps['noise_factor'].iloc[0]:g}"
    crosses = f"{word}: zero at {MS * zero:.0f} ms" if math.isfinite(zero) else word
    upper.plot(delay, mean, label=crosses, zorder=3, **style)
    upper.fill_between(delay, least, mean, color=look.colour, alpha=0.15, linewidth=0.0)
    lower.plot(delay, 100.0 * steps["passed_share"].to_numpy(np.float64), **style)
    ring: dict[str, Any] = {"markersize": 9.0, "markerfacecolor": PAPER, "markeredgecolor": look.colour, "zorder": 5}
    upper.plot(MS * zero, 0.0, look.mark, markeredgewidth=1.8, **ring)


def _lateral(axes: Axes, steps: pd.DataFrame, look: SeriesStyle) -> None:
    """Draw how far from its path the car came in any run of a step."""
    deviation = np.maximum(steps["lateral_deviation_m"].to_numpy(np.float64), DEVIATIONS[0])
    style: dict[str, Any] = {"color": look.colour, "linestyle": look.stroke, "marker": look.mark, "markersize": 5.0}
    axes.plot(MS * steps["delay_s"].to_numpy(np.float64), deviation, **style)


def _closed_form(axes: Axes, steps: pd.DataFrame) -> None:
    style: dict[str, Any] = {"color": QUIET, "linewidth": OVER, "linestyle": (0, (4, 2)), "zorder": 4}
    delay, margin = (steps[column].to_numpy(np.float64) for column in ("delay_s", "closed_form_m"))
    axes.plot(MS * delay, margin, label="closed form: speed x delay lost", **style)
