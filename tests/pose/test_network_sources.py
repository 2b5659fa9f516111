"""Pose receivers over real sockets: when did what arrive, from whom, and what is refused."""

from __future__ import annotations

import math
import os
import random
import socket
import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.pose.ncom_packets import START, content, fix_at, stream
from tests.pose.source_reading import gathered, ready
from vve_sumo.errors import RigError
from vve_sumo.pose import ncom
from vve_sumo.pose.sources import BYTES, PORTIONS, SO_TIMESTAMPNS, open_tcp, open_udp


def port_that_is_free() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def free_port() -> int:
    return port_that_is_free()


@pytest.fixture
def listener(free_port):
    source = open_udp("127.0.0.1", free_port)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", free_port))
        sender.send(b"first")  # the kernel begins to stamp a moment after it was asked to
        ready(source)
        time.sleep(0.02)
        source.receive()
        yield source, sender
    source.close()


# --- UDP --------------------------------------------------------------------------------------------------------------


def test_datagrams_arrive_whole_and_in_order(listener):
    source, sender = listener
    assert source.receive() == []
    for k in range(200):
        sender.send(b"%d" % k)
    assert [data for _, data in gathered(source, 490)] == [b"%d" % k for k in range(200)]
    assert source.next_due() == math.inf
    assert not source.lost


def test_what_is_read_late_is_told_with_the_moment_it_came(listener):
    source, sender = listener
    sent = []
    for _ in range(5):
        sent.append(time.monotonic())
        sender.send(b"x")
        time.sleep(0.05)
    arrivals = [received for received, _ in source.receive()]
    read = time.monotonic()
    assert len(arrivals) == 5
    assert all(-0.001 < received - moment < 0.03 for received, moment in zip(arrivals, sent, strict=True))
    assert read - arrivals[0] > 0.2


def test_what_waited_for_seconds_is_not_fresh(listener):
    """A drive that was stopped for a while must not take what waited for what has just come."""
    source, sender = listener
    sent = time.monotonic()
    sender.send(b"x")
    time.sleep(1.3)
    ((received, _),) = source.receive()
    assert received - sent < 0.1


def test_a_busy_interpreter_does_not_move_arrivals(listener):
    """A thread that keeps the interpreter to itself for long stretches, as a SUMO step does."""
    source, sender = listener
    stop = threading.Event()

    def hog() -> None:
        while not stop.is_set():
            sorted(range(300_000, 0, -1), key=lambda value: -value % 7919)

    sent: list[float] = []
    thread = threading.Thread(target=hog)
    thread.start()
    try:
        for _ in range(20):
            sent.append(time.monotonic())
            sender.send(b"x")
            time.sleep(0.02)
        portions = source.receive()
    finally:
        stop.set()
        thread.join()
    late = sorted(received - moment for (received, _), moment in zip(portions, sent, strict=True))
    assert late[0] > -0.001
    assert late[10] < 0.01


@pytest.mark.parametrize("moved", [-3600.0, -0.03, -0.005, 0.005, 0.03, 3600.0])
def test_a_wall_clock_that_is_set_moves_no_arrival_into_the_past_or_the_future(listener, moved):
    source, sender = listener
    sender.send(b"x")
    time.sleep(0.05)
    then, ahead = source._stamps._last
    source._stamps._last = then, ahead - moved  # as if it had been set since the last look
    before = time.monotonic()
    ((received, _),) = source.receive()
    assert before <= received <= time.monotonic()
    sender.send(b"y")
    sent = time.monotonic()
    time.sleep(0.05)
    ((received, _),) = source.receive()
    assert received - sent < 0.03


def test_where_the_kernel_stamps_nothing_a_datagram_comes_when_it_is_read(listener):
    source, sender = listener
    with socket.socket(fileno=os.dup(source.fileno())) as same:
        same.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 0)
    sender.send(b"x")
    time.sleep(0.05)
    before = time.monotonic()
    ((received, _),) = source.receive()
    assert before <= received <= time.monotonic()


def test_a_flood_does_not_hold_the_reader(listener):
    source, sender = listener
    for _ in range(3 * PORTIONS):
        sender.send(b"x")
    assert 0 < len(source.receive()) <= PORTIONS


@pytest.mark.parametrize("length", [1, 72, 4096])
def test_a_flood_is_taken_in_bounded_pieces_and_none_of_it_is_lost_in_between(listener, length):
    """Neither many datagrams nor long ones hold the reader; what it leaves is there at the next look."""
    source, sender = listener
    for _ in range(20):
        sender.send(b"x" * length)
    time.sleep(0.05)
    pieces = []
    while piece := source.receive():
        pieces.append(sum(len(data) for _, data in piece))
    assert sum(pieces) == 20 * length
    assert max(pieces) < BYTES + 4096


def test_a_flood_of_strangers_does_not_hold_the_reader_either(free_port):
    source = open_udp("127.0.0.1", free_port, "127.0.0.2")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.connect(("127.0.0.1", free_port))
        for _ in range(PORTIONS + 10):
            stranger.send(b"x")
    time.sleep(0.05)
    assert source.receive() == []
    assert sum(source.sender_report()["refused"].values()) == PORTIONS
    source.receive()
    assert sum(source.sender_report()["refused"].values()) == PORTIONS + 10
    source.close()


def sender_from(address: str) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind((address, 0))
    return opened


def test_only_the_source_is_heard_and_every_other_sender_is_told(free_port):
    source = open_udp("0.0.0.0", free_port, "127.0.0.3")
    with sender_from("127.0.0.3") as receiver, sender_from("127.0.0.4") as stranger:
        for data, who in ((b"a", receiver), (b"b", stranger), (b"c", receiver), (b"d", stranger)):
            who.sendto(data, ("127.0.0.1", free_port))
        time.sleep(0.05)
        assert [data for _, data in source.receive()] == [b"a", b"c"]
        assert source.sender_faults() == ("pose_foreign_sender",)
        names = [f"{address}:{port}" for address, port in (receiver.getsockname(), stranger.getsockname())]
    assert source.sender_report() == {"sender": names[0], "refused": {names[1]: 2}}
    time.sleep(1.05)
    assert source.sender_faults() == (), "a stray datagram is told for a second"
    source.close()


def test_a_second_program_at_the_source_s_address_is_another_sender(free_port):
    source = open_udp("127.0.0.1", free_port)
    with sender_from("127.0.0.1") as first, sender_from("127.0.0.1") as second, sender_from("127.0.0.9") as third:
        for data, who in ((b"a", first), (b"b", second), (b"c", first), (b"d", third)):
            who.sendto(data, ("127.0.0.1", free_port))
        time.sleep(0.05)
        assert [data for _, data in source.receive()] == [b"a", b"c"]
    assert source.sender_faults() == ("pose_two_senders",)
    assert len(source.sender_report()["refused"]) == 2
    source.close()


def test_empty_and_long_datagrams_are_survived(listener):
    source, sender = listener
    for data in (b"", b"x" * 20_000, b"last"):
        sender.send(data)
    time.sleep(0.05)
    portions = source.receive()
    assert portions[-1][1] == b"last"
    assert not source.lost


def test_a_port_in_use_and_a_foreign_address_name_the_key(free_port):
    first = open_udp("127.0.0.1", free_port)
    with pytest.raises(
        RigError, match=rf"^rigs/a\.toml, pose\.port: UDP port {free_port} is in use by another program$"
    ):
        open_udp("127.0.0.1", free_port, where="rigs/a.toml, pose")
    first.close()
    with pytest.raises(RigError, match=r"^pose\.address: '192\.0\.2\.1' is no address of this machine$"):
        open_udp("192.0.2.1", free_port)
    with pytest.raises(RigError, match=r"^pose\.address: 'no such name'"):
        open_udp("no such name", free_port)


def test_several_programs_may_listen_to_a_broadcast(free_port):
    sources = [open_udp("0.0.0.0", free_port) for _ in range(2)]
    for source in sources:
        source.close()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open any port")
def test_a_port_that_this_user_may_not_open_names_the_key():
    with pytest.raises(RigError, match=r"^pose\.port: UDP port 7 may not be opened by this user$"):
        open_udp("127.0.0.1", 7)


PACKETS = stream(40)
GOOD = {content(fix) for fix in ncom.Decoder().feed(b"".join(PACKETS), 0.0)}


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32))
def test_bursts_duplicates_reordering_and_garbage_give_only_good_fixes(seed):
    chance, datagrams = random.Random(seed), []
    for packet in PACKETS:
        datagrams += [packet] * chance.choice([0, 1, 1, 1, 2])
        if chance.random() < 0.2:
            datagrams.append(chance.randbytes(chance.randrange(1, 200)))
        if chance.random() < 0.1:
            datagrams.append(packet[: chance.randrange(72)])
        if chance.random() < 0.2 and len(datagrams) > 1:
            datagrams[-1], datagrams[-2] = datagrams[-2], datagrams[-1]
    port = port_that_is_free()
    source, decoder = open_udp("127.0.0.1", port), ncom.Decoder()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for data in datagrams:
                sender.sendto(data, ("127.0.0.1", port))
        portions = gathered(source, sum(len(data) for data in datagrams))
    finally:
        source.close()
    found = [fix for received, data in portions for fix in decoder.feed(data, received)]
    assert {content(fix) for fix in found} <= GOOD
    times = [fix.time for fix in found]
    assert times == sorted(set(times))
    assert len(found) > 5


def test_a_fix_carries_the_moment_its_datagram_came(listener):
    source, sender = listener
    sent = time.monotonic()
    sender.send(ncom.Encoder().encode(fix_at(START)))
    time.sleep(0.05)
    ((received, data),) = source.receive()
    (fix,) = ncom.Decoder().feed(data, received)
    assert fix.time_received - sent < 0.03


# --- TCP --------------------------------------------------------------------------------------------------------------


@pytest.fixture
def connection():
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = open_tcp("127.0.0.1", server.getsockname()[1])
        peer, _ = server.accept()
        with peer:
            yield source, peer
        source.close()


def test_a_stream_arrives_whole_and_its_end_is_told(connection):
    source, peer = connection
    data = random.Random(1).randbytes(100_000)
    peer.sendall(data)
    assert b"".join(part for _, part in gathered(source, len(data))) == data
    peer.sendall(b"last words")
    peer.close()
    assert b"".join(part for _, part in gathered(source, 10)) == b"last words"
    ready(source)
    assert source.receive() == []
    assert source.lost
    assert source.receive() == []


def test_a_connection_that_breaks_is_lost_and_raises_nothing(connection):
    source, peer = connection
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
    peer.close()  # a reset, not an end
    ready(source)
    assert source.receive() == []
    assert source.lost


def test_a_stream_read_late_is_told_with_the_moment_it_came(connection):
    source, peer = connection
    peer.sendall(b"warm")
    ready(source)
    time.sleep(0.05)
    source.receive()
    sent = time.monotonic()
    peer.sendall(b"$GPHDT,12.0,T*07\r\n")
    time.sleep(0.1)
    ((received, _),) = source.receive()
    assert -0.001 < received - sent < 0.03


def test_nobody_there_names_the_key(free_port):
    with pytest.raises(RigError, match=rf"^pose\.port: 127\.0\.0\.1:{free_port} refuses the connection"):
        open_tcp("127.0.0.1", free_port)
    with pytest.raises(RigError, match=r"^pose\.address: 'no such name'"):
        open_tcp("no such name", free_port)
