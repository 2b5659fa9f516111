"""Draws `drive.png`: lays out the page, chooses what of the virtual road its two windows show, and writes the file.

Computes nothing that is not drawn. It knows neither SUMO nor how the drive was run.
"""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from vve_sumo.plotting.birds_eye import MARGIN, MAX_GAP_SHOWN, MapWindow, draw_close_up, draw_overview, rotated
from vve_sumo.plotting.dated_traces import draw_dated_traces
from vve_sumo.plotting.moment import draw_moment, moment_view, nearest_at_the_end, title_of
from vve_sumo.plotting.page import (
    BETWEEN,
    BOTTOM,
    DOTS_PER_INCH,
    LEFT,
    LEFT_WIDTH,
    QUIET,
    SIZE,
    STYLE,
    TOP,
    DrivePage,
    panel,
    prefix,
    say,
    trace,
)
from vve_sumo.plotting.time_series import over_time
from vve_sumo.values import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: the overview shows at least this much of the virtual road [m]
MIN_OVERVIEW = 120.0
#: height over width of the overview at least and at most; the closer view takes what it leaves
FLATTEST, TALLEST = 0.36, 0.5
#: street shown in the closer view before and behind the gap [m]
CLOSE_UP = 20.0
#: a trace shorter than this has no direction of its own [m]
HAS_DIRECTION = 5.0
#: the overview is turned by the look of at most about this many points of the trace
MAX_POINTS = 2000


def long_axis(x: Floats, y: Floats, heading: float) -> float:
    """Return along what the smallest box around points is long, to a degree, north not downwards.

    Points that hardly spread have no such direction; then it is `heading`.
    """
    every = 1 + len(x) // MAX_POINTS
    angles: list[float] = np.radians(np.arange(-89.0, 91.0)).tolist()
    sides = [np.ptp(rotated(x[::every], y[::every], -angle), axis=0) for angle in angles]
    if max(side[0] for side in sides) < HAS_DIRECTION:
        return math.remainder(heading, math.pi)
    lying = [n for n, (along, across) in enumerate(sides) if along >= across]
    return angles[min(lying, key=lambda n: float((sides[n] + MARGIN).prod()))]


def _overview(ticks: pa.Table) -> MapWindow:
    """Return the window on the whole trace: its long axis to the right, its shape between FLATTEST and TALLEST."""
    x, y, heading = trace(ticks)
    angle = long_axis(x, y, float(heading[-1]))
    turned = rotated(x, y, -angle)
    least, greatest = turned.min(axis=0), turned.max(axis=0)
    width, height = greatest - least + 2.0 * MARGIN
    width = max(float(width), float(height) / TALLEST, MIN_OVERVIEW)
    ((right, up),) = (least + greatest)[None] / 2.0
    x, y = rotated(right, up, angle)[0]
    return MapWindow(float(x), float(y), angle, width, max(float(height), FLATTEST * width))


def _left_over(whole: MapWindow) -> float:
    """Return height over width of the closer view that the overview leaves room for."""
    return (TOP - BOTTOM - BETWEEN) / LEFT_WIDTH - whole.height / whole.width


def _close_up(ticks: pa.Table, bumper: float, gap: float, shape: float) -> MapWindow:
    """Return the window on the end: the ego drives to the right, the gap [m] before its bumper in the middle."""
    x, y, heading = (float(column[-1]) for column in trace(ticks))
    shown = gap if 0.0 <= gap <= MAX_GAP_SHOWN else 0.0
    ahead = bumper + shown / 2.0
    width = shown + 2.0 * CLOSE_UP
    return MapWindow(x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading, width, shape * width)


def _from_above(figure: Figure, page: DrivePage) -> None:
    """Draw the two windows on the virtual road; their heights follow from the shape of the trace."""
    if len(trace(page.ticks)[0]) == 0:
        axes = panel(figure, LEFT, BOTTOM, LEFT_WIDTH, TOP - BOTTOM)
        axes.set_xticks(())
        say(axes, "no pose, no place on the virtual road")
        return
    view = _overview(page.ticks)
    height = LEFT_WIDTH * view.height / view.width
    whole = panel(figure, LEFT, TOP - height, LEFT_WIDTH, height)
    draw_overview(whole, page, view)
    whole.set_title(f"from above{nearest_at_the_end(page)}", loc="left", pad=5)
    close = panel(figure, LEFT, BOTTOM, LEFT_WIDTH, TOP - BOTTOM - BETWEEN - height)
    if page.moment is not None and math.isfinite(page.ticks[f"{prefix(page.ticks)}x_m"][page.moment.row].as_py()):
        draw_dated_traces(whole, page, view)
        draw_moment(close, page, page.moment, moment_view(page, page.moment, _left_over(view)))
        close.set_title(title_of(page, page.moment), loc="left", pad=5)
    else:
        bumper = page.vehicle.rear_axle_to_bumper
        draw_close_up(close, page, _close_up(page.ticks, bumper, float(page.lead.gap[-1]), _left_over(view)))
        close.set_title("where it ended, driving to the right", loc="left", pad=5)
    named = {
        name: mark for axes in (close, whole) for mark, name in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    place: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.01), "borderaxespad": 0.2}
    close.legend([*named.values()], [*named], ncols=4, columnspacing=1.4, handletextpad=0.5, **place)


def paint(figure: Figure, page: DrivePage) -> None:
    """Draw a drive of at least one tick into an empty figure of the page's size, in the page's style."""
    _from_above(figure, page)
    over_time(figure, page)
    title = textwrap.shorten(page.title, 110, placeholder=" …")
    figure.text(LEFT / SIZE[0], 0.962, title, fontsize=14, fontweight="bold")
    figure.text(LEFT / SIZE[0], 0.936, textwrap.shorten(page.subtitle, 150, placeholder=" …"), fontsize=11.5)
    if page.setting:
        setting = textwrap.shorten(page.setting, 190, placeholder=" …")
        figure.text(LEFT / SIZE[0], 0.913, setting, fontsize=9.5, color=QUIET)


def draw(page: DrivePage, file: Path) -> None:
    """Write the picture of a drive of at least one tick as a PNG file."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH)
        FigureCanvasAgg(figure)
        paint(figure, page)
        figure.savefig(file)
