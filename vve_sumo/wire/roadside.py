"""Encodes what the signals of the virtual road show as SPATEMs, and the lanes that they are for as MAPEMs.

Each intersection has a roadside unit of its own; its packets are what a GeoNetworking router hands on: GeoNetworking
header, BTP-B header and message, unsecured. The module must not know what the packets travel on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.intersections import Intersection, SignalPhase
from vve_sumo.pose.nmea_encoder import LEAP_SECONDS
from vve_sumo.sensors.roadside_messages import geometry_of, middle_of, state_of
from vve_sumo.v2x import geonetworking, its_time, mapem, spatem
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.geonetworking import PORTS, Packet, PositionVector
from vve_sumo.v2x.mapem import Mapem
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.spatem import Spatem

#: intersections farther from the ego than this are left out [m]: so far the virtual road is simulated in full
RANGE: Final = 220.0
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
#: second of the GNSS epoch since 1970, without leap seconds
GNSS_EPOCH: Final = 315_964_800.0


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
    x, y = middle_of(intersection)
    geometry = geometry_of(number, intersection, frame)
    place = geometry.latitude_deg, geometry.longitude_deg
    try:
        encoded = mapem.encode(Mapem(FIRST_STATION + number, (geometry,)))
    except ValueError as error:
        raise ConfigError(f"signal {intersection.signal}: its lanes do not fit a MAPEM: {error}") from None
    if len(encoded) > MAX_MESSAGE:
        raise ConfigError(f"signal {intersection.signal}: its lanes do not fit a MAPEM: {len(encoded)} bytes")
    return _Unit(FIRST_STATION + number, intersection, x, y, *place, encoded)


def _state(unit: _Unit, phase: SignalPhase, time: float) -> Spatem:
    """Return the SPATEM of a signal at a GNSS time [s]."""
    state = state_of(unit.station - FIRST_STATION, unit.intersection, phase, GNSS_EPOCH + time - LEAP_SECONDS)
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
