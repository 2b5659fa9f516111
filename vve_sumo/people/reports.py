"""What comes from a person: positions, signs of life, the acknowledged start, the wish to stop; and their datagrams.

The datagrams are what the drive receives and what the record keeps. Knows no page, no receiver and no socket.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

from msgspec import Struct

from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind

#: characters of a person's id, at most
MAX_ID_LENGTH: Final = 64


class PositionReport(Struct, frozen=True, tag="position"):
    """Where a person was at one time."""

    person: str  #: id
    measured: float  #: drive time of the position [s]; of the times that are possible, the earliest
    latitude: float  #: WGS84 [rad]
    longitude: float  #: WGS84 [rad]
    accuracy: float  #: radius of the circle that holds the true place with 95 % [m], as W3C's Geolocation has it
    heading: float = math.nan  #: direction faced or walked in [rad], counter-clockwise from true east; NaN for unknown


class FieldEntered(Struct, frozen=True, tag="entered"):
    """The person has read the consent text, agrees, and says that they stand in their field."""

    person: str  #: id
    consent: str  #: SHA-256 of the text that the page showed (hexadecimal)


class PageAlive(Struct, frozen=True, tag="alive"):
    """The person's page is open and answers."""

    person: str  #: id


class PersonStop(Struct, frozen=True, tag="stop"):
    """The person asks for the end of the drive."""

    person: str  #: id


Report: TypeAlias = PositionReport | FieldEntered | PageAlive | PersonStop

_CODEC: Final = MessageCodec[Report](MessageKind.PEOPLE, Report)


def encode(report: Report) -> bytes:
    """Return the datagram of a report."""
    return _CODEC.encode(report)


def decode(datagram: bytes) -> Report | MalformedMessage:
    """Return the report in a datagram."""
    return _CODEC.decode(datagram)
