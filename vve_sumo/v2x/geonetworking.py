"""Codec of the headers below a message: GeoNetworking (ETSI EN 302 636-4-1 V1.4.1) and BTP-B (EN 302 636-5-1 V2.2.1).

Two kinds of packets: single-hop broadcast (SHB), heard by direct neighbours, and geo-broadcast (GBC), to all within an
area. Both are unsecured. The module knows bytes; it must not know who forwards a packet, nor the interface it goes out
on. Headings are counter-clockwise from true east here, clockwise from true north on the wire.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from vve_sumo.v2x.data_elements import StationType, heading_count, heading_of, require_number
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.reference_position import STEPS, latitude_count, longitude_count

ETHERTYPE: Final = 0x8947  #: of GeoNetworking
BROADCAST: Final = b"\xff" * 6
VERSION: Final = 1  #: of the protocol, since V1.3.1
MAX_PAYLOAD: Final = 1398  #: of a packet with its transport header [bytes]: itsGnMaxSduSize
HOP_LIMIT: Final = 10  #: itsGnDefaultHopLimit
LIFETIME: Final = 60.0  #: itsGnDefaultPacketLifetime [s]
TIME_MODULUS: Final = 2**32  #: of a position vector's time [ms]

#: port of each message (TS 103 248)
PORTS: Final = {
    MessageId.CAM: 2001,
    MessageId.DENM: 2002,
    MessageId.MAPEM: 2003,
    MessageId.SPATEM: 2004,
    MessageId.CPM: 2009,
    MessageId.VAM: 2018,
}

_COMMON, _SECURED = 1, 2  # what follows a basic header
_BTP_B: Final = 2  # what follows a common header
_GBC, _TSB = 4, 5  # header types
_MOBILE: Final = 0x80  # flag: the source can move
_BASIC = struct.Struct(">BxBB")  # version and next header, lifetime, remaining hop limit
_COMMON_HEADER = struct.Struct(">BBBBHBx")  # next header, type, traffic class, flags, payload, maximum hop limit
_VECTOR = struct.Struct(">H6sIiiHH")  # address, time, latitude, longitude, accuracy and speed, heading
_MEDIUM: Final = 4  #: bytes of an SHB that depend on the medium
_SEQUENCE = struct.Struct(">Hxx")
_AREA = struct.Struct(">iiHHHxx")  # latitude, longitude, distances, angle
_BTP = struct.Struct(">HH")  # destination port, its info
_ETHERNET = struct.Struct(">6s6sH")
#: units of a lifetime [s]: two bits beside a multiplier of six
_LIFETIME_UNITS: Final = (0.05, 1.0, 10.0, 100.0)
_MAX_MULTIPLIER: Final = 63
_SPEEDS: Final = 1 << 15  # a speed is a signed number of 15 bits, 0.01 m/s each
_MAX_SPEED: Final = _SPEEDS // 2 - 1
_TURN: Final = 3600  # counts of a heading


class AreaShape(IntEnum):
    """Shapes of the area of a geo-broadcast (EN 302 931)."""

    CIRCLE = 0
    RECTANGLE = 1
    ELLIPSE = 2


@dataclass(frozen=True, slots=True)
class Area:
    """Whom a geo-broadcast is for."""

    shape: AreaShape
    latitude_deg: float  #: WGS84, of the centre [degree]
    longitude_deg: float  #: WGS84, of the centre [degree]
    distance_a: int  #: radius, or half of the long side or axis [m], at most 65535
    distance_b: int = 0  #: half of the short side or axis [m]; 0 for a circle
    orientation: float = math.pi / 2.0  #: of the long side [rad], counter-clockwise from true east; to whole degrees


@dataclass(frozen=True, slots=True)
class PositionVector:
    """Who the source is, and where it is: the long position vector."""

    address: bytes  #: link-layer address, 6 bytes
    station_type: StationType
    time_ms: int  #: TimestampIts of the position, modulo 2**32 [ms]
    latitude_deg: float  #: WGS84 [degree]
    longitude_deg: float  #: WGS84 [degree]
    speed: float  #: [m/s], backwards negative; to 0.01, at most 163.83 either way
    heading: float  #: [rad], counter-clockwise from true east
    accurate: bool = True  #: the position is as accurate as the source's own limit asks
    manual: bool = True  #: the address was configured, and not by itself


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet with its message: a geo-broadcast where it has an area, else a single-hop broadcast."""

    source: PositionVector
    port: int  #: of the message, as in `PORTS`
    payload: bytes  #: the message
    area: Area | None = None
    sequence: int = 0  #: of the source's packets that travel more than one hop, modulo 65536; 0 for a single hop
    hops: int = 1  #: that remain
    max_hops: int = 1  #: with which it began
    lifetime: float = LIFETIME  #: [s]; rounded up to what the header carries, at most 6300
    traffic_class: int = 0  #: 0 to 63: a profile of congestion control, the lower the more urgent
    mobile: bool = True  #: the source can move
    port_info: int = 0


def encode(packet: Packet) -> bytes:
    """Return the bytes of a packet, which are the payload of an Ethernet frame of `ETHERTYPE`.

    Raises ValueError for numbers that their fields cannot carry, except that a speed saturates.
    """
    if len(packet.payload) + _BTP.size > MAX_PAYLOAD:
        raise ValueError(f"a packet carries {MAX_PAYLOAD - _BTP.size} bytes at most, got {len(packet.payload)}")
    require_number("hops", packet.hops, 0, 255)
    require_number("max_hops", packet.max_hops, 0, 255)
    require_number("traffic_class", packet.traffic_class, 0, 63)
    require_number("port", packet.port, 0, 0xFFFF)
    require_number("port_info", packet.port_info, 0, 0xFFFF)
    kind, extended = _extended(packet)
    return b"".join(
        (
            _BASIC.pack(VERSION << 4 | _COMMON, _lifetime_code(packet.lifetime), packet.hops),
            _COMMON_HEADER.pack(
                _BTP_B << 4,
                kind,
                packet.traffic_class,
                _MOBILE if packet.mobile else 0,
                _BTP.size + len(packet.payload),
                packet.max_hops,
            ),
            extended,
            _BTP.pack(packet.port, packet.port_info),
            packet.payload,
        )
    )


def _extended(packet: Packet) -> tuple[int, bytes]:
    """Header type with its subtype, and the extended header."""
    vector, area = _vector_bytes(packet.source), packet.area
    if area is None:
        return _TSB << 4, vector + bytes(_MEDIUM)
    require_number("sequence", packet.sequence, 0, 0xFFFF)
    return _GBC << 4 | area.shape, _SEQUENCE.pack(packet.sequence) + vector + _area_bytes(area)


def _vector_bytes(source: PositionVector) -> bytes:
    if len(source.address) != 6:
        raise ValueError(f"a link-layer address has 6 bytes, got {len(source.address)}")
    if not math.isfinite(source.speed):
        raise ValueError(f"speed: expected a finite number, got {source.speed}")
    require_number("time_ms", source.time_ms, 0, TIME_MODULUS - 1)
    speed = round(max(-_MAX_SPEED, min(_MAX_SPEED, 100.0 * source.speed))) % _SPEEDS
    return _VECTOR.pack(
        source.manual << 15 | source.station_type << 10,
        source.address,
        source.time_ms,
        latitude_count(source.latitude_deg),
        longitude_count(source.longitude_deg),
        source.accurate << 15 | speed,
        heading_count(source.heading),
    )


def _area_bytes(area: Area) -> bytes:
    require_number("distance_a", area.distance_a, 0, 0xFFFF)
    require_number("distance_b", area.distance_b, 0, 0xFFFF)
    return _AREA.pack(
        latitude_count(area.latitude_deg),
        longitude_count(area.longitude_deg),
        area.distance_a,
        area.distance_b,
        round(heading_count(area.orientation) / 10.0) % 360,
    )


def _lifetime_code(lifetime: float) -> int:
    """Multiplier and unit of a lifetime [s]: the finest unit that can say it, rounded up."""
    for code, unit in enumerate(_LIFETIME_UNITS):
        if 0.0 <= lifetime <= _MAX_MULTIPLIER * unit:
            return math.ceil(lifetime / unit - 1e-6) << 2 | code
    raise ValueError(f"lifetime: expected 0 to {_MAX_MULTIPLIER * _LIFETIME_UNITS[-1]:g} s, got {lifetime}")


def decode(data: bytes) -> Packet:
    """Return the packet of some bytes; what follows its payload, as Ethernet pads short frames, is ignored.

    Raises MessageDecodeError for bytes that are no unsecured SHB or GBC with BTP-B of this version.
    """
    try:
        return _decode(data)
    except struct.error:
        raise MessageDecodeError(f"a packet ends after {len(data)} bytes") from None


def _decode(data: bytes) -> Packet:
    first, lifetime, hops = _BASIC.unpack_from(data)
    if first != VERSION << 4 | _COMMON:
        what = "a secured packet" if first & 15 == _SECURED else f"version {first >> 4}, next header {first & 15}"
        raise MessageDecodeError(f"{what}, expected an unsecured packet of version {VERSION}")
    following, kind, traffic_class, flags, size, max_hops = _COMMON_HEADER.unpack_from(data, _BASIC.size)
    if following >> 4 != _BTP_B:
        raise MessageDecodeError(f"transport {following >> 4}, expected BTP-B ({_BTP_B})")
    start = _BASIC.size + _COMMON_HEADER.size
    area, sequence = None, 0
    if kind == _TSB << 4:
        source = _vector_of(data, start)
        start += _VECTOR.size + _MEDIUM
    elif kind >> 4 == _GBC and kind & 15 <= AreaShape.ELLIPSE:
        (sequence,) = _SEQUENCE.unpack_from(data, start)
        source = _vector_of(data, start + _SEQUENCE.size)
        start += _SEQUENCE.size + _VECTOR.size
        area = _area_of(data, start, AreaShape(kind & 15))
        start += _AREA.size
    else:
        raise MessageDecodeError(f"header type {kind:#04x}, expected a single-hop or a geo-broadcast")
    port, port_info = _BTP.unpack_from(data, start)
    payload = data[start + _BTP.size : start + size]
    if len(payload) + _BTP.size != size:
        raise MessageDecodeError(f"a payload of {size} bytes is announced, {len(payload) + _BTP.size} are there")
    duration = (lifetime >> 2) * _LIFETIME_UNITS[lifetime & 3]
    return Packet(
        source, port, bytes(payload), area, sequence, hops, max_hops, duration, traffic_class & 63,
        bool(flags & _MOBILE), port_info,
    )  # fmt: skip


def _vector_of(data: bytes, start: int) -> PositionVector:
    kind, address, time_ms, latitude, longitude, motion, heading = _VECTOR.unpack_from(data, start)
    speed = motion % _SPEEDS
    towards = heading_of(heading)
    if towards is None or heading >= _TURN:
        raise MessageDecodeError(f"heading: expected 0 to {_TURN - 1}, got {heading}")
    return PositionVector(
        address,
        StationType.of(kind >> 10 & 31),
        time_ms,
        *_place(latitude, longitude),
        (speed - _SPEEDS if speed > _MAX_SPEED else speed) / 100.0,
        towards,
        bool(motion >> 15),
        bool(kind >> 15),
    )


def _area_of(data: bytes, start: int, shape: AreaShape) -> Area:
    latitude, longitude, a, b, angle = _AREA.unpack_from(data, start)
    towards = heading_of(10 * angle)
    if towards is None or angle >= 360:
        raise MessageDecodeError(f"angle: expected 0 to 359 degrees, got {angle}")
    return Area(shape, *_place(latitude, longitude), a, b, towards)


def _place(latitude: int, longitude: int) -> tuple[float, float]:
    if abs(latitude) > 90 * STEPS or abs(longitude) > 180 * STEPS:
        raise MessageDecodeError(f"a place at {latitude / STEPS}, {longitude / STEPS} degrees")
    return latitude / STEPS, longitude / STEPS


def ethernet_frame(packet: bytes, source: bytes, destination: bytes = BROADCAST) -> bytes:
    """Return an Ethernet frame with a packet, between link-layer addresses of 6 bytes each; it is not padded."""
    return _ETHERNET.pack(destination, source, ETHERTYPE) + packet


def packet_of_frame(frame: bytes) -> bytes:
    """Return the packet in an Ethernet frame; raises MessageDecodeError for a frame of another type."""
    if len(frame) < _ETHERNET.size or _ETHERNET.unpack_from(frame)[2] != ETHERTYPE:
        raise MessageDecodeError(f"no Ethernet frame of type {ETHERTYPE:#x}")
    return frame[_ETHERNET.size :]
