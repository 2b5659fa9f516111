"""Puts messages into packets, as a GeoNetworking router hands them on: its header, BTP-B header and message, unsecured.

It must not know what the packets travel on.
"""

from __future__ import annotations

from typing import Final

from vve_sumo.v2x import denm, geonetworking
from vve_sumo.v2x.cam import Cam
from vve_sumo.v2x.data_elements import ExteriorLights, StationType
from vve_sumo.v2x.denm import Cause, Denm
from vve_sumo.v2x.events import KINDS
from vve_sumo.v2x.geonetworking import PORTS, Area, AreaShape, Packet, PositionVector
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.vam import Vam

#: a locally administered address ends in the station's ID
_ADDRESS: Final = b"\x02\x00"
#: of the packet of an awareness message [s]: one that is older is of no use
LIFETIME: Final = 1.0
#: profile of congestion control of awareness messages (TS 103 175: DP2)
TRAFFIC_CLASS: Final = 2
#: between two CAMs of a station with a low-frequency container [ms] (EN 302 637-2, 6.1.3)
LOW_FREQUENCY: Final = 500


class LowFrequency:
    """Says which CAMs of each station have the low-frequency container."""

    def __init__(self) -> None:
        self._sent: dict[int, int] = {}

    def lights(self, station: int, time_ms: int) -> ExteriorLights | None:
        """Return the lights that a CAM tells of: none is on; None where it has no such container."""
        if time_ms - self._sent.get(station, -LOW_FREQUENCY) < LOW_FREQUENCY:
            return None
        self._sent[station] = time_ms
        return ExteriorLights(0)


def area_packet(said: Denm, cause: Cause, sequence: int) -> bytes:
    """Return a notification in a packet to everyone near its event; `sequence` counts the sender's such packets."""
    kind, place = KINDS[cause], (said.latitude_deg, said.longitude_deg)
    motion = said.speed or 0.0, said.heading or 0.0
    packet = Packet(
        vector_of(said.station, said.station_type, said.reference_time_ms, *place, *motion),
        PORTS[MessageId.DENM],
        denm.encode(said),
        Area(AreaShape.CIRCLE, *place, kind.radius),
        sequence,
        geonetworking.HOP_LIMIT,
        geonetworking.HOP_LIMIT,
        lifetime=float(kind.validity_s),
        traffic_class=kind.traffic_class,
    )
    return geonetworking.encode(packet)


def awareness_packet(message: MessageId, said: Cam | Vam, payload: bytes) -> bytes:
    """Return a message in a packet that direct neighbours hear."""
    place = said.latitude_deg, said.longitude_deg
    motion = said.speed or 0.0, said.heading or 0.0
    return single_hop(message, vector_of(said.station, said.station_type, said.time_ms, *place, *motion), payload)


def vector_of(
    station: int,
    kind: StationType,
    time_ms: int,
    latitude_deg: float,
    longitude_deg: float,
    speed: float,
    heading: float,
) -> PositionVector:
    address, time = _ADDRESS + station.to_bytes(4, "big"), time_ms % geonetworking.TIME_MODULUS
    return PositionVector(address, kind, time, latitude_deg, longitude_deg, speed, heading)


def single_hop(message: MessageId, source: PositionVector, payload: bytes) -> bytes:
    packet = Packet(source, PORTS[message], payload, lifetime=LIFETIME, traffic_class=TRAFFIC_CLASS)
    return geonetworking.encode(packet)
