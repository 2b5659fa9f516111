"""Draws the virtual road from above into turned windows: the whole drive in one, the end of it closer in another.

The windows are given; it must not know how they are chosen, the curves over time, SUMO, or how the drive was run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo.geometry import Box, vehicle_boxes
from vve_sumo.path import ReferencePath
from vve_sumo.plotting.page import (
    EGO,
    INK,
    LEFT_WIDTH,
    OBSTACLE,
    PAPER,
    POINTS_PER_INCH,
    ROAD,
    DrivePage,
    contact,
    prefix,
    trace,
)
from vve_sumo.plotting.placing import Rectangle, around, centred
from vve_sumo.values import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: of the middle of scale and needle over a window's upper edge [inch]
SCALE_HEIGHT = 0.14

#: street shown around the ego's trace [m]
MARGIN = 25.0
#: a longer gap at the end is not shown in the closer view [m]
MAX_GAP_SHOWN = 40.0
#: parts of the way at which an arrow says where the car drives to
ARROWS = (0.2, 0.5, 0.8)
#: a body shorter than this gets a pointer of this size beside it [point], so far from its edge [inch]
MARK, POINTER_APART = 7.0, 0.08


@dataclass(frozen=True, slots=True)
class MapWindow:
    """A window on the map, turned."""

    x: float  #: middle, map [m]
    y: float  #: middle, map [m]
    heading: float  #: what points to the right [rad], counter-clockwise from the map's +x
    width: float  #: [m]
    height: float  #: [m]

    def place(self, x: Floats, y: Floats) -> Floats:
        """Return where map points lie on the window (n x 2), from its middle to the right and up [m]."""
        return rotated(x - self.x, y - self.y, -self.heading)

    def corners(self) -> Floats:
        """Return the window's corners on the map (4 x 2) [m]."""
        return np.array(Box(self.x, self.y, self.heading, self.width, self.height).corners())

    def holds(self, x: float, y: float) -> bool:
        """Whether a map point lies in the window."""
        ((right, up),) = self.place(np.array([x]), np.array([y]))
        return bool(abs(right) <= self.width / 2.0 and abs(up) <= self.height / 2.0)


@dataclass(frozen=True, slots=True)
class DrawnCar:
    """A car on the map and how it is drawn."""

    box: Box
    colour: str
    name: str  #: what the legend calls it
    ego: bool = False

    def place(self, view: MapWindow) -> Floats:
        """Return its corners on a window (4 x 2) [m]."""
        return view.place(*np.array(self.box.corners()).T)

    def pointer(self, view: MapWindow) -> Rectangle | None:
        """Return where the pointer to a body stands that would be too small to be found; None for a larger one.

        The ego's points up from below and all others' down from above, so that two who stand close are told apart.
        """
        inch = view.width / LEFT_WIDTH
        if self.box.length / inch * POINTS_PER_INCH > MARK:
            return None
        body, size = around(self.place(view)), MARK / POINTS_PER_INCH * inch
        away = POINTER_APART * inch + size / 2.0
        y = body.low - away if self.ego else body.high + away
        return centred((body.left + body.right) / 2.0, y, size, size)


def rotated(x: Floats, y: Floats, angle: float) -> Floats:
    """Return points (n x 2) turned about the origin by an angle [rad], counter-clockwise."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.column_stack((x * cos - y * sin, x * sin + y * cos))


def _ego(page: DrivePage) -> DrawnCar:
    x, y, heading = (column[-1:] for column in trace(page.ticks))
    boxes = vehicle_boxes(x, y, heading, np.zeros_like(x), page.vehicle)
    return DrawnCar(
        Box(*(float(column[0]) for column in boxes[:5])),
        EGO,
        f"{page.ego} at the end" if page.moment is None else "_",
        True,
    )


def _actors(page: DrivePage) -> list[DrawnCar]:
    """Return the actors at the last tick; last among them what the ego stands before or has touched."""
    last = page.actors.filter(np.equal(page.actors["tick"].to_numpy(), page.ticks["tick"][-1].as_py()))
    touched = {*"+".join(page.ticks["contacts"].to_pylist()).split("+")}
    met = {page.lead.actor[-1], *touched} if page.moment is None else {page.main, *touched}
    sizes = ("x_m", "y_m", "heading_rad", "length_m", "width_m")
    cars = [
        DrawnCar(
            Box(*(row[name] for name in sizes)),
            *(
                (OBSTACLE, "actor met" if page.moment is None else "_")
                if row["actor"] in met
                else (page.colour_of(row["actor"]), "_" if row["actor"] == page.second else "other traffic")
            ),
        )
        for row in last.to_pylist()
    ]
    return sorted(cars, key=lambda car: car.colour != PAPER)


def draw_map(axes: Axes, page: DrivePage, view: MapWindow, edge: str, end: int | None = None) -> None:
    """Draw lanes, path and trace in a turned window; `edge` is the colour between two lanes.

    The trace ends at the row `end` of the ticks, else at the last; with such an end, which is the moment's, the path
    that the command carried there is drawn too.
    """
    from matplotlib.collections import PolyCollection

    roads = [view.place(*ribbon(line, width).T) for line, width in page.lanes if len(line) > 1]
    axes.add_collection(PolyCollection(roads, facecolor=ROAD, edgecolor=edge, linewidth=0.7, zorder=1))
    points = np.array([page.path.at(float(s))[:2] for s in np.arange(0.0, page.path.length, 2.0)])
    axes.plot(*view.place(*points.T).T, color=INK, linewidth=1.0, linestyle=(0, (4, 3)), zorder=2, label="path")
    x, y, _ = trace(page.ticks if end is None else page.ticks.slice(0, end + 1))
    axes.plot(*view.place(x, y).T, color=EGO, linewidth=2.2, zorder=3, label=f"{page.ego}, rear axle")
    if end is not None and page.commanded is not None:
        axes.plot(*view.place(*page.commanded.T).T, color=EGO, linewidth=1.0, zorder=3, label="commanded path")
    axes.set(xlim=(-view.width / 2.0, view.width / 2.0), ylim=(-view.height / 2.0, view.height / 2.0))
    axes.set(xticks=(), yticks=())
    compass(axes, view, LEFT_WIDTH)


def ribbon(line: Floats, width: float) -> Floats:
    """Return the outline (m x 2) of a band of a width [m] along a line (n x 2) [m]."""
    step = np.gradient(line, axis=0)
    size = np.hypot(step[:, 0], step[:, 1])
    size[size == 0.0] = 1.0
    normal = np.column_stack((-step[:, 1] / size, step[:, 0] / size)) * width / 2.0
    return np.vstack((line + normal, (line - normal)[::-1]))


def _scale(width: float) -> float:
    """Return the greatest of 1, 2, 5, 10, ... metres that is no more than a quarter of the width."""
    power = 10.0 ** math.floor(math.log10(width / 4.0))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= width / 4.0)


def compass(axes: Axes, view: MapWindow, wide: float) -> None:
    """Write scale and north into the line above a window that is so `wide` on the page [inch]: they cover nothing."""
    across, above = axes.get_xaxis_transform(), 1.0 + SCALE_HEIGHT / (wide * view.height / view.width)
    scale, end, north = _scale(view.width), 0.43 * view.width, 0.488 * view.width
    axes.plot((end - scale, end), (above, above), "|-", color=INK, linewidth=1.4, transform=across, clip_on=False)
    needle = rotated(np.array([-0.4, 0.0, 0.4, 0.0]), np.array([-1.0, 1.0, -1.0, -0.6]), -view.heading)
    axes.plot(north, above, marker=needle, markersize=15.0, color=INK, transform=across, clip_on=False)
    for words, before in ((f"{scale:g} m", end - scale), ("N", north - 0.008 * view.width)):
        axes.text(before - 0.01 * view.width, above, words, transform=across, ha="right", va="center")


def draw_car(axes: Axes, view: MapWindow, box: Box, colour: str) -> None:
    """Draw a car as large as it is."""
    placed = view.place(*np.array(box.corners()).T)
    axes.fill(*placed.T, facecolor=colour, edgecolor=INK, linewidth=0.8, zorder=6)


def draw_overview(axes: Axes, page: DrivePage, view: MapWindow) -> None:
    """Draw where the drive went, and who stood where when it ended."""
    draw_map(axes, page, view, ROAD)
    _directions(axes, page, view)
    _cars(axes, page, view)
    x, y, _ = trace(page.ticks)
    mark: dict[str, Any] = {"markersize": 8.0, "markerfacecolor": PAPER, "markeredgecolor": EGO, "markeredgewidth": 2.0}
    axes.plot(*view.place(x[:1], y[:1]).T, "o", zorder=7, label="start", **mark)
    _cross(axes, page, view)


def cars_at_the_end(page: DrivePage, view: MapWindow) -> list[DrawnCar]:
    """Return the cars that a window shows of the last tick, the ego last."""
    return [car for car in (*_actors(page), _ego(page)) if view.holds(car.box.x, car.box.y)]


def _cars(axes: Axes, page: DrivePage, view: MapWindow) -> None:
    for car in cars_at_the_end(page, view):
        _mark(axes, view, car)


def _mark(axes: Axes, view: MapWindow, car: DrawnCar) -> None:
    """Draw a car as large as it is, with a pointer to one that would be too small to be found."""
    draw_car(axes, view, car.box, car.colour)
    if (place := car.pointer(view)) is not None:
        x, y = (place.left + place.right) / 2.0, (place.low + place.high) / 2.0
        shape: dict[str, Any] = {"markersize": MARK, "markeredgecolor": INK, "markeredgewidth": 0.8, "zorder": 6}
        axes.plot(x, y, "^" if car.ego else "v", color=car.colour, **shape)
    style: dict[str, Any] = {"markersize": MARK, "markeredgecolor": INK, "markeredgewidth": 0.8}
    axes.plot(math.nan, math.nan, "s", color=car.colour, label=car.name, **style)


def _directions(axes: Axes, page: DrivePage, view: MapWindow) -> None:
    x, y, heading = trace(page.ticks)
    way = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    for row in np.searchsorted(way, way[-1] * np.array(ARROWS)) if way[-1] > 2.0 * MARGIN else ():
        ((right, up),) = view.place(x[row : row + 1], y[row : row + 1])
        turn = math.degrees(heading[row] - view.heading) - 90.0
        axes.plot(right, up, marker=(3, 0, turn), markersize=13.0, color=EGO, markeredgecolor=PAPER, zorder=4)


def _cross(axes: Axes, page: DrivePage, view: MapWindow) -> None:
    """Mark where the ego's bumper was at the first contact."""
    row = contact(page.ticks)
    if row is None:
        return
    x, y, heading = (page.ticks[f"{prefix(page.ticks)}{name}"][row].as_py() for name in ("x_m", "y_m", "heading_rad"))
    ahead = page.vehicle.rear_axle_to_bumper
    place = view.place(np.array([x + ahead * math.cos(heading)]), np.array([y + ahead * math.sin(heading)]))
    label = f"contact at {page.ticks['time_s'][row].as_py():.2f} s"
    axes.plot(*place.T, "x", color=INK, markersize=10.0, markeredgewidth=2.4, zorder=8, label=label)


def draw_close_up(axes: Axes, page: DrivePage, view: MapWindow) -> None:
    """Draw where the ego stood at the end, and how far from what."""
    draw_map(axes, page, view, PAPER)
    _cars(axes, page, view)
    _cross(axes, page, view)
    gap, s = float(page.lead.gap[-1]), page.ticks["s_m"][-1].as_py()
    if 0.0 < gap <= MAX_GAP_SHOWN and math.isfinite(s):
        bumper = s + page.vehicle.rear_axle_to_bumper
        _dimension(axes, view, page.path, bumper, gap, page.vehicle.width / 2.0 + 0.7)


def _dimension(axes: Axes, view: MapWindow, path: ReferencePath, begin: float, gap: float, aside: float) -> None:
    """Draw a dimension along the path, `aside` metres to its right, with lines to where it begins and ends."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path as Curve

    points = np.array([path.at(float(s))[:3] for s in np.linspace(begin, begin + gap, 30)])
    normal = np.column_stack((np.sin(points[:, 2]), -np.cos(points[:, 2])))
    line = view.place(*(points[:, :2] + aside * normal).T)
    shape: dict[str, Any] = {"arrowstyle": "<|-|>", "mutation_scale": 9.0, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.add_patch(FancyArrowPatch(path=Curve(line), color=INK, linewidth=1.2, zorder=7, **shape))
    for end in (0, -1):
        leg = points[end, :2] + np.outer((0.0, aside + 0.4), normal[end])
        axes.plot(*view.place(*leg.T).T, color=INK, linewidth=0.8, zorder=7)
    place: dict[str, Any] = {"xytext": (0, -7), "textcoords": "offset points", "ha": "center", "va": "top", "zorder": 8}
    axes.annotate(f"{gap:.2f} m", tuple(line[len(line) // 2]), fontsize=13, fontweight="bold", **place)
