"""The tables of an external controller and of the outgoing wires: each contradiction is one line that names its key."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.complaints import complaint_of
from tests.conftest import REPOSITORY
from vve_sumo.rig.load import parse

ABROAD = {"kind": "setpoints", "address": "192.168.1.2", "source": "192.168.1.9", "key_file": "brain.key"}
RADAR = {"kind": "radar", "udp": "127.0.0.1:5002"}
ESR = {"kind": "esr", "interface": "slcan", "channel": "pty:esr.pty"}
STOP = {"kind": "stop", "interface": "socketcan", "channel": "can2", "can_id": 0x3F1}


def foreign(**tables: Any) -> dict[str, Any]:
    """The shipped rig of an external controller, with other tables."""
    return tomllib.loads((REPOSITORY / "rigs" / "foreign.toml").read_text(encoding="utf-8")) | tables


def without(table: dict[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name != key}


@pytest.mark.parametrize(
    "tables",
    [
        {},
        {"brain": ABROAD},
        {"outputs": [RADAR, ESR | {"host": "bus"}]},
        {"outputs": [RADAR, STOP]},
        {"outputs": [RADAR, {"kind": "ncom", "tcp": "127.0.0.1:5001"}, {"kind": "nmea", "device": "/dev/ttyS1"}]},
        {"outputs": [RADAR, {"kind": "ncom", "udp": "192.168.1.9:3000"}]},  # the same port of another machine
        {"outputs": [RADAR, {"kind": "osi_data", "udp": "127.0.0.1:5004"}]},
        {"brain": {"kind": "own"}, "outputs": []},
    ],
)
def test_what_makes_sense_is_taken(tables: dict[str, Any]) -> None:
    parse(foreign(**tables), Path("rig.toml"))


@pytest.mark.parametrize(
    ("brain", "line"),
    [
        (without(ABROAD, "source"), "brain: source is missing: anyone who reaches 192.168.1.2 could move the car"),
        (without(ABROAD, "key_file"), "brain: key_file is missing: anyone who reaches 192.168.1.2 could move the car"),
        (
            without(ABROAD | {"address": "0.0.0.0"}, "key_file"),
            "brain: key_file is missing: anyone who reaches 0.0.0.0",
        ),
        (ABROAD | {"source": "brain-pc"}, "brain.source: expected an IP address in numbers"),
        (ABROAD | {"source": "0.0.0.0"}, "brain.source: expected the IPv4 address of one device"),
        ({"kind": "setpoints", "source": "192.168.1.9"}, "brain: source: 192.168.1.9 cannot be heard on 127.0.0.1"),
    ],
)
def test_a_brain_that_is_not_known_or_not_heard_is_refused(brain: dict[str, Any], line: str) -> None:
    assert line in complaint_of(parse, foreign(brain=brain))


@pytest.mark.parametrize(
    ("outputs", "line"),
    [
        ([], "outputs: a brain of kind 'setpoints' needs one at least"),
        ([ESR], "outputs: expected one of kind 'radar'"),
        ([RADAR | {"tcp": "127.0.0.1:1"}], "kind 'radar' goes out one way"),
        ([{"kind": "radar", "tcp": "127.0.0.1:5002"}], "kind 'radar' goes out in datagrams: name udp, not tcp"),
        ([RADAR, {"kind": "osi_data", "tcp": "127.0.0.1:5004"}], "kind 'osi_data' goes out in datagrams"),
        ([RADAR, {"kind": "osi_view", "device": "/dev/ttyS1"}], "goes out in datagrams: name udp, not device"),
        ([RADAR, {"kind": "ncom", "udp": "127.0.0.1:3000"}], "outputs.1.udp: 127.0.0.1:3000 is where pose listens"),
        ([RADAR | {"udp": "127.0.0.1:5003"}], "outputs.0.udp: 127.0.0.1:5003 is where brain listens"),
        ([RADAR | {"udp": "localhost:5002"}], "expected an IPv4 address and a port"),
        ([RADAR | {"udp": "127.0.0.1:0"}], "port 0 is none"),
        *(
            ([RADAR | {"udp": f"{all_of_them}:5002"}], f"outputs.0.udp: {all_of_them} is everyone's, expected")
            for all_of_them in ("0.0.0.0", "224.0.0.1", "239.255.7.7", "255.255.255.255")
        ),
        ([RADAR, {"kind": "ncom", "tcp": "0.0.0.0:5001"}], "outputs.1.tcp: 0.0.0.0 is everyone's"),
        ([RADAR, {"kind": "ncom", "udp": "127.0.0.1:5009", "sensor": "noisy"}], "outputs.1.sensor: kind 'ncom'"),
        ([RADAR | {"sensor": "noisy"}], "outputs.0.sensor: a setpoint answers the datagrams of 'radar'"),
        ([RADAR | {"host": "bus"}], "host says nothing for kind 'radar'"),
        ([RADAR, *2 * [{"kind": "nmea", "device": "/dev/ttyS1"}]], "outputs.2.device: /dev/ttyS1 is the line of"),
        ([RADAR, {"kind": "nmea", "device": "pty"}], "outputs.1.device: pty is the line of bus"),
        ([RADAR, ESR | {"channel": "pty"}], "outputs.1: slcan:pty commands the car"),
        ([RADAR, ESR | {"interface": "socketcan"}], "outputs.1.interface: a pty is opened as 'slcan'"),
        ([RADAR, ESR, {"kind": "ars408"} | without(ESR, "kind")], "outputs: pty:esr.pty is named twice"),
        ([RADAR, without(STOP, "can_id")], "can_id is the identifier of the stop frame"),
        ([RADAR, STOP | {"channel": "can2", "can_id": 0x501}, ESR | {"interface": "socketcan", "channel": "can2"}],
         "share identifiers 0x501"),
    ],
)  # fmt: skip
def test_outputs_that_contradict_are_refused(outputs: list[dict[str, Any]], line: str) -> None:
    assert line in complaint_of(parse, foreign(outputs=outputs))
