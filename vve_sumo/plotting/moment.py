"""Draws the moment of a drive that matters: both bodies, their speeds, what they did next, what was measured of them.

The window is given; it must not know how the moment was chosen, the curves over time, SUMO, or how the drive was run.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vve_sumo.geometry import Box, Boxes, distance, vehicle_boxes
from vve_sumo.metrics.moment import Moment, MomentMeasure
from vve_sumo.plotting.birds_eye import MapWindow, draw_car, draw_map, rotated
from vve_sumo.plotting.page import (
    ACTOR,
    CLOUD,
    EGO,
    INK,
    LEFT_WIDTH,
    MANY_POINTS,
    OBSTACLE,
    PAPER,
    QUIET,
    SENSED,
    DrivePage,
    halo,
    plain_name,
    prefix,
)
from vve_sumo.plotting.placing import NO_POINTS, Rectangle, around, centred, freest
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
#: an actor that is farther away when the drive ended is not said to be near [m]
NEAR_AT_THE_END: Final = 25.0
#: diameter of the dots at 1, 2 and 3 s [inch]
DOT: Final = 0.1


@dataclass(frozen=True, slots=True)
class ActorTrack:
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


def ego_track(page: DrivePage) -> ActorTrack:
    """Return where the ego's body was."""
    names = (f"{prefix(page.ticks)}{name}" for name in ("x_m", "y_m", "heading_rad", "speed_mps"))
    x, y, heading, speed = (page.ticks[name].to_numpy() for name in names)
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(heading)
    x, y, heading, speed = x[known], y[known], heading[known], speed[known]
    boxes = vehicle_boxes(x, y, heading, speed, page.vehicle)
    time = page.ticks["time_s"].to_numpy()[known]
    return ActorTrack(time, boxes[0], boxes[1], heading, speed, page.vehicle.length, page.vehicle.width, math.nan)


def tracks(page: DrivePage) -> dict[str, ActorTrack]:
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
            found[name] = ActorTrack(times[at[rows]], x, y, heading, speed, *sizes)
    return found


def what_it_is(track: ActorTrack, ego: ActorTrack, time: float) -> str:
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


def called(page: DrivePage, actor: str, track: ActorTrack, ego: ActorTrack, time: float) -> str:
    """Return what an actor is called in the picture: its name where it has one, else what it is at a drive time [s].

    The actor that mattered is called what it was at the moment, in whatever part of the picture it stands.
    """
    when = page.moment.time if page.moment and actor == page.main else time
    return page.name_of(actor) or what_it_is(track, ego, when)


def _explained(page: DrivePage, actor: str, track: ActorTrack, ego: ActorTrack, time: float) -> str:
    """Return what the legend says of an actor: what it is called, and what it is where its name does not say that."""
    word, kind = called(page, actor, track, ego, time), what_it_is(track, ego, time)
    return word if kind in word or word in kind else f"{word} ({kind})"


def title_of(page: DrivePage, moment: Moment) -> str:
    """Return when the moment was and what makes it the one that matters."""
    track = tracks(page).get(moment.actor)
    word = called(page, moment.actor, track, ego_track(page), moment.time) if track else "actor"
    return {
        MomentMeasure.CONTACT: f"contact at {moment.time:.2f} s, with {word}",
        MomentMeasure.TIME_TO_COLLISION: (
            f"least time to collision (TTC) {moment.value:.2f} s at {moment.time:.2f} s: {word}"
        ),
        MomentMeasure.GAP: f"closest at {moment.time:.2f} s: gap {moment.value:.2f} m, {word}",
        MomentMeasure.DISTANCE: f"no conflict; nearest at {moment.time:.2f} s: {word}",
    }[moment.measure]


def nearest_at_the_end(page: DrivePage) -> str:
    """Return in words who was nearest when the drive ended, and how far; empty where nobody was near."""
    ego = ego_track(page)
    end = float(page.ticks["time_s"][-1].as_py())
    if not len(ego.time):
        return ""
    own, found = ego.box(end), []
    for name, track in tracks(page).items():
        if abs(track.time[-1] - end) <= 0.03:
            box = track.box(end)
            pair = (Boxes(*(np.array([value]) for value in (*astuple(one), 0.0))) for one in (own, box))
            found.append((float(distance(*pair)[0]), called(page, name, track, ego, end)))
    away, word = min(found, default=(math.inf, ""))
    return f"; nearest at the end: {word}, {away:.1f} m" if away <= NEAR_AT_THE_END else ""


def moment_view(page: DrivePage, moment: Moment, shape: float) -> MapWindow:
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
    return MapWindow(box.x + float(x), box.y + float(y), box.heading, width, shape * width)


def draw_moment(axes: Axes, page: DrivePage, moment: Moment, view: MapWindow) -> None:
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
            kind = _explained(page, name, track, ego, moment.time) if beside else "other traffic"
            _body(axes, view, track.box(moment.time), page.colour_of(name), kind, _hatched(page, name))
    if other is not None:
        word = _explained(page, moment.actor, other, ego, moment.time)
        _next(axes, view, other, moment.time, OBSTACLE)
        _body(axes, view, other.box(moment.time), OBSTACLE, word, _hatched(page, moment.actor))
    _next(axes, view, ego, moment.time, EGO)
    _body(axes, view, ego.box(moment.time), EGO, page.ego, "")
    _sensed(axes, page, view)
    _labels(axes, page, moment, view, ego, others)


def _body(axes: Axes, view: MapWindow, box: Box, colour: str, name: str, hatched: str) -> None:
    draw_car(axes, view, box, colour)
    if hatched:
        placed = view.place(*np.array(box.corners()).T)
        style: dict[str, Any] = {"facecolor": "none", "edgecolor": INK, "linewidth": 0.8, "hatch": "xxxx"}
        shown = hatched if view.holds(box.x, box.y) else "_"
        axes.fill(*placed.T, **style, zorder=7, label=shown)
    label = name if view.holds(box.x, box.y) else "_"
    axes.plot(math.nan, math.nan, "s", color=colour, markeredgecolor=INK, markersize=7.0, label=label)


def _hatched(page: DrivePage, actor: str) -> str:
    """Return what the hatches over an actor mean; empty where it has none."""
    if actor not in page.unseen:
        return ""
    return f"not seen by {plain_name(page.watching[0]) if len(page.watching) == 1 else 'any sensor'}"


def _sensed(axes: Axes, page: DrivePage, view: MapWindow) -> None:
    """Draw what each sensor measured nearest to the moment: points, rays to points, or boxes."""
    for number, (sensor, shape, placed) in enumerate(page.sensed):
        marker, colour = SENSED[number % len(SENSED)]
        shown = any(view.holds(x, y) for x, y in zip(placed.x.tolist(), placed.y.tolist(), strict=True))
        label = f"sensor {plain_name(sensor)}" if shown else "_"
        points = view.place(placed.x, placed.y)
        if shape == "boxes":
            for corners in placed.corners():
                edge: dict[str, Any] = {"facecolor": "none", "edgecolor": colour, "linewidth": 1.8, "zorder": 8}
                axes.fill(*view.place(*corners.T).T, **edge, path_effects=halo(), label=label)
                label = "_"
            continue
        if shape == "rays":
            origins = view.place(placed.origin_x, placed.origin_y)
            ends = np.stack((origins, points, np.full_like(points, np.nan)), axis=1).reshape(-1, 2)
            axes.plot(*ends.T, color=colour, linewidth=0.8, zorder=7.5)
        if len(points) > MANY_POINTS:
            # A cloud: marks would cover what they lie on. The legend shows one as large as any other.
            axes.plot(*points.T, ".", markersize=1.5, color=CLOUD, zorder=6.5)
            axes.plot(math.nan, math.nan, ".", markersize=6.0, color=CLOUD, label=label)
            continue
        style: dict[str, Any] = {"markersize": 6.0, "markerfacecolor": colour, "markeredgecolor": INK}
        axes.plot(*points.T, marker, **style, markeredgewidth=0.8, zorder=8.5, label=label)


def _next(axes: Axes, view: MapWindow, track: ActorTrack, time: float, colour: str) -> None:
    """Draw where a body's middle goes in the next seconds, with a dot for each second, and where it came from."""
    came = view.place(*track.during(time - BEFORE, time))
    axes.plot(*came.T, color=colour, linewidth=1.2, linestyle=(0, (1, 1)), zorder=5)
    goes = view.place(*track.during(time, time + AFTER))
    if len(goes) > 1 and np.hypot(*np.ptp(goes, axis=0)) > 0.5:
        axes.plot(*goes.T, color=colour, linewidth=2.4, zorder=5)
        mark: dict[str, Any] = {"markersize": 5.5, "markerfacecolor": PAPER, "markeredgecolor": colour}
        dots = view.place(*track.at_seconds(time))
        axes.plot(
            *dots.T, "o", **mark, markeredgewidth=1.5, zorder=8, path_effects=halo(), label="middle 1, 2, 3 s later"
        )


def _labels(
    axes: Axes, page: DrivePage, moment: Moment, view: MapWindow, ego: ActorTrack, others: dict[str, ActorTrack]
) -> None:
    """Write the speeds beside the bodies, where they hide neither a body nor where one goes next."""
    time, inch = moment.time, view.width / LEFT_WIDTH
    shown = [ego, *(track for track in others.values() if np.abs(track.time - time).min() <= 0.03)]
    bodies = [around(view.place(*np.array(track.box(time).corners()).T)) for track in shown]
    dots = [ego, *(track for name, track in others.items() if name == moment.actor)]
    points = np.vstack([view.place(*track.at_seconds(time)) for track in dots])
    taken = [*bodies, *(centred(x, y, DOT * inch, DOT * inch) for x, y in points.tolist())]
    named = [(ego, page.ego, EGO)]
    if (other := others.get(moment.actor)) is not None:
        named.insert(0, (other, called(page, moment.actor, other, ego, time), OBSTACLE))
    for track, word, colour in named:
        words = f"{word} {track.speed[track.row(time)]:.1f} m/s"
        size = LETTER * len(words) * inch, (LINE + 0.04) * inch
        body = around(view.place(*np.array(track.box(time).corners()).T))
        places = _places(body, size, view, above=other is None or track is not ego or body.low > bodies[0].high)
        place = places[freest(places, taken, NO_POINTS)[0]]
        taken.append(place)
        style: dict[str, Any] = {"ha": "center", "va": "center", "color": INK, "zorder": 9}
        frame = {"facecolor": PAPER, "edgecolor": colour, "linewidth": 0.8, "pad": 1.5, "alpha": 0.9}
        x, y = (place.left + place.right) / 2.0, (place.low + place.high) / 2.0
        axes.text(x, y, words, fontsize=11, fontweight="bold", bbox=frame, **style)


def _places(body: Rectangle, size: tuple[float, float], view: MapWindow, above: bool) -> list[Rectangle]:
    """Return where words of a size [m] may stand around a body in a window, the best first, all inside the window."""
    (wide, tall), apart = size, 0.06 * view.width / LEFT_WIDTH
    x, y = (body.left + body.right) / 2.0, (body.low + body.high) / 2.0
    sides = (1.0, -1.0) if above else (-1.0, 1.0)
    aside, over = (body.right - body.left + wide) / 2.0 + apart, (body.high - body.low + tall) / 2.0 + apart
    beside = [(x, y + side * (over + more * tall)) for more in (0.0, 1.2, 2.4) for side in sides]
    beside += [(x + turn * 0.5 * wide, y + side * over) for side in sides for turn in (-1.0, 1.0)]
    beside += [(x - aside, y), (x + aside, y)]
    right, up = (view.width - wide) / 2.0 - apart, (view.height - tall) / 2.0 - apart
    held = [(min(max(one, -right), right), min(max(other, -up), up)) for one, other in beside]
    return [centred(*place, wide, tall) for place in held]
