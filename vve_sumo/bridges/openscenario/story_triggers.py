"""When the events of a storyboard begin, when their acts are stopped, and when the storyboard is over.

Knows triggers and what they are in; it must not know what an event does.
"""

from __future__ import annotations

from collections.abc import Sequence

from vve_sumo.bridges.openscenario.document import Document
from vve_sumo.bridges.openscenario.events import Event, is_stopped
from vve_sumo.bridges.openscenario.triggers import Context, Groups, compiled, latched
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError, Problems
from vve_sumo.bridges.scenario_import.xml_tree import Element


class StoryTriggers:
    """Compiles the triggers of a storyboard's events and acts; those of an act once for all of its events."""

    def __init__(self, document: Document, context: Context, problems: Problems) -> None:
        self._document, self._context, self._problems = document, context, problems
        self._acts: dict[int, Groups | None] = {}
        self._stops: dict[int, Groups] = {}

    def begin_anew(self) -> None:
        """Forget the triggers that are compiled: places count along another path now."""
        self._acts.clear()
        self._stops.clear()

    def starts(self, event: Event) -> tuple[Groups | None, Groups | None]:
        """Return the start triggers of an event's act and of the event itself; None for one that never fires.

        Raises NotTakenError for a trigger that is not taken.
        """
        self._context.within = event.states
        armed = self._act(event)
        return armed, None if armed is None else compiled(
            event.element.child("StartTrigger"), event.scope, self._context
        )

    def stop_of(self, event: Event) -> Groups:
        """Return the trigger that stops an event's act, [] where nothing does; raises NotTakenError."""
        act = event.act
        if id(act) not in self._stops:
            groups = compiled(act.child("StopTrigger"), event.act_scope, self._context) if is_stopped(act) else None
            if groups == []:
                raise NotTakenError(act, "an act that is stopped as it begins is not taken")
            self._stops[id(act)] = groups or []
            event.states[-2].stop = self._stops[id(act)]
        return self._stops[id(act)]

    def end(self, events: Sequence[Event]) -> Groups:
        """Return the trigger that ends the storyboard of these events; [] where nothing ends it."""
        board = self._document.root.child("Storyboard")
        trigger = None if board is None else board.child("StopTrigger")
        self._context.within = ()
        groups: Groups = []
        for one in [] if trigger is None else trigger.all("ConditionGroup"):
            alone = Element("StopTrigger", {}, one.file, one.line, [one])
            try:
                found = compiled(alone, self._document.scope, self._context)
                if found == []:
                    raise NotTakenError(one, "it ends the drive as it begins")
                groups += found or []
            except NotTakenError as error:
                self._problems.add(error)
        if trigger is None or not trigger.children:
            return self._end_of_all(events)
        return groups

    def _end_of_all(self, events: Sequence[Event]) -> Groups:
        """Return when every act has been stopped: then nothing is left of a storyboard that nothing ends otherwise."""
        acts = {id(event.act): event for event in events}
        groups: Groups = [[]]
        try:
            for event in acts.values():
                if not is_stopped(event.act):
                    return []
                stop = self.stop_of(event)
                if len(acts) > 1:
                    stop = latched(event.act, stop) if stop else []
                groups = [[*one, *other] for one in groups for other in stop]
        except NotTakenError as error:
            self._problems.note(f"{error}: it does not end the drive")
            return []
        return groups if acts else []

    def _act(self, event: Event) -> Groups | None:
        """Return the trigger of an event's act, which counts for every event in it."""
        if id(event.act) not in self._acts:
            self._acts[id(event.act)] = compiled(event.act.child("StartTrigger"), event.act_scope, self._context)
        for state in event.states[1:-1]:
            state.begins(self._acts[id(event.act)])
        return self._acts[id(event.act)]
