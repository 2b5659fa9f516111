"""Reads what a real on-board unit has received: a datagram in, what a station says of itself out, or why it is none.

A datagram is a GeoNetworking packet, or an Ethernet frame with one. CAMs and VAMs tell of a body; other messages do
not. No bytes raise anything. Needs the package of the extra `v2x`. Knows no socket and no virtual road.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from msgspec import Struct

from vve_sumo.body_kinds import TYPICAL
from vve_sumo.v2x import cam, geonetworking, its_time, uper, vam
from vve_sumo.v2x.cam import Cam
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.geonetworking import PORTS
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.reference_position import ConfidenceEllipse
from vve_sumo.v2x.vam import Vam

#: a longer datagram is no packet [bytes]: a link-layer header, and what GeoNetworking carries at most
MAX_DATAGRAM: Final = 1600
#: the first byte of an unsecured packet of the version that is read
_PACKET: Final = geonetworking.VERSION << 4 | 1
#: the kind of body that a type of station is placed as; the others have none
KINDS: Final[Mapping[StationType, str]] = {
    StationType.PEDESTRIAN: "pedestrian",
    StationType.CYCLIST: "bicycle",
    StationType.LIGHT_VRU_VEHICLE: "bicycle",
    StationType.MOPED: "motorcycle",
    StationType.MOTORCYCLE: "motorcycle",
    StationType.PASSENGER_CAR: "car",
    StationType.LIGHT_TRUCK: "van",
    StationType.HEAVY_TRUCK: "truck",
    StationType.SPECIAL_VEHICLE: "truck",
    StationType.AGRICULTURAL: "truck",
    StationType.TRAILER: "truck",
    StationType.BUS: "bus",
    StationType.TRAM: "bus",
}
#: Reason codes of datagrams that tell of no body, in plain words.
REASONS: Final[dict[str, str]] = {
    "malformed": "no GeoNetworking packet with a message of these releases, or one that is secured",
    "no_body": "a message of another kind, or of a station that has no body on a road",
}


class StationReport(Struct, frozen=True):
    """What a station says of itself. Places are WGS84, angles counter-clockwise from true east."""

    station: int  #: ID
    message: int  #: 2 CAM, 16 VAM
    kind: str  #: of its body
    measured: float  #: drive time that it tells of [s]
    latitude: float  #: [rad]
    longitude: float  #: [rad]
    ahead: float  #: of that place, from the middle of the body [m]: half of its length, or 0
    accuracy: float  #: radius of the circle that holds the place with 95 % [m]; NaN for unknown
    heading: float  #: of the motion [rad]; NaN for unknown
    speed: float  #: over the ground along the heading [m/s]; NaN for unknown
    yaw_rate: float  #: [rad/s]; 0 where the message has none
    length: float  #: [m]
    width: float  #: [m]


def prepare() -> None:
    """Compile what reads the messages, which takes part of a second; raises ConfigError without the package for it."""
    uper.specification("CAM"), uper.specification("VAM")


def read(datagram: bytes, received: float, epoch: float) -> StationReport | str:
    """Return the report in a datagram that came at drive time `received` [s], or the reason code why it has none.

    GNSS second `epoch` is drive time 0. The same bytes, time and epoch give the same report.
    """
    try:
        return _read(datagram, received, epoch)
    except (MessageDecodeError, ValueError, OverflowError):
        return "malformed"


def _read(datagram: bytes, received: float, epoch: float) -> StationReport | str:
    if len(datagram) > MAX_DATAGRAM:
        raise MessageDecodeError(f"{len(datagram)} bytes")
    of_packet = datagram[:1] == bytes((_PACKET,))
    packet = geonetworking.decode(datagram if of_packet else geonetworking.packet_of_frame(datagram))
    now_ms = its_time.from_gnss(received + epoch)
    said: Cam | Vam
    if packet.port == PORTS[MessageId.CAM]:
        said = cam.decode(packet.payload, now_ms)
    elif packet.port == PORTS[MessageId.VAM]:
        said = vam.decode(packet.payload, now_ms)
    else:
        return "no_body"
    # A station that does not say what it is has the body that the kind of its message is for.
    unknown = "car" if isinstance(said, Cam) else "pedestrian"
    kind = unknown if said.station_type is StationType.UNKNOWN else KINDS.get(said.station_type)
    return "no_body" if kind is None else _report(said, kind, epoch)


def _report(said: Cam | Vam, kind: str, epoch: float) -> StationReport:
    usual, of_vehicle = TYPICAL[kind], isinstance(said, Cam)
    length = said.length or usual.length if isinstance(said, Cam) else usual.length
    width = said.width or usual.width if isinstance(said, Cam) else usual.width
    heading, speed = said.heading, said.speed
    ahead = 0.5 * length if of_vehicle else 0.0
    if isinstance(said, Cam) and said.reversing:
        ahead = -ahead  # the heading is that of the motion: the front is behind
    return StationReport(
        said.station,
        int(MessageId.CAM if of_vehicle else MessageId.VAM),
        kind,
        0.001 * said.time_ms + its_time.EPOCH_GNSS - epoch,
        math.radians(said.latitude_deg),
        math.radians(said.longitude_deg),
        ahead,
        _radius(said.confidence),
        math.nan if heading is None else heading,
        math.nan if speed is None else speed,
        said.yaw_rate or 0.0,
        length,
        width,
    )


def _radius(ellipse: ConfidenceEllipse | None) -> float:
    axes = () if ellipse is None else tuple(axis for axis in (ellipse.semi_major, ellipse.semi_minor) if axis)
    return max(axes, default=math.nan)
