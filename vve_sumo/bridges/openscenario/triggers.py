"""Triggers of OpenSCENARIO as the triggers of a scenario's stories.

A trigger is a list of groups, a group a list of conditions; [] fires at once, None never. Knows no places but through
what it is handed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from vve_sumo.bridges.openscenario.parameters import RULES, Scope, holds
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element

Condition = dict[str, Any]
Groups = list[list[Condition]]

EDGES: Final = {"none": "none", "rising": "rising", "falling": "falling", "risingOrFalling": "any"}
#: states of elements, and what they are of actions here
STATES: Final = {
    "startTransition": "began",
    "runningState": "running",
    "endTransition": "ended",
    "completeState": "ended",
}
#: groups that a trigger may multiply to where variables and several entities stand in it
MAX_GROUPS: Final = 64


@dataclass(slots=True)
class ElementState:
    """What is known of one element of the storyboard for conditions about it."""

    name: str = ""  #: in the file
    start: Groups | None = field(default_factory=list)  #: that of its act or event; None where it never begins
    started: bool = False  #: whether `start` has been found
    actions: list[str] = field(default_factory=list)  #: in it, ACTOR.NAME
    markers: list[Groups] = field(default_factory=list)  #: triggers of events in it that only set variables
    stop: Groups | None = field(default_factory=list)  #: that stops its act; None where that has not been found
    unknown: str = ""  #: why nobody knows when it ends; empty where it is known
    repeats: bool = False  #: whether something in it is done several times
    outer: tuple[ElementState, ...] = ()  #: what it is in
    waits_for: list[ElementState] = field(default_factory=list)  #: what in it has to be known for its end to be

    def is_in(self, names: Sequence[str]) -> bool:
        """Whether it is in elements of such names, outermost first; there may be others between them."""
        outer = iter(state.name for state in reversed(self.outer))
        return all(name in outer for name in names)

    def begins(self, start: Groups | None) -> None:
        """Take down when it begins."""
        self.start, self.started = start, True


@dataclass(slots=True)
class Context:
    """What conditions may ask for beside their own element."""

    ids: Mapping[str, str]  #: of entities, by their names
    place: Callable[[Element, Scope], tuple[float, float]]  #: of a <Position>: s and d on the ego's path
    elements: dict[tuple[str, str], list[ElementState]]  #: of the storyboard, by type and name
    variables: dict[tuple[str, str], list[tuple[str, Groups | None]]]
    """Values that events set, with their triggers, by kind (variable or parameter) and name of what they set."""
    initial: Mapping[str, str]  #: values of variables at the start
    within: Sequence[ElementState] = ()  #: what the condition that is read is in
    types: Mapping[str, str] = field(default_factory=dict)  #: of entities by their ids: vehicle, pedestrian, …
    changes: bool = False  #: whether the ego's path changes lane or offset

    def element(self, kind: str, name: str, outer: Sequence[str] = ()) -> ElementState | None:
        """Return what a condition means by a name: of several the one that it has most in common with, None for none.

        `outer` are the names of what it is in, as far as the condition states them, outermost first. Raises ValueError
        where two are as near.
        """
        found = [state for state in self.elements.get((kind, name), []) if state.is_in(outer)]
        if len(found) < 2:
            return found[0] if found else None
        near = [sum(any(one is other for other in self.within) for one in (state, *state.outer)) for state in found]
        if near.count(max(near)) > 1:
            raise ValueError(f"several elements {kind} {name!r} are in the storyboard")
        return found[near.index(max(near))]


def compiled(trigger: Element | None, scope: Scope, context: Context) -> Groups | None:
    """Return a trigger's groups; [] fires at once, None never. Raises NotTakenError for what no story can say."""
    groups: Groups = []
    stated = [] if trigger is None else trigger.all("ConditionGroup")
    if not stated:
        return []
    for one in stated:
        alternatives: Groups | None = [[]]
        for condition in one.all("Condition"):
            alternatives = _both(alternatives, _condition(condition, scope, context))
        if alternatives is None:
            continue
        if any(not group for group in alternatives):
            return []
        groups += alternatives
        if len(groups) > MAX_GROUPS:
            raise NotTakenError(one, f"more than {MAX_GROUPS} combinations of conditions")
    return groups or None


def _both(first: Groups | None, second: Groups | None) -> Groups | None:
    if first is None or second is None:
        return None
    if not second:
        return first
    return [[*one, *other] for one in first for other in second]


def _condition(element: Element, scope: Scope, context: Context) -> Groups | None:
    edge, delay = scope.text(element, "conditionEdge", "none"), scope.number(element, "delay", 0.0)
    if edge not in EDGES:
        raise NotTakenError(element, f"conditionEdge: expected {', '.join(EDGES)}, got {edge!r}")
    if delay < 0.0:
        raise NotTakenError(element, f"delay: expected 0 or more, got {delay:g}")
    of_value, of_entity = element.child("ByValueCondition"), element.child("ByEntityCondition")
    if of_value is not None and of_value.children:
        return _by_value(of_value.children[0], scope, context, EDGES[edge], delay)
    if of_entity is None:
        raise NotTakenError(element, "expected a ByValueCondition or a ByEntityCondition")
    return _by_entity(of_entity, scope, context, {"edge": EDGES[edge], "delay_s": delay})


def _short(condition: Condition) -> Condition:
    """Return a condition without the keys that say what is so anyway."""
    usual = {"edge": "none", "delay_s": 0.0, "freespace": False, "rule": ">", "of": "ego"}
    return {key: value for key, value in condition.items() if usual.get(key, ...) != value}


def _rule(element: Element, scope: Scope) -> str:
    rule = scope.text(element, "rule")
    if rule not in RULES:
        raise NotTakenError(element, f"rule: expected {', '.join(RULES)}, got {rule!r}")
    return RULES[rule]


def _by_value(of: Element, scope: Scope, context: Context, edge: str, delay: float) -> Groups | None:
    if of.tag == "SimulationTimeCondition":
        value, rule = scope.number(of, "value"), _rule(of, scope)
        rises = value == 0.0 and rule == ">" and edge in ("rising", "any")
        if delay == 0.0 and (rises or (edge == "none" and value <= 0.0 and rule in (">", ">="))):
            return []  # it holds from the first step after the start on
        return [[_short({"time_s": value, "rule": rule, "edge": edge, "delay_s": delay})]]
    if of.tag == "ParameterCondition":
        return _named_value(of, "parameter", scope, scope.values, context, edge, delay)
    if of.tag == "VariableCondition":
        return _named_value(of, "variable", scope, context.initial, context, edge, delay)
    if of.tag == "StoryboardElementStateCondition":
        return _state(of, scope, context, edge, delay)
    raise NotTakenError(of, "this condition is not taken")


def _at_once(delay: float) -> Groups:
    """Return what holds from the start on, and so much later [s]."""
    return [[{"time_s": delay, "rule": ">="}]] if delay else []


def _named_value(
    of: Element, kind: str, scope: Scope, initial: Mapping[str, str], context: Context, edge: str, delay: float
) -> Groups | None:
    """Return when a parameter or variable is as a condition says; what is so from the start on has no edge."""
    name = scope.text(of, f"{kind}Ref").removeprefix("$")
    rule, wanted = _rule(of, scope), scope.text(of, "value")
    if name not in initial:
        raise NotTakenError(of, f"no {kind} {name!r} is declared")
    later = context.variables.get((kind, name), [])
    if edge in ("falling", "any") and later:
        raise NotTakenError(of, f"the edge {edge!r} of a {kind} that events set is not taken")
    if holds(initial[name], rule, wanted):
        if any(not holds(value, rule, wanted) for value, _ in later):
            raise NotTakenError(of, f"the {kind} {name!r} ceases to meet it")
        return _at_once(delay) if edge == "none" else None
    groups: Groups = []
    for value, trigger in later:
        if trigger is not None and holds(value, rule, wanted):
            groups += latched(of, trigger, delay)
    return groups or None


def latched(of: Element, trigger: Groups, delay: float = 0.0) -> Groups:
    """Return a trigger that holds for good once another has fired, so much later [s]."""
    if not trigger:
        return _at_once(delay)
    if any(len(group) > 1 for group in trigger):
        raise NotTakenError(of, "it depends on an event that several conditions start together")
    return [
        [condition | {"latched": True} | ({"delay_s": condition.get("delay_s", 0.0) + delay} if delay else {})]
        for group in trigger
        for condition in group
    ]


def _state(of: Element, scope: Scope, context: Context, edge: str, delay: float) -> Groups | None:
    kind, state = scope.text(of, "storyboardElementType"), scope.text(of, "state")
    *outer, name = re.split("::|/", scope.text(of, "storyboardElementRef"))
    try:
        known = context.element(kind, name, outer)
    except ValueError as error:
        raise NotTakenError(of, str(error)) from None
    if known is None or state not in STATES:
        what = f"no {kind} {name!r} in the storyboard" if known is None else f"the state {state!r} is not taken"
        raise NotTakenError(of, what)
    if known.start is None:
        return None
    wanted = STATES[state]
    if wanted != "ended":
        if known.actions and kind in ("event", "action"):
            return [[_short({"actions": known.actions, "state": wanted, "edge": edge, "delay_s": delay})]]
        if wanted == "running":
            raise NotTakenError(of, f"the state {state!r} of this {kind} is not taken")
        if not known.started:
            raise NotTakenError(of, f"nobody knows when the {kind} {name!r} begins")
        return latched(of, known.start, delay)
    if unknown := next((one.unknown for one in (known, *known.waits_for) if one.unknown), ""):
        raise NotTakenError(of, unknown)
    if known.repeats and state == "completeState":
        raise NotTakenError(of, f"the {kind} {name!r} repeats: nobody knows when that is over")
    if known.stop is None:
        raise NotTakenError(of, f"nobody knows when the {kind} {name!r} is stopped")
    groups: Groups = [[]]
    if known.actions:
        condition = _short({"actions": known.actions, "edge": edge, "delay_s": delay})
        # Where other events count as well, an edge of this part would be none of the whole.
        groups = [[condition if not known.markers else condition | {"edge": "none"}]]
    for marker in known.markers:
        groups = _both(groups, latched(of, marker, delay)) or []
    return groups + (latched(of, known.stop, delay) if known.stop else [])


def _by_entity(of: Element, scope: Scope, context: Context, when: Condition) -> Groups:
    who, inner = of.child("TriggeringEntities"), of.child("EntityCondition")
    if who is None or inner is None or not inner.children:
        raise NotTakenError(of, "expected TriggeringEntities and an EntityCondition")
    names = [scope.text(one, "entityRef") for one in who.all("EntityRef")]
    by_type = inner.children[0].child("ByType")
    if by_type is not None and inner.children[0].tag == "CollisionCondition":
        return _touching(by_type, [_id(who, name, context) for name in names], scope, context, when)
    asked = _asked(inner.children[0], scope, context)
    conditions = [_short({"of": _id(who, name, context), **asked, **when}) for name in names]
    rule = scope.text(who, "triggeringEntitiesRule")
    if not conditions:
        raise NotTakenError(who, "expected an EntityRef")
    if rule not in ("any", "all"):
        raise NotTakenError(who, f"triggeringEntitiesRule: expected any or all, got {rule!r}")
    if len(conditions) > 1 and when["edge"] != "none":
        raise NotTakenError(who, f"the edge {when['edge']!r} of a condition on several entities is not taken")
    return [conditions] if rule == "all" else [[one] for one in conditions]


def _touching(of: Element, who: list[str], scope: Scope, context: Context, when: Condition) -> Groups:
    """Return the groups of a contact with any entity of a type."""
    wanted = scope.text(of, "type")
    others = [other for other, kind in context.types.items() if kind == wanted]
    pairs = [(one, other) for one in who for other in others if one != other]
    if len(who) > 1 or (len(pairs) > 1 and when["edge"] not in ("none", "rising")):
        raise NotTakenError(of, "a contact of several entities, or the end of one with several, is not taken")
    if not pairs:
        raise NotTakenError(of, f"type: no other entity is a {wanted!r}")
    return [[_short({"of": one, "to": other, "touches": True, **when})] for one, other in pairs]


def _id(element: Element, name: str, context: Context) -> str:
    if name not in context.ids:
        raise NotTakenError(element, f"no entity {name!r}")
    return context.ids[name]


def _to(of: Element, scope: Scope, context: Context) -> Condition:
    return {"to": _id(of, scope.text(of, "entityRef"), context)}


def _at(of: Element, scope: Scope, context: Context) -> Condition:
    position = of.child("Position")
    if position is None:
        raise NotTakenError(of, "expected a <Position>")
    s, d = context.place(position, scope)
    return {"at_m": s, "offset_m": d}


def _asked(of: Element, scope: Scope, context: Context) -> Condition:
    """Return what a condition on an entity asks for."""
    if "direction" in of.attributes:
        # Speeds and accelerations here are along the heading; those of others are not along this one's.
        known = ("longitudinal",) if of.tag in ("SpeedCondition", "AccelerationCondition") else ()
        if (direction := scope.text(of, "direction")) not in known:
            raise NotTakenError(of, f"direction: {direction!r} is not taken")
    if of.tag == "EndOfRoadCondition":
        return {"end_of_road_s": scope.number(of, "duration")}
    if of.tag == "StandStillCondition":
        return {"stands_s": scope.number(of, "duration")}
    if of.tag == "CollisionCondition":
        other = of.child("EntityRef")
        if other is None:
            raise NotTakenError(of, "expected an EntityRef")
        return {"to": _id(of, scope.text(other, "entityRef"), context), "touches": True}
    if of.tag == "SpeedCondition":
        return {"speed_mps": scope.number(of, "value"), "rule": _rule(of, scope)}
    if of.tag == "AccelerationCondition":
        return {"acceleration_mps2": scope.number(of, "value"), "rule": _rule(of, scope)}
    if of.tag == "RelativeSpeedCondition":
        return {"relative_speed_mps": scope.number(of, "value"), "rule": _rule(of, scope), **_to(of, scope, context)}
    if of.tag == "TraveledDistanceCondition":
        return {"travelled_m": scope.number(of, "value"), "rule": ">="}
    if of.tag == "ReachPositionCondition":
        return {"within_m": scope.number(of, "tolerance"), **_at(of, scope, context)}
    return _of_distance(of, scope, context)


def _of_distance(of: Element, scope: Scope, context: Context) -> Condition:
    condition: Condition
    if of.tag in ("TimeHeadwayCondition", "RelativeDistanceCondition"):
        condition = _to(of, scope, context)
    elif of.tag == "DistanceCondition":
        condition = _at(of, scope, context)
    elif of.tag == "TimeToCollisionCondition":
        target = of.child("TimeToCollisionConditionTarget") or of
        other = target.child("EntityRef")
        condition = _at(target, scope, context) if other is None else _to(other, scope, context)
    else:
        raise NotTakenError(of, "this condition is not taken")
    keys = {"TimeHeadwayCondition": "headway_s", "TimeToCollisionCondition": "ttc_s"}
    if context.changes and _axis(of, scope) == "path_lateral":
        raise NotTakenError(of, "a distance across lanes beside an ego that changes its lane or offset is not taken")
    return condition | {
        keys.get(of.tag, "distance_m"): scope.number(of, "value"),
        "rule": _rule(of, scope),
        "freespace": scope.flag(of, "freespace", False),
        "along": _axis(of, scope),
    }


def _axis(of: Element, scope: Scope) -> str:
    """Return along what a distance is measured."""
    if "alongRoute" in of.attributes:
        return "path" if scope.flag(of, "alongRoute", False) else "straight"
    kind = scope.text(of, "relativeDistanceType", "euclidianDistance")
    system = scope.text(of, "coordinateSystem", "entity")
    if system not in ("entity", "lane", "road", "trajectory") or kind not in (
        *("longitudinal", "lateral", "euclidianDistance", "cartesianDistance"),
    ):
        raise NotTakenError(of, f"a distance {kind!r} in the coordinates {system!r} is not taken")
    if kind in ("euclidianDistance", "cartesianDistance"):
        return "straight"
    axis = "heading" if system == "entity" else "path"
    return f"{axis}_lateral" if kind == "lateral" else axis
