"""Finds the stretch of a scenario's path that the meeting with an obstacle or actor takes, from rest on.

Knows scenarios and how they go without braking; no lot, no geofence and no rig.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, NamedTuple

from vve_sumo.drive.no_brake_preview import ACCELERATION, BRAKING, NoBrakePreview, preview_without_braking
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.errors import ConfigError, did_you_mean
from vve_sumo.scenario.part import bound_to_the_start

#: driven at speed before the meeting begins: the speed's controller has settled, and its jerk has built up [s]
SETTLING_TIME: Final = 1.5
#: kept by a car that stops for what it meets [m]; the shipped controllers' gap
STANDOFF: Final = 5.0
#: of path behind what is met [m]
RUN_ON: Final = 2.0
#: what stands so near behind the end of a stretch belongs to the meeting, such as a car that hides a child [m]
VICINITY: Final = 8.0


class EventStretch(NamedTuple):
    """The part of a path on which the ego, from rest, gets to speed and meets an obstacle or actor."""

    event: str  #: id of the obstacle or actor
    begin: float  #: where the rear axle stands at the start, along the whole path [m]
    end: float  #: where the part ends, for the rear axle [m]; beyond it only stopping room is needed
    meeting: float  #: where the front bumper is when the meeting begins: a trigger fires, or braking has to begin [m]
    at_speed: bool  #: whether the path has the room to get to speed before the meeting begins
    contact: bool  #: whether an ego that never brakes touches it


def events_of(resolved: ResolvedScenario) -> tuple[str, ...]:
    """Return the ids of a scenario's obstacles and actors, those of actors first: they are what is met."""
    scenario = resolved.scenario
    return (*(one.id for one in scenario.actors), *(one.id for one in scenario.obstacles))


def main_event(resolved: ResolvedScenario) -> str | None:
    """Return whom an ego that never brakes touches first, or else the first actor or obstacle; None for nobody."""
    contact, known = preview_without_braking(resolved).contact, events_of(resolved)
    return contact.id if contact is not None else next(iter(known), None)


def refuse_event(resolved: ResolvedScenario, event: str) -> None:
    """Raise ConfigError where a scenario has no obstacle and no actor of this id."""
    known = events_of(resolved)
    if event not in known:
        near = did_you_mean(event, known) or f"there are {', '.join(known) or 'none'}"
        raise ConfigError(f"{resolved.file}: no obstacle and no actor {event!r}, {near}")


def event_stretch(resolved: ResolvedScenario, event: str) -> EventStretch:
    """Return the stretch of the meeting with the obstacle or actor `event` at the scenario's speed.

    Of an obstacle the meeting begins where a car that stops for it with BRAKING has to begin; of an actor where its
    first trigger fires, if that is sooner. The stretch ends where an ego that never brakes would touch it, a little
    beyond, or with the corridor around that place. Where an actor's motion counts from the drive's start, the stretch
    begins with the path. Raises ConfigError as `refuse_event`, and for an actor that the ego never comes to.
    """
    refuse_event(resolved, event)
    scenario, car, speed = resolved.scenario, resolved.vehicle, resolved.scenario.ego.speed_mps
    meeting, end, contact = _of_obstacle(resolved, event) or _of_actor(resolved, event)
    end = max([end, *(at for at in _standing(resolved) if end < at <= end + VICINITY)])
    axle = meeting - car.rear_axle_to_bumper - SETTLING_TIME * speed
    approach = 0.5 * speed * speed / ACCELERATION
    begin = axle - approach
    for one in resolved.corridor:
        if one.begin < end and one.end > begin:
            begin, end = min(begin, one.begin), max(end, one.end)
    at_speed = begin >= 0.0
    if any(bound_to_the_start(actor) for actor in scenario.actors):
        begin, at_speed = 0.0, True
    return EventStretch(event, max(begin, 0.0), min(end, resolved.path.length), meeting, at_speed, contact)


def _braking_begins(resolved: ResolvedScenario, touched: float) -> float:
    """Return where the front bumper is when a car has to begin to brake that stops before `touched` [m]."""
    speed = resolved.scenario.ego.speed_mps
    return touched - STANDOFF - 0.5 * speed * speed / BRAKING


def _standing(resolved: ResolvedScenario) -> list[float]:
    """Return where whoever stands beside or on the path is behind with [m]."""
    return [one.at_m + 0.5 * one.length_m for one in resolved.scenario.obstacles]


def _of_obstacle(resolved: ResolvedScenario, event: str) -> tuple[float, float, bool] | None:
    """Return where the meeting with an obstacle begins and the path may end, and whether it is touched.

    None for who is no obstacle.
    """
    found = next((one for one in resolved.scenario.obstacles if one.id == event), None)
    if found is None:
        return None
    half = 0.5 * found.length_m
    return _braking_begins(resolved, found.at_m - half), found.at_m + half + RUN_ON, _in_the_way(resolved, event)


def _of_actor(resolved: ResolvedScenario, event: str) -> tuple[float, float, bool]:
    """Return where the meeting with an actor begins and the path may end, and whether it is touched."""
    preview = preview_without_braking(_alone(resolved, event))
    found = _touched(preview, event)
    if found is None:
        raise ConfigError(f"{resolved.file}: the ego never comes to actor {event!r} on its path; name another event")
    touched, length = found
    triggers = [one.s for one in preview.events]
    meeting = min([*triggers, _braking_begins(resolved, touched)])
    # An actor leaves the road at the end of its path: the whole of it has to be on it when it is touched.
    return meeting, max([touched + length, *triggers]) + RUN_ON, preview.contact is not None


def _in_the_way(resolved: ResolvedScenario, obstacle: str) -> bool:
    """Return whether a car that keeps to the path touches an obstacle."""
    found = next(one for one in resolved.scenario.obstacles if one.id == obstacle)
    reach = 0.5 * (found.length_m * abs(math.sin(math.radians(found.turned_deg))) + found.width_m)
    return abs(found.offset_m) < reach + 0.5 * resolved.vehicle.width


def _alone(resolved: ResolvedScenario, event: str) -> ResolvedScenario:
    """Return the scenario with one actor alone, for whom nothing that stands before it ends the preview."""
    scenario = resolved.scenario
    actors = tuple(one for one in scenario.actors if one.id == event)
    ends = scenario.end_trigger.model_copy(update={"ego_at_m": None})
    alone = {"actors": actors, "obstacles": (), "end_trigger": ends}
    return replace(resolved, scenario=scenario.model_copy(update=alone))


def _touched(preview: NoBrakePreview, event: str) -> tuple[float, float] | None:
    """Return where the front bumper touches an actor, or else is nearest to it, and the actor's length [m]."""
    contact = preview.contact
    if contact is not None and contact.actor_state is not None:
        return contact.s, contact.actor_state.length
    nearest: tuple[float, float, float] | None = None
    for sample in preview.samples:
        for actor in sample.actors:
            if actor.id == event:
                apart = (actor.x - sample.ego.x) ** 2 + (actor.y - sample.ego.y) ** 2
                if nearest is None or apart < nearest[0]:
                    nearest = apart, sample.s, actor.length
    return None if nearest is None else nearest[1:]
