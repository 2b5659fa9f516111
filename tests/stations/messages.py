"""Packets of real stations, by the codecs that tshark and pycrate check."""

from __future__ import annotations

import math
from typing import Any

from vve_sumo.frames import MapFrame, local_frame
from vve_sumo.v2x import cam, geonetworking, its_time, vam
from vve_sumo.v2x.cam import Cam
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.geonetworking import PORTS, Packet, PositionVector
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.reference_position import ConfidenceEllipse
from vve_sumo.v2x.vam import Vam

EPOCH = 1.4e9
ORIGIN = (math.radians(40.0041), math.radians(-83.0186))
FRAME = local_frame(*ORIGIN)
CIRCLE = ConfidenceEllipse(1.0, 1.0, 0.0)


def packet(message: MessageId, payload: bytes, station: int = 4711) -> bytes:
    source = PositionVector(
        b"\x02\x00" + station.to_bytes(4, "big"), StationType.PASSENGER_CAR, 0, 40.0, -83.0, 0.0, 0.0
    )
    return geonetworking.encode(Packet(source, PORTS[message], payload))


def car(
    time: float, x: float, y: float = 0.0, heading: float = 0.0, speed: float = 10.0, station: int = 4711,
    frame: MapFrame = FRAME, confidence: ConfidenceEllipse | None = CIRCLE, **more: Any,
) -> bytes:  # fmt: skip
    """A CAM of a car of 4.5 m whose middle of the front is at a place of a map, which moves along a heading there."""
    latitude, longitude = frame.to_geodetic(x, y)
    said = Cam(
        station, more.pop("station_type", StationType.PASSENGER_CAR), its_time.from_gnss(EPOCH + time),
        math.degrees(latitude), math.degrees(longitude), confidence,
        heading - frame.convergence(latitude, longitude), speed,
        **({"reversing": False, "length": 4.5, "width": 1.8} | more),
    )  # fmt: skip
    return packet(MessageId.CAM, cam.encode(said), station)


def walker(time: float, x: float, y: float, heading: float | None, speed: float, station: int = 12) -> bytes:
    """A VAM of a pedestrian."""
    latitude, longitude = FRAME.to_geodetic(x, y)
    said = Vam(
        station, StationType.PEDESTRIAN, its_time.from_gnss(EPOCH + time), math.degrees(latitude),
        math.degrees(longitude), CIRCLE, heading, speed,
    )  # fmt: skip
    return packet(MessageId.VAM, vam.encode(said), station)
