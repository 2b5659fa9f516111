"""What a person is told on their page: how they are on the virtual road, and what comes towards them there.

Places are in the field's map, so that the person finds them by looking around; knows no page.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from msgspec import Struct

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.frames import Alignment
from vve_sumo.geometry import Box
from vve_sumo.people.person import PersonState
from vve_sumo.people.setup import PersonSetup
from vve_sumo.values import Actors

#: bodies that a person is shown, at most, the nearest first, and none farther than this [m]
MAX_BODIES, MAX_DISTANCE = 20, 80.0
#: what comes nearer more slowly than this [m/s] does not arrive
MIN_CLOSING_SPEED: Final = 0.2


class ShownBody(Struct, frozen=True, array_like=True):
    """A body around a person, in the field's map."""

    kind: str
    x: float  #: centre [m]
    y: float  #: centre [m]
    heading: float  #: [rad], counter-clockwise from +x
    length: float  #: [m]
    width: float  #: [m]


class ShownCar(Struct, frozen=True):
    """The car that is tested, in the field's map."""

    body: ShownBody
    speed: float  #: [m/s]
    gap: float  #: from the person's estimated place to the nearest side of the car [m]
    arrives: float | None  #: time until that is 0 if both go on as they do [s]; None where it does not shrink


class PersonView(Struct, frozen=True):
    """What is shown to one person; numbers that nobody knows are None."""

    person: str  #: id
    presence: str  #: `exact`, `area`, `warning` or `gone`
    radius: float | None  #: of the circle that holds the place with 95 % [m]
    age: float | None  #: of the newest believed position [s]
    distance: float | None  #: least possible real distance from the car's lot [m]
    refused: str  #: reason code of the newest position; empty for one that was believed
    faults: tuple[str, ...]  #: reason codes for which the car does not drive
    x: float | None  #: estimated place in the field's map [m]
    y: float | None  #: [m]
    heading: float | None  #: [rad], counter-clockwise from +x
    car: ShownCar | None  #: None before it is on the virtual road
    bodies: tuple[ShownBody, ...]  #: around the person, without themselves and the car


class RoadCar(NamedTuple):
    """The car that is tested, on the virtual road."""

    box: Box
    speed: float  #: [m/s]


def view_of(setup: PersonSetup, state: PersonState, car: RoadCar | None, actors: Actors) -> PersonView:
    """Return what is shown to a person; `car` and `actors` are on the virtual road's map."""
    to_field = setup.alignment.inverse()
    known = math.isfinite(state.x)
    x, y, heading = _moved(to_field, state.x, state.y, state.heading) if known else (math.nan,) * 3
    return PersonView(
        person=state.id,
        presence=state.presence.name.lower(),
        radius=_finite(state.radius),
        age=_finite(state.age),
        distance=_finite(state.distance),
        refused=state.refused,
        faults=state.faults,
        x=_finite(x),
        y=_finite(y),
        heading=_finite(heading),
        car=None if car is None or not known else _shown(to_field, state, car),
        bodies=tuple(_around(to_field, state, actors)) if known else (),
    )


def _shown(to_field: Alignment, state: PersonState, car: RoadCar) -> ShownCar:
    box = car.box
    gap = _gap(box, state.x, state.y)
    later = 0.1  # [s]
    moved = Box(
        box.x + later * car.speed * math.cos(box.heading),
        box.y + later * car.speed * math.sin(box.heading),
        box.heading,
        box.length,
        box.width,
    )
    way = later * state.speed
    closing = (
        gap - _gap(moved, state.x + way * math.cos(state.heading), state.y + way * math.sin(state.heading))
    ) / later
    arrives = gap / closing if closing > MIN_CLOSING_SPEED else None
    return ShownCar(_body(to_field, "car", box), car.speed, gap, arrives)


def _gap(box: Box, x: float, y: float) -> float:
    """Return the distance of a place from the nearest side of a box [m]; 0 inside."""
    cosine, sine = math.cos(box.heading), math.sin(box.heading)
    along = abs(cosine * (x - box.x) + sine * (y - box.y)) - 0.5 * box.length
    across = abs(cosine * (y - box.y) - sine * (x - box.x)) - 0.5 * box.width
    return math.hypot(max(along, 0.0), max(across, 0.0))


def _around(to_field: Alignment, state: PersonState, actors: Actors) -> list[ShownBody]:
    rows: Sequence[tuple[float, ...]] = list(
        zip(actors.x, actors.y, actors.heading, actors.length, actors.width, actors.kind, strict=True)
    )
    near = [
        (math.hypot(row[0] - state.x, row[1] - state.y), row)
        for name, row in zip(actors.ids, rows, strict=True)
        if name != state.id
    ]
    close = sorted((one for one in near if one[0] <= MAX_DISTANCE), key=lambda one: one[0])[:MAX_BODIES]
    return [_body(to_field, BODY_KINDS[int(row[5])], Box(*map(float, row[:5]))) for _, row in close]


def _body(to_field: Alignment, kind: str, box: Box) -> ShownBody:
    return ShownBody(kind, *_moved(to_field, box.x, box.y, box.heading), box.length, box.width)


def _moved(alignment: Alignment, x: float, y: float, heading: float) -> tuple[float, float, float]:
    cosine, sine = math.cos(alignment.rotation), math.sin(alignment.rotation)
    return (
        cosine * x - sine * y + alignment.x,
        sine * x + cosine * y + alignment.y,
        math.remainder(heading + alignment.rotation, math.tau),
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
