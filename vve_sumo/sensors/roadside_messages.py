"""Composes what a roadside unit says of an intersection: its lanes for a MAPEM, what its signals show for a SPATEM.

Knows neither what the messages travel on nor who hears them.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Final

from vve_sumo.frames import MapFrame
from vve_sumo.intersections import Intersection, IntersectionLink, LaneUse, LinkShow, SignalPhase, shows
from vve_sumo.v2x import mapem
from vve_sumo.v2x.mapem import Connection, Direction, IntersectionGeometry, Lane, LaneKind, Maneuver
from vve_sumo.v2x.spatem import Event, IntersectionState, Movement, Phase

HOUR: Final = 3600.0
UNIX_EPOCH: Final = datetime.datetime(1970, 1, 1)
#: phases that a SPATEM tells of a signal, the present one included: up to the next green and its end
MAX_EVENTS: Final = 4
#: of a lane, from its stop line on, that a MAPEM has [m]
LANE_LENGTH: Final = 100.0
#: a link's number is its index and this: 0 and 255 mean something else
GROUP_OFFSET: Final = 1
MAX_GROUP: Final = 254
#: what SUMO's letters of a signal mean (SUMO's documentation, "Traffic Lights", signal state definitions)
PHASES: Final[Mapping[str, Phase]] = {
    "r": Phase.STOP_AND_REMAIN,
    "u": Phase.PRE_MOVEMENT,
    "g": Phase.PERMISSIVE_MOVEMENT_ALLOWED,
    "G": Phase.PROTECTED_MOVEMENT_ALLOWED,
    "y": Phase.PERMISSIVE_CLEARANCE,
    "Y": Phase.PROTECTED_CLEARANCE,
    "s": Phase.STOP_THEN_PROCEED,
    "o": Phase.CAUTION_CONFLICTING_TRAFFIC,
    "O": Phase.DARK,
}
MANEUVERS: Final[Mapping[str, Maneuver]] = {
    "s": Maneuver.STRAIGHT,
    "l": Maneuver.LEFT,
    "L": Maneuver.LEFT,
    "r": Maneuver.RIGHT,
    "R": Maneuver.RIGHT,
    "t": Maneuver.U_TURN,
    "T": Maneuver.U_TURN,
}
_KINDS: Final[Mapping[LaneUse, LaneKind]] = {
    "vehicle": LaneKind.VEHICLE,
    "bicycle": LaneKind.BIKE_LANE,
    "pedestrian": LaneKind.SIDEWALK,
}


def middle_of(intersection: Intersection) -> tuple[float, float]:
    """Return the mean of the ends of the lanes that lead in, map [m]: the reference point of a MAPEM."""
    ends = [lane.points[-1] for lane in intersection.incoming]
    x, y = (math.fsum(values) / len(ends) for values in zip(*ends, strict=True))
    return x, y


def geometry_of(number: int, intersection: Intersection, frame: MapFrame) -> IntersectionGeometry:
    """Return an intersection as its MAPEM has it, under a number; `frame` is that of the map."""
    x, y = middle_of(intersection)
    latitude, longitude = frame.to_geodetic(x, y)
    lanes = _lanes(intersection, frame, (x, y))
    place = math.degrees(latitude), math.degrees(longitude)
    return IntersectionGeometry(number, *place, lanes, lane_width=intersection.incoming[0].width)


def _lanes(intersection: Intersection, frame: MapFrame, reference: tuple[float, float]) -> tuple[Lane, ...]:
    """Return the lanes of a MAPEM: those that lead in, then those that lead out, numbered from 1."""
    numbers = {lane.id: number for number, lane in enumerate((*intersection.incoming, *intersection.outgoing), 1)}
    approaches = _numbered(lane.edge for lane in intersection.incoming)
    exits = _numbered(lane.edge for lane in intersection.outgoing)
    north = frame.convergence(*frame.to_geodetic(*reference))
    lanes = []
    for lane in intersection.incoming:
        links = [link for link in intersection.links if link.incoming == lane.id]
        maneuvers = Maneuver(0)
        for link in links:
            maneuvers |= MANEUVERS.get(link.direction, Maneuver(0))
        lanes.append(
            Lane(
                numbers[lane.id],
                _KINDS[lane.use],
                Direction.INGRESS,
                _nodes(lane.points[::-1], reference, north),
                ingress_approach=approaches[lane.edge],
                maneuvers=maneuvers,
                connections=tuple(_connection(link, numbers) for link in links),
            )
        )
    for lane in intersection.outgoing:
        nodes, approach = _nodes(lane.points, reference, north), exits[lane.edge]
        lanes.append(Lane(numbers[lane.id], _KINDS[lane.use], Direction.EGRESS, nodes, egress_approach=approach))
    return tuple(lanes)


def _numbered(edges: Iterable[str]) -> dict[str, int]:
    """Return a number from 1 on for each approach; 0 where a message has no number left for one."""
    return {edge: number if number <= 15 else 0 for number, edge in enumerate(dict.fromkeys(edges), 1)}


def _connection(link: IntersectionLink, numbers: Mapping[str, int]) -> Connection:
    return Connection(numbers[link.outgoing], MANEUVERS.get(link.direction), _group(link.index))


def _group(index: int) -> int:
    """Return the signal group of a link; 0, unknown, where a message has no number for it."""
    group = index + GROUP_OFFSET
    return group if group <= MAX_GROUP else 0


def _nodes(
    points: Sequence[tuple[float, float]], reference: tuple[float, float], north: float
) -> tuple[tuple[float, float], ...]:
    """Return a lane's first `LANE_LENGTH` as places east and north of the reference point [m]."""
    nodes, left = [points[0]], LANE_LENGTH
    for (x0, y0), (x, y) in pairwise(points):
        length = math.hypot(x - x0, y - y0)
        share = min(1.0, left / length) if length > 0.0 else 1.0
        nodes.append((x0 + share * (x - x0), y0 + share * (y - y0)))
        left -= length
        if left <= 0.0 or len(nodes) == mapem.MAX_NODES:
            break
    cos, sin = math.cos(north), math.sin(north)
    offsets = ((x - reference[0], y - reference[1]) for x, y in nodes)
    return tuple((cos * x + sin * y, cos * y - sin * x) for x, y in offsets)


def state_of(number: int, intersection: Intersection, phase: SignalPhase, utc: float) -> IntersectionState:
    """Return what a signal shows as its SPATEM has it, at a UTC time since 1970 [s]."""
    now = UNIX_EPOCH + datetime.timedelta(seconds=utc)
    of_year = now - datetime.datetime(now.year, 1, 1)
    movements = tuple(
        Movement(_group(index), _events(shows(phase, index), utc))
        for index in dict.fromkeys(link.index for link in intersection.links)
        if index < len(phase.state) and _group(index)
    )
    minute, second = divmod(of_year.total_seconds(), 60.0)
    return IntersectionState(number, movements, minute_of_year=int(minute), second=math.floor(1e3 * second) / 1e3)


def _events(shown: Sequence[LinkShow], utc: float) -> tuple[Event, ...]:
    """Return the phases of a link from a UTC time [s] on, the present one first."""
    return tuple(
        Event(
            PHASES.get(one.letter, Phase.UNAVAILABLE),
            min_end=_mark(utc, one.end),
            start=_mark(utc, one.begin) if row else None,
        )
        for row, one in enumerate(shown[:MAX_EVENTS])
    )


def _mark(utc: float, after: float) -> float | None:
    """Return a time within its hour [s]; None for one that no message can say.

    Rounded down: a phase must not be said to last longer than it does.
    """
    return math.floor(10.0 * math.fmod(utc + after, HOUR)) / 10.0 if after < HOUR else None
