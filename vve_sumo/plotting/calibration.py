"""Draws `calibration.png`: each fit of a calibration over the data that it was made on.

Computes nothing that is not drawn; it knows neither the record nor the fits.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from vve_sumo.metrics.table import axis_of
from vve_sumo.plotting.page import DOTS_PER_INCH, EGO_PALE, INK, QUIET, SIZE, STYLE, say
from vve_sumo.values import Floats
from vve_sumo.vehicle.identification import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: samples farther apart than this are not joined by a line [s]
GAP = 0.3


class CurvePanel(NamedTuple):
    """How one curve is shown."""

    title: str
    unit: str
    factor: float  #: from SI to the unit
    noisy: bool = False  #: samples are dots, not a line


PANELS: Final[dict[str, CurvePanel]] = {
    "pedals": CurvePanel("speed by the wheels: pedals, drag and creep", "m/s", 1.0),
    "wheel_radius": CurvePanel("speed by GNSS: rolling radius", "m/s", 1.0),
    "steering_answer": CurvePanel("steering wheel, reported: dead time and lag", "°", math.degrees(1.0)),
    "steering_geometry": CurvePanel("yaw rate: steering ratio and bias", "°/s", math.degrees(1.0)),
    "heading_misalignment": CurvePanel(
        "receiver's heading less course, on straights, clockwise", "°", -math.degrees(1.0), noisy=True
    ),
    "acceleration": CurvePanel("receiver's forward acceleration: bias", "m/s²", 1.0, noisy=True),
}


def draw(curves: dict[str, Curve], title: str, subtitle: str, file: Path) -> None:
    """Write the picture as a PNG file."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH)
        FigureCanvasAgg(figure)
        grid = figure.add_gridspec(3, 2, left=0.055, right=0.985, bottom=0.075, top=0.85, hspace=0.32, wspace=0.13)
        first: Axes | None = None
        for place, (name, panel) in enumerate(PANELS.items()):
            axes = figure.add_subplot(grid[place // 2, place % 2], sharex=first)
            _paint(axes, curves[name], panel)
            axes.tick_params(labelbottom=place >= len(PANELS) - 2)
            first = first or axes
        _explain(figure.axes)
        figure.text(0.02, 0.955, title, fontsize=14, fontweight="bold")
        figure.text(0.02, 0.92, subtitle, fontsize=12)
        figure.savefig(file)


def _paint(axes: Axes, curve: Curve, panel: CurvePanel) -> None:
    axes.set_title(f"{panel.title} [{panel.unit}]", loc="left", pad=5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.35, linewidth=0.6)
    if not len(curve.time):
        say(axes, "nothing in this drive to learn it from")
        return
    time, measured, fitted = _broken(curve, panel.factor)
    style = {"marker": ".", "linestyle": "", "markersize": 2.0} if panel.noisy else {"linewidth": 3.6}
    axes.plot(time, measured, color=EGO_PALE, label="measured", **style)
    axes.plot(time, fitted, color=INK, linewidth=1.0, label="fitted")
    left = abs(panel.factor) * curve.misfit
    axes.set_title(f"leaves {left:.2g} {panel.unit} rms", loc="right", pad=5, color=QUIET, fontsize=10)


def _broken(curve: Curve, factor: float) -> tuple[Floats, Floats, Floats]:
    """The curve in its unit, with a hole wherever samples lie far apart."""
    holes = np.flatnonzero(np.diff(curve.time) > GAP) + 1
    columns = (curve.time, factor * curve.measured, factor * curve.fitted)
    time, measured, fitted = (np.insert(column, holes, np.nan) for column in columns)
    return time, measured, fitted


def _explain(panels: list[Axes]) -> None:
    """Name the two lines once, and the time axes below."""
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.08), ncols=2, borderpad=0.0)
    for axes in panels[-2:]:
        axes.set_xlabel(axis_of("time_s"), labelpad=2)
