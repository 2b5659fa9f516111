"""Says whether the triggers of a story fire: what bodies there are, how far they are apart, edges and delays.

Pure arithmetic on what it is told at each tick. Must not know files, SUMO or how actors move.
"""

from __future__ import annotations

import math
import operator
from collections import deque
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from vve_sumo.geometry import Box, overlap
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.story_schema import COMPARED, Groups, StoryCondition

#: a time that a condition states has come when no more than this is left of it [s]: ticks add up to it in floats
TIME_TOLERANCE: Final = 1e-6
#: numbers that differ by no more than this are equal to `==`: measured speeds are never the same to the bit
EQUAL_WITHIN: Final = 1e-3
#: below this speed a body stands [m/s]
STANDING_SPEED: Final = 0.01

RULES: Final[Mapping[str, Callable[[float, float], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": lambda one, other: abs(one - other) <= EQUAL_WITHIN,
    "!=": lambda one, other: abs(one - other) > EQUAL_WITHIN,
}


class Body(NamedTuple):
    """What conditions know of a body at one time."""

    x: float  #: reference point, map [m]
    y: float  #: reference point, map [m]
    heading: float  #: [rad], counter-clockwise from map +x
    speed: float  #: along the heading [m/s]
    box: Box
    acceleration: float = 0.0  #: [m/s2]
    travelled: float = 0.0  #: since it was first there [m]
    stands: float = -math.inf  #: how long it has stood [s]; -inf while it moves
    at_end: float = -math.inf  #: how long it has been at the end of its path [s]; -inf elsewhere


class BodyHistory:
    """Follows one body from tick to tick for what its states alone do not say."""

    def __init__(self) -> None:
        self._last: Body | None = None
        self._time = self._standing_since = self._end_since = math.nan

    def follow(self, now: float, body: Body, at_end: bool = False) -> Body:
        """Return the body at a time [s] with acceleration, way and how long it has stood or been at its path's end."""
        last, since = self._last, now - self._time
        if last is not None and since > 0.0:
            way = last.travelled + math.hypot(body.x - last.x, body.y - last.y)
            body = body._replace(acceleration=(body.speed - last.speed) / since, travelled=way)
        elif last is not None:
            body = body._replace(acceleration=last.acceleration, travelled=last.travelled)
        self._standing_since = self._since(self._standing_since, now, body.speed <= STANDING_SPEED)
        self._end_since = self._since(self._end_since, now, at_end)
        stands, ended = now - self._standing_since, now - self._end_since
        body = body._replace(
            stands=-math.inf if math.isnan(stands) else stands, at_end=-math.inf if math.isnan(ended) else ended
        )
        self._last, self._time = body, now
        return body

    @staticmethod
    def _since(began: float, now: float, holds: bool) -> float:
        if not holds:
            return math.nan
        return now if math.isnan(began) else began


class Scene(NamedTuple):
    """All that conditions may ask for at one tick."""

    now: float  #: drive time [s]
    bodies: Mapping[str, Body]  #: by id, the ego's is `ego`; who is not on the road is not there
    path: ReferencePath  #: the ego's
    states: Mapping[str, str]  #: of actions, ACTOR.NAME: running or ended; who has not begun is not there


class ConditionMonitor:
    """One condition from the tick on at which it is first looked at: its edge, its delay, its latch."""

    def __init__(self, condition: StoryCondition) -> None:
        self._condition = condition
        self._before: bool | None = None
        self._held: deque[tuple[float, bool]] = deque()
        self._delayed = self._latch = False

    def step(self, scene: Scene) -> bool:
        """Return whether it holds at a tick; call it at every tick from the first on."""
        condition = self._condition
        holds = scene.now >= condition.from_s - TIME_TOLERANCE and self._edge(raw(condition, scene))
        if condition.delay_s > 0.0:
            self._held.append((scene.now, holds))
            holds, due = False, scene.now - condition.delay_s + TIME_TOLERANCE
            while self._held and self._held[0][0] <= due:
                self._delayed = self._held.popleft()[1]
                holds = holds or self._delayed
            if condition.edge == "none":
                holds = self._delayed
        self._latch = condition.latched and (self._latch or holds)
        return holds or self._latch

    def _edge(self, now: bool) -> bool:
        before, self._before = self._before, now
        edge = self._condition.edge
        if edge == "none":
            return now
        rises, falls = before is False and now, before is True and not now
        return {"rising": rises, "falling": falls, "any": rises or falls}[edge]


class TriggerMonitor:
    """A trigger from the tick on at which it is first looked at."""

    def __init__(self, groups: Groups) -> None:
        self._groups = [[ConditionMonitor(one) for one in group] for group in groups]

    def step(self, scene: Scene) -> bool:
        """Return whether it fires at a tick; call it at every tick until it does. A trigger without groups fires."""
        # Every condition is stepped: edges and delays count from tick to tick.
        held = [[one.step(scene) for one in group] for group in self._groups]
        return not held or any(all(group) for group in held)


def raw(condition: StoryCondition, scene: Scene) -> bool:
    """Return whether a condition holds now, but for its edge, its delay and its latch."""
    if condition.actions is not None:
        return _in_state(condition, scene.states)
    if condition.time_s is not None:
        return compared(scene.now, condition.rule, condition.time_s, TIME_TOLERANCE)
    body = scene.bodies.get(condition.of)
    other = None if condition.to is None else scene.bodies.get(condition.to)
    if body is None or (condition.to is not None and other is None):
        return False
    if condition.stands_s is not None:
        return body.stands >= condition.stands_s - TIME_TOLERANCE
    if condition.end_of_road_s is not None:
        return body.at_end >= condition.end_of_road_s - TIME_TOLERANCE
    if condition.touches:
        return other is not None and overlap(body.box, other.box)
    if other is None and condition.at_m is not None:
        other = _place(condition.at_m, condition.offset_m, scene.path)
    if condition.within_m is not None:
        return other is not None and math.hypot(other.x - body.x, other.y - body.y) <= condition.within_m
    key = next(key for key in COMPARED if getattr(condition, key) is not None)
    found = _quantity(key, condition, body, other, scene.path)
    return math.isfinite(found) and compared(found, condition.rule, getattr(condition, key))


def compared(found: float, rule: str, wanted: float, tolerance: float = 0.0) -> bool:
    """Return whether a number is above, below, … another; `tolerance` counts for `>`, `>=` alone, for times."""
    return RULES[rule](found + (tolerance if rule == ">=" else 0.0), wanted)


def _in_state(condition: StoryCondition, states: Mapping[str, str]) -> bool:
    of = [states.get(name) for name in condition.actions or ()]
    if condition.state == "ended":
        return all(state == "ended" for state in of)
    began = any(state is not None for state in of)
    return began and (condition.state == "began" or not all(state == "ended" for state in of))


def _place(s: float, d: float, path: ReferencePath) -> Body:
    point = path.at(s)
    x, y = point.x - d * math.sin(point.heading), point.y + d * math.cos(point.heading)
    return Body(x, y, point.heading, 0.0, Box(x, y, point.heading, 0.0, 0.0))


def _quantity(key: str, condition: StoryCondition, body: Body, other: Body | None, path: ReferencePath) -> float:
    """Return what a condition compares; NaN where there is none."""
    if other is None:
        return {"speed_mps": body.speed, "acceleration_mps2": body.acceleration, "travelled_m": body.travelled}[key]
    if key == "relative_speed_mps":
        return body.speed - other.speed
    between = distance_between(condition.along, condition.freespace, body, other, path)
    gap = abs(between.signed)
    if key == "distance_m":
        return gap
    if key == "headway_s":
        ahead = between.signed >= 0.0 or not between.directed
        return gap / body.speed if ahead and body.speed > STANDING_SPEED else math.nan
    return gap / between.closing if between.closing > 0.0 else math.nan


class Between(NamedTuple):
    """What lies between two bodies."""

    signed: float  #: from the first to the second [m]; negative behind or right of the first
    closing: float  #: speed at which the size of that shrinks [m/s]
    directed: bool  #: whether the sign says anything


def distance_between(along: str, freespace: bool, body: Body, other: Body, path: ReferencePath) -> Between:
    """Return what lies between two bodies along or across the ego's path or the first one's heading, or straight.

    With `freespace` it is between their nearest faces, 0 where they overlap in that direction.
    """
    if along == "straight":
        return _straight(freespace, body, other)
    lateral = along.endswith("lateral")
    if along.startswith("path"):
        first, second = (path.project(one.x, one.y) for one in (body, other))
        signed = second.d - first.d if lateral else second.s - first.s
        axes = first.heading, second.heading
    else:
        dx, dy = other.x - body.x, other.y - body.y
        cos, sin = math.cos(body.heading), math.sin(body.heading)
        signed = dy * cos - dx * sin if lateral else dx * cos + dy * sin
        axes = body.heading, body.heading
    turn = 0.5 * math.pi if lateral else 0.0
    rate = other.speed * math.cos(other.heading - axes[1] - turn) - body.speed * math.cos(body.heading - axes[0] - turn)
    closing = -math.copysign(1.0, signed) * rate
    if not freespace:
        return Between(signed, closing, True)
    own, their = _reach(body, axes[0] + turn), _reach(other, axes[1] + turn)
    if signed >= 0.0:
        return Between(max(signed - own[1] + their[0], 0.0), closing, True)
    return Between(min(signed - own[0] + their[1], -0.0), closing, True)


def _reach(body: Body, axis: float) -> tuple[float, float]:
    """How far the box reaches back and forward of the reference point along an axis [rad]: the first is negative."""
    cos, sin = math.cos(axis), math.sin(axis)
    along = [(x - body.x) * cos + (y - body.y) * sin for x, y in body.box.corners()]
    return min(along), max(along)


def _straight(freespace: bool, body: Body, other: Body) -> Between:
    dx, dy = other.x - body.x, other.y - body.y
    size = math.hypot(dx, dy)
    if size == 0.0:
        return Between(0.0, 0.0, False)
    apart = [one.speed * (math.cos(one.heading) * dx + math.sin(one.heading) * dy) / size for one in (body, other)]
    gap = size
    if freespace:
        gap = 0.0 if overlap(body.box, other.box) else min(_to_box(body.box, other.box), _to_box(other.box, body.box))
    return Between(gap, apart[0] - apart[1], False)


def _to_box(box: Box, other: Box) -> float:
    """Distance from the nearest corner of a box to another box [m]."""
    cos, sin, nearest = math.cos(other.heading), math.sin(other.heading), math.inf
    for x, y in box.corners():
        forward = (x - other.x) * cos + (y - other.y) * sin
        left = (y - other.y) * cos - (x - other.x) * sin
        beyond = max(abs(forward) - 0.5 * other.length, 0.0), max(abs(left) - 0.5 * other.width, 0.0)
        nearest = min(nearest, math.hypot(*beyond))
    return nearest
