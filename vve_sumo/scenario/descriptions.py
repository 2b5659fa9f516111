"""Says in a few words what a scenario's tables say, for lists and pictures. Knows the models alone."""

from __future__ import annotations

from typing import Any, get_origin

from vve_sumo.config_file import alternatives, inside, is_table
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.scenario.schema import Actor, Band, Criteria, Event, Scenario, When

CONDITIONS = {
    "drive_s": "{:g} s into the drive",
    "after_s": "{:g} s later",
    "ego_at_m": "the ego's bumper is at {:g} m",
    "ego_within_m": "the gap is {:g} m",
    "ttc_s": "the time to collision is {:g} s",
    "ego_arrives_in_s": "the ego is {:g} s away",
    "ego_speed_mps": "the ego drives {:g} m/s",
}


def meaning_of_key(key: str) -> str:
    """Return what the value at a scenario's dotted key means; empty for what no table of a scenario describes.

    A part of the key that names a table of an array may be any name.
    """
    kinds: list[Any] = [Scenario]
    meaning = ""
    for part in key.split("."):
        fields = [kind.model_fields[part] for kind in kinds if is_table(kind) and part in kind.model_fields]
        meaning = next((field.description for field in fields if field.description), "")
        in_array = any(get_origin(kind) is tuple for kind in kinds)
        kinds = list(alternatives(one for kind in kinds for one in inside(kind, 0 if in_array else part)))
    return meaning


def condition(when: When) -> str:
    """Return when a trigger fires; empty where it fires at once."""
    return " and ".join(
        words.format(wanted) for key, words in CONDITIONS.items() if (wanted := getattr(when, key)) is not None
    )


def name(actor: Actor) -> str:
    """Return what an actor is called beside others."""
    return actor.id if actor.id == actor.kind else f"{actor.kind} {actor.id!r}"


def entrance(actor: Actor) -> str:
    """Return where and how fast an actor enters."""
    place = f"at {actor.at_m:g} m" if actor.at_m is not None else f"{actor.ahead_m:g} m ahead"
    beside = f", {_beside(actor.offset_m)}" if actor.offset_m else ""
    return f"enters {place}{beside}" + (f", {actor.speed_mps:g} m/s" if actor.speed_mps else ", stands")


def action(event: Event) -> str:
    """Return what an actor does in an event."""
    said = []
    if event.speed_mps is not None:
        rate = "" if event.acceleration_mps2 is None else f" at {event.acceleration_mps2:g} m/s²"
        said.append(f"changes its speed to {event.speed_mps:g} m/s{rate}")
    if event.speeds is not None:
        said.append(f"drives as recorded in {event.speeds}")
    if event.offset_m is not None:
        over = "" if event.over_s is None else f" in {event.over_s:g} s"
        said.append(f"goes over to {_beside(event.offset_m)}{over}")
    if event.leaves:
        said.append("leaves")
    return ", ".join(said) or "goes on"


def _beside(offset: float) -> str:
    return (
        f"{abs(offset):g} m {'left' if offset > 0.0 else 'right'} of the path" if offset else "the middle of the path"
    )


def passes(criteria: Criteria) -> str:
    """Return what a drive must come to, in one line."""
    said = [] if criteria.outcome is None else [f"outcome {criteria.outcome}"]
    for name, wanted in criteria:
        if isinstance(wanted, Band):
            said.append(f"{label_of(name)} {_between(wanted)} {unit_of(name)}".rstrip())
        elif isinstance(wanted, bool):
            said.append(label_of(name) if wanted else f"no {label_of(name)}")
    return ", ".join(said) or "not judged"


def _between(band: Band) -> str:
    if band.min is None:
        return f"at most {band.max:g}" if band.max is not None else "measured"
    return f"at least {band.min:g}" if band.max is None else f"{band.min:g} to {band.max:g}"


def others(scenario: Scenario) -> str:
    """Return who else is on the street: actors by kind, obstacles, traffic."""
    said = [name(actor) for actor in scenario.actors]
    said += [f"standing {one.id!r}" for one in scenario.obstacles]
    said += [f"traffic {name}" for name in scenario.road.demand]
    return ", ".join(said) or "nobody"
