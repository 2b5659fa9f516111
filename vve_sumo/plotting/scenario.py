"""Draws a scenario before anybody has driven it: the virtual road, who moves how, which trigger fires where and when.

What it draws is how the scenario would go if its ego never braked (`foreseen`). It must not know SUMO or a drive.
"""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo.drive.no_brake_preview import NoBrakePreview, TriggeredEvent, obstacle_boxes, preview_without_braking
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.errors import ConfigError
from vve_sumo.geometry import Box
from vve_sumo.plotting.birds_eye import MapWindow, compass, draw_car, ribbon, rotated
from vve_sumo.plotting.drive_page import long_axis
from vve_sumo.plotting.page import (
    ACTOR,
    ALARM,
    BOTTOM,
    DOTS_PER_INCH,
    EGO,
    INK,
    LEFT,
    OBSTACLE,
    PAPER,
    POINTS_PER_INCH,
    QUIET,
    ROAD,
    SIZE,
    STYLE,
    TOP,
    panel,
)
from vve_sumo.scenario import descriptions
from vve_sumo.scenario.road_users import Actor
from vve_sumo.values import ActorState, Floats
from vve_sumo.world.network import lane_shapes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Where things stand on the page [inch].
WIDE, HIGH = SIZE[0] - 2.0 * LEFT, 3.0
CURVES, CURVES_WIDTH, WAY, WAY_WIDTH, WORDS, LOW_HEIGHT = 0.95, 4.3, 5.55, 2.55, 8.45, 2.5
#: street shown around what happens, and the least and the most of it across the page [m]
MARGIN, LEAST, MOST = 7.0, 45.0, 190.0
#: what lies farther from the contact than this is not what the window is chosen by [m]
MAX_CONTACT_DISTANCE = 95.0
#: of the ego before what it meets first, where no actor has a trigger [m]
LEAD_IN_DISTANCE = 45.0
#: a body smaller than this is drawn as a square of this size [point]
MARK = 7.0
#: time shown before the first event and after the contact [s]
LEAD_IN, LEAD_OUT = 3.0, 1.0
#: time shown before a contact where no actor has a trigger [s]
APPROACH = 8.0
#: letters' size, characters in a line, and lines that the page has room for, of the list of events; the first that fits
SETTINGS = ((10.0, 52, 15), (8.8, 60, 17), (7.8, 68, 19))
#: an actor on a way that differs from the ego's by less than this goes along it [deg]
ALONG = 30.0
#: steps from the ground's colour to that of a line on it, in the written file
STEPS = 8

CONTACT: dict[str, Any] = {
    "marker": "o",
    "linestyle": "",
    "markersize": 22.0,
    "markerfacecolor": "none",
    "markeredgecolor": ALARM,
    "markeredgewidth": 2.6,
}
NUMBERED: dict[str, Any] = {"boxstyle": "circle,pad=0.18", "facecolor": PAPER, "linewidth": 1.0}
#: the lines of the triggers are not drawn through what a legend says
OPAQUE_LEGEND: dict[str, Any] = {
    "loc": "upper left",
    "fontsize": 9,
    "borderaxespad": 0.5,
    "frameon": True,
    "framealpha": 1.0,
    "facecolor": PAPER,
    "edgecolor": PAPER,
}


@dataclass(frozen=True, slots=True)
class Page:
    """Everything that the picture shows."""

    resolved: ResolvedScenario
    seen: NoBrakePreview
    boxes: dict[str, Box]  #: of the obstacles
    lanes: Sequence[tuple[Floats, float]]
    view: MapWindow

    @property
    def staged(self) -> bool:
        """Whether there is a place where something happens."""
        return self.seen.contact is not None or bool(self.seen.events)

    @property
    def end(self) -> float:
        """Time of the contact, else of the last event or the last moment [s]."""
        if self.seen.contact is not None:
            return self.seen.contact.time
        return self.seen.events[-1].time if self.seen.events else self.seen.samples[-1].time


def draw(resolved: ResolvedScenario, file: Path, special_conditions: Sequence[str] = ()) -> None:
    """Write the picture of a scenario as a PNG file; raises ConfigError where none can be written there.

    `special_conditions` are lines about what cannot be drawn, for the list beside the picture.
    """
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        _save(picture(resolved, special_conditions), file)


def picture(resolved: ResolvedScenario, special_conditions: Sequence[str] = ()) -> Figure:
    """Return the picture of a scenario; `special_conditions` as in `draw`."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from vve_sumo.plotting.style import Picture

    page = _page(resolved)
    with mpl.rc_context(STYLE):
        figure = Picture(figsize=SIZE, dpi=DOTS_PER_INCH)
        FigureCanvasAgg(figure)
        _street(panel(figure, LEFT, TOP - HIGH, WIDE, HIGH), page)
        _over_time(panel(figure, CURVES, BOTTOM, CURVES_WIDTH, LOW_HEIGHT), page)
        _whole_way(panel(figure, WAY, BOTTOM, WAY_WIDTH, LOW_HEIGHT), page)
        _list(figure, page, special_conditions)
        _head(figure, resolved)
        return figure


def _save(figure: Figure, file: Path) -> None:
    """Write a page in the house's own colours: a fraction of the bytes, and nothing that the eye would miss."""
    from PIL import Image

    palette = Image.new("P", (1, 1))
    palette.putpalette([value for colour in _colours() for value in colour])
    with io.BytesIO() as page:
        figure.savefig(page, format="png")
        image = Image.open(page).convert("RGB")
    try:
        image.quantize(palette=palette, dither=Image.Dither.NONE).save(file, format="PNG", optimize=True)
    except OSError as error:
        raise ConfigError(f"picture {file}: cannot be written: {error.strerror}") from None


def _colours() -> list[tuple[int, int, int]]:
    """Return every colour of the page and, for soft edges, its steps towards paper and road."""
    found = []
    for ground in (PAPER, ROAD):
        for ink in (INK, QUIET, EGO, OBSTACLE, ALARM, ACTOR):
            for step in range(STEPS + 1):
                pairs = [(int(ground[n : n + 2], 16), int(ink[n : n + 2], 16)) for n in (1, 3, 5)]
                red, green, blue = (round(under + (over - under) * step / STEPS) for under, over in pairs)
                found.append((red, green, blue))
    return found


def _page(resolved: ResolvedScenario) -> Page:
    seen, boxes = preview_without_braking(resolved), obstacle_boxes(resolved)
    view = _view(resolved, seen, boxes)
    points = np.vstack((_path_points(resolved), view.corners()))
    (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
    lanes = lane_shapes(resolved.network.path, (float(left), float(low), float(right), float(high)))
    return Page(resolved, seen, boxes, lanes, view)


def _path_points(resolved: ResolvedScenario) -> Floats:
    return np.array([resolved.path.at(float(s))[:2] for s in np.arange(0.0, resolved.path.length, 2.0)])


def _view(resolved: ResolvedScenario, seen: NoBrakePreview, boxes: dict[str, Box]) -> MapWindow:
    """Return the window on what happens, the ego driving to the right; on the whole way where nothing does."""
    shown = _shown(seen, boxes)
    shape = HIGH / WIDE
    if not shown:
        x, y = _path_points(resolved).T
        angle, margin, most = long_axis(x, y, 0.0), 4.0 * MARGIN, math.inf
        points = np.column_stack((x, y))
    else:
        points = np.array([corner for box in shown for corner in box.corners()])
        angle, margin, most = shown[0].heading, MARGIN, MOST
    turned = rotated(points[:, 0], points[:, 1], -angle)
    least, greatest = turned.min(axis=0), turned.max(axis=0)
    width, height = (float(size) for size in greatest - least + 2.0 * margin)
    width = min(max(width, height / shape, LEAST), most)
    ((right, up),) = (least + greatest)[None] / 2.0
    x, y = rotated(right, up, angle)[0]
    return MapWindow(float(x), float(y), angle, width, shape * width)


def _shown(seen: NoBrakePreview, boxes: dict[str, Box]) -> list[Box]:
    """Return the boxes that the window must hold, the ego's at the contact or the last event first."""
    contact, events = seen.contact, seen.events
    if contact is None and not events:
        return []
    ego = events[-1].ego if contact is None else contact.ego
    before = [
        moment.ego
        for moment in seen.samples
        if math.dist((moment.ego.x, moment.ego.y), (ego.x, ego.y)) < LEAD_IN_DISTANCE
    ]
    others = [*(event.ego for event in events), *(_box(event.actor_state) for event in events), *boxes.values()]
    others += [] if contact is None or contact.actor_state is None else [_box(contact.actor_state)]
    near = [box for box in others if math.dist((box.x, box.y), (ego.x, ego.y)) < MAX_CONTACT_DISTANCE]
    return [ego, before[0], *near] if not events else [ego, *near]


def _box(actor_state: ActorState) -> Box:
    return Box(actor_state.x, actor_state.y, actor_state.heading, actor_state.length, actor_state.width)


def _street(axes: Axes, page: Page) -> None:
    view = page.view
    _lanes(axes, page, view, PAPER if page.staged else ROAD)
    placed = view.place(*_path_points(page.resolved).T)
    axes.plot(*placed.T, color=INK, linewidth=1.0, linestyle=(0, (4, 3)), zorder=2)
    for box in page.boxes.values():
        _body(axes, view, box, OBSTACLE)
    _lines_of_motion(axes, page)
    for number, event in enumerate(page.seen.events, 1):
        _body(axes, view, event.ego, PAPER, EGO)
        _body(axes, view, _box(event.actor_state), PAPER, ACTOR)
        _number(axes, view, event.ego, number, EGO, (0.0, -1.0))
        crosses = _crosses(page.resolved.scenario.actors[event.actor].turned_deg)
        _number(axes, view, _box(event.actor_state), number, ACTOR, (1.0, 0.0) if crosses else (0.0, 1.0))
    _meeting(axes, page)
    axes.set(xlim=(-view.width / 2.0, view.width / 2.0), ylim=(-view.height / 2.0, view.height / 2.0))
    axes.set(xticks=(), yticks=())
    compass(axes, view, WIDE)
    title = "the virtual road from above, the ego drives to the right" if page.staged else "the way"
    axes.set_title(title, loc="left", pad=5)
    _legend(axes, page)


def _lanes(axes: Axes, page: Page, view: MapWindow, edge: str) -> None:
    from matplotlib.collections import PolyCollection

    roads = [view.place(*ribbon(line, width).T) for line, width in page.lanes if len(line) > 1]
    axes.add_collection(PolyCollection(roads, facecolor=ROAD, edgecolor=edge, linewidth=0.7, zorder=1))


def _lines_of_motion(axes: Axes, page: Page) -> None:
    """Draw each actor's way from its first moment to a little after the contact, with an arrow at its end."""
    until = page.end + LEAD_OUT
    for actor in page.resolved.scenario.actors:
        moved = [p for m in page.seen.samples if m.time <= until for p in m.actors if p.id == actor.id]
        if not moved:
            continue
        line = page.view.place(np.array([p.x for p in moved]), np.array([p.y for p in moved]))
        axes.plot(*line.T, color=ACTOR, linewidth=2.0, zorder=4)
        far = next((point for point in line[::-1] if math.dist(point, line[-1]) > 0.5), None)
        if far is not None:
            shape: dict[str, Any] = {"arrowstyle": "-|>", "color": ACTOR, "linewidth": 2.0, "mutation_scale": 16.0}
            axes.annotate("", tuple(line[-1]), tuple(far), arrowprops=shape, zorder=5)


def _body(axes: Axes, view: MapWindow, box: Box, colour: str, edge: str = INK) -> None:
    """Draw a body as it is where that is large enough to be seen, else as a square."""
    if not view.holds(box.x, box.y):
        return
    if min(box.length, box.width) / view.width * WIDE * POINTS_PER_INCH > MARK / 2.0:
        draw_car(axes, view, box, colour)
        axes.patches[-1].set_edgecolor(edge)
        axes.patches[-1].set_linewidth(1.3)
        return
    ((x, y),) = view.place(np.array([box.x]), np.array([box.y]))
    axes.plot(x, y, "s", color=colour, markersize=MARK, markeredgecolor=edge, markeredgewidth=1.3, zorder=6)


def _number(axes: Axes, view: MapWindow, box: Box, number: int, colour: str, side: tuple[float, float]) -> None:
    """Write an event's number beside a body, on that `side` of it (right, up)."""
    if not view.holds(box.x, box.y):
        return
    ((x, y),) = view.place(np.array([box.x]), np.array([box.y]))
    turn = box.heading - view.heading
    half = 0.5 * (box.width * abs(math.cos(turn)) + box.length * abs(math.sin(turn)))
    place: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": "center", "zorder": 9}
    spot, off = (x, y + side[1] * half), (15.0 * side[0], 13.0 * side[1])
    axes.annotate(str(number), spot, off, color=colour, fontsize=10, bbox=NUMBERED | {"edgecolor": colour}, **place)


def _meeting(axes: Axes, page: Page) -> None:
    contact = page.seen.contact
    if contact is None:
        return
    _body(axes, page.view, contact.ego, EGO)
    if contact.actor_state is not None:
        _body(axes, page.view, _box(contact.actor_state), ACTOR)
    ((x, y),) = page.view.place(np.array([contact.ego.x]), np.array([contact.ego.y]))
    x += 0.5 * contact.ego.length
    axes.plot(x, y, **CONTACT, zorder=10)


def _legend(axes: Axes, page: Page) -> None:
    from matplotlib.lines import Line2D

    def square(colour: str, edge: str = INK) -> Line2D:
        return Line2D([], [], marker="s", linestyle="", color=colour, markeredgecolor=edge, markersize=8.0)

    rows: list[tuple[Any, str]] = [(Line2D([], [], color=INK, linewidth=1.0, linestyle=(0, (4, 3))), "ego's path")]
    if page.seen.contact is not None:
        rows.append((square(EGO), "ego then"))
    if page.resolved.scenario.actors:
        rows.append((Line2D([], [], color=ACTOR, marker=">", markersize=7.0), "actor and its way"))
        rows.append((square(PAPER, QUIET), "where both are at a trigger"))
    if page.boxes:
        rows.append((square(OBSTACLE), "stands all the time"))
    if page.seen.contact is not None:
        rows.append((Line2D([], [], **(CONTACT | {"markersize": 11.0})), "contact, if it never braked"))
    marks, names = zip(*rows, strict=True)
    axes.legend(
        marks,
        names,
        loc="upper left",
        bbox_to_anchor=(0.0, -0.01),
        ncols=len(rows),
        borderaxespad=0.2,
        columnspacing=1.4,
    )


def _over_time(axes: Axes, page: Page) -> None:
    """Draw the way along the path over time, or across it where somebody crosses."""
    crossing = [one.id for one in page.resolved.scenario.actors if _crosses(one.turned_deg)]
    first = min((event.time for event in page.seen.events), default=page.end - APPROACH if page.staged else 0.0)
    axes.set_xlim(max(first - LEAD_IN, 0.0), page.end + LEAD_OUT)
    axes.set_xlabel("drive time if the ego never braked [s]")
    (_across if crossing else _along)(axes, page)
    for number, event in enumerate(page.seen.events, 1):
        axes.axvline(event.time, color=QUIET, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)
        place: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": "center", "zorder": 9}
        axes.annotate(
            str(number), (event.time, 1.0), (0.0, 8.0), xycoords=axes.get_xaxis_transform(), fontsize=9, **place
        )
    for spine in ("top", "right"):
        axes.spines[spine].set_visible(False)


def _crosses(turned: float) -> bool:
    return ALONG < abs(turned) < 180.0 - ALONG


def _within(axes: Axes, page: Page) -> list[Any]:
    low, high = axes.get_xlim()
    return [moment for moment in page.seen.samples if low <= moment.time <= high]


def _along(axes: Axes, page: Page) -> None:
    """Draw the ego's front and every other's nearest face along the path."""
    moments = _within(axes, page)
    axes.plot([m.time for m in moments], [m.s for m in moments], color=EGO, label="ego's front")
    path = page.resolved.path
    for actor in page.resolved.scenario.actors:
        seen = [(m.time, actor_state) for m in moments for actor_state in m.actors if actor_state.id == actor.id]
        # Against the path its front is the nearest face, along it its rear: both lie half a length towards the ego.
        places = [
            path.project(actor_state.x, actor_state.y).s - actor_state.length / 2.0 for _time, actor_state in seen
        ]
        axes.plot([time for time, _state in seen], places, color=ACTOR, label=f"{actor.id}, nearest face")
    for one in page.resolved.scenario.obstacles:
        axes.axhline(one.at_m - one.length_m / 2.0, color=OBSTACLE, linewidth=1.2, label=f"{one.id}, nearest face")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.4 * (high - low))
    axes.set_ylabel("along the path [m]")
    if page.resolved.scenario.actors or page.resolved.scenario.obstacles:
        axes.legend(**OPAQUE_LEGEND)


def _across(axes: Axes, page: Page) -> None:
    """Draw how far beside the path every actor is, the strip that the ego covers, and when the ego would be there."""
    moments, path = _within(axes, page), page.resolved.path
    half = page.resolved.vehicle.width / 2.0
    axes.axhspan(-half, half, color=EGO, alpha=0.18, linewidth=0.0, label="strip that the ego covers")
    for actor in page.resolved.scenario.actors:
        seen = [(m.time, actor_state) for m in moments for actor_state in m.actors if actor_state.id == actor.id]
        d = [path.project(actor_state.x, actor_state.y).d for _time, actor_state in seen]
        axes.plot([time for time, _state in seen], d, color=ACTOR, label=f"{actor.id}, middle")
    if page.seen.contact is not None:
        axes.axvline(page.seen.contact.time, color=EGO, linewidth=1.6, label="the ego would be there")
    axes.set_ylabel("beside the path,\nleft positive [m]")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.5 * (high - low))
    axes.legend(**OPAQUE_LEGEND)


def _whole_way(axes: Axes, page: Page) -> None:
    """Draw the whole path, north up, its start, and what of it the window shows."""
    points = _path_points(page.resolved)
    least, greatest = points.min(axis=0), points.max(axis=0)
    middle = (least + greatest) / 2.0
    size = np.maximum(greatest - least, 20.0) * 1.25
    width = float(max(size[0], size[1] * WAY_WIDTH / LOW_HEIGHT))
    view = MapWindow(float(middle[0]), float(middle[1]), 0.0, width, width * LOW_HEIGHT / WAY_WIDTH)
    _lanes(axes, page, view, ROAD)
    placed = view.place(*points.T)
    axes.plot(*placed.T, color=EGO, linewidth=1.8, zorder=3)
    axes.plot(
        *placed[0], "o", markersize=8.0, markerfacecolor=PAPER, markeredgecolor=EGO, markeredgewidth=2.0, zorder=5
    )
    corners = view.place(*page.view.corners().T)
    if page.staged:
        axes.fill(*corners.T, fill=False, edgecolor=INK, linewidth=1.4, zorder=6)
    axes.set(xlim=(-view.width / 2.0, view.width / 2.0), ylim=(-view.height / 2.0, view.height / 2.0))
    axes.set(xticks=(), yticks=())
    axes.set_title("the whole way, north up", loc="left", pad=4)
    axes.set_xlabel(f"{page.resolved.path.length:.0f} m from the circle on", labelpad=3)


def _list(figure: Figure, page: Page, special_conditions: Sequence[str]) -> None:
    """Write what happens, numbered as on the virtual road, what makes the drive pass, and what cannot be drawn."""
    texts = [*_texts(page, special_conditions)]
    laid = [
        [line for text, mark in texts for line in _wrapped(text, mark, column)] for _size, column, _most in SETTINGS
    ]
    fits = (number for number, (_size, _column, most) in enumerate(SETTINGS) if len(laid[number]) <= most)
    chosen = next(fits, len(SETTINGS) - 1)
    (size, _column, most), lines = SETTINGS[chosen], laid[chosen]
    if len(lines) > most:
        lines = [*lines[: most - 1], "…"]
    place: dict[str, Any] = {"va": "top", "linespacing": 1.25, "fontsize": size}
    figure.text(WORDS / SIZE[0], (BOTTOM + LOW_HEIGHT + 0.1) / SIZE[1], "\n".join(lines), **place)


def _texts(page: Page, special_conditions: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the texts of the list, each with the mark before it."""
    for actor in page.resolved.scenario.actors:
        if not _enters_later(page, actor.id):
            yield _entering(page, actor), "-"
    for number, event in enumerate(page.seen.events, 1):
        yield _happening(page, event), str(number)
    for text in _still_to_come(page):
        yield text, "-"
    for actor in page.resolved.scenario.actors:
        for action in actor.story.actions if actor.story is not None else ():
            when = descriptions.trigger(action.when) or "at once"
            yield f"{descriptions.name(actor)}, {when}, {descriptions.story_action(action)}", "-"
    if page.seen.contact is not None:
        contact = page.seen.contact
        yield f"{contact.time:.1f} s: contact with {contact.id!r} if the ego never braked", "o"
    yield f"passes if: {descriptions.passes(page.resolved.scenario.criteria)}", "✓"
    for text in special_conditions:
        yield text, "·"


def _still_to_come(page: Page) -> list[str]:
    """Return the events that no ego which never braked would see."""
    begun = {(event.actor, event.number) for event in page.seen.events}
    return [
        f"then {descriptions.name(actor)}, {descriptions.condition(event.when) or 'at once'}, "
        f"{descriptions.action(event)}"
        for number, actor in enumerate(page.resolved.scenario.actors)
        for order, event in enumerate(actor.events)
        if (number, order) not in begun
    ]


def _entering(page: Page, actor: Actor) -> str:
    """Return how an actor enters that is there from the start, or that an ego which never braked would not see."""
    enters = f"{descriptions.name(actor)} {descriptions.entrance(actor)}"
    seen = any(actor_state.id == actor.id for moment in page.seen.samples for actor_state in moment.actors)
    return enters if seen else f"later, if at all: {descriptions.condition(actor.enters)}; {enters}"


def _enters_later(page: Page, actor: str) -> bool:
    scenario = page.resolved.scenario
    return any(event.number < 0 and scenario.actors[event.actor].id == actor for event in page.seen.events)


def _happening(page: Page, event: TriggeredEvent) -> str:
    actor = page.resolved.scenario.actors[event.actor]
    when = descriptions.condition(actor.enters if event.number < 0 else actor.events[event.number].when)
    does = descriptions.entrance(actor) if event.number < 0 else descriptions.action(actor.events[event.number])
    return f"{event.time:.1f} s: " + (f"{when}; " if when else "") + f"{descriptions.name(actor)} {does}"


def _wrapped(text: str, mark: str, column: int) -> list[str]:
    first, *rest = textwrap.wrap(text, column)
    return [f"{mark}  {first}", *(f"     {line}" for line in rest)]


def _head(figure: Figure, resolved: ResolvedScenario) -> None:
    scenario = resolved.scenario
    title = textwrap.shorten(f"{resolved.name}: {scenario.title}", 110, placeholder=" …")
    figure.text(LEFT / SIZE[0], 0.955, title, fontsize=14, fontweight="bold")
    traffic = ", ".join(scenario.road.demand) or "no other traffic"
    speed = descriptions.ego_speed(scenario.ego)
    below = f"{scenario.road.network}, {scenario.ego.path} · ego at {speed} · {traffic}"
    figure.text(LEFT / SIZE[0], 0.92, below, fontsize=12)
