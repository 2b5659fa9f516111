"""Two drives compared: every signal of both, and their difference.

Draws what a comparison holds; computes nothing that is not drawn.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.plotting.page import INK, QUIET
from vve_sumo.plotting.style import FIRST, OVER, SECOND, UNDER, blank, explain, name, page, plain

if TYPE_CHECKING:
    import pandas as pd

    from vve_sumo.analysis.comparison import Comparison
    from vve_sumo.analysis.run import Run

WIDE: Final = 10.0
ROW: Final = 1.55  #: height of a signal's row [inch]
#: what the axes that signals are compared over are called
ALONG: Final = {"time_s": "time from first motion [s]", "s_m": "s along the path [m]"}


def comparison(compared: Comparison) -> Figure:
    """Draw each signal of two drives upon each other, and beside it the second less the first.

    What follows time stands above what follows the path. A signal that not both have is left out.
    """
    signals = {one: table for one, table in compared.series.items() if table.notna().all(axis=1).any()}
    ordered = sorted(signals, key=lambda one: str(signals[one].index.name) != "time_s")
    with page(WIDE, 1.3 + ROW * max(1, len(ordered))) as figure:
        name(figure, f"first: {_called(compared.one)}", f"second: {_called(compared.other)}")
        if not ordered:
            blank(figure.subplots(), "the two drives have no signal in common")
            return figure
        panels = figure.subplots(len(ordered), 2, squeeze=False, width_ratios=(1.25, 1.0))
        for row, signal in enumerate(ordered):
            both, apart = panels[row]
            last = row == len(ordered) - 1 or signals[ordered[row + 1]].index.name != signals[signal].index.name
            _overlaid(both, signals[signal], signal)
            _difference(apart, signals[signal], dict(compared.signals.loc[signal]))
            for axes in (both, apart):
                axes.tick_params(labelbottom=last)
                axes.set_xlim(float(signals[signal].index[0]), float(signals[signal].index[-1]))
                axes.set_xlabel(ALONG[str(signals[signal].index.name)] if last else "")
        explain(panels[0][0], 2)
        figure.align_ylabels()
        return figure


def _called(run: Run) -> str:
    """Return what a drive is called: scenario, kind, seed."""
    return (
        f"{run.name}, {'live' if run.live else 'lockstep'}, seed {run.resolved['settings']['seed']} ({run.folder.name})"
    )


def _overlaid(axes: Axes, table: pd.DataFrame, signal: str) -> None:
    plain(axes)
    for column, word, look, wide in (("one", "first", FIRST, UNDER), ("other", "second", SECOND, OVER)):
        style: dict[str, Any] = {"color": look.colour, "linestyle": look.stroke, "linewidth": wide}
        axes.plot(table.index, table[column], label=word, **style)
    axes.set_ylabel(f"{textwrap.fill(label_of(signal), 12)}\n[{unit_of(signal)}]")


def _difference(axes: Axes, table: pd.DataFrame, figures: Mapping[Any, Any]) -> None:
    plain(axes)
    axes.axhline(0.0, color=QUIET, linewidth=0.8)
    axes.plot(table.index, table["other"] - table["one"], color=INK, linewidth=1.0)
    unit = figures["unit"]
    axes.set_title(
        f"RMSE {figures['rmse']:.3g}, at most {figures['max_error']:.3g} {unit}", loc="left", fontsize=10, pad=3
    )
    axes.set_ylabel(f"second less\nfirst [{unit}]")
