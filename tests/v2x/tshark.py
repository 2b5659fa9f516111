"""What tshark, whose decoders of GeoNetworking, BTP and messages are independent of ours, reads of packets."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

needs_tshark = pytest.mark.skipif(shutil.which("tshark") is None, reason="needs tshark (apt-get install tshark)")
#: of a capture file: magic number, version 2.4, no time zone, longest frame, Ethernet
_FILE = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 0xFFFF, 1)

Fields = dict[str, list[str]]


def read(frames: Sequence[bytes], folder: Path) -> list[Fields]:
    """Return the fields that tshark reads of each Ethernet frame: the values of each name in their order."""
    capture = folder / "frames.pcap"
    records = (struct.pack("<IIII", number, 0, len(frame), len(frame)) + frame for number, frame in enumerate(frames))
    capture.write_bytes(_FILE + b"".join(records))
    command = ["tshark", "-n", "-r", str(capture), "-T", "json", "-J", "gnw btpb its _ws.malformed _ws.expert"]
    done = subprocess.run(command, check=True, capture_output=True, timeout=300)
    packets = json.loads(done.stdout, object_pairs_hook=list)
    assert len(packets) == len(frames)
    return [_fields(packet) for packet in packets]


def _fields(packet: Any) -> Fields:
    fields: Fields = {}
    for name, value in _leaves(packet):
        fields.setdefault(name, []).append(value)
    return fields


def _leaves(pairs: Any) -> Iterator[tuple[str, str]]:
    for name, value in pairs:
        if isinstance(value, str):
            yield name, value
        elif value and isinstance(value[0], tuple):
            yield from _leaves(value)


def assert_read(found: Fields, expected: dict[str, Any]) -> None:
    """Fail unless tshark reads these numbers, or lists of numbers, under these names, and finds nothing malformed."""
    assert not [name for name in found if name.startswith("_ws.")], found
    wanted = {
        name: [str(one) for one in (value if isinstance(value, list) else [value])] for name, value in expected.items()
    }
    assert {name: found.get(name) for name in wanted} == wanted
