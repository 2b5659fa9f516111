"""Draws the moment of a drive that matters: both bodies, their speeds, what they did next, and what the radar missed.

The window is given; it must not know how the moment was chosen, the curves over time, SUMO, or how the drive was run.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vve_sumo.geometry import Box, Boxes, distance, vehicle_boxes
from vve_sumo.metrics.moment import Measure, Moment
from vve_sumo.plotting.birds_eye import View, draw_car, draw_map, rotated
from vve_sumo.plotting.page import ACTOR, EGO, INK, LEFT_WIDTH, OBSTACLE, PAPER, QUIET, DrivePage, halo, prefix
from vve_sumo.values import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: driven time that the window shows after and before the moment [s]
AFTER, BEFORE = 3.0, 2.0
#: street around what the window shows, and its least and greatest width [m]
MARGIN, NARROWEST, WIDEST = 5.0, 34.0, 110.0
#: height of a line of text and width of one of its letters [inch]
LINE, LETTER = 0.2, 0.088
#: an actor slower than this stands [m/s]
STANDING: Final = 0.2
#: an actor that was faster than this at any time has stopped, and did not stand all the time [m/s]
MOVED: Final = 1.0
#: radar cross sections that the record gives to people and two-wheelers [m2], with their names
SMALL: Final = ((0.3, "child"), (0.6, "pedestrian"), (1.5, "scooter"), (2.5, "bicyclist"), (6.0, "two-wheeler"))
#: a vehicle is at least so wide [m]; a narrower body is told by its radar cross section
NARROWEST_VEHICLE: Final = 1.3


@dataclass(frozen=True, slots=True)
class Track:
    """Where an actor was, tick by tick."""

    time: Floats  #: drive time [s]
    x: Floats  #: centre, map [m]
    y: Floats  #: centre, map [m]
    heading: Floats  #: [rad]
    speed: Floats  #: [m/s]
    length: float  #: [m]
    width: float  #: [m]
    section: float  #: radar cross section [m2]

    def row(self, time: float) -> int:
        """Return the row that is nearest to a drive time [s]."""
        return int(np.argmin(np.abs(self.time - time)))

    def box(self, time: float) -> Box:
        """Return the body at a drive time [s]."""
        row = self.row(time)
        return Box(float(self.x[row]), float(self.y[row]), float(self.heading[row]), self.length, self.width)

    def during(self, begin: float, end: float) -> tuple[Floats, Floats]:
        """Return x and y [m] between two drive times [s]."""
        rows = (self.time >= begin) & (self.time <= end)
        return self.x[rows], self.y[rows]

    def at_seconds(self, time: float) -> tuple[Floats, Floats]:
        """Return x and y [m] at whole seconds after a drive time [s], up to AFTER, as far as the drive goes."""
        steps = [time + second for second in range(1, round(AFTER) + 1) if time + second <= self.time[-1] + 0.02]
        rows = [self.row(step) for step in steps]
        return self.x[rows], self.y[rows]


def ego_track(page: DrivePage) -> Track:
    """Return where the ego's body was."""
    names = (f"{prefix(page.ticks)}{name}" for name in ("x_m", "y_m", "heading_rad", "speed_mps"))
    x, y, heading, speed = (page.ticks[name].to_numpy() for name in names)
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(heading)
    x, y, heading, speed = x[known], y[known], heading[known], speed[known]
    boxes = vehicle_boxes(x, y, heading, speed, page.vehicle)
    time = page.ticks["time_s"].to_numpy()[known]
    return Track(time, boxes[0], boxes[1], heading, speed, page.vehicle.length, page.vehicle.width, math.nan)


def tracks(page: DrivePage) -> dict[str, Track]:
    """Return where every actor was, by its name, at the ticks of the record."""
    ticks, times = page.ticks["tick"].to_numpy(), page.ticks["time_s"].to_numpy()
    number = page.actors["tick"].to_numpy()
    at = np.minimum(np.searchsorted(ticks, number), len(ticks) - 1)
    known = ticks[at] == number
    names = page.actors["actor"].combine_chunks().dictionary_encode()
    codes = names.indices.to_numpy()
    columns = ("x_m", "y_m", "heading_rad", "speed_mps", "length_m", "width_m", "radar_cross_section_m2")
    values = [page.actors[name].to_numpy() for name in columns]
    found = {}
    for code, name in enumerate(names.dictionary.to_pylist()):
        rows = np.flatnonzero(known & (codes == code))
        if len(rows):
            x, y, heading, speed, length, width, section = (column[rows] for column in values)
            sizes = (float(length[0]), float(width[0]), float(section[0]))
            found[name] = Track(times[at[rows]], x, y, heading, speed, *sizes)
    return found


def what_it_is(track: Track, ego: Track, time: float) -> str:
    """Return in words what an actor is at a drive time, as the ego's driver would say it."""
    row, own = track.row(time), ego.row(time)
    standing = track.speed[row] < STANDING
    if track.width < NARROWEST_VEHICLE:
        small = next((word for most, word in SMALL if track.section < most), "two-wheeler")
        return f"standing {small}" if standing else small
    turn = abs(math.remainder(float(track.heading[row] - ego.heading[own]), math.tau))
    away = np.array([track.x[row] - ego.x[own]]), np.array([track.y[row] - ego.y[own]])
    ((ahead, aside),) = rotated(*away, -float(ego.heading[own]))
    beside = abs(aside) > (track.width + ego.width) / 2.0
    if standing:
        return "stopped vehicle" if track.speed.max() > MOVED else "standing vehicle"
    if turn > math.radians(135.0):
        return "oncoming vehicle"
    if turn > math.radians(35.0):
        return "crossing vehicle"
    if ahead < -ego.length / 2.0:
        return "vehicle behind"
    return "vehicle beside" if beside else "vehicle ahead"


def title_of(page: DrivePage, moment: Moment) -> str:
    """Return when the moment was and what makes it the one that matters."""
    track = tracks(page).get(moment.actor)
    word = what_it_is(track, ego_track(page), moment.time) if track else "actor"
    return {
        Measure.CONTACT: f"contact at {moment.time:.2f} s, with {word}",
        Measure.TIME_TO_COLLISION: f"least time to collision (TTC) {moment.value:.2f} s at {moment.time:.2f} s: {word}",
        Measure.GAP: f"closest at {moment.time:.2f} s: gap {moment.value:.2f} m, {word}",
        Measure.DISTANCE: f"no conflict; nearest at {moment.time:.2f} s: {word}",
    }[moment.measure]


def nearest_at_the_end(page: DrivePage) -> str:
    """Return in words who was nearest when the drive ended, and how far; empty where nobody was within NEAR."""
    ego = ego_track(page)
    end = float(page.ticks["time_s"][-1].as_py())
    if not len(ego.time):
        return ""
    own, found = ego.box(end), []
    for track in tracks(page).values():
        if abs(track.time[-1] - end) <= 0.03:
            box = track.box(end)
            pair = (Boxes(*(np.array([value]) for value in (*astuple(one), 0.0))) for one in (own, box))
            found.append((float(distance(*pair)[0]), what_it_is(track, ego, end)))
    away, word = min(found, default=(math.inf, ""))
    return f"; nearest at the end: {word}, {away:.1f} m" if away <= NEAR else ""


def moment_view(page: DrivePage, moment: Moment, shape: float) -> View:
    """Return the window that holds both bodies and what they did next; the ego drives to the right.

    `shape` is the window's height over its width.
    """
    ego, other = ego_track(page), tracks(page).get(moment.actor)
    box = ego.box(moment.time)
    points = [np.array(box.corners())]
    for track in (ego, other) if other is not None else (ego,):
        points.append(np.array(track.box(moment.time).corners()))
        points.append(np.column_stack(track.during(moment.time, moment.time + AFTER)))
    placed = np.vstack([rotated(part[:, 0] - box.x, part[:, 1] - box.y, -box.heading) for part in points])
    bodies = np.vstack(points[:2] if other is None else [points[0], points[3]])
    held = rotated(bodies[:, 0] - box.x, bodies[:, 1] - box.y, -box.heading)
    placed = np.clip(placed, held.min(axis=0) - 0.4 * WIDEST, held.max(axis=0) + 0.4 * WIDEST)
    least, greatest = placed.min(axis=0) - MARGIN, placed.max(axis=0) + MARGIN
    width = float(max(greatest[0] - least[0], (greatest[1] - least[1]) / shape, NARROWEST))
    width = min(width, max(WIDEST, float(np.ptp(held[:, 0])) + 2.0 * MARGIN))
    middle = (least + greatest)[None] / 2.0
    ((x, y),) = rotated(middle[:, 0], middle[:, 1], box.heading)
    return View(box.x + float(x), box.y + float(y), box.heading, width, shape * width)


def draw_moment(axes: Axes, page: DrivePage, moment: Moment, view: View) -> None:
    """Draw the window at the moment; the legend's names say what each actor is."""
    draw_map(axes, page, view, PAPER, end=moment.row)
    ego, others = ego_track(page), tracks(page)
    other = others.get(moment.actor)
    for name, track in others.items():
        if np.abs(track.time - moment.time).min() <= 0.03 and name != moment.actor:
            way = view.place(*track.during(moment.time - BEFORE, moment.time + AFTER))
            colour = ACTOR if name == page.second else QUIET
            axes.plot(*way.T, color=colour, linewidth=1.0, linestyle=(0, (1, 1)), zorder=4)
            beside = name == page.second
            kind = what_it_is(track, ego, moment.time) if beside else "other traffic"
            _body(axes, view, track.box(moment.time), page.colour_of(name), kind, name in page.unseen)
    if other is not None:
        word = what_it_is(other, ego, moment.time)
        _next(axes, view, other, moment.time, OBSTACLE, word)
        _body(axes, view, other.box(moment.time), OBSTACLE, word, moment.actor in page.unseen)
    _next(axes, view, ego, moment.time, EGO, "ego")
    _body(axes, view, ego.box(moment.time), EGO, "ego", False)
    _labels(axes, page, moment, view, ego, other)


def _body(axes: Axes, view: View, box: Box, colour: str, name: str, unseen: bool) -> None:
    draw_car(axes, view, box, colour)
    if unseen:
        placed = view.place(*np.array(box.corners()).T)
        style: dict[str, Any] = {"facecolor": "none", "edgecolor": INK, "linewidth": 0.8, "hatch": "xxxx"}
        shown = "not seen by the radar" if view.holds(box.x, box.y) else "_"
        axes.fill(*placed.T, **style, zorder=7, label=shown)
    label = name if view.holds(box.x, box.y) else "_"
    axes.plot(math.nan, math.nan, "s", color=colour, markeredgecolor=INK, markersize=7.0, label=label)


def _next(axes: Axes, view: View, track: Track, time: float, colour: str, name: str) -> None:
    """Draw where a body goes in the next seconds, with a dot for each second, and where it came from."""
    came = view.place(*track.during(time - BEFORE, time))
    axes.plot(*came.T, color=colour, linewidth=1.2, linestyle=(0, (1, 1)), zorder=5)
    goes = view.place(*track.during(time, time + AFTER))
    if len(goes) > 1 and np.hypot(*np.ptp(goes, axis=0)) > 0.5:
        axes.plot(*goes.T, color=colour, linewidth=2.4, zorder=5)
        mark: dict[str, Any] = {"markersize": 5.5, "markerfacecolor": PAPER, "markeredgecolor": colour}
        dots = view.place(*track.at_seconds(time))
        axes.plot(*dots.T, "o", **mark, markeredgewidth=1.5, zorder=8, path_effects=halo(), label="1, 2, 3 s later")


def _labels(axes: Axes, page: DrivePage, moment: Moment, view: View, ego: Track, other: Track | None) -> None:
    """Write the speeds beside the bodies, one above its body and one below, inside the window."""
    named = [(ego, f"ego {ego.speed[ego.row(moment.time)]:.1f} m/s", EGO)]
    if other is not None:
        word = what_it_is(other, ego, moment.time)
        named.append((other, f"{word} {other.speed[other.row(moment.time)]:.1f} m/s", OBSTACLE))
    places = [view.place(*np.array(track.box(moment.time).corners()).T) for track, _words, _colour in named]
    highest = int(np.argmax([place[:, 1].mean() for place in places[::-1]])) if len(places) > 1 else 0
    metre = view.width / LEFT_WIDTH
    for number, ((_track, words, colour), place) in enumerate(zip(named, places, strict=True)):
        above = len(places) == 1 or number == len(places) - 1 - highest
        half = 0.5 * LETTER * len(words) * metre
        x = float(np.clip(place[:, 0].mean(), -view.width / 2.0 + half, view.width / 2.0 - half))
        room = view.height / 2.0 - LINE * metre
        y = place[:, 1].max() + 0.12 * metre if above else place[:, 1].min() - 0.12 * metre
        y = float(np.clip(y, -room, room))
        style: dict[str, Any] = {"ha": "center", "va": "bottom" if above else "top", "color": INK, "zorder": 9}
        frame = {"facecolor": PAPER, "edgecolor": colour, "linewidth": 0.8, "pad": 1.5, "alpha": 0.9}
        axes.text(x, y, words, fontsize=11, fontweight="bold", bbox=frame, **style)


def draw_dated_traces(axes: Axes, page: DrivePage, view: View) -> None:
    """Draw the traces of the actors that came near, with the drive time along them and along the ego's.

    The marks of the ego and of the actor that mattered bear the same times, so that the reader sees where both were.
    """
    ego, others = ego_track(page), tracks(page)
    if not len(ego.time):
        return
    main = page.moment.actor if page.moment else ""
    for name, track in others.items():
        rows = np.searchsorted(ego.time, track.time).clip(0, len(ego.time) - 1)
        near = np.hypot(track.x - ego.x[rows], track.y - ego.y[rows])
        if (near.min() <= NEAR or name in (main, page.second)) and np.hypot(np.ptp(track.x), np.ptp(track.y)) > 1.0:
            shown = near <= TRACE_SHOWN
            placed = view.place(np.where(shown, track.x, np.nan), np.where(shown, track.y, np.nan))
            colour, wide = (OBSTACLE, 1.8) if name == main else (ACTOR, 1.8) if name == page.second else (QUIET, 0.9)
            label = "tracks of others" if colour == QUIET else page.second.replace("_", " ") if colour == ACTOR else "_"
            axes.plot(*placed.T, color=colour, linewidth=wide, zorder=4, label=label)
    _dates(axes, view, ego, others.get(main), others.get(page.second))


#: an actor that came within this distance of the ego is traced, while within the second distance [m]
NEAR, TRACE_SHOWN = 25.0, 80.0
#: between two dates on the page [inch]; and steps that dates may have [s]
BETWEEN_DATES, STEPS = 0.55, (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0)


def _dates(axes: Axes, view: View, ego: Track, main: Track | None, second: Track | None) -> None:
    """Write drive times along the ego's trace, and the same ones along the main actor's where it moves."""
    way = float(np.hypot(np.diff(ego.x), np.diff(ego.y)).sum())
    duration = float(ego.time[-1] - ego.time[0])
    fitting = way / view.width * LEFT_WIDTH / BETWEEN_DATES
    step = next((step for step in STEPS if duration / step <= max(fitting, 1.0)), STEPS[-1])
    written: list[tuple[float, float]] = []
    for track, colour, below in ((main, OBSTACLE, False), (second, ACTOR, False), (ego, EGO, True)):
        if track is None or np.hypot(np.ptp(track.x), np.ptp(track.y)) < MARGIN:
            continue
        for time in np.arange(math.ceil(track.time[0] / step) * step, track.time[-1], step):
            if np.abs(track.time - time).min() > 0.03 or not view.holds(*_at(track, float(time))):
                continue
            x, y = _at(track, float(time))
            ((right, up),) = view.place(np.array([x]), np.array([y]))
            axes.plot(right, up, "o", color=colour, markersize=3.5, markeredgecolor=PAPER, zorder=6)
            aside, over = _beside(float(track.heading[track.row(float(time))]) - view.heading, below, view.width)
            x, y = float(right) + aside, float(up) + over
            apart = [math.hypot(x - a, 2.5 * (y - b)) / view.width * LEFT_WIDTH for a, b in written]
            inside = abs(x) < 0.47 * view.width and abs(y) < 0.5 * view.height - 0.1 * view.width / LEFT_WIDTH
            if inside and min(apart, default=math.inf) > BETWEEN_DATES * 0.8:
                written.append((x, y))
                style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8.5, "zorder": 7}
                axes.text(x, y, f"{time:g} s", color=colour, path_effects=halo(), **style)


def _beside(heading: float, below: bool, width: float) -> tuple[float, float]:
    """Return from a trace of a heading [rad] to its date, in a window of a width [m]: below or left of it, or not."""
    right, up = -math.sin(heading), math.cos(heading)
    side = -1.0 if (up > 0.0 if abs(up) > 0.3 else right > 0.0) == below else 1.0
    return side * 0.24 * right * width / LEFT_WIDTH, side * 0.14 * up * width / LEFT_WIDTH


def _at(track: Track, time: float) -> tuple[float, float]:
    row = track.row(time)
    return float(track.x[row]), float(track.y[row])
