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
    types = {name: one for module in modules.values() for name, one in module["types"].items()}
    named = {name: one["named-numbers"] for name, one in types.items() if "named-numbers" in one}
    constants = {name: one["value"] for module in modules.values() for name, one in module["values"].items()}
    _resolve(modules, named, constants)
    return _library().compile_dict(modules, "uper", numeric_enums=True)


def _resolve(node: Any, named: dict[str, dict[str, int]], constants: dict[str, int]) -> None:
    """Replace, in a parsed tree, what asn1tools 0.169 compiles wrong without a word.

    A default that is a name (of `named` by type, or of `constants`) becomes its number. A union of values to which a
    number is restricted becomes its span, of which alone the encoding depends (X.691, 13.2); asn1tools takes the first
    part for all of it.
    """
    if isinstance(node, list):
        for one in node:
            _resolve(one, named, constants)
    elif isinstance(node, dict):
        names = {**constants, **named.get(node.get("type", ""), {})}
        if "default" in node:
            node["default"] = names.get(node["default"], node["default"])
        parts: list[Any] = node.get("restricted-to", [])
        if len(parts) > 1 and None not in parts:
            ends: list[int] = [names.get(end, end) for part in parts for end in _ends(part)]
            node["restricted-to"] = [(min(ends), max(ends))]
        for one in node.values():
            _resolve(one, named, constants)


def _ends(part: Any) -> tuple[Any, ...]:
    return part if isinstance(part, tuple) else (part,)


def encode(message: str, content: Any, part: str | None = None) -> bytes:
    """Return the bytes of a message, or of a `part` that it carries as bytes, whose content is within its ASN.1 type.

    Enumerations are numbers in the content, choices pairs of a name and a content.
    """
    encoded: bytes = specification(message).encode(part or message, content)
    return encoded


def decode(message: str, data: bytes, part: str | None = None) -> Any:
    """Return the content of a message, or of a `part` that it carries as bytes.

    Raises MessageDecodeError for bytes that are none.
    """
    compiled, kind = specification(message), part or message
    try:
        return compiled.decode(kind, data, check_constraints=True)
    except Exception as error:  # asn1tools meets some bytes with errors of Python's own
        raise MessageDecodeError(f"no {kind}: {error}") from None


@functools.cache
def alternatives(message: str, choice: str) -> tuple[str, ...]:
    """Return the names of a choice's alternatives, in the order of their numbers, in the modules of a message."""
    (members,) = (
        module["types"][choice]["members"]
        for file in MODULES[message]
        for module in _parsed(file).values()
        if choice in module["types"]
    )
    return tuple(member["name"] for member in members if member is not None)
