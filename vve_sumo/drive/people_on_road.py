"""Real people on the virtual road: reports in, bodies and reasons to stop out, all of it recorded.

The same for every shell and for the replay; knows neither SUMO nor where reports come from.
"""

from __future__ import annotations

from typing import Protocol

from vve_sumo.messages import MalformedMessage
from vve_sumo.people.person import People, PersonState
from vve_sumo.people.reports import decode
from vve_sumo.record.rows import PersonReportRow, PersonRow
from vve_sumo.values import ActorState


class PeopleRecorder(Protocol):
    """What records people: a record, or a client that sends to one."""

    def person_reported(self, row: PersonReportRow) -> None:
        """Record what came from a person."""
        ...

    def person_placed(self, row: PersonRow) -> None:
        """Record a person at one step of the virtual road."""
        ...


class PeopleOnRoad:
    """All persons of a drive, step by step of the virtual road."""

    def __init__(self, people: People, record: PeopleRecorder) -> None:
        self._people, self._record = people, record
        self._steps = 0
        self.states: tuple[PersonState, ...] = ()  #: after the last step

    @property
    def faults(self) -> tuple[str, ...]:
        """Reason codes for which the car must not drive, each once."""
        return tuple(dict.fromkeys(code for state in self.states for code in state.faults))

    def receive(self, received: float, datagram: bytes) -> None:
        """Take a report that arrived at drive time `received` [s]; what is none is recorded and nothing else."""
        self._record.person_reported(PersonReportRow(self._steps, received, datagram))
        report = decode(datagram)
        if not isinstance(report, MalformedMessage):
            self._people.receive(received, report)

    def step(self, time: float) -> tuple[ActorState, ...]:
        """Return the bodies of all who are on the virtual road at drive time `time` [s], which never falls."""
        self.states = self._people.step(time)
        for state in self.states:
            self._record.person_placed(row_of(self._steps, time, state))
        self._steps += 1
        return tuple(state.body for state in self.states if state.body is not None)


def row_of(step: int, time: float, state: PersonState) -> PersonRow:
    """Return a person at one step as a row of the record."""
    return PersonRow(
        step=step,
        time_s=time,
        person=state.id,
        presence=state.presence.name.lower(),
        x_m=state.x,
        y_m=state.y,
        heading_rad=state.heading,
        speed_mps=state.speed,
        radius_m=state.radius,
        age_s=state.age,
        distance_m=state.distance,
        refused=state.refused,
        faults="+".join(state.faults),
    )
