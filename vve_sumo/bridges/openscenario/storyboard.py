"""The storyboard of a scenario: which event does what when, as actions of the actors' stories.

Knows events, their triggers, actions and places; it must not know files that are written.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

from vve_sumo.bridges.openscenario.actions import (
    LEADING_OFF,
    PATHS,
    Action,
    Stage,
    kind_of,
    longitudinal,
    read_action,
)
from vve_sumo.bridges.openscenario.document import Document
from vve_sumo.bridges.openscenario.ego_path import CHANGES, EgoPath, NominalDrive, PathChange, fires_at
from vve_sumo.bridges.openscenario.entities import slug
from vve_sumo.bridges.openscenario.events import (
    Event,
    EventReader,
    element_state,
    goes_on,
    private_kind,
    variable_actions,
)
from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.openscenario.story_triggers import StoryTriggers
from vve_sumo.bridges.openscenario.triggers import Context, ElementState, Groups
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError, Problems
from vve_sumo.bridges.scenario_import.xml_tree import Element
from vve_sumo.values import EGO

OVERRIDING: Final = ("override", "overwrite")
#: how often an event is done at most: who states more, or -1, means always
MOST_TIMES: Final = 1000


class Storyboard:
    """Reads a storyboard into the actions of each entity's story, and the trigger that ends the drive."""

    def __init__(self, document: Document, stage: Stage, context: Context, problems: Problems) -> None:
        self._document, self._stage, self._context, self._problems = document, stage, context, problems
        self.stories: dict[str, list[Action]] = {name: [] for name in stage.ids}  #: by entity's name
        self._events = list(EventReader(document, context, problems).read())
        self._triggers = StoryTriggers(document, context, problems)
        self._last: dict[str, float] = {}  #: when each actor last went elsewhere, as far as times say so [s]

    def at_once(self, who: str) -> Iterator[tuple[Element, Scope]]:
        """Yield what says where an entity goes, and begins as the drive does: part of the start as much as Init is."""
        for event in self._events:
            if who not in event.actors:
                continue
            try:
                private = [one for one in event.actions if one.child("PrivateAction") is not None]
                kinds = [kind for one in private if (kind := kind_of(one.children[0])).tag in PATHS]
                begins = bool(kinds) and self._triggers.starts(event) == ([], [])
            except NotTakenError:
                continue
            timed = [kind for kind in kinds if kind.child("TimeReference", "Timing") is not None]
            yield from ((kind, event.scope) for kind in kinds if begins and not timed)

    @property
    def actors(self) -> set[str]:
        """The names of all entities that the story has do anything."""
        return {actor for event in self._events for actor in event.actors}

    def doing(self, who: str) -> Iterator[tuple[Event, Element]]:
        """Yield what the story has an entity do, with the event of each."""
        for event in self._events:
            for one in event.actions if who in event.actors else ():
                if (kind := private_kind(one)) is not None:
                    yield event, kind

    def change_path(self, path: EgoPath) -> EgoPath:
        """Return the ego's path with the changes of the storyboard in it.

        The stage's `refused_changes` say why others are not. Use a storyboard of its own for that: it knows nothing of
        what others do.
        """
        for event in self._events:
            self._name_actions(event)
            if path.name in event.actors or any(one.child("PrivateAction") is None for one in event.actions):
                event.states[0].unknown = f"nobody knows when {event.where} is over"
                for state in event.states[1:]:
                    state.waits_for.append(event.states[0])
        for event in self._events:
            self._markers(event)
        for event, kind in self.doing(path.name):
            try:
                path = self._with_change(path, event, kind) if kind.tag in CHANGES else path
            except NotTakenError as error:
                self._stage.refused_changes[event.maneuver, id(kind)] = error
        return path

    def _with_change(self, path: EgoPath, event: Event, kind: Element) -> EgoPath:
        self._on(path)
        armed, when = self._triggers.starts(event)
        if armed is None or when is None:
            return path  # it never begins
        if event.times > 1:
            raise NotTakenError(kind, "a change of lane or offset of the ego that repeats is not taken")
        begin = fires_at(armed, when, path.nominal, kind)
        if begin == math.inf:
            raise NotTakenError(kind, "at the ego's speed at the start it begins nowhere on the ego's path")
        before, key = self._stage.tracks[path.name], (event.maneuver, id(kind))
        changed, made = path.with_change(kind, event.scope, begin)
        self._stage.path_changes[key] = begin - path.nominal.begin, made.end - path.nominal.begin
        self._stage.decided.append((armed, when, path.nominal.speed))
        self._known_by_place(event)
        try:
            self._on(changed)
            self._uninterrupted(event, kind, changed.nominal, made)
        except NotTakenError:
            del self._stage.path_changes[key]
            self._stage.tracks[path.name] = before
            event.states[0].unknown = "the ego's change is not taken"
            raise
        return changed

    def _on(self, path: EgoPath) -> None:
        """Have places count along a path from now on, those of triggers that are known already, too."""
        self._context.place = path.place
        self._triggers.begin_anew()

    def _known_by_place(self, event: Event) -> bool:
        """Take down where an event of changes that are all in the ego's path begins and is over; whether it is one."""
        own = [self._stage.path_changes.get((event.maneuver, id(private_kind(one)))) for one in event.actions]
        ways = [way for way in own if way is not None]
        if not ways or len(ways) < len(own):
            return False
        event.states[0].unknown = ""
        event.states[0].begins([[_gone(min(begin for begin, _ in ways))]])
        for one, (_, end) in zip(event.actions, ways, strict=True):
            self._state_of_action(event, one).markers.append([[_gone(end)]])
        for state in event.states:
            state.markers.append([[_gone(max(end for _, end in ways))]])
        return True

    def _uninterrupted(self, event: Event, kind: Element, nominal: NominalDrive, made: PathChange) -> None:
        """Raise NotTakenError where another event or its act's stop trigger ends a change before it is over."""
        for other in self._events:
            overrides = other.scope.text(other.element, "priority", "parallel") in OVERRIDING
            if other is event or other.maneuver != event.maneuver or not overrides:
                continue
            armed, when = self._triggers.starts(other)
            if armed is not None and when is not None and made.begin <= fires_at(armed, when, nominal, kind) < made.end:
                raise NotTakenError(kind, f"{other.name!r} ends the ego's change before it is over")
        stop = self._triggers.stop_of(event)
        if stop and fires_at([], stop, nominal, kind) < made.end:
            raise NotTakenError(kind, "its act is stopped before the ego's change is over")

    def compile(self) -> Groups:
        """Fill `stories` and return the groups of the trigger that ends the drive; [] where nothing ends it."""
        for event in self._events:
            self._name_actions(event)
        for event in self._events:
            self._unnamed(event)
        for event in self._events:
            self._repeats(event)
        for event in self._events:
            self._markers(event)
        for event in self._events:
            self._event(event)
        self._drop_ends()
        return self._triggers.end(self._events)

    def _drop_ends(self) -> None:
        """Take actions that are left out, or that never begin, off the lists of what others end."""
        kept = {f"{self._stage.ids[name]}.{action['name']}" for name, story in self.stories.items() for action in story}
        for story in self.stories.values():
            for action in story:
                ends = [name for name in action.pop("ends", []) if name in kept]
                if ends:
                    action["ends"] = ends

    def _name_actions(self, event: Event) -> None:
        """Name the actions that others than the ego will have of an event, so that conditions may ask for them."""
        for actor in event.actors:
            own = self._stage.ids.get(actor)
            if own is None or own == EGO:
                continue
            for number, action in enumerate(event.actions):
                if action.child("PrivateAction") is None:
                    continue
                taken = [name for other in self._events for name in other.names]
                wanted = f"{own}.{slug(event.name, 'event')}" + (f"_{number + 1}" if number else "")
                name, copy = wanted, 2
                while name in taken:
                    name, copy = f"{wanted}_{copy}", copy + 1
                event.names.append(name)
                for state in (self._state_of_action(event, action), *event.states):
                    state.actions.append(name)

    def _state_of_action(self, event: Event, action: Element) -> ElementState:
        """Return the state of an action, one for all of the event's actors; it is known from the first of them on."""
        known = event.of_actions.get(id(action))
        if known is None:
            known = event.of_actions[id(action)] = element_state(self._context, "action", action, *event.states)
        return known

    def _unnamed(self, event: Event) -> None:
        """Note of an event that has other actions than those of actors whether anybody knows when it is over."""
        if not event.actions:
            event.forget(f"{event.where} changes nothing here")
        elif any(goes_on(kind) for one in event.actions if (kind := private_kind(one)) is not None):
            event.forget(f"{event.where} goes on for good")
        elif any(one.child("PrivateAction") is None and not list(variable_actions(one)) for one in event.actions):
            event.forget(f"nobody knows when {event.where} is over")
        elif any(self._stage.ids.get(actor) == EGO for actor in event.actors) and not self._known_by_place(event):
            event.forget(f"{event.where}: the ego's controller decides when it is over")

    def _repeats(self, event: Event) -> None:
        """Note that nobody knows when an event that repeats is over for good."""
        try:
            if event.times > 1:
                for state in (*event.of_actions.values(), *event.states):
                    state.repeats = True
        except NotTakenError as error:
            self._leave_out(event, error)

    def _markers(self, event: Event) -> None:
        """Take in an event that sets variables: what it sets, and when."""
        of_variables = [kind for one in event.actions for kind in variable_actions(one)]
        if not of_variables:
            return
        try:
            armed, when = self._triggers.starts(event)
            groups = None if armed is None or when is None else _not_before(event, armed, when)
            for kind, what in of_variables:
                key = what, event.scope.text(kind, f"{what}Ref").removeprefix("$")
                setter = kind.child("SetAction")
                if setter is None:
                    raise NotTakenError(kind, "expected a SetAction")
                self._context.variables.setdefault(key, []).append((event.scope.text(setter, "value"), groups))
            event.states[0].begins(groups)
            if groups is not None:
                for state in event.states:
                    state.markers.append(groups)
        except NotTakenError as error:
            self._leave_out(event, error)

    def _event(self, event: Event) -> None:
        try:
            self._read_event(event)
        except NotTakenError as error:
            self._leave_out(event, error)

    def _leave_out(self, event: Event, error: NotTakenError) -> None:
        self._problems.add(error)
        event.forget(f"{event.where} is not taken")

    def _read_event(self, event: Event) -> None:
        private = [one for one in event.actions if one.child("PrivateAction") is not None]
        for one in event.actions:
            if one.child("GlobalAction") is not None and not list(variable_actions(one)):
                self._global(event, one)
            elif one.child("PrivateAction") is None and one.child("GlobalAction") is None:
                raise NotTakenError(one.children[0] if one.children else one, "this action is not taken")
        if not private:
            if not event.actions:
                event.forget(f"{event.where} changes nothing here")
            return
        armed, when = self._triggers.starts(event)
        if armed is None or when is None:
            self._problems.note(f"{event.where} never begins")
            event.states[0].begins(None)
            event.forget(f"the event {event.name!r} never begins")
            return
        if not event.states[0].markers:
            event.states[0].begins(armed + when if not (armed and when) else when)
        names, taken = iter(event.names), list[tuple[str, Action]]()
        only_ego = all(self._stage.ids.get(actor) == EGO for actor in event.actors)
        until = [] if only_ego else self._triggers.stop_of(event)
        common = _when(armed, when, until, self._ended_by(event))
        if event.times > 1:
            common["times"] = event.times
        for actor in event.actors:
            for one in private:
                kind = kind_of(one.children[0])
                if self._stage.id(one, actor) == EGO:
                    self._of_ego(event, kind, actor)
                    continue
                self._in_order(kind, actor, armed, when)
                action, name = read_action(kind, event.scope, actor, self._stage), next(names)
                taken.append((actor, {"name": name.partition(".")[2]} | common | (action or {})))
        if event.times > 1 and len(taken) > 1:
            raise NotTakenError(event.element, "an event of several actions that repeats is not taken")
        for actor, action in taken:
            self.stories[actor].append(action)

    def _in_order(self, kind: Element, actor: str, armed: Groups, when: Groups) -> None:
        """Raise NotTakenError where an action that leads an actor elsewhere comes after a later one in the file."""
        times = [_time(groups) for groups in (armed, when) if groups]
        if kind.tag not in LEADING_OFF or None in times:
            return
        time = max([one for one in times if one is not None], default=0.0)
        if time < self._last.get(actor, 0.0):
            raise NotTakenError(kind, f"it stands after an action of {actor!r} that begins later, which is not taken")
        self._last[actor] = time

    def _of_ego(self, event: Event, kind: Element, ego: str) -> None:
        """Take down that the controller drives in place of an action of the ego; refuse what leads it elsewhere."""
        begun, key = id(kind) in self._stage.begun, (event.maneuver, id(kind))
        if key in self._stage.path_changes:
            begin, end = self._stage.path_changes[key]
            self._problems.note(
                f"{event.where}: the ego's path follows its {kind.tag}, {begin:.1f} m to {end:.1f} m from the start"
            )
            return
        if kind.tag in LEADING_OFF and not begun:
            raise self._stage.refused_changes.get(key) or NotTakenError(
                kind, "the ego's path is the one that it begins on: an action that leads it off is not taken"
            )
        why = f"{event.where}: the ego's controller drives in place of its {kind.tag}"
        if not begun and (longitudinal(kind) or read_action(kind, event.scope, ego, self._stage) is not None):
            self._problems.note(why)
        event.forget(why)

    def _ended_by(self, event: Event) -> list[str]:
        priority = event.scope.text(event.element, "priority", "parallel")
        if priority not in (*OVERRIDING, "parallel"):
            raise NotTakenError(event.element, f"priority: {priority!r} is not taken")
        if priority not in OVERRIDING:
            return []
        others = [one for one in self._events if one.maneuver == event.maneuver and one is not event]
        return [name for one in others for name in one.names]

    def _global(self, event: Event, action: Element) -> None:
        inner = action.children[0].children[0] if action.children[0].children else action
        delete = inner.child("DeleteEntityAction")
        if inner.tag == "EntityAction" and delete is not None:
            name = event.scope.text(inner, "entityRef")
            if self._stage.id(inner, name) == EGO:
                raise NotTakenError(inner, "the ego stays until the drive is over")
            armed, when = self._triggers.starts(event)
            if armed is not None and when is not None:
                story = self.stories[name]
                when_it_leaves = _when(armed, when, self._triggers.stop_of(event), [])
                story.append({"name": f"leaves_{len(story)}"} | when_it_leaves | {"leaves": True})
            return
        raise NotTakenError(inner, "this global action is not taken")


def _time(groups: Groups) -> float | None:
    """Return when a trigger fires that asks for a time alone [s], None for any other."""
    (first, *more), *others = groups
    if more or others or "time_s" not in first or first.get("rule", ">") not in (">", ">="):
        return None
    return float(first["time_s"] + first.get("delay_s", 0.0))


def _gone(way: float) -> dict[str, Any]:
    """Return the condition that the ego has gone a way [m] since the start."""
    return {"travelled_m": round(way, 4), "rule": ">="}


def _not_before(event: Event, armed: Groups, when: Groups) -> Groups:
    """Return an event's trigger as it is once its act's has fired, where that is a time."""
    if not armed or not when:
        return armed or when
    times = [group[0].get("time_s") for group in armed if len(group) == 1 and group[0].get("rule", ">") in (">", ">=")]
    if len(times) != len(armed) or None in times or any("delay_s" in group[0] for group in armed):
        raise NotTakenError(event.element, "an event of variables in an act that other than a time starts is not taken")
    first = min(time for time in times if time is not None)
    return [[condition | {"from_s": first} for condition in group] for group in when]


def _when(armed: Groups, when: Groups, until: Groups, ends: Sequence[str]) -> dict[str, Any]:
    stated: dict[str, Any] = {"armed": armed, "when": when, "until": until, "ends": list(ends)}
    return {key: value for key, value in stated.items() if value}
