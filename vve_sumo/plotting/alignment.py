"""Draws how a path lies in a lot: the edges, the ground that the car may cover, where it starts and where it must end.

Computes nothing that is not drawn.
"""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Final

import numpy as np

from vve_sumo.drive.virtual_road import standing
from vve_sumo.lot.swept_area import Body, as_pairs, fan
from vve_sumo.plotting.page import ALARM, DOTS_PER_INCH, EGO, EGO_PALE, INK, PAPER, QUIET, ROAD, STYLE
from vve_sumo.values import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vve_sumo.commissioning.align import Laid, Site

WIDTH: Final = 12.0  #: of the page [inch]
TALLEST, FLATTEST = 8.0, 3.0  #: of the lot on it [inch]
ABOVE, BELOW = 1.35, 0.7  #: room for words [inch]
#: stations from one swept place that is drawn to the next [m]
EVERY: Final = 3
ARROW: Final = 0.06  #: of the start's arrow, of the lot's width


def draw(site: Site, laid: Laid, file: FilePath) -> None:
    """Write the picture as a PNG file, in the lot's map: metres east and north of its origin."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    lot = site.fence.lot
    wide, high = np.ptp(lot.outline, axis=0)
    height = min(max(0.91 * WIDTH * float(high / wide), FLATTEST), TALLEST) + BELOW + ABOVE
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, height), dpi=DOTS_PER_INCH)
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0.07, BELOW / height, 0.91, 1.0 - (BELOW + ABOVE) / height))
        _lot(axes, site)
        _path(axes, site, laid)
        _start(axes, site, laid, float(wide))
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("east of the lot's origin [m]")
        axes.set_ylabel("north [m]")
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.01), ncols=6, borderaxespad=0.2)
        figure.text(0.02, 1.0 - 0.38 / height, _title(site), fontsize=14, fontweight="bold")
        figure.text(0.02, 1.0 - 0.68 / height, _subtitle(site, laid), fontsize=12)
        figure.savefig(file)


def _title(site: Site) -> str:
    return f"{site.setting.scenario.ego.path} in the lot of {site.rig_file.stem}"


def _subtitle(site: Site, laid: Laid) -> str:
    if laid.fit is None:
        return "not even the start lies inside"
    if laid.fit.whole:
        return (
            f"fits at up to {site.speed:.1f} m/s: all that is swept stays {laid.fit.clearance:.1f} m inside the margin"
        )
    return f"from {laid.fit.station:.0f} m on, the car could not stop inside"


def _lot(axes: Axes, site: Site) -> None:
    lot = site.fence.lot
    axes.fill(*lot.outline.T, facecolor=ROAD, edgecolor=INK, linewidth=1.6, label="lot")
    for hole in lot.holes:
        axes.fill(*hole.T, facecolor=PAPER, edgecolor=INK, linewidth=1.6)
    for number, edge in enumerate(lot.edges):
        name = f"margin of {lot.margin:g} m" if number == 0 else None
        axes.plot(*edge.T, color=QUIET, linewidth=0.8, linestyle="--", label=name)


def _path(axes: Axes, site: Site, laid: Laid) -> None:
    """The ground that the drive may cover, stops included, and the rear axle's way over it."""
    from matplotlib.collections import PolyCollection

    to_lot = laid.alignment.inverse()
    end = -math.inf if laid.fit is None else laid.fit.station
    inside: list[Floats] = []
    outside: list[Floats] = []
    line = []
    for place in site.fence.driven(site.setting.path, site.speed):
        pose = to_lot.apply(place.pose)
        line.append((pose.x, pose.y))
        if int(place.station) % EVERY == 0:
            shapes = site.fence.sweep(pose, place.steering, place.profile)
            if shapes is not None:
                (inside if place.station <= end else outside).append(shapes)
    for swept, colour, name in ((inside, EGO_PALE, "swept, stops included"), (outside, ALARM, "no stop inside")):
        if swept:
            every = list(np.concatenate(swept))
            axes.add_collection(PolyCollection(every, facecolor=colour, edgecolor=colour, label=name))
    axes.plot(*np.array(line).T, color=EGO, linewidth=1.2, label="path of the rear axle")


def _start(axes: Axes, site: Site, laid: Laid, wide: float) -> None:
    """The car as it stands at the start, with an arrow of where it looks."""
    begin = site.setting.path.at(0.0)
    pose = laid.alignment.inverse().apply(standing(begin.x, begin.y, begin.heading))
    x, y, heading = pose.x, pose.y, pose.heading
    body = as_pairs(fan(Body.of(site.setting.vehicle), 0.0, 0.0, 0.0), x, y, heading)[0]
    axes.fill(*body.T, facecolor=INK, label="start")
    long = ARROW * wide
    tip = (x + long * math.cos(heading), y + long * math.sin(heading))
    axes.annotate("", xy=tip, xytext=(x, y), arrowprops={"color": INK, "arrowstyle": "-|>", "linewidth": 2.0})
