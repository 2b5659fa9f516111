"""Routes of OpenSCENARIO: the roads from waypoint to waypoint, and the places that count along them.

Knows roads; it must not know positions, entities or actions.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from vve_sumo.bridges.openscenario.road_map import RoadMap, RoadPlace, Way


class Waypoint(NamedTuple):
    """A place that a route leads over."""

    on: RoadPlace
    sense: int  #: in which the entity faces there: 1 along the road's reference line, -1 against it


class Leg(NamedTuple):
    """What of a route lies on one road."""

    way: Way
    first: float  #: s where the route comes onto the road, or begins [m]
    last: float  #: s where it leaves the road, or ends [m]
    path_s: float  #: of the first place, along the reference lines from where the route begins [m]

    @property
    def length(self) -> float:
        """Along the reference line [m]."""
        return abs(self.last - self.first)


class RoutePlace(NamedTuple):
    """Where a place that counts along a route lies."""

    way: Way
    s: float  #: on that road [m]


@dataclass(frozen=True, slots=True)
class Route:
    """A way over roads."""

    legs: tuple[Leg, ...]

    @property
    def turns(self) -> dict[Way, Way]:
        """Which road follows on which."""
        return {one.way: later.way for one, later in itertools.pairwise(self.legs)}

    def way(self, road: str) -> Way | None:
        """Return how the route goes over a road, None where it does not."""
        return next((leg.way for leg in self.legs if leg.way.road == road), None)

    def at(self, path_s: float, roads: RoadMap) -> RoutePlace | None:
        """Return the place so far along the reference lines [m], up to the end of the last road; None beyond."""
        last = self.legs[-1]
        for leg in self.legs:
            gone = path_s - leg.path_s
            s = leg.first + leg.way.sense * gone
            on_leg = -1e-6 <= gone <= leg.length + 1e-6
            if on_leg or (leg is last and gone > 0.0 and -1e-6 <= s <= roads.roads[leg.way.road].length + 1e-6):
                return RoutePlace(leg.way, s)
        return None


def route_over(roads: RoadMap, waypoints: Sequence[Waypoint]) -> Route:
    """Return the shortest way over roads from waypoint to waypoint.

    It begins as the first waypoint faces, or the other way where that leads nowhere. Raises ValueError where no way
    leads from one waypoint to the next.
    """
    if len(waypoints) < 2:
        raise ValueError("expected two waypoints or more")
    first, *others = waypoints
    for sense in (first.sense, -first.sense):
        legs = _legs(roads, RoutePlace(Way(first.on.road, sense), first.on.s), others)
        if legs:
            return Route(tuple(legs))
    raise ValueError(f"no way leads from road {first.on.road} over all of its waypoints")


def _legs(roads: RoadMap, start: RoutePlace, others: Sequence[Waypoint]) -> list[Leg]:
    """Return a route's legs, [] where no way leads to a waypoint."""
    here, legs, path_s = start, list[Leg](), 0.0
    for waypoint in others:
        ways = _shortest(roads, here, waypoint.on)
        if not ways:
            return []
        for number, way in enumerate(ways):
            road = roads.roads[way.road]
            first = here.s if number == 0 else 0.0 if way.sense > 0 else road.length
            last = waypoint.on.s if number == len(ways) - 1 else road.length if way.sense > 0 else 0.0
            if legs and legs[-1].way == way and number == 0:
                before = legs.pop()
                first, path_s = before.first, before.path_s
            legs.append(Leg(way, first, last, path_s))
            path_s += legs[-1].length
        here = RoutePlace(ways[-1], waypoint.on.s)
    return legs


def _shortest(roads: RoadMap, start: RoutePlace, to: RoadPlace) -> list[Way]:
    """Return the ways of least length from a place to another (Dijkstra), [] where none leads there."""
    if start.way.road == to.road and (to.s - start.s) * start.way.sense >= 0.0:
        return [start.way]
    length = roads.roads[start.way.road].length
    count = itertools.count()
    waiting = [(length - start.s if start.way.sense > 0 else start.s, next(count), [start.way])]
    seen: set[Way] = set()
    while waiting:
        gone, _number, ways = heapq.heappop(waiting)
        if len(ways) > 1 and ways[-1].road == to.road:
            return ways
        if ways[-1] in seen:
            continue
        seen.add(ways[-1])
        for entry in roads.onward(ways[-1]):
            road = roads.roads[entry.way.road]
            part = road.length
            if entry.way.road == to.road:
                part = to.s if entry.way.sense > 0 else road.length - to.s
            heapq.heappush(waiting, (gone + part, next(count), [*ways, entry.way]))
    return []
