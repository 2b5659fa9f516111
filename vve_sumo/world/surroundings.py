"""Reads the actors near the egos from SUMO into tables, one column per quantity.

Must not know what uses the table; radar, contact tests and the record take it as it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence, Set
from typing import Any, Final, NamedTuple

import libsumo
import numpy as np

from vve_sumo.body_kinds import BODY_KINDS, TYPICAL, number_of
from vve_sumo.geometry import Box
from vve_sumo.values import Actors, ActorState
from vve_sumo.world.ego_sync import heading_of
from vve_sumo.world.obstacles import Obstacle
from vve_sumo.world.standoff import STANDING

#: Mean radar cross section at 77 GHz of SUMO's vehicle classes that reflect otherwise than their kind of body [m2].
OWN_CROSS_SECTIONS: Final = {"emergency": 20.0, "moped": 3.0, "scooter": 1.0, "wheelchair": 1.0}

#: Kind of body by SUMO vehicle class; any other is a car.
BODY_KIND_OF_CLASS: Final = {
    "delivery": "van",
    "bus": "bus",
    "coach": "bus",
    "tram": "bus",
    "truck": "truck",
    "trailer": "truck",
    "motorcycle": "motorcycle",
    "moped": "motorcycle",
    "bicycle": "bicycle",
    "scooter": "bicycle",
    "wheelchair": "bicycle",
    "pedestrian": "pedestrian",
}

#: Greatest distance from a road vehicle's front bumper, to which SUMO measures, back to its centre [m].
MAX_CENTRE_DISTANCE: Final = 15.0

#: A vehicle whose centre is farther from the ego's than this along an axis of the map is in no standoff [m].
CLOSE: Final = 30.0

VARIABLES = (libsumo.VAR_POSITION, libsumo.VAR_SPEED, libsumo.VAR_ANGLE)

#: Cached bodies are dropped when the cache holds so many more vehicles than SUMO reports near the ego.
MAX_FORGOTTEN: Final = 256


#: A greater lateral speed [m/s] is taken as 0: it comes from a kink in the drawn lanes, because a car on a dry road
#: does not slip more. In a lane change SUMO also turns the body, so that its centre moves across its heading at most
#: half as fast as the change itself (0.5 m/s for 3.2 m in 3 s).
MAX_LATERAL_SPEED: Final = 1.5

#: Greatest speed at which a body's tail may swing around its front [m/s]. Where a lane change begins in a junction,
#: SUMO turns a body by up to 0.3 rad in one step. The tail of a car at 10 m/s in a turn of 6 m radius swings at 8 m/s.
MAX_TAIL_SWING: Final = 15.0


class ActorBody(NamedTuple):
    """The constant properties of an actor."""

    length: float  #: [m]
    width: float  #: [m]
    radar_cross_section: float  #: [m2]
    height: float  #: [m]
    kind: int  #: row of BODY_KINDS


#: name, centre x, centre y, heading, speed, length, width, radar cross section, speed across the heading, height, kind
Row = tuple[str, float, float, float, float, float, float, float, float, float, int]
Place = tuple[float, float, float]  #: centre x, centre y, heading


def cross_section(vehicle_class: str) -> float:
    """Return the radar cross section of a SUMO vehicle class [m2]."""
    own = OWN_CROSS_SECTIONS.get(vehicle_class)
    return TYPICAL[BODY_KIND_OF_CLASS.get(vehicle_class, "car")].radar_cross_section if own is None else own


def body_of_kind(kind: str, length: float, width: float) -> ActorBody:
    """Return the body of a kind, one of BODY_KINDS, with a size of its own [m]."""
    typical = TYPICAL[kind]
    return ActorBody(length, width, typical.radar_cross_section, typical.height, number_of(kind))


def body_of(name: str, vehicle_class: str, length: float, width: float, height: float) -> ActorBody:
    """Return the body of a vehicle of SUMO's: by its name, its vehicle class and its size [m].

    Where a vehicle is named after a kind of body, as `bus.15`, it is of that kind.
    """
    named = name.partition(".")[0]
    kind = named if named in BODY_KINDS else BODY_KIND_OF_CLASS.get(vehicle_class, "car")
    return ActorBody(length, width, cross_section(vehicle_class), height, number_of(kind))


class Surroundings:
    """Reads the actors within a range of the egos, each once, however many egos it is near."""

    def __init__(self, reach: float, obstacles: Sequence[tuple[Obstacle, Box]]) -> None:
        """`reach` [m] is the range from an ego's front bumper to an actor's centre."""
        self._reach = reach
        self._egos: list[str] = []  # whose surroundings SUMO reports
        self._rows: list[Row] = []
        self._obstacles: list[Row] = [
            row_of(one.id, (box.x, box.y, box.heading), 0.0, body_of_kind(one.kind, box.length, box.width), 0.0)
            for one, box in obstacles
        ]
        self._bodies: dict[str, ActorBody] = {}
        self._before: dict[str, Place] = {}
        self._time = math.nan

    def watch(self, ego: str) -> None:
        """Subscribe to the vehicles near an ego in every step; call it whenever the ego has entered."""
        reach = self._reach + MAX_CENTRE_DISTANCE
        libsumo.vehicle.subscribeContext(ego, libsumo.CMD_GET_VEHICLE_VARIABLE, reach, VARIABLES)
        if ego not in self._egos:
            self._egos.append(ego)

    def read_actors(self, time: float, hidden: Set[str], actors: Iterable[tuple[ActorState, ActorBody]] = ()) -> None:
        """Read the actors near the egos at a drive time [s], without the vehicles in `hidden`.

        Rows are vehicles by name, persons on foot, obstacles, and `actors`: the scenario's actors, each with its
        body. A vehicle's lateral speed is the mean since the last look. Its front is where SUMO has
        it; its heading follows SUMO's, limited by MAX_TAIL_SWING. Raises SUMO's errors.
        """
        found = self._vehicles(time, hidden)
        found += _persons()
        found += self._obstacles
        found += [
            row_of(one.id, (one.x, one.y, one.heading), one.speed, body, one.lateral_speed) for one, body in actors
        ]
        self._rows = found

    def around(self, x: float, y: float, egos: Sequence[Row]) -> list[Row]:
        """Return the rows of the last look around x, y [m]; `egos` are the rows of egos, which may be near too."""
        limit = self._reach * self._reach
        rows = [*self._rows, *egos] if egos else self._rows
        return [row for row in rows if (row[1] - x) ** 2 + (row[2] - y) ** 2 <= limit]

    def standing(self, seen: Actors, near: Box) -> list[tuple[str, Box]]:
        """Return the vehicles of a snapshot that stand within `CLOSE` of a body, with their boxes."""
        at = np.flatnonzero(
            (np.abs(seen.speed) < STANDING) & (np.abs(seen.x - near.x) < CLOSE) & (np.abs(seen.y - near.y) < CLOSE)
        )
        columns = (seen.x, seen.y, seen.heading, seen.length, seen.width)
        return [
            (seen.ids[row], Box(*(float(column[row]) for column in columns)))
            for row in at.tolist()
            if seen.ids[row] in self._before
        ]

    def _vehicles(self, time: float, hidden: Set[str]) -> list[Row]:
        seen: dict[str, dict[int, Any]] = {}
        for ego in self._egos:
            seen |= libsumo.vehicle.getContextSubscriptionResults(ego)
        if len(self._bodies) > len(seen) + MAX_FORGOTTEN:
            self._bodies = {name: body for name, body in self._bodies.items() if name in seen}
        period, before, self._before = time - self._time, self._before, {}
        self._time = time
        rows: list[Row] = []
        for name, values in seen.items():
            if name in hidden:
                continue
            body = self._bodies.get(name) or self._learn(name)
            heading, last, lateral = heading_of(values[libsumo.VAR_ANGLE]), before.get(name), 0.0
            if last is not None:
                heading = followed(last[2], heading, MAX_TAIL_SWING * period / body.length)
            front_x, front_y = values[libsumo.VAR_POSITION]
            place = _centre(front_x, front_y, heading, body)
            if last is not None:
                lateral = _lateral(last, place, period)
            self._before[name] = place
            rows.append(row_of(name, place, values[libsumo.VAR_SPEED], body, lateral))
        return rows

    def _learn(self, name: str) -> ActorBody:
        vehicle = libsumo.vehicle
        size = vehicle.getLength(name), vehicle.getWidth(name), vehicle.getHeight(name)
        body = self._bodies[name] = body_of(name, vehicle.getVehicleClass(name), *size)
        return body


def _persons() -> Iterator[Row]:
    """Yield the persons on foot; a subscription would confuse a person and a vehicle of the same name."""
    person = libsumo.person
    for name in person.getIDList():
        if person.getVehicle(name) == "":
            body = body_of("", "pedestrian", person.getLength(name), person.getWidth(name), person.getHeight(name))
            x, y = person.getPosition(name)
            place = _centre(x, y, heading_of(person.getAngle(name)), body)
            yield row_of(name, place, person.getSpeed(name), body, 0.0)


def row_of(name: str, place: Place, speed: float, body: ActorBody, lateral_speed: float) -> Row:
    """Return an actor as a row of the table."""
    length, width, section, height, kind = body
    return name, *place, speed, length, width, section, lateral_speed, height, kind


def followed(before: float, heading: float, most: float) -> float:
    """Return `heading` [rad], but turned from the heading `before` by at most `most` [rad].

    NaN stays NaN, so that the radar refuses it, and does not affect later headings.
    """
    turn = math.remainder(heading - before, math.tau)
    return math.remainder(before + math.copysign(most, turn), math.tau) if abs(turn) > most else heading


def _centre(front_x: float, front_y: float, heading: float, body: ActorBody) -> Place:
    """Return the centre of a body, which SUMO places by the middle of its front, and its heading."""
    half = 0.5 * body.length
    return front_x - half * math.cos(heading), front_y - half * math.sin(heading), heading


def _lateral(before: Place, now: Place, period: float) -> float:
    """Return the mean speed of a centre across the mean heading [m/s], left positive; 0 above MAX_LATERAL_SPEED."""
    if not period > 0.0:
        return 0.0
    heading = before[2] + 0.5 * math.remainder(now[2] - before[2], math.tau)
    lateral = ((now[1] - before[1]) * math.cos(heading) - (now[0] - before[0]) * math.sin(heading)) / period
    return lateral if abs(lateral) <= MAX_LATERAL_SPEED else 0.0


def table(time: float, rows: Sequence[Row]) -> Actors:
    """Return rows as a table of actors at a drive time [s]."""
    if not rows:
        return Actors.none(time)
    names, *columns, kinds = zip(*rows, strict=True)
    block, kind = np.array(columns), np.array(kinds, np.int8)
    for shared in (block, kind):
        shared.setflags(write=False)  # all sensors and the record share the columns
    return Actors(time, names, *(*block, kind))
