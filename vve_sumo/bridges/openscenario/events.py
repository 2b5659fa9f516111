"""The events of a storyboard: what is in which act, whose they are, and how often they are done.

Reads a document's elements; it must not know what an event does to a story, nor when it begins.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from vve_sumo.bridges.openscenario.actions import kind_of, looks
from vve_sumo.bridges.openscenario.document import Document
from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.openscenario.triggers import Context, ElementState
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError, Problems
from vve_sumo.bridges.scenario_import.xml_tree import Element

#: how often an event is done at most: who states more, or -1, means always
MOST_TIMES: Final = 1000


@dataclass(slots=True)
class Event:
    """One event of the storyboard."""

    element: Element
    scope: Scope
    act: Element
    act_scope: Scope
    actors: list[str]  #: names of entities
    maneuver: int  #: number of its manoeuvre
    rounds: int  #: how often its manoeuvre group is done
    states: list[ElementState] = field(default_factory=list)  #: of itself and what it is in, innermost first
    of_actions: dict[int, ElementState] = field(default_factory=dict)  #: by the identity of their elements
    names: list[str] = field(default_factory=list)  #: of its actions, ACTOR.NAME

    @property
    def name(self) -> str:
        """Its name in the file."""
        return self.element.attributes.get("name", "")

    @property
    def actions(self) -> list[Element]:
        """The elements that say what it does, but for what only changes how something looks."""
        return [one for one in self.element.all("Action") if not looks(one)]

    @property
    def times(self) -> int:
        """How often it is done; raises NotTakenError for no number of times."""
        stated = self.scope.whole(self.element, "maximumExecutionCount", 1)
        if stated < 1 and stated != -1:
            raise NotTakenError(self.element, f"maximumExecutionCount: expected 1 or more, got {stated}")
        return min(_times(stated) * self.rounds, MOST_TIMES)

    @property
    def where(self) -> str:
        """Its place in the file and its name, for messages."""
        return f"{self.element.where} {self.name!r}"

    def forget(self, why: str) -> None:
        """Note that nobody knows when it ends, nor what it is in."""
        for state in (*self.of_actions.values(), *self.states):
            state.unknown = state.unknown or why
            state.actions[:] = [name for name in state.actions if name not in self.names]


def element_state(context: Context, kind: str, element: Element, *outer: ElementState) -> ElementState:
    """Return the state of an element of the storyboard, which conditions may ask the context for; `outer` it is in."""
    state = ElementState(element.attributes.get("name", ""), outer=outer)
    context.elements.setdefault((kind, element.attributes.get("name", "")), []).append(state)
    return state


class EventReader:
    """Reads the events of a document, and enters the states of all that they are in into a context."""

    def __init__(self, document: Document, context: Context, problems: Problems) -> None:
        self._document, self._context, self._problems = document, context, problems

    def read(self) -> Iterator[Event]:
        """Yield the events in the file's order."""
        board = self._document.root.child("Storyboard")
        number = 0
        for story in [] if board is None else board.all("Story"):
            in_story = self._document.scope.declared(story.child("ParameterDeclarations"))
            whole = element_state(self._context, "story", story)
            whole.begins([])
            for act in story.all("Act"):
                act_state = element_state(self._context, "act", act, whole)
                if is_stopped(act):
                    act_state.stop = whole.stop = None
                for group in act.all("ManeuverGroup"):
                    group_state = element_state(self._context, "maneuverGroup", group, act_state, whole)
                    try:
                        found = list(self._maneuvers(group, in_story))
                        rounds = _rounds(group, in_story, found)
                    except NotTakenError as error:
                        self._problems.add(error)
                        for one in (group_state, act_state, whole):
                            one.unknown = str(error)
                        continue
                    for maneuver, scope in found:
                        number += 1
                        outer = [group_state, act_state, whole]
                        outer = [element_state(self._context, "maneuver", maneuver, *outer), *outer]
                        for event in maneuver.all("Event"):
                            states = [element_state(self._context, "event", event, *outer), *outer]
                            actors = self._actors(group, in_story)
                            yield Event(event, scope, act, in_story, actors, number, rounds, states)

    def _maneuvers(self, group: Element, scope: Scope) -> Iterator[tuple[Element, Scope]]:
        for one in group.children:
            if one.tag == "CatalogReference":
                yield self._document.entry(one, scope, "Maneuver")
            elif one.tag == "Maneuver":
                yield one, scope.declared(one.child("ParameterDeclarations"))

    def _actors(self, group: Element, scope: Scope) -> list[str]:
        actors = group.child("Actors")
        if actors is None:
            return []
        try:
            if scope.flag(actors, "selectTriggeringEntities", False):
                raise NotTakenError(actors, "selectTriggeringEntities: expected false")
            return [scope.text(one, "entityRef") for one in actors.all("EntityRef")]
        except NotTakenError as error:
            self._problems.add(error)
            return []


def private_kind(action: Element) -> Element | None:
    """Return what a private action of an event does, None where that is none."""
    private = action.child("PrivateAction")
    try:
        return None if private is None else kind_of(private)
    except NotTakenError:
        return None


def goes_on(kind: Element) -> bool:
    """Whether an action keeps an offset for good, which is no action of its own here once the offset is reached."""
    return kind.tag == "LaneOffsetAction" and kind.attributes.get("continuous", "false").lower() in ("true", "1")


def variable_actions(action: Element) -> Iterator[tuple[Element, str]]:
    """Yield the elements of an action that set a variable or a parameter, and which of both."""
    for tag, what in (("VariableAction", "variable"), ("ParameterAction", "parameter")):
        found = action.child("GlobalAction", tag)
        if found is not None:
            yield found, what


def is_stopped(act: Element) -> bool:
    """Whether an act has a trigger that stops it."""
    stop = act.child("StopTrigger")
    return stop is not None and bool(stop.children)


def _rounds(group: Element, scope: Scope, maneuvers: Sequence[tuple[Element, Scope]]) -> int:
    """Return how often a manoeuvre group is done; raises NotTakenError where that is more than to repeat one event.

    A group begins anew once all in it is complete: with one event whose trigger has no delay that is as if the event
    were done so often.
    """
    stated = scope.whole(group, "maximumExecutionCount", 1)
    if stated < 1 and stated != -1:
        raise NotTakenError(group, f"maximumExecutionCount: expected 1 or more, got {stated}")
    events = [(event, inner) for maneuver, inner in maneuvers for event in maneuver.all("Event")]
    delayed = any(
        one.tag == "Condition" and inner.number(one, "delay", 0.0) for event, inner in events for one in event.walk()
    )
    if stated != 1 and (len(events) != 1 or delayed):
        raise NotTakenError(group, "a group that repeats is taken with one event alone, whose trigger has no delay")
    return _times(stated)


def _times(stated: int) -> int:
    return MOST_TIMES if stated == -1 else min(stated, MOST_TIMES)
