"""Draws where the actors that came near went, with drive times along their traces and the ego's.

The window is given; it must not know the moment that matters, the curves over time, SUMO, or how the drive was run.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vve_sumo.plotting.birds_eye import MapWindow, cars_at_the_end
from vve_sumo.plotting.moment import ActorTrack, ego_track, tracks
from vve_sumo.plotting.page import ACTOR, EGO, LEFT_WIDTH, OBSTACLE, PAPER, QUIET, DrivePage, halo
from vve_sumo.plotting.placing import Rectangle, around, centred, freest

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: an actor that came within this distance of the ego is traced, from when it first is within the second one [m]
NEAR, TRACE_SHOWN = 25.0, 80.0
#: one that went less far stood [m]; one that went less than the second distance needs no drive times
STOOD, SHORT = 1.0, 5.0
#: between two dates on the page [inch]; and steps that dates may have [s]
BETWEEN_DATES, STEPS = 0.55, (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0)
#: height of a date, width of one of its letters, diameter of its dot [inch]
LINE, LETTER, DOT = 0.13, 0.075, 0.05
#: a record whose ticks lie farther from a date does not hold it [s]
TICK: Final = 0.03


def draw_dated_traces(axes: Axes, page: DrivePage, view: MapWindow) -> None:
    """Draw the traces of the actors that came near, with the drive time along them and along the ego's.

    The marks of the ego and of the actor that mattered bear the same times, so that the reader sees where both were.
    """
    ego, others = ego_track(page), tracks(page)
    if not len(ego.time):
        return
    for name, track in others.items():
        rows = np.searchsorted(ego.time, track.time).clip(0, len(ego.time) - 1)
        near = np.hypot(track.x - ego.x[rows], track.y - ego.y[rows])
        if (near.min() <= NEAR or name in (page.main, page.second)) and _way(track) > STOOD:
            shown = np.maximum.accumulate(near <= TRACE_SHOWN)  # to the end, where its body is drawn
            placed = view.place(np.where(shown, track.x, np.nan), np.where(shown, track.y, np.nan))
            colours = {page.main: (OBSTACLE, 1.8, "_"), page.second: (ACTOR, 1.8, page.name_of(name))}
            colour, wide, label = colours.get(name, (QUIET, 0.9, "tracks of others"))
            axes.plot(*placed.T, color=colour, linewidth=wide, zorder=4, label=label)
    _dates(axes, page, view, ego, others)


def _way(track: ActorTrack) -> float:
    """Return how far an actor came at most, in map directions [m]."""
    return float(np.hypot(np.ptp(track.x), np.ptp(track.y)))


def _dates(axes: Axes, page: DrivePage, view: MapWindow, ego: ActorTrack, others: dict[str, ActorTrack]) -> None:
    """Write drive times along the ego's trace, and the same ones along those of the two actors that have a colour.

    A date that would hide a body, a pointer or another date is left out.
    """
    cars = cars_at_the_end(page, view)
    bodies = [around(car.place(view)) for car in cars]
    bodies += [place for car in cars if (place := car.pointer(view)) is not None]
    written: list[Rectangle] = []
    chosen = [
        (track, colour, below)
        for track, colour, below in (
            (others.get(page.main), OBSTACLE, False),
            (others.get(page.second), ACTOR, False),
            (ego, EGO, True),
        )
        if track is not None and _way(track) >= SHORT
    ]
    ways = np.vstack([view.place(track.x, track.y) for track, _colour, _below in chosen] or [np.zeros((0, 2))])
    step = _step(ego, view)
    for track, colour, below in chosen:
        for time in np.arange(math.ceil(track.time[0] / step) * step, track.time[-1], step).tolist():
            if np.abs(track.time - time).min() <= TICK:
                _date(axes, view, (track, time, colour, below), bodies, written, ways)


def _step(ego: ActorTrack, view: MapWindow) -> float:
    """Return the time between two dates [s] that leaves room for them along the ego's trace."""
    way = float(np.hypot(np.diff(ego.x), np.diff(ego.y)).sum())
    duration = float(ego.time[-1] - ego.time[0])
    fitting = way / view.width * LEFT_WIDTH / BETWEEN_DATES
    return next((step for step in STEPS if duration / step <= max(fitting, 1.0)), STEPS[-1])


def _date(
    axes: Axes,
    view: MapWindow,
    date: tuple[ActorTrack, float, str, bool],
    bodies: list[Rectangle],
    written: list[Rectangle],
    ways: Any,
) -> None:
    """Mark a drive time on a trace, and write it on that side where it hides nothing, and no trace if that can be."""
    track, time, colour, below = date
    row, inch = track.row(time), view.width / LEFT_WIDTH
    if not view.holds(float(track.x[row]), float(track.y[row])):
        return
    ((right, up),) = view.place(track.x[row : row + 1], track.y[row : row + 1]).tolist()
    if any(centred(right, up, DOT * inch, DOT * inch).overlap(body) for body in bodies):
        return
    axes.plot(right, up, "o", color=colour, markersize=3.5, markeredgecolor=PAPER, zorder=6)
    words = f"{time:g} s"
    asides = [_beside(float(track.heading[row]) - view.heading, side, inch) for side in (below, not below)]
    size = LETTER * len(words) * inch, LINE * inch
    places = [centred(right + aside, up + over, *size) for aside, over in asides]
    places = [one for one in places if max(-one.left, one.right) < 0.5 * view.width]
    places = [one for one in places if max(-one.low, one.high) < 0.5 * view.height]
    best, covered = freest(places, bodies, ways) if places else (0, math.inf)
    if covered > 0.0 or any(places[best].overlap(other) for other in written):
        return
    left, low, right, high = places[best]
    apart = 0.1 * inch  # else two dates side by side would read as one number
    written.append(Rectangle(left - apart, low, right + apart, high))
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8.5, "zorder": 7, "path_effects": halo()}
    axes.text((left + right) / 2.0, (low + high) / 2.0, words, color=colour, **style)


def _beside(heading: float, below: bool, inch: float) -> tuple[float, float]:
    """Return from a trace of a heading [rad] to its date [m]: below or left of it, or not; `inch` of the page [m]."""
    right, up = -math.sin(heading), math.cos(heading)
    side = -1.0 if (up > 0.0 if abs(up) > 0.3 else right > 0.0) == below else 1.0
    return side * 0.24 * right * inch, side * 0.14 * up * inch
