"""Codec of the map message, MAPEM (ETSI TS 103 301 V2.1.1, ISO/TS 19091): the lanes of intersections, for a SPATEM.

Lanes are lines of nodes, east and north of the intersection's reference point in metres. Names, speed limits, road
segments and what else a lane may carry are not sent, and not read of a received message. The module must not know where
lanes come from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum, IntFlag
from typing import Any, Final

from vve_sumo.v2x import dsrc
from vve_sumo.v2x.data_elements import Scale, require_number
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.dsrc import MAX_INTERSECTIONS
from vve_sumo.v2x.pdu_header import MessageId, require_station
from vve_sumo.v2x.reference_position import NO_LATITUDE, NO_LONGITUDE, STEPS, latitude_count, longitude_count

MAX_LANES, MAX_CONNECTIONS = 255, 16
MIN_NODES, MAX_NODES = 2, 63
NODE_STEPS: Final = 100.0  #: counts of a node's place in a metre
LANE_WIDTH: Final = Scale("LaneWidth", 100.0, 0, 32_767, upward=False)  #: [m]
#: alternatives of a step from node to node, by the bits of each coordinate
_STEPS: Final = {10: "node-XY1", 11: "node-XY2", 12: "node-XY3", 13: "node-XY4", 14: "node-XY5", 16: "node-XY6"}
_DIRECTION_BITS, _SHARING_BITS, _MANEUVER_BITS = 2, 10, 12


class LaneKind(IntEnum):
    """For whom a lane is."""

    VEHICLE = 0
    CROSSWALK = 1
    BIKE_LANE = 2
    SIDEWALK = 3
    MEDIAN = 4
    STRIPING = 5
    TRACKED_VEHICLE = 6
    PARKING = 7


#: names of the kinds in the ASN.1, each with the bits of its attributes
_KINDS: Final = (
    ("vehicle", 8), ("crosswalk", 16), ("bikeLane", 16), ("sidewalk", 16), ("median", 16), ("striping", 16),
    ("trackedVehicle", 16), ("parking", 16),
)  # fmt: skip
_KIND_NAMES: Final = tuple(name for name, _ in _KINDS)


class Direction(IntFlag):
    """Which way a lane is driven. The standard's bit 0 is the highest."""

    EGRESS = 1  #: away from the intersection
    INGRESS = 2  #: towards the intersection


class Maneuver(IntFlag):
    """What is allowed from a lane (AllowedManeuvers). The standard's bit 0 is the highest."""

    STRAIGHT = 1 << 11
    LEFT = 1 << 10
    RIGHT = 1 << 9
    U_TURN = 1 << 8
    LEFT_TURN_ON_RED = 1 << 7
    RIGHT_TURN_ON_RED = 1 << 6
    LANE_CHANGE = 1 << 5
    NO_STOPPING = 1 << 4
    YIELD_ALWAYS = 1 << 3
    GO_WITH_HALT = 1 << 2
    CAUTION = 1 << 1


@dataclass(frozen=True, slots=True)
class Connection:
    """Where one may go on from a lane."""

    lane: int  #: identifier of the lane beyond, 0 to 255
    maneuver: Maneuver | None = None  #: by which one gets there
    signal_group: int | None = None  #: of the SPATEM that applies, 0 to 255
    id: int | None = None  #: of the connection, 0 to 255


@dataclass(frozen=True, slots=True)
class Lane:
    """One lane of an intersection."""

    id: int  #: 0 to 255
    kind: LaneKind
    direction: Direction
    nodes: tuple[tuple[float, float], ...]  #: 2 to 63 places from the stop line outwards, x east, y north [m], to 0.01
    ingress_approach: int | None = None  #: group of lanes that lead in, 0 to 15
    egress_approach: int | None = None  #: group of lanes that lead out, 0 to 15
    maneuvers: Maneuver | None = None
    connections: tuple[Connection, ...] = ()  #: at most 16


@dataclass(frozen=True, slots=True)
class IntersectionGeometry:
    """The lanes of one intersection."""

    id: int  #: 0 to 65535
    latitude_deg: float  #: WGS84, of the reference point [degree]
    longitude_deg: float  #: WGS84 [degree]
    lanes: tuple[Lane, ...]  #: 1 to 255
    region: int | None = None  #: of the identifier, 0 to 65535
    revision: int = 0  #: of the content's changes, 0 to 127
    lane_width: float | None = None  #: of lanes that say nothing else [m], to 0.01, at most 327.67


@dataclass(frozen=True, slots=True)
class Mapem:
    """The lanes of some intersections."""

    station: int  #: identifier, 32 bits
    intersections: tuple[IntersectionGeometry, ...] = ()  #: at most 32
    revision: int = 0  #: of the message's changes, 0 to 127


def encode(mapem: Mapem) -> bytes:
    """Return the bytes of a message.

    Raises ValueError for what no message can say: numbers that are not finite or beyond their range, places that are
    not on the earth, nodes more than 327 m apart, too many or too few parts. Raises ConfigError where pycrate is
    missing.
    """
    _require(mapem)
    body: dict[str, Any] = {"msgIssueRevision": mapem.revision}
    if mapem.intersections:
        body["intersections"] = [_intersection_content(one) for one in mapem.intersections]
    return dsrc.encode(MessageId.MAPEM, mapem.station, body)


def _require(mapem: Mapem) -> None:
    require_station(mapem.station)
    require_number("revision", mapem.revision, 0, 127)
    require_number("intersections", len(mapem.intersections), 0, MAX_INTERSECTIONS)
    for one in mapem.intersections:
        require_number("id", one.id, 0, 0xFFFF)
        require_number("region", one.region, 0, 0xFFFF)
        require_number("revision", one.revision, 0, 127)
        require_number("lanes", len(one.lanes), 1, MAX_LANES)
        for lane in one.lanes:
            _require_lane(lane)


def _require_lane(lane: Lane) -> None:
    require_number("lane", lane.id, 0, 255)
    require_number("ingress_approach", lane.ingress_approach, 0, 15)
    require_number("egress_approach", lane.egress_approach, 0, 15)
    require_number("nodes", len(lane.nodes), MIN_NODES, MAX_NODES)
    require_number("connections", len(lane.connections), 0, MAX_CONNECTIONS)
    for connection in lane.connections:
        for name, value in (
            ("lane", connection.lane),
            ("signal_group", connection.signal_group),
            ("connection", connection.id),
        ):
            require_number(name, value, 0, 255)
    for x, y in _steps(_node_counts(lane)):
        if not -(2**15) <= min(x, y) <= max(x, y) < 2**15:
            raise ValueError(f"lane {lane.id}: expected nodes at most 327.67 m apart, got {x / 100}, {y / 100} m")


def _node_counts(lane: Lane) -> list[tuple[int, int]]:
    """Places of a lane's nodes, in steps from the reference point."""
    for x, y in lane.nodes:
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ValueError(f"lane {lane.id}: expected finite numbers, got a node at {x}, {y}")
    return [(round(x * NODE_STEPS), round(y * NODE_STEPS)) for x, y in lane.nodes]


def _steps(places: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """From each node to the next, the first from the reference point."""
    return [
        (x - before_x, y - before_y) for (before_x, before_y), (x, y) in zip([(0, 0), *places], places, strict=False)
    ]


def _intersection_content(one: IntersectionGeometry) -> dict[str, Any]:
    content: dict[str, Any] = {
        "id": {"id": one.id} if one.region is None else {"region": one.region, "id": one.id},
        "revision": one.revision,
        "refPoint": {"lat": latitude_count(one.latitude_deg), "long": longitude_count(one.longitude_deg)},
        "laneSet": [_lane_content(lane) for lane in one.lanes],
    }
    if one.lane_width is not None:
        content["laneWidth"] = LANE_WIDTH.count(one.lane_width)
    return content


def _lane_content(lane: Lane) -> dict[str, Any]:
    kind, bits = _KINDS[lane.kind]
    content: dict[str, Any] = {
        "laneID": lane.id,
        "laneAttributes": {
            "directionalUse": (int(lane.direction), _DIRECTION_BITS),
            "sharedWith": (0, _SHARING_BITS),
            "laneType": (kind, (0, bits)),
        },
        "nodeList": ("nodes", [{"delta": _step_content(x, y)} for x, y in _steps(_node_counts(lane))]),
    }
    if lane.ingress_approach is not None:
        content["ingressApproach"] = lane.ingress_approach
    if lane.egress_approach is not None:
        content["egressApproach"] = lane.egress_approach
    if lane.maneuvers is not None:
        content["maneuvers"] = (int(lane.maneuvers), _MANEUVER_BITS)
    if lane.connections:
        content["connectsTo"] = [_connection_content(connection) for connection in lane.connections]
    return content


def _step_content(x: int, y: int) -> tuple[str, dict[str, int]]:
    """The shortest alternative that carries a step."""
    bits = min(bits for bits in _STEPS if -(2 ** (bits - 1)) <= min(x, y) and max(x, y) < 2 ** (bits - 1))
    return _STEPS[bits], {"x": x, "y": y}


def _connection_content(connection: Connection) -> dict[str, Any]:
    beyond: dict[str, Any] = {"lane": connection.lane}
    if connection.maneuver is not None:
        beyond["maneuver"] = (int(connection.maneuver), _MANEUVER_BITS)
    content: dict[str, Any] = {"connectingLane": beyond}
    if connection.signal_group is not None:
        content["signalGroup"] = connection.signal_group
    if connection.id is not None:
        content["connectionID"] = connection.id
    return content


def decode(data: bytes) -> Mapem:
    """Return the message of some bytes.

    Raises MessageDecodeError for bytes that are no MAPEM, for a reference point that is unavailable, and for lanes of
    a kind that later versions have added, or whose nodes are computed of another lane's or are degrees.
    """
    station, body = dsrc.decode(MessageId.MAPEM, data)
    intersections = tuple(_intersection_of(content) for content in body.get("intersections", ()))
    return Mapem(station, intersections, body["msgIssueRevision"])


def _intersection_of(content: dict[str, Any]) -> IntersectionGeometry:
    latitude, longitude = content["refPoint"]["lat"], content["refPoint"]["long"]
    if latitude == NO_LATITUDE or longitude == NO_LONGITUDE:
        raise MessageDecodeError("the position is unavailable")
    width = content.get("laneWidth")
    return IntersectionGeometry(
        content["id"]["id"],
        latitude / STEPS,
        longitude / STEPS,
        tuple(_lane_of(lane) for lane in content["laneSet"]),
        content["id"].get("region"),
        content["revision"],
        None if width is None else LANE_WIDTH.value(width),
    )


def _lane_of(content: dict[str, Any]) -> Lane:
    attributes, maneuvers = content["laneAttributes"], content.get("maneuvers")
    kind = attributes["laneType"][0]
    if kind not in _KIND_NAMES:
        raise MessageDecodeError(f"lane {content['laneID']} is of a kind that is not known ({kind})")
    return Lane(
        content["laneID"],
        LaneKind(_KIND_NAMES.index(kind)),
        Direction(attributes["directionalUse"][0]),
        _nodes_of(*content["nodeList"]),
        content.get("ingressApproach"),
        content.get("egressApproach"),
        None if maneuvers is None else Maneuver(maneuvers[0]),
        tuple(_connection_of(connection) for connection in content.get("connectsTo", ())),
    )


def _nodes_of(alternative: str, content: Any) -> tuple[tuple[float, float], ...]:
    if alternative != "nodes":
        raise MessageDecodeError(f"a lane's nodes are {alternative}, expected to be listed")
    places, x, y = [], 0, 0
    for node in content:
        name, step = node["delta"]
        if name not in _STEPS.values():
            raise MessageDecodeError(f"a node is {name}, expected a step in metres")
        x, y = x + step["x"], y + step["y"]
        places.append((x / NODE_STEPS, y / NODE_STEPS))
    return tuple(places)


def _connection_of(content: dict[str, Any]) -> Connection:
    beyond = content["connectingLane"]
    maneuver = beyond.get("maneuver")
    return Connection(
        beyond["lane"],
        None if maneuver is None else Maneuver(maneuver[0]),
        content.get("signalGroup"),
        content.get("connectionID"),
    )


def rounded(mapem: Mapem) -> Mapem:
    """Return what a receiver reads of a message, without making its bytes; raises ValueError as `encode` does."""
    _require(mapem)
    return replace(mapem, intersections=tuple(_rounded_intersection(one) for one in mapem.intersections))


def _rounded_intersection(one: IntersectionGeometry) -> IntersectionGeometry:
    return replace(
        one,
        latitude_deg=latitude_count(one.latitude_deg) / STEPS,
        longitude_deg=longitude_count(one.longitude_deg) / STEPS,
        lanes=tuple(_rounded_lane(lane) for lane in one.lanes),
        lane_width=None if one.lane_width is None else LANE_WIDTH.rounded(one.lane_width),
    )


def _rounded_lane(lane: Lane) -> Lane:
    return replace(lane, nodes=tuple((x / NODE_STEPS, y / NODE_STEPS) for x, y in _node_counts(lane)))
