"""One person through a drive: reports in; their state, their body on the virtual road and reasons to stop out.

Pure: time comes in with every call. Nothing that a report holds can move the car: it moves a body that sensors see,
or it is a reason to stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vve_sumo.frozen import fast_frozen
from vve_sumo.people.area import Circle, ShownArea
from vve_sumo.people.presence import Presence, PresenceMachine
from vve_sumo.people.report_gate import Place, ReportGate
from vve_sumo.people.reports import FieldEntered, PageAlive, PersonStop, PositionReport, Report
from vve_sumo.people.separation import separation
from vve_sumo.people.setup import PersonSetup
from vve_sumo.people.track import Estimate, Track
from vve_sumo.values import ActorState

#: A page that has said nothing for longer counts as gone [s]; an open one speaks twice a second.
PAGE_TIMEOUT: Final = 3.0

#: Reason codes to plain words.
REASONS: Final[dict[str, str]] = {
    "person_absent": "a person of the scenario has not been seen yet",
    "person_lost": "nobody knows any more where a person is",
    "person_near_lot": "a person may be nearer to the car's lot than the rig allows",
    "person_not_in_field": "a person has not said yet that they stand in their field",
    "person_stop": "a person has asked for a stop",
    "person_unreachable": "a person's page is closed or does not answer",
}


@fast_frozen
@dataclass(frozen=True, slots=True)
class PersonState:
    """A person at one time."""

    id: str
    presence: Presence
    body: ActorState | None  #: on the virtual road, the uncertainty of its place added; None for one who is gone
    x: float  #: place shown on the virtual road's map [m]; NaN before the first position, as all that follow
    y: float  #: [m]
    heading: float  #: [rad], counter-clockwise from the virtual road map's +x
    speed: float  #: [m/s]
    radius: float  #: of the circle around it that holds the true place with 95 % [m]
    age: float  #: of the newest believed position [s]
    distance: float  #: least possible one from the car's ground [m], negative inside; inf where there is none
    refused: str  #: why the newest position was not believed; empty for one that was
    faults: tuple[str, ...]  #: reason codes for which the car must not drive


class Person:
    """Everything that is kept of one person."""

    def __init__(self, setup: PersonSetup) -> None:
        self.setup = setup
        self._frame, limits = setup.frame(), setup.limits
        self._gate = ReportGate(setup.max_speed, limits.lost, limits.lost_age)
        self._machine, self._area = PresenceMachine(limits), ShownArea(setup.max_speed)
        self._track: Track | None = None
        self._believed: Place | None = None  # the newest position
        # Where positions that jumped since then say that they are: of these the one nearest to the car's ground.
        self._elsewhere: Place | None = None
        self._refused = ""
        self._seen = self._entered = self._stopped = False
        self._page_heard = -math.inf

    def receive(self, received: float, report: Report) -> None:
        """Take a report that arrived at drive time `received` [s]."""
        if isinstance(report, PositionReport):
            # A receiver that the person carries goes on while the page is closed: positions are no sign of the page.
            self._take(received, report)
            return
        self._page_heard = max(self._page_heard, received) if math.isfinite(received) else self._page_heard
        if isinstance(report, FieldEntered):
            self._entered = True
        elif isinstance(report, PersonStop):
            self._stopped = True
        else:
            assert isinstance(report, PageAlive)

    def step(self, now: float) -> PersonState:
        """Return the person at drive time `now` [s], which never falls."""
        estimate = self._track.at(now) if self._track is not None else None
        circle = self._area.step(now, estimate) if estimate is not None else None
        age, radius = math.inf, math.inf
        if estimate is not None and circle is not None:
            age, radius = estimate.age, circle.radius
        presence = self._machine.step(now, age, radius)
        if estimate is not None and not age <= self.setup.limits.lost_age:
            # The next position is the first of a person whom nobody knew the place of.
            self._gate.forget()
            self._area.forget()
            self._track = None
        self._seen |= presence is not Presence.GONE
        distance = self._distance(now)
        faults = self._faults(now, presence, distance)
        if estimate is None or circle is None:
            return _unknown(self.setup.id, presence, distance, self._refused, faults)
        return self._state(estimate, circle, presence, distance, faults)

    def _take(self, received: float, report: PositionReport) -> None:
        x, y = self._placed(report)
        place = Place(report.measured, x, y, report.accuracy)
        self._refused = self._gate.step(received, report, place)
        if self._refused:
            if self._refused == "report_jumped":
                # Who may have been wrong before is taken to be at both places.
                known = self._elsewhere
                nearer = known is None or self._reach(place, received) < self._reach(known, received)
                self._elsewhere = place if nearer else known
            return
        self._believed, self._elsewhere = place, None
        facing = report.heading + self._frame.convergence(report.latitude, report.longitude)
        if self._track is None:
            self._track = Track(self.setup.kind, self.setup.max_speed, place)
            self._track.face(facing)
        else:
            self._track.update(place, facing)

    def _placed(self, report: PositionReport) -> tuple[float, float]:
        numbers = (report.latitude, report.longitude)
        return self._frame.to_map(*numbers) if all(map(math.isfinite, numbers)) else (math.nan, math.nan)

    def _distance(self, now: float) -> float:
        """Return the least possible distance from the car's ground [m].

        Since the newest position the person may have gone anywhere at their greatest speed.
        """
        if not self.setup.fence:
            return math.inf
        places = [place for place in (self._believed, self._elsewhere) if place is not None]
        return min((self._reach(one, now) for one in places), default=math.nan)

    def _reach(self, place: Place, now: float) -> float:
        """Return the least possible distance from the car's ground of somebody who was at a place [m]."""
        radius = place.accuracy + self.setup.max_speed * max(now - place.time, 0.0)
        return separation(place.x, place.y, radius, self.setup.fence)

    def _faults(self, now: float, presence: Presence, distance: float) -> tuple[str, ...]:
        faults: tuple[str, ...] = ()
        if presence is Presence.GONE:
            faults += ("person_lost",) if self._seen else ("person_absent",)
        if not (distance >= self.setup.least_distance or (math.isnan(distance) and presence is Presence.GONE)):
            faults += ("person_near_lot",)
        if self.setup.pages and not self._entered:
            faults += ("person_not_in_field",)
        elif self.setup.pages and not now - self._page_heard <= PAGE_TIMEOUT:
            faults += ("person_unreachable",)
        return (*faults, "person_stop") if self._stopped else faults

    def _state(
        self, estimate: Estimate, circle: Circle, presence: Presence, distance: float, faults: tuple[str, ...]
    ) -> PersonState:
        setup, turned = self.setup, self.setup.alignment
        cosine, sine = math.cos(turned.rotation), math.sin(turned.rotation)
        x = cosine * circle.x - sine * circle.y + turned.x
        y = sine * circle.x + cosine * circle.y + turned.y
        facing = math.remainder(estimate.heading + turned.rotation, math.tau)
        body = ActorState(setup.id, setup.kind, x, y, facing, estimate.speed, setup.length, setup.width)
        if presence in (Presence.AREA, Presence.WARNING):
            body = _widened(body, circle.radius, setup.road_heading)
        return PersonState(
            setup.id,
            presence,
            None if presence is Presence.GONE else body,
            x,
            y,
            facing,
            estimate.speed,
            circle.radius,
            estimate.age,
            distance,
            self._refused,
            faults,
        )


def _widened(body: ActorState, radius: float, along: float) -> ActorState:
    """Return the box that holds a body wherever in a circle it is and wherever it faces.

    Two of its sides lie across the road, whose heading is `along` [rad]: what comes along the road meets a side, as it
    meets a body, and not a corner that lies beside its way. The box moves as the body does.
    """
    size, turn = 2.0 * radius + math.hypot(body.length, body.width), body.heading - along
    if math.cos(turn) < 0.0:
        along, turn = along + math.pi, turn - math.pi
    return body._replace(
        heading=math.remainder(along, math.tau),
        speed=body.speed * max(math.cos(turn), 0.0),
        length=size,
        width=size,
        lateral_speed=body.speed * math.sin(turn),
    )


def _unknown(name: str, presence: Presence, distance: float, refused: str, faults: tuple[str, ...]) -> PersonState:
    nowhere = (math.nan,) * 6
    return PersonState(name, presence, None, *nowhere, distance, refused, faults)


class People:
    """All persons of a drive."""

    def __init__(self, setups: tuple[PersonSetup, ...]) -> None:
        self._persons = {setup.id: Person(setup) for setup in setups}

    def receive(self, received: float, report: Report) -> None:
        """Take a report that arrived at drive time `received` [s]; one of a person who is not expected is left out."""
        if report.person in self._persons:
            self._persons[report.person].receive(received, report)

    def step(self, now: float) -> tuple[PersonState, ...]:
        """Return all persons at drive time `now` [s], which never falls, in the scenario's order."""
        return tuple(person.step(now) for person in self._persons.values())
