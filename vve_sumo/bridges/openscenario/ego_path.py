"""The ego's own lane changes and offsets as part of its path: where each begins, and the line that it leads along.

A path has no time: where a trigger fires is known where it asks for a place of the ego, for what stands, or for a time
while the ego keeps the speed that it begins with. Knows actions, paths and compiled triggers; it must not know the
storyboard.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

from pydantic import ValidationError

from vve_sumo.bridges.openscenario.actions import Stage, read_action
from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.openscenario.road_map import Pose2
from vve_sumo.bridges.openscenario.triggers import Groups
from vve_sumo.bridges.scenario_import.lines import Points, reference
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element
from vve_sumo.geometry import Box
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.story_conditions import Body, Scene, TriggerMonitor
from vve_sumo.scenario.story_schema import StoryCondition
from vve_sumo.scenario.transitions import Transition, length
from vve_sumo.values import EGO

#: what of it may be in a path
CHANGES: Final = ("LaneChangeAction", "LaneOffsetAction")
#: triggers are looked at after each such piece of the path [m]
STEP: Final = 0.1
#: between two points of the path [m]
SPACING: Final = 1.0
#: points of the path are at least so far apart [m]
CLOSEST: Final = 0.3
#: an offset that differs by no more is no change [m]
SAME: Final = 1e-3
#: of a condition: what a place alone decides, and what needs the ego's speed as well
OF_PLACES: Final = frozenset({"travelled_m", "within_m", "distance_m", "touches"})
OF_TIMES: Final = frozenset({"time_s", "headway_s", "ttc_s", "speed_mps", "relative_speed_mps"})
#: speed at which places are looked for where nobody knows the ego's [m/s]; it does not matter which
ANY_SPEED: Final = 10.0


class NominalDrive(NamedTuple):
    """The ego along its path as the file alone has it."""

    path: ReferencePath
    begin: float  #: s of its rear axle at the start [m]
    speed: float | None  #: that it keeps [m/s]; None where the file changes it, or has it begin from rest
    standing: Mapping[str, Body]  #: who never moves, by id
    size: tuple[float, float, float]  #: of the file's ego: length, width, from its rear axle forward to its centre [m]


class PathChange(NamedTuple):
    """A path with a change in it."""

    points: Points
    begin: float  #: s where the change begins [m]
    end: float  #: s where it is over [m]


class EgoPath:
    """The ego's path while its changes are put into it, each after the one before."""

    def __init__(self, stage: Stage, name: str, points: Points, nominal: NominalDrive) -> None:
        """`name` is the ego's in the file; the nominal drive begins on the line of the points."""
        self._stage, self.name = stage, name
        self.points, self.nominal = points, nominal
        self._over = nominal.begin

    def place(self, position: Element, scope: Scope) -> tuple[float, float]:
        """Return s and d [m] of a <Position> on the path; raises NotTakenError for one off its ends."""
        there = self._stage.places.spot(position, scope).pose
        path = self.nominal.path
        foot = path.project(there.x, there.y)
        if not -1.0 <= foot.s <= path.length + 1.0:
            raise NotTakenError(position, "a place behind or beyond the ego's path is not taken")
        return round(foot.s, 4), round(foot.d, 4) + 0.0

    def with_change(self, kind: Element, scope: Scope, begin: float) -> tuple[EgoPath, PathChange]:
        """Return the path with a change that begins at s [m] in it; raises NotTakenError for what is no path.

        The stage has the ego where it is after the change then.
        """
        if begin < self._over - SAME:
            raise NotTakenError(kind, "the ego's change of lane or offset begins before the one before it is over")
        before = self._stage.track(kind, self.name)
        try:
            action = read_action(kind, scope, self.name, self._stage) or {}
            onto = reference(self._stage.tracks[self.name].points, kind)
            made = changed_path(self.nominal, onto, begin, action["line"], kind)
            path = reference(made.points, kind)
        except NotTakenError:
            self._stage.tracks[self.name] = before
            raise
        start = self.nominal.path.at(self.nominal.begin)
        foot = path.project(start.x, start.y, self.nominal.begin)
        changed = EgoPath(self._stage, self.name, made.points, self.nominal._replace(path=path, begin=foot.s))
        changed._over = made.end
        return changed, made


def fires_at(armed: Groups, when: Groups, nominal: NominalDrive, of: Element) -> float:
    """Return s [m] of the ego's rear axle where a trigger fires, once the one of its act has; infinity for nowhere.

    Raises NotTakenError naming the element where that depends on who moves, or on a speed that nobody knows.
    """
    for condition in itertools.chain(*armed, *when):
        _decided(condition, nominal, of)
    first = TriggerMonitor(_parsed(armed, of)) if armed else None
    second = TriggerMonitor(_parsed(when, of))
    for scene in _scenes(nominal):
        if first is not None:
            if not first.step(scene):
                continue
            first = None
        if second.step(scene):
            return nominal.begin + scene.bodies[EGO].travelled
    return math.inf


def _decided(condition: Mapping[str, Any], nominal: NominalDrive, of: Element) -> None:
    """Raise NotTakenError where the nominal drive alone does not decide a condition."""
    asked = next((key for key in condition if key in OF_PLACES | OF_TIMES), None)
    known = {EGO, *nominal.standing}
    who = {condition.get("of", EGO), condition.get("to", EGO)}
    if asked is None or (asked != "time_s" and not who <= known):
        raise NotTakenError(of, "the ego's path is fixed: where this begins depends on who moves, or on a controller")
    if nominal.speed is None and (asked in OF_TIMES or condition.get("delay_s") or condition.get("from_s")):
        raise NotTakenError(of, "the ego's path is fixed: nobody knows where the ego is when this begins")


def body_at(pose: Pose2, size: tuple[float, float, float]) -> Body:
    """Return a body that stands with its reference point at a pose; its size as in `NominalDrive`."""
    x, y = pose.x + size[2] * math.cos(pose.heading), pose.y + size[2] * math.sin(pose.heading)
    return Body(pose.x, pose.y, pose.heading, 0.0, Box(x, y, pose.heading, size[0], size[1]))


def _parsed(groups: Groups, of: Element) -> tuple[tuple[StoryCondition, ...], ...]:
    try:
        return tuple(tuple(StoryCondition.model_validate(one) for one in group) for group in groups)
    except ValidationError as error:
        first = error.errors()[0]
        raise NotTakenError(of, f"its trigger: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None


def _scenes(nominal: NominalDrive) -> Iterator[Scene]:
    speed = nominal.speed or ANY_SPEED
    for n in itertools.count():
        way = n * STEP
        if nominal.begin + way > nominal.path.length:
            return
        at = nominal.path.at(nominal.begin + way)
        body = body_at(Pose2(at.x, at.y, at.heading), nominal.size)._replace(speed=speed, travelled=way)
        yield Scene(way / speed, {EGO: body, **nominal.standing}, nominal.path, {})


def changed_path(
    nominal: NominalDrive, onto: ReferencePath, begin: float, change: Mapping[str, Any], of: Element
) -> PathChange:
    """Return the path that leaves that of a nominal drive at `begin` [m] and goes over beside another line.

    `change` is that of a story's `line`: `offset_m` beside the line, by `shape` in `over_s`, `over_m` or `rate_mps`.
    Raises NotTakenError where it is a jump, and where it takes a time at a speed that nobody knows.
    """
    start = nominal.path.at(begin)
    foot = onto.project(start.x, start.y)
    over = _way(change, change["offset_m"] - foot.d, nominal.speed, of)
    shift = Transition(foot.d, change["offset_m"], change.get("shape", "step"), over)
    points = [nominal.path.at(n * SPACING)[:2] for n in range(math.floor(begin / SPACING) + 1)]
    s, end, last = foot.s, begin, (start.x, start.y)
    for gone, step in _pieces(over):
        d = shift.at(gone)[0]
        at = onto.at(s)
        here = at.x - d * math.sin(at.heading), at.y + d * math.cos(at.heading)
        end += math.dist(here, last) if gone <= over else 0.0
        if math.dist(here, points[-1]) >= CLOSEST:
            points.append(here)
        # On the inside of a bend, a metre is more of the line.
        s, last = s + step / max(1.0 - d * at.curvature, 0.2), here
        if s > onto.length:
            break
    return PathChange(points, begin, end)


def _pieces(over: float) -> Iterator[tuple[float, float]]:
    """Yield ways [m] from 0 on, each with the step to the next; one of them is `over`."""
    count = math.ceil(over / SPACING)
    yield from ((over * n / count, over / count) for n in range(count))
    yield from ((over + n * SPACING, SPACING) for n in itertools.count())


def _way(change: Mapping[str, Any], size: float, speed: float | None, of: Element) -> float:
    """Return the way that a change takes [m]; 0 where nothing changes."""
    if abs(size) <= SAME:
        return 0.0
    if "over_m" in change:
        return float(change["over_m"])
    if "shape" not in change:
        raise NotTakenError(of, "the ego cannot jump sidewards: a step is not taken")
    if speed is None:
        raise NotTakenError(of, "it takes a time in which nobody knows how far the ego goes: state it as a distance")
    time = change["over_s"] if "over_s" in change else length(change["shape"], size, change["rate_mps"])
    return float(time) * speed
