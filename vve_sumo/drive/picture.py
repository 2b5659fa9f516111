"""Draws `drive.png` from a record: the street from above and the drive over time.

Reads the record's tables and the street's lanes; computes nothing that is not drawn. It knows neither SUMO nor how
the drive was run.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vve_sumo.drive.figures import AT_REST, Ahead
from vve_sumo.path import Path
from vve_sumo.values import ArmingState, Floats, Vehicle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours after Okabe and Ito, Color Universal Design (2008): told apart by the colour-blind, and by lightness in grey.
INK, QUIET, ROAD, PAPER = "#1b1b1b", "#767676", "#dcdcd8", "#ffffff"
EGO, EGO_PALE, OBSTACLE, ALARM = "#0072b2", "#56b4e9", "#d55e00", "#e69f00"

#: of the page; at half of it, a paper's column pair, the letters are still 5 points high [inch]
SIZE = (13.0, 8.0)
DOTS_PER_INCH = 120
POINTS_PER_INCH = 72
STYLE: dict[Any, Any] = {
    "font.size": 11,
    "axes.titlesize": 11,
    "legend.fontsize": 10.5,
    "legend.frameon": False,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "butt",
}

# Where things stand on the page [inch], from its left and lower edge.
LEFT, LEFT_WIDTH, RIGHT, RIGHT_WIDTH = 0.25, 7.35, 8.35, 4.4
BOTTOM, TOP, BETWEEN = 0.75, 6.95, 0.42
#: of the middle of scale and needle over a window's upper edge [inch]
ABOVE = 0.14

#: street shown around the ego's trace [m]
MARGIN = 25.0
#: the overview shows at least this much of the street [m]
LEAST_OVERVIEW = 120.0
#: height over width of the overview at least and at most; the closer view takes what it leaves
FLATTEST, TALLEST = 0.36, 0.5
#: street shown in the closer view before and behind the gap [m]
CLOSE_UP = 20.0
#: a longer gap at the end is not shown in the closer view [m]
LONGEST_GAP = 40.0
#: a trace shorter than this has no direction of its own [m]
HAS_DIRECTION = 5.0
#: parts of the way at which an arrow says where the car drives to
ARROWS = (0.2, 0.5, 0.8)
#: the criterion of the shipped scenarios, drawn for scale [m]
DEVIATION_GUIDE = 0.15
#: where the car left the path by this many times the guide, the guides would be one line
GUIDE_READABLE = 10.0
#: the overview is turned by the look of at most about this many points of the trace
ENOUGH_POINTS = 2000
#: side of the mark that stands for a car too small to see [point]
MARK = 7.0


@dataclass(frozen=True, slots=True)
class Sheet:
    """Everything that the picture shows."""

    title: str
    subtitle: str
    ticks: pa.Table
    actors: pa.Table
    seen: Ahead
    path: Path
    vehicle: Vehicle
    lanes: Sequence[tuple[Floats, float]]  #: centre line (n x 2) [m] and width [m] of each lane


@dataclass(frozen=True, slots=True)
class View:
    """A window on the map, turned."""

    x: float  #: middle, map [m]
    y: float  #: middle, map [m]
    heading: float  #: what points to the right [rad], counter-clockwise from the map's +x
    width: float  #: [m]
    height: float  #: [m]

    def place(self, x: Floats, y: Floats) -> Floats:
        """Return where map points lie on the window (n x 2), from its middle to the right and up [m]."""
        return _turned(x - self.x, y - self.y, -self.heading)

    def corners(self) -> Floats:
        """Return the window's corners on the map (4 x 2) [m]."""
        right, up = np.array([1.0, 1.0, -1.0, -1.0]), np.array([1.0, -1.0, -1.0, 1.0])
        return np.array([self.x, self.y]) + _turned(right * self.width / 2.0, up * self.height / 2.0, self.heading)

    def holds(self, x: float, y: float) -> bool:
        """Whether a map point lies in the window."""
        ((right, up),) = self.place(np.array([x]), np.array([y]))
        return bool(abs(right) <= self.width / 2.0 and abs(up) <= self.height / 2.0)


@dataclass(frozen=True, slots=True)
class Box:
    """A car on the map."""

    x: float  #: of its middle [m]
    y: float  #: of its middle [m]
    heading: float  #: [rad]
    length: float  #: [m]
    width: float  #: [m]
    colour: str
    name: str  #: what the legend calls it


def _turned(x: Floats, y: Floats, angle: float) -> Floats:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.column_stack((x * cos - y * sin, x * sin + y * cos))


def _prefix(ticks: pa.Table) -> str:
    return "true_" if np.isfinite(ticks["true_x_m"].to_numpy()).any() else ""


def trace(ticks: pa.Table) -> tuple[Floats, Floats, Floats]:
    """Return x, y and heading of the rear axle where they are known: the truth if any, else the estimate."""
    x, y, heading = (ticks[f"{_prefix(ticks)}{name}"].to_numpy() for name in ("x_m", "y_m", "heading_rad"))
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(heading)
    return x[known], y[known], heading[known]


def bounds(ticks: pa.Table) -> tuple[float, float, float, float]:
    """Return least x, least y, greatest x and greatest y of what the picture shows of the street [m]."""
    if len(trace(ticks)[0]) == 0:
        return (0.0, 0.0, 1.0, 1.0)
    whole = _overview(ticks)
    corners = np.vstack((whole.corners(), _close_up(ticks, 0.0, LONGEST_GAP, _left_over(whole)).corners()))
    (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
    return (float(left), float(low), float(right), float(high))


def _long_axis(x: Floats, y: Floats, heading: float) -> float:
    """Return along what the smallest box around points is long, to a degree, north not downwards.

    Points that hardly spread have no such direction; then it is `heading`.
    """
    every = 1 + len(x) // ENOUGH_POINTS
    angles: list[float] = np.radians(np.arange(-89.0, 91.0)).tolist()
    sides = [np.ptp(_turned(x[::every], y[::every], -angle), axis=0) for angle in angles]
    if max(side[0] for side in sides) < HAS_DIRECTION:
        return math.remainder(heading, math.pi)
    lying = [n for n, (along, across) in enumerate(sides) if along >= across]
    return angles[min(lying, key=lambda n: float((sides[n] + MARGIN).prod()))]


def _overview(ticks: pa.Table) -> View:
    """Return the window on the whole trace: its long axis to the right, its shape between FLATTEST and TALLEST."""
    x, y, heading = trace(ticks)
    angle = _long_axis(x, y, float(heading[-1]))
    turned = _turned(x, y, -angle)
    least, greatest = turned.min(axis=0), turned.max(axis=0)
    width, height = greatest - least + 2.0 * MARGIN
    width = max(float(width), float(height) / TALLEST, LEAST_OVERVIEW)
    ((right, up),) = (least + greatest)[None] / 2.0
    x, y = _turned(right, up, angle)[0]
    return View(float(x), float(y), angle, width, max(float(height), FLATTEST * width))


def _left_over(whole: View) -> float:
    """Return height over width of the closer view that the overview leaves room for."""
    return (TOP - BOTTOM - BETWEEN) / LEFT_WIDTH - whole.height / whole.width


def _close_up(ticks: pa.Table, bumper: float, gap: float, shape: float) -> View:
    """Return the window on the end: the ego drives to the right, the gap [m] before its bumper in the middle."""
    x, y, heading = (float(column[-1]) for column in trace(ticks))
    shown = gap if 0.0 <= gap <= LONGEST_GAP else 0.0
    ahead = bumper + shown / 2.0
    width = shown + 2.0 * CLOSE_UP
    return View(x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading, width, shape * width)


def _ego(sheet: Sheet) -> Box:
    x, y, heading = (float(column[-1]) for column in trace(sheet.ticks))
    car = sheet.vehicle
    ahead = car.rear_axle_to_bumper - car.length / 2.0
    x, y = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
    return Box(x, y, heading, car.length, car.width, EGO, "ego at the end")


def _boxes(sheet: Sheet) -> list[Box]:
    """Return the actors at the last tick; last among them what the ego stands before or has touched."""
    last = sheet.actors.filter(np.equal(sheet.actors["tick"].to_numpy(), sheet.ticks["tick"][-1].as_py()))
    met = {sheet.seen.actor[-1], *"+".join(sheet.ticks["contacts"].to_pylist()).split("+")}
    columns = (last[name].to_pylist() for name in ("actor", "x_m", "y_m", "heading_rad", "length_m", "width_m"))
    boxes = [
        Box(x, y, heading, length, width, *((OBSTACLE, "obstacle") if actor in met else (PAPER, "other traffic")))
        for actor, x, y, heading, length, width in zip(*columns, strict=True)
    ]
    return sorted(boxes, key=lambda box: box.name, reverse=True)


def _contact(ticks: pa.Table) -> int | None:
    """Return the row of the first contact."""
    return next((row for row, names in enumerate(ticks["contacts"].to_pylist()) if names), None)


def _map(axes: Axes, sheet: Sheet, view: View, edge: str) -> None:
    """Draw lanes, path and trace in a turned window; `edge` is the colour between two lanes."""
    from matplotlib.collections import PolyCollection

    roads = [view.place(*_ribbon(line, width).T) for line, width in sheet.lanes if len(line) > 1]
    axes.add_collection(PolyCollection(roads, facecolor=ROAD, edgecolor=edge, linewidth=0.7, zorder=1))
    points = np.array([sheet.path.at(float(s))[:2] for s in np.arange(0.0, sheet.path.length, 2.0)])
    axes.plot(*view.place(*points.T).T, color=INK, linewidth=1.0, linestyle=(0, (4, 3)), zorder=2, label="path")
    x, y, _ = trace(sheet.ticks)
    axes.plot(*view.place(x, y).T, color=EGO, linewidth=2.2, zorder=3, label="ego, rear axle")
    axes.set(xlim=(-view.width / 2.0, view.width / 2.0), ylim=(-view.height / 2.0, view.height / 2.0))
    axes.set(xticks=(), yticks=())
    _compass(axes, view)


def _ribbon(line: Floats, width: float) -> Floats:
    step = np.gradient(line, axis=0)
    size = np.hypot(step[:, 0], step[:, 1])
    size[size == 0.0] = 1.0
    normal = np.column_stack((-step[:, 1] / size, step[:, 0] / size)) * width / 2.0
    return np.vstack((line + normal, (line - normal)[::-1]))


def _scale(width: float) -> float:
    """Return the greatest of 1, 2, 5, 10, ... metres that is no more than a quarter of the width."""
    power = 10.0 ** math.floor(math.log10(width / 4.0))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= width / 4.0)


def _compass(axes: Axes, view: View) -> None:
    """Write scale and north into the line above a window, where they can cover nothing."""
    across, above = axes.get_xaxis_transform(), 1.0 + ABOVE / (LEFT_WIDTH * view.height / view.width)
    scale, end, north = _scale(view.width), 0.43 * view.width, 0.488 * view.width
    axes.plot((end - scale, end), (above, above), "|-", color=INK, linewidth=1.4, transform=across, clip_on=False)
    needle = _turned(np.array([-0.4, 0.0, 0.4, 0.0]), np.array([-1.0, 1.0, -1.0, -0.6]), -view.heading)
    axes.plot(north, above, marker=needle, markersize=15.0, color=INK, transform=across, clip_on=False)
    for words, before in ((f"{scale:g} m", end - scale), ("N", north - 0.008 * view.width)):
        axes.text(before - 0.01 * view.width, above, words, transform=across, ha="right", va="center")


def _car(axes: Axes, view: View, box: Box) -> None:
    right, up = np.array([1.0, 1.0, -1.0, -1.0]), np.array([1.0, -1.0, -1.0, 1.0])
    corners = _turned(right * box.length / 2.0, up * box.width / 2.0, box.heading)
    placed = view.place(box.x + corners[:, 0], box.y + corners[:, 1])
    axes.fill(*placed.T, facecolor=box.colour, edgecolor=INK, linewidth=0.8, zorder=6)


def _draw_overview(axes: Axes, sheet: Sheet, view: View) -> None:
    """Draw where the drive went, and who stood where when it ended."""
    _map(axes, sheet, view, ROAD)
    _directions(axes, sheet, view)
    _cars(axes, sheet, view)
    x, y, _ = trace(sheet.ticks)
    mark: dict[str, Any] = {"markersize": 8.0, "markerfacecolor": PAPER, "markeredgecolor": EGO, "markeredgewidth": 2.0}
    axes.plot(*view.place(x[:1], y[:1]).T, "o", zorder=7, label="start", **mark)
    _cross(axes, sheet, view)


def _cars(axes: Axes, sheet: Sheet, view: View) -> None:
    for box in (*_boxes(sheet), _ego(sheet)):
        if view.holds(box.x, box.y):
            _mark(axes, view, box)


def _mark(axes: Axes, view: View, box: Box) -> None:
    """Draw a car as it is if that is large enough to be seen, else as a square."""
    ((x, y),) = view.place(np.array([box.x]), np.array([box.y]))
    if box.length / view.width * LEFT_WIDTH * POINTS_PER_INCH > MARK:
        _car(axes, view, box)
        x, y = math.nan, math.nan
    style: dict[str, Any] = {"markersize": MARK, "markeredgecolor": INK, "markeredgewidth": 0.8, "zorder": 6}
    axes.plot(x, y, "s", color=box.colour, label=box.name, **style)


def _directions(axes: Axes, sheet: Sheet, view: View) -> None:
    x, y, heading = trace(sheet.ticks)
    way = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    for row in np.searchsorted(way, way[-1] * np.array(ARROWS)) if way[-1] > 2.0 * MARGIN else ():
        ((right, up),) = view.place(x[row : row + 1], y[row : row + 1])
        turn = math.degrees(heading[row] - view.heading) - 90.0
        axes.plot(right, up, marker=(3, 0, turn), markersize=13.0, color=EGO, markeredgecolor=PAPER, zorder=4)


def _cross(axes: Axes, sheet: Sheet, view: View) -> None:
    """Mark where the ego's bumper was at the first contact."""
    row = _contact(sheet.ticks)
    if row is None:
        return
    x, y, heading = (
        sheet.ticks[f"{_prefix(sheet.ticks)}{name}"][row].as_py() for name in ("x_m", "y_m", "heading_rad")
    )
    ahead = sheet.vehicle.rear_axle_to_bumper
    place = view.place(np.array([x + ahead * math.cos(heading)]), np.array([y + ahead * math.sin(heading)]))
    label = f"contact at {sheet.ticks['time_s'][row].as_py():.2f} s"
    axes.plot(*place.T, "x", color=INK, markersize=10.0, markeredgewidth=2.4, zorder=8, label=label)


def _draw_close_up(axes: Axes, sheet: Sheet, view: View) -> None:
    """Draw where the ego stood at the end, and how far from what."""
    _map(axes, sheet, view, PAPER)
    _cars(axes, sheet, view)
    _cross(axes, sheet, view)
    gap, station = float(sheet.seen.gap[-1]), sheet.ticks["station_m"][-1].as_py()
    if 0.0 < gap <= LONGEST_GAP and math.isfinite(station):
        bumper = station + sheet.vehicle.rear_axle_to_bumper
        _dimension(axes, view, sheet.path, bumper, gap, sheet.vehicle.width / 2.0 + 0.7)


def _dimension(axes: Axes, view: View, path: Path, begin: float, gap: float, aside: float) -> None:
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


def _say(axes: Axes, words: str) -> None:
    axes.set_yticks(())
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", color=QUIET)


def _curves(axes: Axes, title: str, sheet: Sheet, curves: Iterable[tuple[Floats, dict[str, Any]]], none: str) -> bool:
    """Draw values over time under a title, or say what is missing; return whether there was anything."""
    axes.set_title(title, loc="left", pad=5)
    known = [(values, style) for values, style in curves if np.isfinite(values).any()]
    for values, style in known:
        lonely = "o" if np.isfinite(values).sum() == 1 else ""
        axes.plot(sheet.ticks["time_s"].to_numpy(), values, marker=lonely, **style)
    if not known:
        _say(axes, none)
    return bool(known)


def _include(axes: Axes, low: float, high: float) -> None:
    """Widen the limits to hold at least these, so that noise around nothing looks like nothing."""
    least, greatest = axes.get_ylim()
    axes.set_ylim(min(least, low), max(greatest, high))


def _from_zero(axes: Axes, values: Floats, high: float) -> None:
    """Let the axis begin at zero unless values lie clearly below."""
    _include(axes, 0.0, high)
    if np.nanmin(values) > -AT_REST:
        axes.set_ylim(bottom=0.0)


def _speed(axes: Axes, sheet: Sheet) -> None:
    speed = sheet.ticks[f"{_prefix(sheet.ticks)}speed_mps"].to_numpy()
    title = f"{'true' if _prefix(sheet.ticks) else 'estimated'} speed [m/s]"
    if _curves(axes, title, sheet, [(speed, {"color": EGO})], "no pose"):
        _from_zero(axes, speed, 1.0)


def _gap(axes: Axes, sheet: Sheet) -> None:
    """Draw the gap; the curve breaks where nothing is ahead and where something else becomes the nearest."""
    gap = sheet.seen.gap.copy()
    changed = [other not in (one, "") for one, other in pairwise(sheet.seen.actor)]
    gap[:-1][np.array(changed, bool)] = np.nan
    if not _curves(axes, "gap to what is ahead [m]", sheet, [(gap, {"color": OBSTACLE})], "nothing ahead"):
        return
    _from_zero(axes, gap, 1.0)
    if math.isfinite(gap[-1]):
        axes.plot(sheet.ticks["time_s"][-1].as_py(), gap[-1], "o", color=OBSTACLE, markersize=5.0, clip_on=False)
        axes.set_title(f"{gap[-1]:.2f} m at the end", loc="right", pad=5)


def _acceleration(axes: Axes, sheet: Sheet) -> None:
    """Draw what the car did, wide and pale, and what it was told, thin and dark.

    Told is what the gateway granted, without the brake's hold at rest, which no car answers; in a drive that never
    engaged it is what the controller asked for.
    """
    ticks = sheet.ticks
    did = ticks[f"{_prefix(ticks)}acceleration_mps2"].to_numpy()
    told, word = ticks["acceleration_setpoint_mps2"].to_numpy(), "asked by the controller"
    if _engaged(ticks).any():
        granted, speed = ticks["granted_acceleration_mps2"].to_numpy(), ticks[f"{_prefix(ticks)}speed_mps"].to_numpy()
        held = (np.abs(speed) < AT_REST) & (granted < 0.0)
        told, word = np.where(held, np.nan, granted), "granted, hold left out"
    curves: list[tuple[Floats, dict[str, Any]]] = [
        (did, {"color": EGO_PALE, "linewidth": 3.6, "label": "car"}),
        (told, {"color": INK, "linewidth": 1.0, "label": word}),
    ]
    if _curves(axes, "acceleration [m/s²]", sheet, curves, "no pose"):
        _include(axes, -0.5, 0.5)


def _deviation(axes: Axes, sheet: Sheet) -> None:
    deviation, word = sheet.ticks["lateral_deviation_m"].to_numpy(), "true"
    if not np.isfinite(deviation).any():
        deviation, word = sheet.ticks["estimated_deviation_m"].to_numpy(), "estimated"
    title = f"{word} lateral deviation [m], left positive"
    if not _curves(axes, title, sheet, [(deviation, {"color": EGO})], "no pose on the path"):
        return
    _include(axes, -1.3 * DEVIATION_GUIDE, 1.3 * DEVIATION_GUIDE)
    if np.nanmax(np.abs(deviation)) > GUIDE_READABLE * DEVIATION_GUIDE:
        return
    for guide in (-DEVIATION_GUIDE, DEVIATION_GUIDE):
        label = f"±{DEVIATION_GUIDE:g} m" if guide > 0.0 else ""
        axes.axhline(guide, color=QUIET, linewidth=1.0, linestyle=(0, (2, 3)), label=label)


def _engaged(ticks: pa.Table) -> NDArray[np.bool_]:
    return np.array([state == ArmingState.ENGAGED.value for state in ticks["state"].to_pylist()], bool)


def _events(axes: Axes, sheet: Sheet) -> None:
    """Shade when the emergency layer braked (or asked, where nobody ever obeyed) and mark the first contact."""
    ticks, time = sheet.ticks, sheet.ticks["time_s"].to_numpy()
    engaged, asked = _engaged(ticks), ticks["emergency"].to_numpy(zero_copy_only=False)
    band, word = (asked & engaged, "emergency layer") if engaged.any() else (asked, "emergency layer asked")
    if band.any():
        across = axes.get_xaxis_transform()
        axes.fill_between(time, 0, 1, where=band, transform=across, color=ALARM, alpha=0.35, linewidth=0, label=word)
    row = _contact(ticks)
    if row is not None:
        axes.axvline(time[row], color=INK, linewidth=1.2, linestyle=(0, (1, 1.5)), label="first contact")


def _over_time(figure: Figure, sheet: Sheet) -> None:
    """Draw the column of curves over one time axis; legends stand in the titles' lines, where no curve can be."""
    panels = (_speed, _gap, _acceleration, _deviation)
    pitch = (TOP - BOTTOM + BETWEEN) / len(panels)
    time = sheet.ticks["time_s"].to_numpy()
    limits = (time[0], time[-1]) if len(time) > 1 else (time[0] - 1.0, time[0] + 1.0)
    for row, paint in enumerate(panels):
        axes = _panel(figure, RIGHT, TOP - row * pitch - (pitch - BETWEEN), RIGHT_WIDTH, pitch - BETWEEN)
        axes.spines[["top", "right"]].set_visible(False)
        axes.locator_params(axis="y", nbins=5, steps=(1, 2, 5, 10))
        axes.set_xlim(*limits)
        axes.grid(alpha=0.35, linewidth=0.6)
        paint(axes, sheet)
        _events(axes, sheet)
        axes.tick_params(labelbottom=row == len(panels) - 1)
        _legend_above(axes, events=paint is _speed)
    axes.set_xlabel("drive time [s]", labelpad=2)


def _legend_above(axes: Axes, events: bool) -> None:
    """Explain the curves of a panel, and in one panel also the events that all of them show."""
    shared = ("emergency layer", "emergency layer asked", "first contact")
    entries = [(mark, name) for mark, name in zip(*axes.get_legend_handles_labels(), strict=True)]
    entries = [(mark, name) for mark, name in entries if (name in shared) == events]
    if entries:
        marks, names = zip(*entries, strict=True)
        place: dict[str, Any] = {
            "loc": "lower right",
            "bbox_to_anchor": (1.0, 1.0),
            "borderpad": 0.0,
            "borderaxespad": 0.2,
        }
        axes.legend(
            list(marks), list(names), ncols=len(names), handlelength=1.4, columnspacing=1.0, handletextpad=0.5, **place
        )


def _panel(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    return figure.add_axes((left / SIZE[0], bottom / SIZE[1], width / SIZE[0], height / SIZE[1]))


def _from_above(figure: Figure, sheet: Sheet) -> None:
    """Draw the two windows on the street; their heights follow from the shape of the trace."""
    if len(trace(sheet.ticks)[0]) == 0:
        axes = _panel(figure, LEFT, BOTTOM, LEFT_WIDTH, TOP - BOTTOM)
        axes.set_xticks(())
        _say(axes, "no pose, no place on the street")
        return
    view = _overview(sheet.ticks)
    height = LEFT_WIDTH * view.height / view.width
    whole = _panel(figure, LEFT, TOP - height, LEFT_WIDTH, height)
    _draw_overview(whole, sheet, view)
    whole.set_title("the street from above", loc="left", pad=5)
    close = _panel(figure, LEFT, BOTTOM, LEFT_WIDTH, TOP - BOTTOM - BETWEEN - height)
    bumper = sheet.vehicle.rear_axle_to_bumper
    _draw_close_up(close, sheet, _close_up(sheet.ticks, bumper, float(sheet.seen.gap[-1]), _left_over(view)))
    close.set_title("where it ended, driving to the right", loc="left", pad=5)
    named = {
        name: mark for axes in (close, whole) for mark, name in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    close.legend([*named.values()], [*named], loc="upper left", bbox_to_anchor=(0.0, -0.01), ncols=4, borderaxespad=0.2)


def draw(sheet: Sheet, file: FilePath) -> None:
    """Write the picture of a drive of at least one tick as a PNG file."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH)
        FigureCanvasAgg(figure)
        _from_above(figure, sheet)
        _over_time(figure, sheet)
        title = textwrap.shorten(sheet.title, 110, placeholder=" …")
        figure.text(LEFT / SIZE[0], 0.955, title, fontsize=14, fontweight="bold")
        figure.text(LEFT / SIZE[0], 0.92, sheet.subtitle, fontsize=12)
        figure.savefig(file)
