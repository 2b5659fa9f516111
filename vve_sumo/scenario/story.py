"""Moves an actor whose actions each have a trigger of their own, as a storyboard of OpenSCENARIO has them.

An actor of a story is there from the start; at the end of its path it stands. Must not know SUMO or files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from vve_sumo.body_kinds import TYPICAL
from vve_sumo.geometry import Box
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.road_users import Actor
from vve_sumo.scenario.story_conditions import Body, Scene, TriggerMonitor
from vve_sumo.scenario.story_schema import LineChange, StoryAction
from vve_sumo.scenario.story_speed import (
    Arriving,
    Change,
    Following,
    Motion,
    Moved,
    Timed,
    change_of,
    profile_of,
)
from vve_sumo.scenario.transitions import Transition, length
from vve_sumo.values import ActorState

#: below this speed a body that goes over sidewards turns less than the way it goes: whoever stands faces on [m/s]
TURNING_SPEED: Final = 2.0
#: from the path's end, an actor that is nearer is there [m]
AT_END: Final = 1e-6


class RunningAction:
    """One action of an actor: waiting, running or ended."""

    def __init__(self, actor: str, action: StoryAction) -> None:
        self.action, self.name = action, f"{actor}.{action.name}"
        self._armed: TriggerMonitor | None = TriggerMonitor(action.armed) if action.armed else None
        self._when = TriggerMonitor(action.when)
        self._until: TriggerMonitor | None = TriggerMonitor(action.until) if action.until else None
        self._left = action.times
        self.state = ""  #: empty before it begins for the first time
        self.parts: set[str] = set()  #: of it that run: "speed", "line"

    def due(self, scene: Scene) -> bool:
        """Return whether it begins at a tick; call it at every tick. One that runs does not begin again."""
        if not self._left:
            return False
        if self._armed is not None:
            if not self._armed.step(scene):
                return False
            self._armed = None
        # The trigger of one that runs is stepped, too: what rises meanwhile does not rise once it is over.
        fires = self._when.step(scene) and self.state != "running"
        self._left -= fires
        return fires

    def stopped(self, scene: Scene) -> bool:
        """Return whether it is stopped for good at a tick; call it at every tick."""
        if self._until is None or not self._until.step(scene):
            return False
        self._left, self._until = 0, None
        return True

    def done(self, part: str) -> None:
        """Take note that a part of it is over."""
        self.parts.discard(part)
        if self.state == "running" and not self.parts:
            self.state = "ended"


class StoryActor:
    """One actor of a story."""

    def __init__(self, actor: Actor, path: ReferencePath, lines: Mapping[str, ReferencePath]) -> None:
        """`path` is the one that it is on at first; `lines` are the paths that its actions name."""
        assert actor.story is not None
        assert actor.at_m is not None
        self.id, self._actor, self._lines = actor.id, actor, lines
        size = TYPICAL[actor.kind]
        self._length = size.length if actor.length_m is None else actor.length_m
        self._width = size.width if actor.width_m is None else actor.width_m
        self._reference = actor.story.reference_m
        self._path, self._s, self._speed = path, actor.at_m, actor.speed_mps
        self._side, self._d, self._rate = Transition(actor.offset_m, actor.offset_m), actor.offset_m, 0.0
        self._side_by_way = False
        self._side_began = self._speed_began = 0.0  # drive time [s], or way gone [m] for a change over a way
        self._motion: Motion | Following = Change([Transition(self._speed, self._speed)])
        self._gone, self._now = 0.0, math.nan
        self.actions = [RunningAction(actor.id, action) for action in actor.story.actions]
        self._of_speed: RunningAction | None = None
        self._of_line: RunningAction | None = None
        self.gone = False  #: whether it left for good

    @property
    def begun(self) -> int:
        """How many of its actions have begun; -1 before it entered."""
        return -1 if math.isnan(self._now) else sum(bool(action.state) for action in self.actions)

    @property
    def at_end(self) -> bool:
        """Whether it is at the end of its path."""
        return self._s >= self._path.length - AT_END

    def depends_on(self) -> set[str]:
        """Return the ids of the actors whose motion its own follows in the same tick."""
        of = {action.action.keeps.to for action in self.actions if action.action.keeps is not None}
        return of | {action.action.speed.of or "" for action in self.actions if action.action.speed is not None}

    def move(self, now: float, scene: Scene) -> None:
        """Advance to a time [s] of the drive."""
        dt = 0.0 if math.isnan(self._now) else now - self._now
        self._now = now
        if dt <= 0.0:
            return
        moved = self._moved(now - self._speed_began, dt, scene)
        self._advance(moved.way)
        self._speed = 0.0 if self.at_end and moved.way >= 0.0 else moved.speed
        if moved.over and self._of_speed is not None:
            self._take(Change([Transition(self._speed, self._speed)]), None)
        self._step_aside(now)

    def _moved(self, time: float, dt: float, scene: Scene) -> Moved:
        if not isinstance(self._motion, Following):
            return self._motion.step(time, dt, self._speed, self._s, scene)
        other = scene.bodies.get(self._motion.other)
        if other is None:
            return Moved(self._speed * dt, self._speed, False)
        foot = self._path.project(other.x, other.y)
        along = other.speed * math.cos(other.heading - foot.heading)
        missing = self._motion.missing(self._s, other, foot.s, other.heading - foot.heading, self._speed)
        return self._motion.follow(missing, self._speed, max(along, 0.0), dt)

    def _advance(self, way: float) -> None:
        """Go a way [m] along the line at the present d: on the inside of a bend that is more of the path."""
        bend = 1.0 - self._d * self._path.at(self._s).curvature
        middle = self._path.at(self._s + 0.5 * way / max(bend, 0.2))
        step = way / max(1.0 - self._d * middle.curvature, 0.2)
        self._s = min(self._s + step, self._path.length)
        self._gone += way

    def _step_aside(self, now: float) -> None:
        gone = (self._gone if self._side_by_way else now) - self._side_began
        self._d, slope = self._side.at(gone)
        self._rate = slope * self._speed if self._side_by_way else slope
        of_line = self._of_line
        if of_line is not None and gone >= self._side.over and not self._on_its_way(of_line):
            of_line.done("line")
            self._of_line = None

    def _on_its_way(self, running: RunningAction) -> bool:
        """Whether an action goes on until a place that the actor has not come to yet."""
        line = running.action.line
        if line is None or line.until_m is None or self.at_end:
            return False
        return self._s < line.until_m - AT_END

    def begin_due(self, scene: Scene) -> list[RunningAction]:
        """Stop what is stopped, begin the actions whose triggers fire at this tick and return these."""
        self.end([running.name for running in self.actions if running.stopped(scene)])
        begun = []
        for running in self.actions:
            if running.due(scene):
                self._begin(running, scene)
                begun.append(running)
        return begun

    def end(self, names: Sequence[str]) -> None:
        """End those of its actions that are named: it keeps the speed and the d that it has."""
        for running in self.actions:
            if running.name in names and running.state == "running":
                if running is self._of_speed:
                    self._take(Change([Transition(self._speed, self._speed)]), None)
                if running is self._of_line:
                    self._keep_aside()
                running.parts.clear()
                running.state = "ended"

    def _begin(self, running: RunningAction, scene: Scene) -> None:
        action = running.action
        running.state = "running"
        self.gone = self.gone or action.leaves
        if action.line is not None:
            running.parts.add("line")
            self._take_line(action.line, running)
        motion = self._motion_of(action, scene)
        if motion is not None:
            running.parts.add("speed")
            self._take(motion, running)
            if isinstance(motion, Following) and motion.at_once:
                self._jump(scene)
        if not running.parts:
            running.state = "ended"

    def _jump(self, scene: Scene) -> None:
        """Be where a distance without limits puts it in the tick in which the action begins."""
        moved = self._moved(0.0, 0.0, scene)
        self._advance(moved.way)
        self._speed = moved.speed
        if moved.over:
            self._take(Change([Transition(self._speed, self._speed)]), None)

    def _motion_of(self, action: StoryAction, scene: Scene) -> Motion | Following | None:
        if action.speed is not None:
            return change_of(action.speed, self._speed, scene)
        if action.profile:
            return profile_of(action.profile, self._speed)
        if action.keeps is not None:
            half = 0.5 * self._length
            return Following(action.keeps, (self._reference - half, self._reference + half))
        if action.meets is not None:
            return Arriving(action.meets)
        return Timed(action.line) if action.line is not None and action.line.timing else None

    def _take(self, motion: Motion | Following, running: RunningAction | None) -> None:
        if self._of_speed is not None and self._of_speed is not running:
            self._of_speed.done("speed")
        self._motion, self._of_speed, self._speed_began = motion, running, self._now
        if isinstance(motion, Change):
            first = motion.start
            self._speed = first.speed
            if first.over and running is not None:
                running.done("speed")
                self._of_speed = None

    def _keep_aside(self) -> None:
        self._side, self._side_by_way, self._rate = Transition(self._d, self._d), False, 0.0
        self._side_began, self._of_line = self._now, None

    def _take_line(self, change: LineChange, running: RunningAction) -> None:
        if self._of_line is not None and self._of_line is not running:
            self._of_line.done("line")
        if change.path is not None:
            self._go_over(change)
        before, target = self._d, change.offset_m
        over = change.over_s or change.over_m or 0.0
        if change.rate_mps is not None:
            over = length(change.shape, target - before, change.rate_mps)
        self._side_by_way = change.over_m is not None
        self._side = Transition(before, target, change.shape, over)
        self._side_began = self._gone if self._side_by_way else self._now
        self._of_line = running
        self._step_aside(self._now)

    def _go_over(self, change: LineChange) -> None:
        """Be on another path from now on: beside it where the actor is, or at a place of it."""
        path = self._lines[change.path or ""]
        x, y, heading = self._spot()
        if change.from_here:
            path = _moved_to(path, x, y, heading)
        foot = path.project(x, y)
        self._path, self._s, self._d = path, min(max(foot.s, 0.0), path.length), foot.d
        if change.at_m is not None:
            self._s = min(change.at_m, path.length)
        elif change.from_here:
            self._s, self._d = 0.0, 0.0

    def _spot(self) -> tuple[float, float, float]:
        """Reference point x, y [m] and heading of the line there [rad]."""
        point = self._path.at(self._s)
        sin, cos = math.sin(point.heading), math.cos(point.heading)
        return point.x - self._d * sin, point.y + self._d * cos, point.heading

    def body(self) -> Body:
        """Return what conditions know of it."""
        x, y, heading = self._spot()
        turn = math.atan2(self._rate, max(self._speed, TURNING_SPEED)) if self._rate else 0.0
        speed = self._speed * math.cos(turn) + self._rate * math.sin(turn)
        heading = math.remainder(heading + turn, math.tau)
        cx, cy = x + self._reference * math.cos(heading), y + self._reference * math.sin(heading)
        return Body(x, y, heading, speed, Box(cx, cy, heading, self._length, self._width))

    def state(self) -> ActorState:
        """Return what radar and contact tests see of it."""
        body = self.body()
        box = body.box
        return ActorState(self.id, self._actor.kind, box.x, box.y, body.heading, body.speed, box.length, box.width)


def _moved_to(path: ReferencePath, x: float, y: float, heading: float) -> ReferencePath:
    """Return a path moved and turned so that it begins at a place with a heading [rad]."""
    start = path.at(0.0)
    turn = heading - start.heading
    cos, sin = math.cos(turn), math.sin(turn)
    points = [
        (x + (px - start.x) * cos - (py - start.y) * sin, y + (px - start.x) * sin + (py - start.y) * cos)
        for px, py in path.points
    ]
    return ReferencePath.from_points([one for one, _ in points], [other for _, other in points])
