"""The header of every message: protocol version, kind of message, station (ItsPduHeader of ETSI TS 102 894-2)."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Final

from vve_sumo.v2x.data_elements import require_number
from vve_sumo.v2x.decode_error import MessageDecodeError

MAX_STATION: Final = 2**32 - 1  #: a station's identifier has 32 bits


class MessageId(IntEnum):
    """Kinds of messages."""

    DENM = 1
    CAM = 2
    SPATEM = 4
    MAPEM = 5
    CPM = 14
    VAM = 16


#: of the releases in `asn1/`, and of SPATEM and MAPEM by TS 103 301 V2.1.1
PROTOCOL_VERSIONS: Final = {
    MessageId.DENM: 2,
    MessageId.CAM: 2,
    MessageId.SPATEM: 2,
    MessageId.MAPEM: 2,
    MessageId.CPM: 2,
    MessageId.VAM: 3,
}


def header_content(message: MessageId, station: int) -> dict[str, int]:
    """Return the content of a message's header; raises ValueError for a station that is no 32-bit number."""
    version = PROTOCOL_VERSIONS[message]
    return {"protocolVersion": version, "messageId": int(message), "stationId": require_station(station)}


def require_station(station: int) -> int:
    """Return a station's identifier; raises ValueError for one that is no 32-bit number."""
    require_number("station", station, 0, MAX_STATION)
    return station


def station_of(header: dict[str, Any], message: MessageId) -> int:
    """Return the station of a header's content; raises MessageDecodeError for another message or version."""
    version, number = header["protocolVersion"], header["messageId"]
    if (version, number) != (PROTOCOL_VERSIONS[message], message):
        raise MessageDecodeError(
            f"message {number} of protocol version {version}, "
            f"expected {message} of version {PROTOCOL_VERSIONS[message]} ({message.name})"
        )
    station: int = header["stationId"]
    return station
