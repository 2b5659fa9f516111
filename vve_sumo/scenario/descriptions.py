"""Says in a few words what a scenario's tables say, for lists and pictures. Knows the models alone."""

from __future__ import annotations

from typing import Any, get_origin

from pydantic import BaseModel

from vve_sumo.config_file import alternatives, inside, is_table
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.scenario.road_users import Actor, ActorEvent, When
from vve_sumo.scenario.schema import Criteria, CriterionBand, DeclaredStretch, EgoSettings, Scenario, SensorSettings
from vve_sumo.scenario.story_schema import COMPARED, Groups, StoryAction, StoryCondition

CONDITIONS = {
    "drive_s": "{:g} s into the drive",
    "after_s": "{:g} s later",
    "ego_at_m": "the ego's bumper is at {:g} m",
    "ego_within_m": "the gap is {:g} m",
    "ttc_s": "the time to collision is {:g} s",
    "ego_arrives_in_s": "the ego would be there in {:g} s",
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
    aside = f", {beside(actor.offset_m)}" if actor.offset_m else ""
    return f"enters {place}{aside}{_facing(actor.turned_deg)}" + (
        f", {actor.speed_mps:g} m/s" if actor.speed_mps else ", stands"
    )


def _facing(turned: float) -> str:
    """Return where an actor goes, as an angle to the path [deg], left positive; empty along the path."""
    if turned == 0.0:
        return ""
    return (
        ", against the path"
        if abs(turned) == 180.0
        else f", turned {abs(turned):g}° {'left' if turned > 0.0 else 'right'}"
    )


def action(event: ActorEvent) -> str:
    """Return what an actor does in an event."""
    parts = []
    if event.speed_mps is not None:
        rate = "" if event.acceleration_mps2 is None else f" at {event.acceleration_mps2:g} m/s²"
        rate += f", built up in {event.build_up_s:g} s" if event.build_up_s else ""
        parts.append(f"changes its speed to {event.speed_mps:g} m/s{rate}")
    if event.speeds is not None:
        parts.append(f"drives as recorded in {event.speeds}")
    if event.offset_m is not None:
        over = "" if event.over_s is None else f" in {event.over_s:g} s"
        parts.append(f"goes over to {beside(event.offset_m)}{over}")
    if event.leaves:
        parts.append("leaves")
    return ", ".join(parts) or "goes on"


def trigger(groups: Groups) -> str:
    """Return when a trigger of a story fires; empty where it fires at once."""
    return ", or ".join(" and ".join(map(story_condition, group)) for group in groups)


def story_condition(condition: StoryCondition) -> str:
    """Return what one condition of a story asks for."""
    key, other = condition.asked, condition.to or (f"{condition.at_m:g} m" if condition.at_m is not None else "")
    if condition.actions is not None:
        return f"{', '.join(condition.actions)} {condition.state}"
    wanted = getattr(condition, key)
    of = "the drive" if key == "time_s" else condition.of
    words = f"{of} {label_of(key)}" + (f" to {other}" if other else "")
    if isinstance(wanted, float):
        words += f" {condition.rule if key in COMPARED else 'of'} {wanted:g} {unit_of(key)}"
    return words + (f", {condition.delay_s:g} s before" if condition.delay_s else "")


def story_action(action: StoryAction) -> str:
    """Return what an actor does in an action of its story."""
    parts = []
    if action.speed is not None:
        other = "" if action.speed.of is None else f" beyond {action.speed.factor:g} times that of {action.speed.of}"
        parts.append(f"changes its speed to {action.speed.to_mps:g} m/s{other}, {action.speed.shape}")
    if action.profile:
        parts.append(f"changes its speed piece by piece to {action.profile[-1].speed_mps:g} m/s")
    if action.keeps is not None:
        side = "on either side of" if action.keeps.side == "any" else action.keeps.side
        parts.append(f"takes up a distance {side} {action.keeps.to}")
    if action.meets is not None:
        parts.append("arrives when the ego arrives")
    if action.line is not None:
        path = "" if action.line.path is None else f"the path {action.line.path}, "
        parts.append(f"goes over to {path}{action.line.offset_m:g} m beside it, {action.line.shape}")
    often = f", up to {action.times} times" if action.times > 1 else ""
    return (", ".join([*parts, *(["leaves"] if action.leaves else [])]) or "does nothing") + often


def beside(d: float) -> str:
    """Return where beside the path `d` [m], left positive, is."""
    return f"{abs(d):g} m {'left' if d > 0.0 else 'right'} of the path" if d else "the middle of the path"


def passes(criteria: Criteria) -> str:
    """Return what a drive must come to, in one line."""
    conditions = [] if criteria.outcome is None else [f"outcome {criteria.outcome}"]
    for name, wanted in criteria:
        if isinstance(wanted, CriterionBand):
            conditions.append(f"{label_of(name)} {_between(wanted)} {unit_of(name)}".rstrip())
        elif isinstance(wanted, bool):
            conditions.append(label_of(name) if wanted else f"no {label_of(name)}")
    return ", ".join(conditions) or "not judged"


def _between(band: CriterionBand) -> str:
    if band.min is None:
        return f"at most {band.max:g}" if band.max is not None else "measured"
    return f"at least {band.min:g}" if band.max is None else f"{band.min:g} to {band.max:g}"


def special_conditions(scenario: Scenario) -> list[str]:
    """Return a line for everything besides actors and obstacles that makes the drive another than the usual one."""
    return [
        line
        for line in (
            _fault(scenario),
            *map(_stretch, scenario.ego.corridor),
            _controller(scenario),
            _changed("the radar differs from the usual one", scenario.radar),
            *map(_sensor, scenario.sensors),
            *(f"also measured: {name}" for name in scenario.metrics),
            _changed("the weather", scenario.weather),
            _end(scenario),
            _traffic(scenario),
            _changed("the simulated vehicle differs from the car as declared", scenario.ego.car),
        )
        if line
    ]


def _traffic(scenario: Scenario) -> str:
    if not scenario.road.demand:
        return "no traffic"
    warm_up = f", which drives for {scenario.road.warm_up_s:g} s before" if scenario.road.warm_up_s else ""
    return f"traffic {', '.join(scenario.road.demand)}{warm_up}"


def _controller(scenario: Scenario) -> str:
    control = scenario.controller
    if control == type(control)():
        return ""
    tuned = ", ".join(f"{key} = {value}" for key, value in control.tuning.items())
    return f"controller {control.name}" + (f" with {tuned}" if tuned else "")


def _sensor(one: SensorSettings) -> str:
    stated = ", ".join(f"{label_of(key)} {_value(key, value)}" for key, value in one.settings.items())
    return f"sensor {one.name!r}: {one.kind}" + (f" with {stated}" if stated else "")


def _stretch(room: DeclaredStretch) -> str:
    """Return how far beside a stretch of its path the ego may go."""
    sides = [f"{way:g} m {side}" for way, side in ((room.left_m, "left"), (room.right_m, "right")) if way]
    end = "the path's end" if room.to_m is None else f"{room.to_m:g} m"
    return f"the ego may go up to {' and '.join(sides)} of its path, from {room.from_m:g} m to {end}"


def rolling_start(ego: EgoSettings) -> str:
    """Return with which speed and from where the ego's drive begins; empty where it begins at rest."""
    if ego.initial_speed_mps is None:
        return ""
    return f"begins at {ego.initial_s_m:g} m with {ego.initial_speed_mps:g} m/s"


def ego_speed(ego: EgoSettings) -> str:
    """Return an ego's desired speed and its rolling start."""
    return ", ".join(part for part in (f"{ego.speed_mps:g} m/s", rolling_start(ego)) if part)


def _changed(what: str, table: BaseModel) -> str:
    """Return the values of a table that are not its defaults, after what the table is; empty where all are."""
    usual = type(table)()
    changes = [
        f"{label_of(key)} {_value(key, value)}"
        for key in type(table).model_fields
        if (value := getattr(table, key)) != getattr(usual, key)
    ]
    return f"{what}: {', '.join(changes)}" if changes else ""


def _value(key: str, value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g} {unit_of(key)}".strip() if isinstance(value, float) else str(value)


def _fault(scenario: Scenario) -> str:
    """Return what the gateway stops the car for, where that is not the usual or where it is what the drive is about."""
    limit, due = scenario.ego.deviation_limit_m, scenario.criteria.outcome == "fault"
    usual = type(scenario.ego).model_fields["deviation_limit_m"].default
    if limit == usual and not due:
        return ""
    which = "fault: " if due else ""
    return f"{which}the gateway stops the car where it is more than {limit:g} m off its path"


def _end(scenario: Scenario) -> str:
    """Return when the drive ends before its time."""
    end = scenario.end_trigger
    conditions = ["at the first contact"] if end.contact else []
    conditions += [f"when the ego's bumper is at {end.ego_at_m:g} m"] if end.ego_at_m is not None else []
    if end.lateral_deviation_m is not None:
        conditions.append(f"when the ego is more than {end.lateral_deviation_m:g} m off its path")
    conditions += [f"when the time to collision is below {end.ttc_s:g} s"] if end.ttc_s is not None else []
    conditions += [f"when {trigger(end.when)}"] if end.when else []
    return f"ends {' or '.join(conditions)}" if conditions else ""


def others(scenario: Scenario) -> str:
    """Return who else is on the virtual road: further egos, actors by kind, obstacles, traffic."""
    names = [f"ego {one.id!r}" for one in scenario.egos]
    names += [name(actor) for actor in scenario.actors]
    names += [f"standing {one.id!r}" for one in scenario.obstacles]
    names += [f"traffic {name}" for name in scenario.road.demand]
    return ", ".join(names) or "nobody"
