"""Setpoints over a real socket: who is heard, and what a live drive finds of anybody else that sends."""

from __future__ import annotations

import select
import socket
import struct
import time
import zlib
from collections.abc import Callable

import pytest

from tests.live.stage import free_ports
from vve_sumo.live.brain_link import ChannelLink, open_setpoints
from vve_sumo.live.channel import pair
from vve_sumo.rig.connections import Brain
from vve_sumo.wire.datagrams import RadarDatagram, SetpointDatagram, encode_radar, encode_setpoint
from vve_sumo.wire.setpoints import SetpointInbox
from vve_sumo.wire.signature import signed

HERE = "127.0.0.1"


class Bench:
    """A link as a live drive has it, its inbox, and two programs that send to it."""

    def __init__(self, key: bytes = b"") -> None:
        (port,) = free_ports(1)
        self._source = open_setpoints(Brain(kind="setpoints", port=port), key)
        ours, self._theirs = pair()
        self.link, self.inbox = ChannelLink(ours, self._source, 0.0, actors=False), SetpointInbox(0.0, key)
        self.inbox.sample_sent(7)
        with socket.socket(fileno=socket.dup(self._source.fileno())) as same:
            self._port = same.getsockname()[1]
        self.brain, self.stranger = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))

    def send(self, sender: socket.socket, data: bytes) -> None:
        """Send a datagram, and take in what arrives."""
        sender.sendto(data, (HERE, self._port))
        select.select([self._source], [], [], 5.0)
        for received, heard in self.link.receive(0.0, False):
            self.inbox.take(received, heard)
            self.at = received

    def close(self) -> None:
        """Close all sockets."""
        for each in (self.link, self.brain, self.stranger, self._theirs):
            each.close()


@pytest.fixture
def bench():
    bench = Bench()
    yield bench
    bench.close()


def _setpoint(sequence: int, acceleration: float) -> bytes:
    return encode_setpoint(SetpointDatagram(sequence, 7, time.monotonic(), 0.1, 0.0, acceleration))


def test_a_strangers_setpoint_is_refused_and_found(bench: Bench) -> None:
    bench.send(bench.brain, _setpoint(1, -1.0))
    assert bench.link.faults() == ()
    bench.send(bench.stranger, _setpoint(2, 2.0))
    command = bench.inbox.command(bench.at)
    assert command is not None
    assert command.acceleration == -1.0
    assert bench.inbox.taken == 1
    assert bench.link.faults() == ("setpoint_two_senders",)
    bench.send(bench.brain, _setpoint(2, -2.0))
    assert bench.inbox.taken == 2, "the brain is still heard"


@pytest.mark.parametrize(
    "junk",
    [
        b"",
        b"hello",
        b"\0" * 44,
        encode_setpoint(SetpointDatagram(1, 7, 0.0, 0.1, 0.0, 2.0))[:-1] + b"\0",
        encode_radar(RadarDatagram(1, 0.0, 0.1, 0.0, 0.0, 0.0, ())),
    ],
    ids=["empty", "short", "zeros", "torn", "radar"],
)
def test_what_is_no_setpoint_makes_nobody_the_brain(bench: Bench, junk: bytes) -> None:
    bench.send(bench.stranger, junk)
    bench.send(bench.brain, _setpoint(1, -1.0))
    assert bench.inbox.taken == 1, "the brain is heard"
    assert bench.link.faults() == ()
    bench.send(bench.stranger, junk)
    assert bench.link.faults() == ("setpoint_two_senders",)
    assert sum(bench.inbox.counts.values()) <= 1, "once there is a brain, nothing of a stranger is looked at"


def test_with_a_key_only_a_signed_setpoint_makes_its_sender_the_brain() -> None:
    bench = Bench(b"secret")
    try:
        for forged in (_setpoint(1, 2.0), signed(_setpoint(1, 2.0), b"other")):
            bench.send(bench.stranger, forged)
        assert bench.inbox.counts == {"setpoint_forged": 2}
        bench.send(bench.brain, signed(_setpoint(1, -1.0), b"secret"))
        assert bench.inbox.taken == 1
        assert bench.link.faults() == ()
    finally:
        bench.close()


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (lambda: b"VVES\x02" + _setpoint(2, 1.0)[5:], "setpoint_version"),
        (lambda: _setpoint(2, 1.0)[:-1] + b"\0", "setpoint_crc"),
        (lambda: _setpoint(1, 1.0), "setpoint_replayed"),
        (lambda: b"\0" * 2000, "setpoint_length"),
        (lambda: _setpoint(2, 1.0)[:-1], "setpoint_length"),
    ],
    ids=["version", "crc", "replayed", "long", "short"],
)
def test_what_the_brain_itself_sends_wrong_has_a_reason_and_changes_nothing(
    bench: Bench, made: Callable[[], bytes], reason: str
) -> None:
    bench.send(bench.brain, _setpoint(1, -1.0))
    before = bench.inbox.command(bench.at)
    bench.send(bench.brain, made())
    assert bench.inbox.counts == {reason: 1}
    assert bench.inbox.command(bench.at) == before


def test_a_number_that_is_none_moves_nothing_over_the_socket(bench: Bench) -> None:
    body = _setpoint(1, 1.0)[:28] + struct.pack("<f", float("nan")) + _setpoint(1, 1.0)[32:40]
    bench.send(bench.brain, body + struct.pack("<I", zlib.crc32(body)))
    assert bench.inbox.counts == {"setpoint_not_finite": 1}
    assert bench.inbox.command(0.0) is None
