"""Encodes and decodes SPATEM and MAPEM (ETSI TS 103 301 V2.1.1) in unaligned packed encoding rules, by pycrate.

Their content is of ISO/TS 19091 (module DSRC), which is not freely published; pycrate ships it compiled. Needs the
package of the extra `v2x-signals`. It knows types and Python's dictionaries of them; it must not know what a field
means. pycrate keeps the message that it works on in its types: one thread at a time may use this module.
"""

from __future__ import annotations

from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.v2x.data_elements import DataElement, Scale
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.pdu_header import PROTOCOL_VERSIONS, MessageId, require_station, station_of

MAX_INTERSECTIONS: Final = 32
#: of the year [minutes]; the greatest is "unknown"
UNKNOWN_MINUTE: Final = 527_040
#: time within an hour [s]
TIME_MARK: Final = DataElement(Scale("TimeMark", 10.0, 0, 36_000, upward=False), 36_001)
#: time within a minute [s], leap second included
SECOND: Final = DataElement(Scale("DSecond", 1000.0, 0, 60_999, upward=False), 65_535)
#: name of the content beside the header
_BODIES: Final = {MessageId.SPATEM: "spat", MessageId.MAPEM: "map"}


def _type(message: MessageId) -> Any:
    try:
        from pycrate_asn1dir.ITS_IS import MAPEM_PDU_Descriptions, SPATEM_PDU_Descriptions
    except ImportError:
        raise ConfigError("SPATEM and MAPEM need pycrate: pip install 'vve-sumo[v2x-signals]'") from None
    return SPATEM_PDU_Descriptions.SPATEM if message is MessageId.SPATEM else MAPEM_PDU_Descriptions.MAPEM


def encode(message: MessageId, station: int, body: dict[str, Any]) -> bytes:
    """Return the bytes of a message whose body is within its ASN.1 type.

    Raises ValueError for a station that is no 32-bit number, and ConfigError where pycrate is missing.
    """
    version = PROTOCOL_VERSIONS[message]
    header = {"protocolVersion": version, "messageID": int(message), "stationID": require_station(station)}
    kind = _type(message)
    kind.set_val({"header": header, _BODIES[message]: body})
    encoded: bytes = kind.to_uper()
    return encoded


def decode(message: MessageId, data: bytes) -> tuple[int, dict[str, Any]]:
    """Return station and body of a message; raises MessageDecodeError for bytes that are none."""
    kind = _type(message)
    try:
        kind.from_uper(data)
        content = kind.get_val()
    except Exception as error:  # pycrate meets some bytes with errors of Python's own
        raise MessageDecodeError(f"no {message.name}: {error}") from None
    header = content["header"]
    renamed = {
        "protocolVersion": header["protocolVersion"],
        "messageId": header["messageID"],
        "stationId": header["stationID"],
    }
    return station_of(renamed, message), content[_BODIES[message]]
