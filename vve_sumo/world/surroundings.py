"""Reads the boxes of everything near the ego out of SUMO, a column per quantity.

Must not know what looks at them; radar, contact tests and the record take the table as it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence, Set
from typing import NamedTuple

import libsumo
import numpy as np

from vve_sumo.geometry import Box
from vve_sumo.values import Actors, ActorState
from vve_sumo.world.ego_sync import EGO, heading_of
from vve_sumo.world.obstacles import Obstacle
from vve_sumo.world.standoff import STANDING

#: Mean radar cross section at 77 GHz by SUMO vehicle class [m2]. Assumptions of the usual order of magnitude:
#: car 10, lorry 100 (Skolnik, "Introduction to Radar Systems", 3rd ed., table 2.1: car 100, pickup truck 200 at
#: microwaves; at 77 GHz and close range cars are measured near 10), two-wheelers and people as in Euro NCAP targets.
RADAR_CROSS_SECTIONS = {
    "passenger": 10.0,
    "taxi": 10.0,
    "evehicle": 10.0,
    "emergency": 20.0,
    "delivery": 30.0,
    "bus": 100.0,
    "coach": 100.0,
    "truck": 100.0,
    "trailer": 100.0,
    "tram": 100.0,
    "motorcycle": 5.0,
    "moped": 3.0,
    "bicycle": 2.0,
    "scooter": 1.0,
    "wheelchair": 1.0,
    "pedestrian": 0.5,
    "child": 0.25,  # no class of SUMO's, but a kind of player: half the surface of an adult
}
OTHER_CROSS_SECTION = 10.0

#: SUMO measures to the front bumper; no road vehicle's centre is farther behind it [m].
MAX_CENTRE_DISTANCE = 15.0

#: Whose centre is farther off than this along an axis of the map is in nobody's way [m].
CLOSE = 30.0

VARIABLES = (libsumo.VAR_POSITION, libsumo.VAR_SPEED, libsumo.VAR_ANGLE)

#: Bodies of vehicles that left are forgotten when so many more are known than seen.
MAX_FORGOTTEN = 256


NO_COLUMNS = (np.empty(0),) * 8

#: A vehicle that is faster across its heading [m/s] only went over a kink in how the lanes are drawn: a car on a dry
#: road does not slip more. SUMO turns a body into a lane change, and its centre is at most half as fast across as
#: the change is (0.5 m/s for 3.2 m in 3 s).
MAX_LATERAL_SPEED = 1.5

#: A body's tail swings around its front no faster [m/s]: where a lane change begins in a junction, SUMO turns a body by
#: up to 0.3 rad in one step. A car at 10 m/s in a turn of 6 m radius swings it at 8 m/s.
MAX_TAIL_SWING = 15.0


class Body(NamedTuple):
    """What of an actor does not change."""

    length: float  #: [m]
    width: float  #: [m]
    radar_cross_section: float  #: [m2]


#: name, centre x, centre y, heading, speed, body, speed across the heading
Row = tuple[str, float, float, float, float, Body, float]
Place = tuple[float, float, float]  #: centre x, centre y, heading


def cross_section(kind: str) -> float:
    """Return the radar cross section of a SUMO vehicle class [m2]."""
    return RADAR_CROSS_SECTIONS.get(kind, OTHER_CROSS_SECTION)


class Surroundings:
    """The actors within a range of the ego."""

    def __init__(self, reach: float, obstacles: Sequence[tuple[Obstacle, Box]]) -> None:
        """Look as far as `reach` [m] from the ego's front bumper to an actor's centre."""
        self._reach = reach
        self._obstacles = [
            (declared.id, box, Body(box.length, box.width, cross_section(declared.kind))) for declared, box in obstacles
        ]
        self._bodies: dict[str, Body] = {}
        self._before: dict[str, Place] = {}
        self._time = math.nan

    def watch(self) -> None:
        """Have SUMO gather the vehicles near the ego in every step; to be called whenever the ego entered."""
        reach = self._reach + MAX_CENTRE_DISTANCE
        libsumo.vehicle.subscribeContext(EGO, libsumo.CMD_GET_VEHICLE_VARIABLE, reach, VARIABLES)

    def snapshot(
        self, time: float, x: float, y: float, hidden: Set[str], players: Iterable[tuple[ActorState, float]] = ()
    ) -> Actors:
        """Return the actors around x, y [m] at a drive time [s], without the vehicles in `hidden`.

        Vehicles by name, then persons on foot, then obstacles, then players, each with its radar cross section [m2].
        A vehicle's speed across its heading is its mean since the snapshot before. Its front is where SUMO has it; its
        body turns as SUMO's does, but no faster than a body can. Raises SUMO's errors.
        """
        found = [*self._vehicles(time, hidden), *_persons()]
        found += [(name, box.x, box.y, box.heading, 0.0, body, 0.0) for name, box, body in self._obstacles]
        found += [
            (one.id, one.x, one.y, one.heading, one.speed, Body(one.length, one.width, section), 0.0)
            for one, section in players
        ]
        limit = self._reach * self._reach
        return table(time, [row for row in found if (row[1] - x) ** 2 + (row[2] - y) ** 2 <= limit])

    def standing(self, seen: Actors, near: Box) -> list[tuple[str, Box]]:
        """Return the vehicles of the last snapshot that stand within `CLOSE` of a body, with the ground they cover."""
        at = np.flatnonzero(
            (np.abs(seen.speed) < STANDING) & (np.abs(seen.x - near.x) < CLOSE) & (np.abs(seen.y - near.y) < CLOSE)
        )
        columns = (seen.x, seen.y, seen.heading, seen.length, seen.width)
        return [
            (seen.ids[row], Box(*(float(column[row]) for column in columns)))
            for row in at.tolist()
            if seen.ids[row] in self._before
        ]

    def _vehicles(self, time: float, hidden: Set[str]) -> Iterator[Row]:
        seen = libsumo.vehicle.getContextSubscriptionResults(EGO)
        if len(self._bodies) > len(seen) + MAX_FORGOTTEN:
            self._bodies = {name: body for name, body in self._bodies.items() if name in seen}
        period, before, self._before = time - self._time, self._before, {}
        self._time = time
        for name, values in seen.items():
            if name in hidden:
                continue
            body = self._bodies.get(name) or self._learn(name)
            heading, last, lateral = heading_of(values[libsumo.VAR_ANGLE]), before.get(name), 0.0
            if last is not None:
                heading = followed(last[2], heading, MAX_TAIL_SWING * period / body.length)
            front_x, front_y = values[libsumo.VAR_POSITION]
            x, y, heading = place = _centre(front_x, front_y, heading, body)
            if last is not None:
                lateral = _lateral(last, place, period)
            self._before[name] = place
            yield name, x, y, heading, values[libsumo.VAR_SPEED], body, lateral

    def _learn(self, name: str) -> Body:
        vehicle = libsumo.vehicle
        body = Body(vehicle.getLength(name), vehicle.getWidth(name), cross_section(vehicle.getVehicleClass(name)))
        self._bodies[name] = body
        return body


def _persons() -> Iterator[Row]:
    """Persons by plain queries: in SUMO's answer for an area one with a vehicle's name would replace the vehicle."""
    person = libsumo.person
    for name in person.getIDList():
        if person.getVehicle(name) == "":
            body = Body(person.getLength(name), person.getWidth(name), RADAR_CROSS_SECTIONS["pedestrian"])
            x, y = person.getPosition(name)
            yield name, *_centre(x, y, heading_of(person.getAngle(name)), body), person.getSpeed(name), body, 0.0


def followed(before: float, heading: float, most: float) -> float:
    """Return the heading [rad] that follows another one, turning by at most so much [rad].

    One that is not a number stays that, for the radar to refuse it, and holds up no heading after it.
    """
    turn = math.remainder(heading - before, math.tau)
    return math.remainder(before + math.copysign(most, turn), math.tau) if abs(turn) > most else heading


def _centre(front_x: float, front_y: float, heading: float, body: Body) -> Place:
    """SUMO places a body by the middle of its front."""
    half = 0.5 * body.length
    return front_x - half * math.cos(heading), front_y - half * math.sin(heading), heading


def _lateral(before: Place, now: Place, period: float) -> float:
    """Return the mean speed of a centre across the mean of its headings [m/s]."""
    if not period > 0.0:
        return 0.0
    heading = before[2] + 0.5 * math.remainder(now[2] - before[2], math.tau)
    lateral = ((now[1] - before[1]) * math.cos(heading) - (now[0] - before[0]) * math.sin(heading)) / period
    return lateral if abs(lateral) <= MAX_LATERAL_SPEED else 0.0


def table(time: float, rows: Sequence[Row]) -> Actors:
    """Return rows as a table of actors at a drive time [s]."""
    if not rows:
        return Actors(time, (), *NO_COLUMNS)
    names, x, y, heading, speed, bodies, lateral = zip(*rows, strict=True)
    length, width, section = zip(*bodies, strict=True)
    columns = (x, y, heading, speed, length, width, section, lateral)
    arrays = [np.array(column) for column in columns]
    for array in arrays:
        array.setflags(write=False)  # every sensor looks at them, and the record keeps them
    return Actors(time, names, *arrays)
