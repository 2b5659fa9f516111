"""Draws random traffic for a network and writes it as a SUMO route file of vehicles, routes and departure times.

It runs before any drive and knows nothing of one. The same network and arguments give the same file.
"""

from __future__ import annotations

import math
import random
import xml.etree.ElementTree as ET
from bisect import bisect
from collections.abc import Collection, Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.build import attribution
from vve_sumo.world.network import Roads

#: mean number of vehicles on the streets at any time, from the start on
LEVELS = {"light": 20, "moderate": 50, "heavy": 120}

DURATION = 1200.0  #: time during which vehicles enter [s]
SEED = 43211

#: Share of trip ends at the network's edge, where roads lead in or out; the others are at kerbs of side streets.
THROUGH_SHARE = 0.7
#: Weight of an end of the network by the class of its street, after the traffic volume of such streets in a US city
#: (FHWA, "Highway Functional Classification: Concepts, Criteria and Procedures", 2013, table 3-5: arterials some
#: 7 000 to 27 000, collectors 1 100 to 6 300, local streets 80 to 700 vehicles a day).
THROUGH_WEIGHTS = {"primary": 15.0, "secondary": 8.0, "tertiary": 4.0, "unclassified": 0.4, "residential": 0.2}
KERB_CLASSES = ("residential", "unclassified")  #: freeways are in neither list: they cannot be seen from the streets
MAX_TRIP_FACTOR = 3.0  #: assumed greatest travel time of a trip over the mean
SAMPLES = 250  #: trips drawn to estimate the mean travel time
MIN_TRIP_LENGTH = 400.0  #: shorter trips are left out: people walk them [m]
DELAY = 1.25  #: travel time over the time at the speed limit, measured in SUMO with the vehicle types below
MAX_DRAWS = 1000  #: attempts to draw two ends with a route between them


class VehicleType(NamedTuple):
    """One kind of road user."""

    share: float  #: of all vehicles
    length: float  #: [m]
    width: float  #: [m]
    height: float  #: [m]
    vehicle_class: str  #: SUMO's vClass
    shape: str  #: SUMO's guiShape
    accel: float  #: greatest [m/s2]
    decel: float  #: comfortable [m/s2]


#: Light trucks are more than half of US light vehicles. Truck and bus are the single-unit truck (SU-9) and the city bus
#: (CITY-BUS) of AASHTO, "A Policy on Geometric Design of Highways and Streets"; the others are common models' sizes.
TYPES = {
    "sedan": VehicleType(0.42, 4.85, 1.85, 1.45, "passenger", "passenger/sedan", 2.6, 4.5),
    "suv": VehicleType(0.33, 4.75, 1.90, 1.70, "passenger", "passenger/wagon", 2.4, 4.5),
    "pickup": VehicleType(0.16, 5.85, 2.03, 1.95, "passenger", "passenger/van", 2.4, 4.3),
    "van": VehicleType(0.05, 5.95, 2.05, 2.60, "delivery", "delivery", 2.0, 4.0),
    "truck": VehicleType(0.03, 9.15, 2.44, 3.60, "truck", "truck", 1.3, 3.5),
    "bus": VehicleType(0.01, 12.20, 2.59, 3.20, "bus", "bus", 1.2, 3.5),
}

#: Attributes common to all types. Drivers act every 0.1 s, which makes most steps of 0.02 s much cheaper. They pass a
#: stopped car on the opposite lane, but seldom a moving one: with SUMO's default eagerness of 1 a few cars touched in
#: crossings. The desired headway is calibrated so that queues discharge at the Highway Capacity Manual's saturation
#: flow for this mix (`benchmarks/strings.py`). It is the same at all levels, as the manual's value is.
DRIVER = {
    "sigma": "0.5",
    "tau": "1.1",
    "speedFactor": "normc(1.0,0.1,0.8,1.3)",
    "actionStepLength": "0.1",
    "lcOpposite": "0.2",
}


class Braking(NamedTuple):
    """How drivers of one class brake."""

    comfortable: float  #: [m/s2]
    emergency: float  #: greatest [m/s2]


#: Braking of `comfortable` drivers, by SUMO's vehicle class. SUMO's drivers use all of the comfortable deceleration in
#: every stop: cars have 3.0 m/s2, with which the Institute of Transportation Engineers times yellow lights (10 ft/s2);
#: AASHTO's stopping sight distance counts with 3.4 m/s2. Greatest: 8.0 m/s2 for cars, less than a dry road's grip of
#: 8.8 m/s2 (assumed), and 5.0 m/s2 for lorries and buses, which UN R13 demands of them; their comfortable 2.0 m/s2 are
#: assumed, for standing passengers and loads.
COMFORTABLE = {
    "passenger": Braking(3.0, 8.0),
    "delivery": Braking(3.0, 7.0),
    "truck": Braking(2.0, 5.0),
    "bus": Braking(2.0, 5.0),
}

#: How drivers brake: `brisk` stops with the `decel` of their type and SUMO's emergency braking of their class, 9 m/s2
#: for cars and 7 m/s2 for lorries and buses.
DRIVERS = ("comfortable", "brisk")


class Trip(NamedTuple):
    """One vehicle's trip."""

    depart: float  #: [s]; below 0: under way already when the simulation starts
    kind: str  #: its vehicle type
    edges: tuple[Any, ...]  #: sumolib's edges, in order
    kerb: float | None  #: position on the first edge where it leaves the kerb [m]; None enters at the edge's start


class Demand(NamedTuple):
    """Figures of the traffic that was written."""

    vehicles: int  #: in the file
    at_start: int  #: vehicles in the file that depart at time 0
    travel_time: float  #: expected, mean of all trips [s]


def write_demand(
    network: Path,
    out: Path,
    *,
    level: str,
    duration: float = DURATION,
    seed: int = SEED,
    clear: Collection[str] = (),
    unhindered: Sequence[str] = (),
    drivers: str = DRIVERS[0],
) -> Demand:
    """Draw the traffic of a level ("light", "moderate", "heavy") and write it to `out` as a SUMO route file.

    The streets are busy from the start: vehicles under way at time 0 begin at the place that they would have reached.
    `clear` are edges (the ego's path) on which no vehicle appears, neither at time 0 nor later, and none disappears.
    `unhindered` is a route, edge by edge: no vehicle gets a route through a junction in which it would have the right
    of way over the ego. `drivers` is one of DRIVERS; trips and vehicles are the same for both. Raises ConfigError on an
    unknown level, edge or kind of drivers, edges that do not follow each other, or a network without usable streets.
    """
    if level not in LEVELS:
        raise ConfigError(f"no traffic level {level!r}; known: {', '.join(LEVELS)}")
    types = vehicle_types(drivers)
    if not (math.isfinite(duration) and duration > 0.0):
        raise ConfigError(f"duration {duration}: expected a time above zero [s]")
    drawn = random.Random(f"{seed} {level}")
    roads = Roads(network)
    for name in clear:
        roads.edge(name)  # raises for an edge that the network does not have
    roads.close(roads.prior(unhindered))
    places = Places(roads, frozenset(clear))
    samples = [places.trip(drawn) for _ in range(SAMPLES)]
    mean = sum(travel_time(edges) for edges, _kerb in samples) / len(samples)
    trips = list(_trips(places, drawn, mean / LEVELS[level], MAX_TRIP_FACTOR * mean, duration))
    spares = ", nobody with right of way over the ego's path" if unhindered else ""
    driver_note = "" if drivers == DRIVERS[0] else f", {drivers} drivers"
    drawn_as = f"{level} traffic, seed {seed}{spares}{driver_note}: drawn trips, no counts of real traffic."
    return write_trips(out, trips, types, " ".join((drawn_as, *attribution(network))), frozenset(clear), mean)


class Choice:
    """A weighted random choice among items."""

    def __init__(self, items: Sequence[Any], weights: Sequence[float]) -> None:
        self.items = items
        self._sums = list(accumulate(weights))

    def draw(self, drawn: random.Random) -> Any:
        return self.items[bisect(self._sums, drawn.random() * self._sums[-1], 0, len(self.items) - 1)]


class Places:
    """The places where trips begin and end, with their weights."""

    def __init__(self, roads: Roads, clear: frozenset[str]) -> None:
        self.roads = roads
        cars = [edge for edge in roads.edges if edge.allows("passenger") and edge.getID() not in clear]
        kerbs = [edge for edge in cars if _class(edge) in KERB_CLASSES]
        ends = [edge for edge in cars if _class(edge) in THROUGH_WEIGHTS]
        if not (kerbs or ends):
            # A network of other data than OpenStreetMap's knows no classes: every street is one like another.
            kerbs = ends = cars
        self.kerbs = Choice(kerbs, [edge.getLength() for edge in kerbs])
        self.entries = _through([edge for edge in ends if edge.is_fringe(edge.getIncoming())])
        self.exits = _through([edge for edge in ends if edge.is_fringe(edge.getOutgoing())])
        if ends is kerbs and not (self.entries.items and self.exits.items):
            self.entries = self.exits = self.kerbs  # no street leads in or out of the town
        if not (kerbs and self.entries.items and self.exits.items):
            raise ConfigError(f"{roads.network.path}: expected streets that lead in, lead out and have kerbs")

    def trip(self, drawn: random.Random) -> tuple[tuple[Any, ...], float | None]:
        """Return the edges of a random trip and the kerb position on the first one, as in `Trip`."""
        for _ in range(MAX_DRAWS):
            through = drawn.random() < THROUGH_SHARE
            start = (self.entries if through else self.kerbs).draw(drawn)
            end = (self.exits if drawn.random() < THROUGH_SHARE else self.kerbs).draw(drawn)
            kerb = None if through else round(drawn.uniform(0.2, 0.8) * start.getLength(), 2)
            edges = self._way(start, end)
            if sum(edge.getLength() for edge in edges) >= MIN_TRIP_LENGTH:
                return edges, kerb
        raise ConfigError(
            f"{self.roads.network.path}: found no two streets {MIN_TRIP_LENGTH:.0f} m apart that a way joins"
        )

    def _way(self, start: Any, end: Any) -> tuple[Any, ...]:
        back = end.getFromNode() is start.getToNode() and end.getToNode() is start.getFromNode()
        if start is end or back:
            return ()
        return self.roads.fastest(start, end)


def _through(edges: Sequence[Any]) -> Choice:
    return Choice(edges, [THROUGH_WEIGHTS.get(_class(edge), 1.0) for edge in edges])


def _class(edge: Any) -> str:
    return str(edge.getType()).removeprefix("highway.")


def _edge_time(edge: Any) -> float:
    """Return the expected time on an edge, including delay by signals, junctions and other drivers [s]."""
    return DELAY * float(edge.getLength()) / float(edge.getSpeed())


def travel_time(edges: Sequence[Any]) -> float:
    """Return the expected time along sumolib's edges [s]."""
    return sum(_edge_time(edge) for edge in edges)


def _trips(places: Places, drawn: random.Random, headway: float, before: float, duration: float) -> Iterator[Trip]:
    """Yield trips in order of departure, one in every `headway` [s], from `before` [s] ahead of time 0 to `duration`.

    A trip that would have ended before time 0 is left out.
    """
    kinds = Choice(list(TYPES), [kind.share for kind in TYPES.values()])
    for slot in range(-math.ceil(before / headway), math.ceil(duration / headway)):
        depart = (slot + drawn.random()) * headway
        edges, kerb = places.trip(drawn)
        kind = kinds.draw(drawn)
        if depart + travel_time(edges) > 0.0:
            yield Trip(depart, kind, edges, kerb)


def _reached(trip: Trip) -> tuple[tuple[Any, ...], float]:
    """Return the remaining edges, at time 0, of a trip begun earlier, and the position on the first of them [m]."""
    elapsed = -trip.depart
    for i, edge in enumerate(trip.edges):
        if elapsed < _edge_time(edge):
            return trip.edges[i:], edge.getLength() * elapsed / _edge_time(edge)
        elapsed -= _edge_time(edge)
    return trip.edges[-1:], trip.edges[-1].getLength()


def _vehicle(name: str, trip: Trip, clear: frozenset[str]) -> ET.Element | None:
    """Return the element of one vehicle; None if it would stand on a clear edge at time 0."""
    edges, position, speed = trip.edges, "base", "max"
    if trip.depart < 0.0:
        edges, reached = _reached(trip)
        position = f"{reached:.2f}"
    elif trip.kerb is not None:
        position, speed = f"{trip.kerb:.2f}", "0"
    if trip.depart < 0.0 and edges[0].getID() in clear:
        return None
    where = {"departLane": "best", "departPos": position, "departSpeed": speed}
    element = ET.Element("vehicle", {"id": name, "type": trip.kind, "depart": f"{max(0.0, trip.depart):.2f}"} | where)
    ET.SubElement(element, "route", edges=" ".join(edge.getID() for edge in edges))
    return element


def vehicle_types(drivers: str) -> list[ET.Element]:
    """Return SUMO's elements of all of TYPES, for one of DRIVERS; raises ConfigError for others."""
    if drivers not in DRIVERS:
        raise ConfigError(f"no drivers {drivers!r}; known: {', '.join(DRIVERS)}")
    return [_type(name, drivers) for name in TYPES]


def _type(name: str, drivers: str) -> ET.Element:
    kind = TYPES[name]
    braking = {"decel": f"{kind.decel}"}
    if drivers == "comfortable":
        comfortable, emergency = COMFORTABLE[kind.vehicle_class]
        braking = {"decel": f"{comfortable}", "emergencyDecel": f"{emergency}"}
    size = {"length": f"{kind.length}", "width": f"{kind.width}", "height": f"{kind.height}"}
    looks = {"vClass": kind.vehicle_class, "guiShape": kind.shape}
    return ET.Element("vType", {"id": name, "accel": f"{kind.accel}"} | braking | size | looks | DRIVER)


def write_trips(
    out: Path, trips: Sequence[Trip], types: Sequence[ET.Element], said: str, clear: frozenset[str], mean: float
) -> Demand:
    """Write trips as a SUMO route file with a line that says what they are; `mean` is their travel time [s]."""
    root = ET.Element("routes")
    root.extend(types)
    named = ((f"{trip.kind}.{i}", trip) for i, trip in enumerate(trips))
    vehicles = [vehicle for vehicle in (_vehicle(name, trip, clear) for name, trip in named) if vehicle is not None]
    vehicles.sort(key=lambda vehicle: float(vehicle.attrib["depart"]))
    root.extend(vehicles)
    ET.indent(root)
    head = f"<!-- {said} -->"
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(f"{head}\n{ET.tostring(root, encoding='unicode')}\n", encoding="utf-8")
    at_start = sum(vehicle.attrib["depart"] == "0.00" for vehicle in vehicles)
    return Demand(len(vehicles), at_start, mean)
