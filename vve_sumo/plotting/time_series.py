"""Draws the drive over time: speed, gap, acceleration and deviation, one panel each, with their legends.

Knows the page; it must not know the virtual road from above, SUMO, or how the drive was run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vve_sumo.metrics.stopping import AT_REST
from vve_sumo.metrics.table import axis_of
from vve_sumo.plotting.page import (
    ALARM,
    BETWEEN,
    BOTTOM,
    EGO,
    EGO_PALE,
    INK,
    OBSTACLE,
    PAPER,
    POINTS_PER_INCH,
    QUIET,
    RIGHT,
    RIGHT_WIDTH,
    TOP,
    DrivePage,
    contact,
    halo,
    panel,
    plain_name,
    prefix,
    say,
)
from vve_sumo.values import ArmingState, Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: the deviation's axis spans at least this to either side [m]
LEAST_DEVIATION_SHOWN = 0.2
#: what is higher in the panel than this share of it is where words stand
HIGH_UP = 0.6
#: a bound below this is written above its line, clear of the time axis
LOW_BOUND = 2.5
#: where there is no gap, the distance between the bodies is drawn up to this [m]
DISTANCE_SHOWN = 40.0
#: the last metres of the gap take half of its axis [m]
LAST_METRES = 10.0
#: between two lines of words in a panel [point]
LINE_PITCH = 10.5
#: sensors whose first sight of the actor that mattered is said at most: more lines would cover the curves
SIGHTED_SHOWN = 4
#: words on a bound that begins after this share of the drive stand before the bound, else over or under it
LATE = 0.4
#: of words that neither lines nor a hatch may cross
GROUND: dict[str, Any] = {"facecolor": PAPER, "edgecolor": "none", "pad": 0.5}
#: how a bound is drawn that the scenario's criteria set
BOUND: dict[str, Any] = {"color": QUIET, "linewidth": 1.0, "linestyle": (0, (2, 3))}


def _curves(
    axes: Axes, title: str, page: DrivePage, curves: Iterable[tuple[Floats, dict[str, Any]]], none: str
) -> bool:
    """Draw values over time under a title, or say what is missing; return whether there was anything."""
    axes.set_title(title, loc="left", pad=5)
    known = [(values, style) for values, style in curves if np.isfinite(values).any()]
    for values, style in known:
        lonely = "o" if np.isfinite(values).sum() == 1 else ""
        axes.plot(page.ticks["time_s"].to_numpy(), values, **{"marker": lonely, **style})
    if not known:
        say(axes, none)
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


def _speed(axes: Axes, page: DrivePage) -> None:
    speed = page.ticks[f"{prefix(page.ticks)}speed_mps"].to_numpy()
    title = f"{'true' if prefix(page.ticks) else 'estimated'} speed [m/s]"
    if _curves(axes, title, page, [(speed, {"color": EGO})], "no pose"):
        _from_zero(axes, speed, 1.0)
        _criterion_lines(axes, page, "max_speed_mps", "")


def _gap(axes: Axes, page: DrivePage) -> None:
    """Draw the gap in the colour of the actor it is to; where there is none, thin, the distance between the bodies."""
    names, gap = page.lead.actor, page.lead.gap
    ahead = [
        (name, np.where([one == name for one in names], gap, np.nan)) for name in dict.fromkeys(page.lead.actor) if name
    ]
    curves: list[tuple[Floats, dict[str, Any]]] = [(values, {"color": _of(page, name)}) for name, values in ahead]
    free = np.zeros(len(gap), bool) if page.distance is None else np.isnan(gap) & (page.distance <= DISTANCE_SHOWN)
    bare = bool(free.any())
    if page.distance is not None:
        thin = {"color": OBSTACLE, "linewidth": 0.9, "linestyle": (0, (4, 1.5)), "marker": ""}
        curves.append((np.where(free, page.distance, np.nan), thin))
    title = "gap from bumper along path [m]" + (f"; dashed: distance, to {DISTANCE_SHOWN:g} m" if bare else "")
    if not _curves(axes, title, page, curves, "nothing ahead"):
        return
    shown = np.concatenate([values for values, _style in curves])
    _criterion_lines(axes, page, "stop_gap_m", "gap at rest ", np.isfinite(gap))
    _criterion_lines(axes, page, "min_gap_m", "gap ", np.isfinite(gap))
    _from_zero(axes, shown, 1.0)
    _enlarge_last_metres(axes, float(np.nanmax(shown)))
    if math.isfinite(gap[-1]):
        end, colour = page.ticks["time_s"][-1].as_py(), _of(page, page.lead.actor[-1])
        axes.plot(end, gap[-1], "o", color=colour, markersize=5.0, clip_on=False)
    _say_gap(axes, page, shown)


def _of(page: DrivePage, actor: str) -> str:
    """Return the colour of the gap to an actor."""
    colour = page.colour_of(actor) if page.main else OBSTACLE
    return QUIET if colour == PAPER else colour


def _say_gap(axes: Axes, page: DrivePage, shown: Floats) -> None:
    """Write whose gap is drawn, the least distance, the first detection and the gap at the end into a free corner."""
    time, lines = page.ticks["time_s"].to_numpy(), []
    if page.distance is not None and np.isfinite(page.distance).any():
        row = int(np.nanargmin(page.distance))
        axes.plot(time[row], page.distance[row], "v", color=OBSTACLE, markeredgecolor=INK, markersize=5.0, zorder=5)
        lines.append((f"least distance {page.distance[row]:.2f} m at {time[row]:.2f} s ▾", INK))
    for sensor, first, far in page.sighted[:SIGHTED_SHOWN]:
        lines.append((f"{plain_name(sensor)} first sees it at {first:.2f} s, {far:.0f} m ┊", INK))
    if page.lost:
        lines.append(("lost at {:.2f} s, seen again at {:.2f} s ▨".format(*_lost_last(page)), INK))
    if math.isfinite(page.lead.gap[-1]) and page.distance is None:
        lines.append((f"{page.lead.gap[-1]:.2f} m at the end ●", INK))
    others = [name for name in dict.fromkeys(page.lead.actor) if name]
    if others and (page.second or page.main not in others):
        lines += [(f"to {plain_name(name)}", _of(page, name)) for name in others[:2]]
    _mark_detections(axes, page, len(lines))
    place: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "top", "fontsize": 8.5}
    left = _freer_on_the_left(axes, time, shown)
    for number, (words, colour) in enumerate(lines):
        corner, aside = ((0.0, 1.0), 3.0) if left else ((1.0, 1.0), -3.0)
        at: dict[str, Any] = {"xytext": (aside, -2.0 - LINE_PITCH * number), "ha": "left" if left else "right"}
        axes.annotate(words, corner, color=colour, zorder=9, path_effects=halo(), **at, **place)


def _lost_last(page: DrivePage) -> tuple[float, float]:
    """Return when all sensors had lost the actor that mattered for the last time before the moment, until when [s]."""
    before = [times for times in page.lost if page.moment is None or times[0] < page.moment.time]
    return (before or [*page.lost])[-1]


def _mark_detections(axes: Axes, page: DrivePage, lines: int) -> None:
    """Mark when each sensor first saw the actor that mattered, and hatch while none did, below `lines` of words."""
    height = axes.bbox.height / axes.figure.dpi * POINTS_PER_INCH
    top = 1.0 - (2.0 + LINE_PITCH * lines + 2.0) / height
    for _sensor, first, _far in page.sighted[:SIGHTED_SHOWN]:
        axes.axvline(first, ymax=top, color=OBSTACLE, linewidth=1.0, linestyle=(0, (1, 1)))
    for begin, end in page.lost:
        style: dict[str, Any] = {"facecolor": "none", "edgecolor": QUIET, "hatch": "/////", "linewidth": 0.0}
        axes.axvspan(begin, end, ymax=top, zorder=1, **style)


def _freer_on_the_left(axes: Axes, time: Floats, shown: Floats) -> bool:
    """Whether the curves cover less of the left upper corner of their panel than of the right one."""
    values = shown.reshape(-1, len(time))
    places = np.column_stack((np.broadcast_to(time, values.shape).ravel(), values.ravel()))
    right, up = axes.transAxes.inverted().transform(axes.transData.transform(places)).T
    high = up > HIGH_UP
    return bool((high & (right < 0.5)).sum() <= (high & (right >= 0.5)).sum())


def _enlarge_last_metres(axes: Axes, most: float) -> None:
    """Give the last metres of the gap half of the axis where the whole gap would leave them a narrow strip."""
    if most < 2.0 * LAST_METRES:
        return
    share = LAST_METRES / (most - LAST_METRES)

    def forward(gap: Floats) -> Floats:
        return np.where(gap > LAST_METRES, LAST_METRES + (gap - LAST_METRES) * share, gap)

    def backward(height: Floats) -> Floats:
        return np.where(height > LAST_METRES, LAST_METRES + (height - LAST_METRES) / share, height)

    low = axes.get_ylim()[0]
    axes.set_yscale("function", functions=(forward, backward))
    step = next(step for step in (10.0, 20.0, 50.0, 100.0, 200.0) if (most - LAST_METRES) / step <= 3.0)
    coarse = step * math.ceil((LAST_METRES + 3.0 / share) / step)  # clear of the words at the tick before
    axes.set_yticks([0.0, 5.0, LAST_METRES, *np.arange(coarse, most, step)])
    axes.set_ylim(low, 1.05 * most)
    axes.axhline(LAST_METRES, color=QUIET, linewidth=0.6)
    beside: dict[str, Any] = {"rotation": 90.0, "ha": "left", "va": "center", "fontsize": 8.5, "color": QUIET}
    axes.text(1.01, 0.5, f"last {LAST_METRES:g} m enlarged", transform=axes.transAxes, **beside)


def _acceleration(axes: Axes, page: DrivePage) -> None:
    """Draw what the car did, wide and pale, and what it was told, thin and dark.

    Told is what the gateway granted, without the brake's hold at rest, which no car answers; in a drive that never
    engaged it is what the controller asked for.
    """
    ticks = page.ticks
    did = ticks[f"{prefix(ticks)}acceleration_mps2"].to_numpy()
    asked, word = ticks["acceleration_setpoint_mps2"].to_numpy(), "asked by the controller"
    if _engaged(ticks).any():
        granted, speed = ticks["granted_acceleration_mps2"].to_numpy(), ticks[f"{prefix(ticks)}speed_mps"].to_numpy()
        held = (np.abs(speed) < AT_REST) & (granted < 0.0)
        asked, word = np.where(held, np.nan, granted), "commanded while moving" if held.any() else "commanded"
    curves: list[tuple[Floats, dict[str, Any]]] = [
        (did, {"color": EGO_PALE, "linewidth": 3.6, "label": "car"}),
        (asked, {"color": INK, "linewidth": 1.0, "label": word}),
    ]
    if _curves(axes, axis_of("acceleration_mps2"), page, curves, "no pose"):
        _include(axes, -0.5, 0.5)
        _say_hunting(axes, page)


def _say_hunting(axes: Axes, page: DrivePage) -> None:
    """Mark the approach on which the car gained speed and braked again, and how often its acceleration changed sign."""
    approach = page.approach
    if approach is None or not approach.hunting:
        return
    time, across = page.ticks["time_s"].to_numpy(), axes.get_xaxis_transform()
    axes.plot(time[[approach.onset, approach.rest]], [0.02, 0.02], color=ALARM, linewidth=4.0, transform=across)
    place: dict[str, Any] = {"xytext": (0, 6), "textcoords": "offset points", "ha": "right", "va": "bottom"}
    ground = {"facecolor": "white", "edgecolor": ALARM, "boxstyle": "round,pad=0.2"}
    text = f"hunting: {approach.reversals} reversals"
    axes.annotate(text, (time[approach.rest], 0.02), xycoords=across, color=INK, bbox=ground, **place)


def _deviation(axes: Axes, page: DrivePage) -> None:
    deviation, word = page.ticks["lateral_deviation_m"].to_numpy(), "true"
    if not np.isfinite(deviation).any():
        deviation, word = page.ticks["estimated_deviation_m"].to_numpy(), "estimated"
    title = f"{word} lateral deviation [m], left +"
    if not _curves(axes, title, page, [(deviation, {"color": EGO})], "no pose on the path"):
        return
    _include(axes, -LEAST_DEVIATION_SHOWN, LEAST_DEVIATION_SHOWN)
    if (most := page.criteria.get("max_lateral_deviation_m", {}).get("max")) is not None:
        shown = most <= 2.0 * max(map(abs, axes.get_ylim()))
        if shown:
            _include(axes, -1.15 * most, 1.15 * most)
            _bound(axes, most, f"required: ±{most:g} m")
            _bound(axes, -most, "")
    if page.deviation_limit is not None:
        _stopped_at(axes, page.deviation_limit)


def _stopped_at(axes: Axes, limit: float) -> None:
    """Draw the deviation to either side at which the gateway stopped the car."""
    _include(axes, -1.15 * limit, 1.15 * limit)
    for side in (limit, -limit):
        axes.axhline(side, color=ALARM, linewidth=1.4, linestyle=(0, (3, 1)))
    place: dict[str, Any] = {"xycoords": axes.get_yaxis_transform(), "textcoords": "offset points"}
    style: dict[str, Any] = {"va": "bottom", "fontsize": 8.5, "color": INK}
    axes.annotate(f"the gateway stops the car beyond ±{limit:g} m", (0.0, limit), (2.0, 1.5), **style, **place)


def _bound(axes: Axes, value: float, label: str) -> None:
    """Draw a bound that the scenario's criteria set."""
    axes.axhline(value, label=label, **BOUND)


def _criterion_lines(
    axes: Axes, page: DrivePage, metric: str, word: str, known: NDArray[np.bool_] | None = None
) -> None:
    """Draw the bounds that the scenario's criteria set to a metric, with words where they begin.

    A bound stands only at the ticks at which its quantity is `known`, so that no other curve is read against it.
    """
    time = page.ticks["time_s"].to_numpy()
    known = np.ones(len(time), np.bool_) if known is None else known
    if not known.any():
        return
    begin = float(time[int(np.argmax(known))])
    late = begin - time[0] > LATE * (time[-1] - time[0])
    for end, sign, side in (("min", "≥", "top"), ("max", "≤", "bottom")):
        if (bound := page.criteria.get(metric, {}).get(end)) is not None and math.isfinite(bound):
            axes.plot(time, np.where(known, bound, np.nan), **BOUND)
            below = side == "top" and bound >= LOW_BOUND
            aside = (-2.0 if late else 2.0, -1.5 if below else 1.5)
            style: dict[str, Any] = {"va": "top" if below else "bottom", "ha": "right" if late else "left"}
            look: dict[str, Any] = {"fontsize": 8.5, "color": QUIET, "textcoords": "offset points", "bbox": GROUND}
            axes.annotate(f"required: {word}{sign} {bound:g}", (begin, bound), aside, **style, **look)


def _engaged(ticks: pa.Table) -> NDArray[np.bool_]:
    return np.array([state == ArmingState.ENGAGED.value for state in ticks["state"].to_pylist()], bool)


def _events(axes: Axes, page: DrivePage) -> None:
    """Shade when the emergency layer braked (or asked, where nobody ever obeyed) and mark the first contact."""
    ticks, time = page.ticks, page.ticks["time_s"].to_numpy()
    engaged, asked = _engaged(ticks), ticks["emergency"].to_numpy(zero_copy_only=False)
    band, word = (asked & engaged, "emergency braking") if engaged.any() else (asked, "emergency asked")
    if band.any():
        across = axes.get_xaxis_transform()
        axes.fill_between(time, 0, 1, where=band, transform=across, color=ALARM, alpha=0.35, linewidth=0, label=word)
    _gateway_stop(axes, page)
    row = contact(ticks)
    if row is not None:
        axes.axvline(time[row], color=INK, linewidth=1.2, linestyle=(0, (1, 1.5)), label="contact")


def _gateway_stop(axes: Axes, page: DrivePage) -> None:
    """Mark where the gateway took the car from the controller to stop it."""
    state = page.ticks["state"].to_pylist()
    row = next((n for n, name in enumerate(state) if name == ArmingState.STOPPING.value), None)
    if row is not None:
        begun = page.ticks["time_s"][row].as_py()
        style: dict[str, Any] = {"color": ALARM, "linewidth": 2.0, "linestyle": (0, (3, 1))}
        axes.axvline(begun, **style, label="the gateway stops the car")


def over_time(figure: Figure, page: DrivePage) -> None:
    """Draw the column of curves over one time axis; legends stand in the titles' lines, where no curve can be."""
    panels = (_speed, _gap, _acceleration, _deviation)
    pitch = (TOP - BOTTOM + BETWEEN) / len(panels)
    time = page.ticks["time_s"].to_numpy()
    limits = (time[0], time[-1]) if len(time) > 1 else (time[0] - 1.0, time[0] + 1.0)
    for row, paint in enumerate(panels):
        axes = panel(figure, RIGHT, TOP - row * pitch - (pitch - BETWEEN), RIGHT_WIDTH, pitch - BETWEEN)
        axes.spines[["top", "right"]].set_visible(False)
        axes.locator_params(axis="y", nbins=5, steps=(1, 2, 5, 10))
        axes.set_xlim(*limits)
        axes.grid(alpha=0.35, linewidth=0.6)
        paint(axes, page)
        _events(axes, page)
        axes.tick_params(labelbottom=row == len(panels) - 1)
        _legend_above(axes, events=paint is _speed)
    axes.set_xlabel(axis_of("time_s"), labelpad=2)


def _legend_above(axes: Axes, events: bool) -> None:
    """Explain the curves of a panel, and in one panel also the events that all of them show."""
    shared = ("emergency braking", "emergency asked", "contact", "the gateway stops the car")
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
