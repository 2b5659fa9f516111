"""Draws `redrive.png`: acceleration and steering over time, as recorded and as another controller would have asked.

Computes nothing that is not drawn; it knows neither the record nor the controllers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import pyarrow as pa

from vve_sumo.drive.redrive import ControllerComparison, numeric_column
from vve_sumo.metrics.table import axis_of
from vve_sumo.plotting.page import ALARM, DOTS_PER_INCH, EGO_PALE, INK, QUIET, SIZE, STYLE, say

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class ColumnPanel(NamedTuple):
    """How one column is shown."""

    title: str
    unit: str
    factor: float  #: from SI to the unit
    min_half_range: float  #: half of the axis at least, so that noise around nothing looks like nothing


PANELS: Final[Mapping[str, ColumnPanel]] = {
    "acceleration_mps2": ColumnPanel("acceleration asked", " m/s²", 1.0, 0.5),
    "steering_rad": ColumnPanel("road-wheel angle asked, left positive", "°", math.degrees(1.0), 1.0),
}


def draw(table: pa.Table, comparison: ControllerComparison, title: str, names: tuple[str, str], file: Path) -> None:
    """Write the picture as a PNG file; `names` are those of the recorded controller and of the other one."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH)
        FigureCanvasAgg(figure)
        grid = figure.add_gridspec(len(PANELS), 1, left=0.055, right=0.985, bottom=0.075, top=0.83, hspace=0.2)
        for place, name in enumerate(PANELS):
            axes = figure.add_subplot(grid[place], sharex=figure.axes[0] if figure.axes else None)
            _paint(axes, table, comparison, name, names)
            axes.tick_params(labelbottom=place == len(PANELS) - 1)
        _explain(figure, names)
        figure.text(0.02, 0.955, title, fontsize=14, fontweight="bold")
        figure.text(0.02, 0.92, f"open loop: the car did what {names[0]} said, whatever {names[1]} would have said")
        figure.savefig(file)


def _paint(axes: Axes, table: pa.Table, comparison: ControllerComparison, name: str, names: tuple[str, str]) -> None:
    panel, time = PANELS[name], numeric_column(table, "time_s")
    recorded, other = (panel.factor * numeric_column(table, f"{whose}_{name}") for whose in ("recorded", "other"))
    axes.set_title(f"{panel.title} [{panel.unit.strip()}]", loc="left", pad=5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.35, linewidth=0.6)
    if comparison.ticks == 0:
        say(axes, "no tick at which both gave an answer")
        return
    axes.plot(time, recorded, color=EGO_PALE, linewidth=3.6, label=f"{names[0]}, as recorded")
    axes.plot(time, other, color=INK, linewidth=1.0, label=f"{names[1]}, on the same inputs")
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -panel.min_half_range), max(high, panel.min_half_range))
    apart = panel.factor * comparison.greatest[name], panel.factor * comparison.rms[name]
    words = "differ by {:.3g}{unit} at most, {:.3g}{unit} rms".format(*apart, unit=panel.unit)
    axes.set_title(words, loc="right", pad=5, color=QUIET, fontsize=10)
    _emergency(axes, table)


def _emergency(axes: Axes, table: pa.Table) -> None:
    """Shade when either asked for the emergency envelope, each in its half of the panel."""
    time, across = numeric_column(table, "time_s"), axes.get_xaxis_transform()
    label = "emergency envelope asked (lower half: as recorded)"
    for whose, low in (("recorded", 0.0), ("other", 0.5)):
        asked = table[f"{whose}_emergency"].to_numpy(zero_copy_only=False)
        if np.any(asked):
            style: dict[str, Any] = {"color": ALARM, "alpha": 0.35, "linewidth": 0, "label": label}
            axes.fill_between(time, low, low + 0.5, where=asked, transform=across, **style)


def _explain(figure: Figure, names: tuple[str, str]) -> None:
    """Name the lines once, above, and the time axis below."""
    marks = dict(zip(*reversed(figure.axes[0].get_legend_handles_labels()), strict=True))
    if marks:
        figure.axes[0].legend(
            [*marks.values()], [*marks], loc="lower left", bbox_to_anchor=(0.0, 1.075), ncols=3, borderpad=0.0
        )
    figure.axes[-1].set_xlabel(axis_of("time_s"), labelpad=2)
