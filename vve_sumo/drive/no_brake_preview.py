"""Previews a scenario whose ego never brakes for an actor: the actors' events, and what the ego would hit.

Plays the scenario's actors against an ego that keeps to its path and desired speed, slowing for bends alone. Knows no
SUMO, no traffic and no vehicle dynamics.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.virtual_road import obstacle_position, scenario_engine
from vve_sumo.geometry import Box, behind_bumper, overlap
from vve_sumo.laws import squared_speed_limits
from vve_sumo.path import SAMPLE_SPACING, ReferencePath
from vve_sumo.timing import PERIOD
from vve_sumo.values import ActorState, Point, Pose

#: the shipped controller's accelerations on a free road: speeding up, slowing for bends, lateral in bends [m/s2]
ACCELERATION, BRAKING, LATERAL_ACCELERATION = 1.5, 1.5, 2.0
#: time by which the preview goes on after the first contact [s]
TIME_AFTER_CONTACT = 1.0


class TriggeredEvent(NamedTuple):
    """An actor that enters after the start, or begins an event."""

    actor: int  #: the actor's number in the scenario
    number: int  #: the event's number, -1 for entering
    time: float  #: since the drive began [s]
    ego: Box  #: where the ego is then
    s: float  #: of the ego's front bumper [m]
    actor_state: ActorState  #: where the actor is then


class Contact(NamedTuple):
    """The first obstacle or actor that an ego that never brakes touches."""

    id: str  #: of the obstacle or actor
    time: float  #: since the drive began [s]
    ego: Box
    s: float  #: of the ego's front bumper [m]
    actor_state: ActorState | None  #: None for an obstacle


class PreviewSample(NamedTuple):
    """One moment of the preview."""

    time: float  #: since the drive began [s]
    ego: Box
    s: float  #: of the ego's front bumper [m]
    speed: float  #: of the ego [m/s]
    actors: tuple[ActorState, ...]


@dataclass(frozen=True, slots=True)
class NoBrakePreview:
    """How a scenario goes with an ego that never brakes for an actor."""

    samples: Sequence[PreviewSample]  #: one every PERIOD
    events: Sequence[TriggeredEvent]  #: until the contact
    contact: Contact | None


def preview_without_braking(resolved: ResolvedScenario) -> NoBrakePreview:
    """Play a scenario without traffic against an ego that keeps its speed.

    The preview ends with the scenario, or TIME_AFTER_CONTACT after a contact.
    """
    engine, begun = scenario_engine(resolved), [-1] * len(resolved.scenario.actors)
    boxes = obstacle_boxes(resolved)
    samples: list[PreviewSample] = []
    events: list[TriggeredEvent] = []
    contact: Contact | None = None
    for time, ego, pose, s in _ego(resolved):
        actors = engine.step(time, pose)
        samples.append(PreviewSample(time, ego, s, pose.speed, actors))
        if contact is None:
            events += _events(resolved, begun, engine.begun, samples[-1])
            contact = _contact(samples[-1], boxes)
        begun = list(engine.begun)
        if contact is not None and time > contact.time + TIME_AFTER_CONTACT:
            break
    return NoBrakePreview(samples, events, contact)


def obstacle_boxes(resolved: ResolvedScenario) -> dict[str, Box]:
    """Return the box of each of the scenario's obstacles, by id."""
    placed = {}
    for one in resolved.scenario.obstacles:
        at = obstacle_position(one, resolved.path)
        placed[one.id] = Box(at.x, at.y, at.heading, one.length_m, one.width_m)
    return placed


def _ego(resolved: ResolvedScenario) -> Iterator[tuple[float, Box, Pose, float]]:
    """Yield time, box, pose of the front bumper and its s, from the start, at rest or rolling, to the drive's end."""
    path, car, scenario = resolved.path, resolved.vehicle, resolved.scenario
    limits = _limits(path)
    end = (
        path.length
        if scenario.end_trigger.ego_at_m is None
        else scenario.end_trigger.ego_at_m - car.rear_axle_to_bumper
    )
    s, speed, tick = scenario.ego.initial_s_m, scenario.ego.initial_speed_mps or 0.0, 0
    while s < min(end, path.length) and tick * PERIOD < scenario.duration_s:
        at = path.at(s)
        x = at.x + car.rear_axle_to_bumper * math.cos(at.heading)
        y = at.y + car.rear_axle_to_bumper * math.sin(at.heading)
        pose = Pose(tick * PERIOD, Point.FRONT_BUMPER, x, y, at.heading, speed, 0.0, speed * at.curvature, 0.0, 0.0)
        bumper = path.project(x, y, s + car.rear_axle_to_bumper).s
        yield tick * PERIOD, behind_bumper(x, y, at.heading, car.length, car.width), pose, bumper
        allowed = min(scenario.ego.speed_mps, limits[min(int(s / SAMPLE_SPACING), len(limits) - 1)])
        speed = min(speed + ACCELERATION * PERIOD, allowed)
        s, tick = s + speed * PERIOD, tick + 1


def _limits(path: ReferencePath) -> list[float]:
    """Return the greatest speed [m/s] at every SAMPLE_SPACING of the path, by LATERAL_ACCELERATION and BRAKING."""
    bends = [path.at(number * SAMPLE_SPACING).curvature for number in range(int(path.length / SAMPLE_SPACING) + 1)]
    return [
        math.sqrt(v2) for v2 in squared_speed_limits(bends, math.inf, LATERAL_ACCELERATION, BRAKING, SAMPLE_SPACING)
    ]


def _events(
    resolved: ResolvedScenario, before: Sequence[int], after: Sequence[int], moment: PreviewSample
) -> Iterator[TriggeredEvent]:
    here = {state.id: state for state in moment.actors}
    for number, actor in enumerate(resolved.scenario.actors):
        if actor.story is not None:
            continue  # its actions begin in any order: how many have begun says not which
        for event in range(before[number], after[number]):
            actor_state = here.get(actor.id)
            if actor_state is not None and (event >= 0 or moment.time > 0.0):
                yield TriggeredEvent(number, event, moment.time, moment.ego, moment.s, actor_state)


def _contact(moment: PreviewSample, boxes: dict[str, Box]) -> Contact | None:
    for name, box in boxes.items():
        if overlap(moment.ego, box):
            return Contact(name, moment.time, moment.ego, moment.s, None)
    for actor in moment.actors:
        if overlap(moment.ego, Box(actor.x, actor.y, actor.heading, actor.length, actor.width)):
            return Contact(actor.id, moment.time, moment.ego, moment.s, actor)
    return None
