"""All actors of a scenario that have stories, tick by tick: who moves first, what fires, whether the drive ends.

Pure: it is told the ego's pose and the other actors. Must not know SUMO or files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from vve_sumo.geometry import Box, behind_bumper
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.road_users import Actor
from vve_sumo.scenario.story import StoryActor
from vve_sumo.scenario.story_conditions import Body, BodyHistory, Scene, TriggerMonitor
from vve_sumo.scenario.story_schema import Groups
from vve_sumo.values import EGO, ActorState, Pose, Vehicle


class StoryStage:
    """The actors of stories, and the trigger that ends the drive."""

    def __init__(
        self,
        actors: Sequence[Actor],
        path: ReferencePath,
        lines: Mapping[str, ReferencePath],
        vehicle: Vehicle,
        end: Groups = (),
    ) -> None:
        """`path` is the ego's, `lines` what the actors' names of paths mean, `end` the trigger that ends the drive."""
        self.actors = {one.id: StoryActor(one, path if one.path is None else lines[one.path], lines) for one in actors}
        self._order = _dependents_last(list(self.actors.values()))
        self._path, self._vehicle = path, vehicle
        self._end = TriggerMonitor(end) if end else None
        self._histories: dict[str, BodyHistory] = {}
        self._bodies: dict[str, Body] = {}
        self._states: dict[str, str] = {}
        self._now = -math.inf
        self.ended = False  #: whether that trigger has fired

    @property
    def watches(self) -> bool:
        """Whether there is anything to step."""
        return bool(self.actors) or self._end is not None

    def step(self, now: float, pose: Pose | None, others: Sequence[ActorState]) -> list[ActorState]:
        """Advance to a time [s] of the drive and return the actors of stories that are on the virtual road.

        `pose` is that of the ego's front bumper, None where nobody knows it; `others` are the actors without a story.
        A time that is not later than the last moves nobody and fires nothing.
        """
        there = [one for one in self._order if not one.gone]
        if now > self._now:
            self._now = now
            self._take_in(now, pose, others)
            for one in there:
                one.move(now, self._scene(now))
                self._follow(now, one)
            self._fire(now, there)
        return [one.state() for one in self.actors.values() if not one.gone]

    def _take_in(self, now: float, pose: Pose | None, others: Sequence[ActorState]) -> None:
        known = {one.id: Body(*_of_state(one)) for one in others}
        if pose is not None:
            known[EGO] = _of_ego(pose, self._vehicle)
        self._bodies = {name: body for name, body in self._bodies.items() if name in self.actors}
        for name, body in known.items():
            at_end = name == EGO and self._path.project(body.x, body.y).s >= self._path.length
            self._bodies[name] = self._histories.setdefault(name, BodyHistory()).follow(now, body, at_end)

    def _follow(self, now: float, one: StoryActor) -> None:
        history = self._histories.setdefault(one.id, BodyHistory())
        self._bodies[one.id] = history.follow(now, one.body(), one.at_end)

    def _fire(self, now: float, there: Sequence[StoryActor]) -> None:
        """Begin what is due, end what that ends, and look whether the drive is over."""
        scene = self._scene(now)
        for one in there:
            for running in one.begin_due(scene):
                for other in there:
                    other.end([name for name in running.action.ends if name != running.name])
            self._follow(now, one)
            if one.gone:
                del self._bodies[one.id]
        self._states = {
            running.name: running.state for one in self.actors.values() for running in one.actions if running.state
        }
        if self._end is not None and not self.ended:
            self.ended = self._end.step(self._scene(now))

    def _scene(self, now: float) -> Scene:
        return Scene(now, self._bodies, self._path, self._states)


def _dependents_last(actors: list[StoryActor]) -> tuple[StoryActor, ...]:
    """Return the actors so that whoever follows another moves after that one; a circle stays in the file's order."""
    placed: list[StoryActor] = []
    waiting = list(actors)
    while waiting:
        names = {one.id for one in waiting}
        free = next((one for one in waiting if not one.depends_on() & (names - {one.id})), waiting[0])
        waiting.remove(free)
        placed.append(free)
    return tuple(placed)


def _of_state(state: ActorState) -> tuple[float, float, float, float, Box]:
    box = Box(state.x, state.y, state.heading, state.length, state.width)
    return state.x, state.y, state.heading, state.speed, box


def _of_ego(pose: Pose, vehicle: Vehicle) -> Body:
    """Return the ego by the pose of its front bumper; its reference point is its rear axle."""
    x = pose.x - vehicle.rear_axle_to_bumper * math.cos(pose.heading)
    y = pose.y - vehicle.rear_axle_to_bumper * math.sin(pose.heading)
    box = behind_bumper(pose.x, pose.y, pose.heading, vehicle.length, vehicle.width)
    return Body(x, y, pose.heading, pose.speed, box)
