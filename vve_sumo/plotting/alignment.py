"""Draws how a path lies in a lot: the edges, the ground that the car may cover, where it starts and where it must end.

Computes nothing that is not drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.frames import Alignment
from vve_sumo.lot.corridor import DeclaredCorridor
from vve_sumo.lot.fit import Fit
from vve_sumo.lot.geofence import Geofence
from vve_sumo.lot.swept_area import Body, as_pairs, fan
from vve_sumo.path import ReferencePath
from vve_sumo.plotting.page import ALARM, DOTS_PER_INCH, EGO, EGO_PALE, INK, PAPER, QUIET, ROAD, STYLE
from vve_sumo.values import Floats, Vehicle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH: Final = 12.0  #: of the page [inch]
TALLEST, FLATTEST = 8.0, 3.0  #: of the lot on it [inch]
ABOVE, BELOW = 1.35, 0.7  #: room for words [inch]
#: along the path from one swept place that is drawn to the next [m]
EVERY: Final = 3
ARROW: Final = 0.06  #: of the start's arrow, of the lot's width


@dataclass(frozen=True, slots=True)
class PathInLot:
    """A path, the lot that it is to lie in, and how it lies there."""

    path_name: str
    lot_name: str
    path: ReferencePath  #: in the virtual road's map
    speed: float  #: wanted on it [m/s]
    vehicle: Vehicle
    geofence: Geofence  #: with the lot's map as the road's
    alignment: Alignment
    fit: Fit | None  #: None where not even the start lies inside
    corridor: DeclaredCorridor = ()  #: that the scenario declares beside the path


def draw(shown: PathInLot, file: Path) -> None:
    """Write the picture as a PNG file, in the lot's map: metres east and north of its origin."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        path_in_lot(shown).savefig(file)


def path_in_lot(shown: PathInLot) -> Figure:
    """Return the picture, in the lot's map: metres east and north of its origin."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    lot = shown.geofence.lot
    wide, high = np.ptp(lot.outline, axis=0)
    height = min(max(0.91 * WIDTH * float(high / wide), FLATTEST), TALLEST) + BELOW + ABOVE
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, height), dpi=DOTS_PER_INCH)
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0.07, BELOW / height, 0.91, 1.0 - (BELOW + ABOVE) / height))
        _lot(axes, shown)
        _path(axes, shown)
        _corridor(axes, shown)
        _start(axes, shown, float(wide))
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("east of the lot's origin [m]")
        axes.set_ylabel("north [m]")
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.01), ncols=6, borderaxespad=0.2)
        title = f"{shown.path_name} in the lot of {shown.lot_name}"
        figure.text(0.02, 1.0 - 0.38 / height, title, fontsize=14, fontweight="bold")
        figure.text(0.02, 1.0 - 0.68 / height, _subtitle(shown), fontsize=12)
        return figure


def _subtitle(shown: PathInLot) -> str:
    if shown.fit is None:
        return "not even the start lies inside"
    if shown.fit.whole:
        clear = f"{shown.fit.clearance:.1f} m inside the margin"
        return f"fits at up to {shown.speed:.1f} m/s: all that is swept stays {clear}"
    return f"from {shown.fit.last_s:.0f} m on, the car could not stop inside"


def _lot(axes: Axes, shown: PathInLot) -> None:
    lot = shown.geofence.lot
    axes.fill(*lot.outline.T, facecolor=ROAD, edgecolor=INK, linewidth=1.6, label="lot")
    for hole in lot.holes:
        axes.fill(*hole.T, facecolor=PAPER, edgecolor=INK, linewidth=1.6)
    for number, edge in enumerate(lot.edges):
        name = f"margin of {lot.margin:g} m" if number == 0 else None
        axes.plot(*edge.T, color=QUIET, linewidth=0.8, linestyle="--", label=name)


def _path(axes: Axes, shown: PathInLot) -> None:
    """The ground that the drive may cover, stops included, and the rear axle's way over it."""
    from matplotlib.collections import PolyCollection

    to_lot = shown.alignment.inverse()
    end = -math.inf if shown.fit is None else shown.fit.last_s
    inside: list[Floats] = []
    outside: list[Floats] = []
    line = []
    for place in shown.geofence.driven(shown.path, shown.speed, shown.corridor):
        pose = to_lot.apply(place.pose)
        if place.d == 0.0:
            line.append((pose.x, pose.y))
        if int(place.s) % EVERY == 0:
            shapes = shown.geofence.sweep(pose, place.steering, place.fallback_path, place.s)
            if shapes is not None:
                (inside if place.s <= end else outside).append(shapes)
    for swept, colour, name in ((inside, EGO_PALE, "swept, stops included"), (outside, ALARM, "no stop inside")):
        if swept:
            every = list(np.concatenate(swept))
            # Thousands of shapes: as dots, where the picture is drawn as lines. What would roll on for ever reaches out
            # of the picture.
            shapes_of = PolyCollection(every, facecolor=colour, edgecolor=colour, label=name, rasterized=True)
            axes.add_collection(shapes_of, autolim=False)
    axes.plot(*np.array(line).T, color=EGO, linewidth=1.2, label="path of the rear axle")


def _corridor(axes: Axes, shown: PathInLot) -> None:
    """The lines between which the rear axle may be, around every stretch of the declared corridor."""
    to_lot = shown.alignment.inverse()
    for number, stretch in enumerate(shown.corridor):
        end = min(stretch.end, shown.path.length)
        along = np.linspace(stretch.begin, end, math.ceil(end - stretch.begin) + 1).tolist()
        points = [shown.path.at(s) for s in along]
        sides = [
            [(point.x - d * math.sin(point.heading), point.y + d * math.cos(point.heading)) for point in points]
            for d in (stretch.left, -stretch.right)
        ]
        around = [to_lot.apply(pose_at_rest(x, y, 0.0)) for x, y in (*sides[0], *sides[1][::-1])]
        name = "corridor of the rear axle" if number == 0 else None
        corners = np.array([(pose.x, pose.y) for pose in around])
        axes.fill(*corners.T, fill=False, edgecolor=INK, linewidth=1.0, linestyle=":", label=name)


def _start(axes: Axes, shown: PathInLot, wide: float) -> None:
    """The car as it stands at the start, with an arrow of where it looks."""
    begin = shown.path.at(0.0)
    pose = shown.alignment.inverse().apply(pose_at_rest(begin.x, begin.y, begin.heading))
    x, y, heading = pose.x, pose.y, pose.heading
    body = as_pairs(fan(Body.of(shown.vehicle), 0.0, 0.0, 0.0), x, y, heading)[0]
    axes.fill(*body.T, facecolor=INK, label="start")
    long = ARROW * wide
    tip = (x + long * math.cos(heading), y + long * math.sin(heading))
    axes.annotate("", xy=tip, xytext=(x, y), arrowprops={"color": INK, "arrowstyle": "-|>", "linewidth": 2.0})
