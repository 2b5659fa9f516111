"""The process of the outgoing wires signs this project's own datagrams where it is given a key, and no others."""

from __future__ import annotations

import socket
import time
from dataclasses import asdict

import pytest

from tests.vehicles import FUSION
from vve_sumo.live import spawn
from vve_sumo.live.channel import pair
from vve_sumo.pose import ncom
from vve_sumo.rig.connections import RigOutput
from vve_sumo.wire.datagrams import decode_radar
from vve_sumo.wire.signature import TAG, signed, without_tag

KEY = bytes(range(32))


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("key", [b"", KEY], ids=["unsigned", "signed"])
def test_radar_datagrams_are_signed_and_ncom_packets_are_not(key: bytes) -> None:
    ends = {kind: socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for kind in ("radar", "ncom")}
    drive, drives = pair()
    console, consoles = pair()
    for end in ends.values():
        end.bind(("127.0.0.1", 0))
        end.settimeout(30.0)
    tables = [RigOutput(kind=kind, udp=f"127.0.0.1:{end.getsockname()[1]}") for kind, end in ends.items()]
    config = {
        "outputs": [table.model_dump(mode="json") for table in tables],
        "vehicle": asdict(FUSION.vehicle),
        "projection": "",
        "map_offset": (0.0, 0.0),
        "intersections": (),
        "key": key.hex(),
        "t0": time.monotonic(),
        "epoch": 0.0,
    }
    process = spawn.start("outputs", config, {"drive": drives, "console": consoles})
    try:
        # The drive says nothing, so both wires say by themselves that they are invalid.
        radar, packet = (ends[kind].recv(2048) for kind in ("radar", "ncom"))
    finally:
        drive.close()
        process.wait(30.0)
        for end in (console, *ends.values()):
            end.close()
    body = without_tag(radar, key)
    assert body is not None
    read = decode_radar(body)
    assert read is not None
    assert not read.valid
    assert len(body) == len(radar) - (TAG if key else 0)
    assert (decode_radar(radar) is None) == bool(key)
    assert without_tag(radar, bytes(32)) is None
    assert radar == (signed(body, key) if key else body)
    assert len(packet) == ncom.LENGTH
