"""Encodes what the signals of the virtual road show as SPATEMs, and the lanes that they are for as MAPEMs.

Each intersection has a roadside unit of its own; its packets are what a GeoNetworking router hands on: GeoNetworking
header, BTP-B header and message, unsecured. The module must not know what the packets travel on.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.intersections import Intersection, IntersectionLink, LaneUse, SignalPhase
from vve_sumo.pose.nmea_encoder import LEAP_SECONDS
from vve_sumo.v2x import geonetworking, its_time, mapem, spatem
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.geonetworking import PORTS, Packet, PositionVector
from vve_sumo.v2x.mapem import Connection, Direction, IntersectionGeometry, Lane, LaneKind, Maneuver, Mapem
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.spatem import Event, IntersectionState, Movement, Phase, Spatem

#: intersections farther from the ego than this are left out [m]: so far the virtual road is simulated in full
RANGE: Final = 220.0
#: of a lane, from its stop line on, that a MAPEM has [m]
LANE_LENGTH: Final = 100.0
#: stations of the roadside units count up from here
FIRST_STATION: Final = 1001
#: a locally administered address ends in the station's ID
_ADDRESS: Final = b"\x02\x00"
#: a packet that is older is of no use [s]
LIFETIME: Final = 1.0
#: that a packet carries [bytes]
MAX_MESSAGE: Final = geonetworking.MAX_PAYLOAD - 4
#: profile of congestion control (TS 103 175: DP2)
TRAFFIC_CLASS: Final = 2
HOUR: Final = 3600.0
GNSS_EPOCH: Final = datetime.datetime(1980, 1, 6)
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


class _Unit(NamedTuple):
    """A roadside unit."""

    station: int
    intersection: Intersection
    x: float  #: of the reference point, map [m]
    y: float  #: as x [m]
    latitude_deg: float
    longitude_deg: float
    map: bytes  #: its MAPEM


class RoadsideEncoder:
    """Encodes the messages of all roadside units near the ego."""

    def __init__(self, intersections: Iterable[Intersection], frame: MapFrame) -> None:
        """`frame` is that of the virtual road's map. Raises ConfigError where the package for it is missing, or an
        intersection has more lanes than a message can say.
        """
        ordered = sorted(intersections, key=lambda one: one.signal)
        self._units = tuple(_unit(number, one, frame) for number, one in enumerate(ordered))

    def encode_maps(self, x: float, y: float, time: float) -> Sequence[bytes]:
        """Return the MAPEMs of the intersections near a place of the map [m], at a GNSS time [s]."""
        return [_packet(MessageId.MAPEM, unit, time, unit.map) for unit in self._near(x, y)]

    def encode_signals(self, x: float, y: float, time: float, shown: Mapping[str, SignalPhase]) -> Sequence[bytes]:
        """Return the SPATEMs of the intersections near a place of the map [m], by what their signals show."""
        near = (
            (unit, shown[unit.intersection.signal]) for unit in self._near(x, y) if unit.intersection.signal in shown
        )
        return [_packet(MessageId.SPATEM, unit, time, spatem.encode(_state(unit, phase, time))) for unit, phase in near]

    def _near(self, x: float, y: float) -> list[_Unit]:
        return [unit for unit in self._units if math.hypot(unit.x - x, unit.y - y) <= RANGE]


def _unit(number: int, intersection: Intersection, frame: MapFrame) -> _Unit:
    ends = [lane.points[-1] for lane in intersection.incoming]
    x, y = (math.fsum(values) / len(ends) for values in zip(*ends, strict=True))
    latitude, longitude = frame.to_geodetic(x, y)
    lanes = _lanes(intersection, frame, (x, y))
    place = math.degrees(latitude), math.degrees(longitude)
    geometry = IntersectionGeometry(number, *place, lanes, lane_width=intersection.incoming[0].width)
    try:
        encoded = mapem.encode(Mapem(FIRST_STATION + number, (geometry,)))
    except ValueError as error:
        raise ConfigError(f"signal {intersection.signal}: its lanes do not fit a MAPEM: {error}") from None
    if len(encoded) > MAX_MESSAGE:
        raise ConfigError(f"signal {intersection.signal}: its lanes do not fit a MAPEM: {len(encoded)} bytes")
    return _Unit(FIRST_STATION + number, intersection, x, y, *place, encoded)


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


def _state(unit: _Unit, phase: SignalPhase, time: float) -> Spatem:
    """Return the SPATEM of a signal at a GNSS time [s]."""
    utc = time - LEAP_SECONDS
    now = GNSS_EPOCH + datetime.timedelta(seconds=utc)
    of_year = now - datetime.datetime(now.year, 1, 1)
    # Rounded down: a phase must not be said to last longer than it does.
    end = math.floor(10.0 * math.fmod(utc + phase.remaining, HOUR)) / 10.0 if phase.remaining < HOUR else None
    movements = tuple(
        Movement(_group(index), (Event(PHASES.get(phase.state[index], Phase.UNAVAILABLE), min_end=end),))
        for index in dict.fromkeys(link.index for link in unit.intersection.links)
        if index < len(phase.state) and _group(index)
    )
    minute, second = divmod(of_year.total_seconds(), 60.0)
    state = IntersectionState(
        unit.station - FIRST_STATION, movements, minute_of_year=int(minute), second=math.floor(1e3 * second) / 1e3
    )
    return Spatem(unit.station, (state,))


def _packet(message: MessageId, unit: _Unit, time: float, payload: bytes) -> bytes:
    """Return a message in a packet that direct neighbours hear."""
    address, time_ms = _ADDRESS + unit.station.to_bytes(4, "big"), its_time.from_gnss(time)
    source = PositionVector(
        address,
        StationType.INFRASTRUCTURE,
        time_ms % geonetworking.TIME_MODULUS,
        unit.latitude_deg,
        unit.longitude_deg,
        0.0,
        0.0,
    )
    return geonetworking.encode(
        Packet(source, PORTS[message], payload, lifetime=LIFETIME, traffic_class=TRAFFIC_CLASS, mobile=False)
    )
