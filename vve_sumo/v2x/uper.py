"""Encodes and decodes ETSI's messages in unaligned packed encoding rules (X.691), by the ASN.1 modules in `asn1/`.

Needs the package of the extra `v2x`. It knows types and Python's dictionaries of them; it must not know what a field
means. A message's modules are parsed and compiled when the first one is encoded or decoded, once in a process.
"""

from __future__ import annotations

import copy
import functools
from pathlib import Path
from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.v2x.decode_error import MessageDecodeError

FOLDER: Final = Path(__file__).with_name("asn1")
#: the common data dictionary is in Windows-1252
ENCODING: Final = "cp1252"
_DICTIONARY: Final = "TS102894-2v241-CDD.asn"
#: files of each message's modules, by the message's type
MODULES: Final = {
    "CAM": ("TS103900v231-CAM.asn", _DICTIONARY),
    "DENM": ("TS103831v231-DENM.asn", _DICTIONARY),
    "VAM": ("VAM-PDU-Descriptions.asn", _DICTIONARY),
    "CollectivePerceptionMessage": (
        "CPM-PDU-Descriptions.asn",
        "CPM-OriginatingStationContainers.asn",
        "CPM-SensorInformationContainer.asn",
        "CPM-PerceptionRegionContainer.asn",
        "CPM-PerceivedObjectContainer.asn",
        _DICTIONARY,
    ),
}


def _library() -> Any:
    try:
        import asn1tools
    except ImportError:
        raise ConfigError("V2X messages need asn1tools: pip install 'vve-sumo[v2x]'") from None
    return asn1tools


@functools.cache
def _parsed(file: str) -> dict[str, Any]:
    parsed: dict[str, Any] = _library().parse_string((FOLDER / file).read_text(encoding=ENCODING))
    return parsed


@functools.cache
def specification(message: str) -> Any:
    """Return the compiled modules of a message; it takes part of a second, once in a process.

    Raises ConfigError where asn1tools is missing.
    """
    modules = {name: module for file in MODULES[message] for name, module in _parsed(file).items()}
    modules = copy.deepcopy(modules)  # compiling writes into them, and messages share the dictionary
    return _library().compile_dict(modules, "uper")


def encode(message: str, content: dict[str, Any]) -> bytes:
    """Return the bytes of a message whose content is within the ASN.1 type."""
    encoded: bytes = specification(message).encode(message, content)
    return encoded


def decode(message: str, data: bytes) -> dict[str, Any]:
    """Return the content of a message; raises MessageDecodeError for bytes that are none."""
    compiled = specification(message)
    try:
        content: dict[str, Any] = compiled.decode(message, data, check_constraints=True)
    except Exception as error:  # asn1tools meets some bytes with errors of Python's own
        raise MessageDecodeError(f"no {message}: {error}") from None
    return content
