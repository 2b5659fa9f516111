"""The software adapter: python-can's own slcan driver, and a bare terminal, on the other side."""

from __future__ import annotations

import os
import re
import select
import time
from collections.abc import Iterator

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.live.patience import until
from vve_sumo.bus import Bus
from vve_sumo.errors import RigError
from vve_sumo.live.slcan import QUEUE_SIZE, Adapter, SlcanProtocol, encode_frame
from vve_sumo.values import EXTENDED, Frame

IDENTIFIERS = st.integers(0, 0x7FF) | st.integers(EXTENDED, EXTENDED + 0x1FFF_FFFF)  # of 11 and of 29 bits
FRAMES = st.builds(Frame, IDENTIFIERS, st.binary(max_size=8))
#: of both lengths, in turn
MANY = [
    Frame(0x7FF - 13 * n if n % 2 else EXTENDED | (0x1FFFFFFF - 999_983 * n), bytes(range(n % 9))) for n in range(100)
]
OPENING = b"C\rS6\r\rO\r"  # what python-can sends


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    with Adapter() as made:
        yield made


def python_can(adapter: Adapter) -> can.BusABC:
    bus = can.Bus(interface="slcan", channel=adapter.name, bitrate=500_000, sleep_after_open=0)
    assert adapter.receive() == []
    return bus


def opened() -> SlcanProtocol:
    dialogue = SlcanProtocol()
    dialogue.take(OPENING)
    return dialogue


def heard(bus: can.BusABC) -> list[Frame]:
    """All that python-can reads until nothing comes for a while."""
    frames, end = [], time.monotonic() + 1.0
    while time.monotonic() < end and (message := bus.recv(0.05)) is not None:
        mark = EXTENDED if message.is_extended_id else 0
        frames.append(Frame(message.arbitration_id | mark, bytes(message.data)))
    return frames


def taken(adapter: Adapter, count: int) -> list[Frame]:
    """Take frames until there are as many; the kernel hands them over when it has time."""
    frames: list[Frame] = []

    def enough() -> bool:
        frames.extend(adapter.receive())
        return len(frames) >= count

    until(enough, 5.0)
    return frames


def test_frames_cross_to_python_can_and_back_bit_identical(adapter):
    frames = MANY
    with python_can(adapter) as bus:
        adapter.send(frames[:50])
        assert heard(bus) == frames[:50]
        for frame in frames[50:]:
            wide = bool(frame.id & EXTENDED)
            bus.send(can.Message(arbitration_id=frame.id & ~EXTENDED, data=frame.data, is_extended_id=wide))
        assert taken(adapter, len(frames[50:])) == frames[50:]


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x800, b""), Frame(-1, b""), Frame(0x60, bytes(9)), Frame(EXTENDED | 0x2000_0000, b""),
        Frame(EXTENDED | 1, bytes(9)),
    ],
)  # fmt: skip
def test_what_is_no_classic_frame_is_not_written_as_another(adapter, frame):
    with Bus("slcan", adapter.name) as bus, pytest.raises(RigError, match="cannot send: no classic frame"):
        bus.send(frame)


def test_our_own_bus_opens_it(adapter):
    with Bus("slcan", adapter.name) as bus:
        adapter.receive()
        bus.send(Frame(0x60, b"\x01\x02"))
        assert taken(adapter, 1) == [Frame(0x60, b"\x01\x02")]
        adapter.send([Frame(0x61, b""), Frame(0x65, bytes(8))])
        got = [bus.receive(1.0) for _ in range(2)]
        assert [one and one[1] for one in got] == [Frame(0x61, b""), Frame(0x65, bytes(8))]


def test_frames_cross_to_our_own_bus_and_back_bit_identical(adapter):
    frames = MANY
    with Bus("slcan", adapter.name) as bus:
        adapter.receive()
        adapter.send(frames[:50])
        came: list[Frame] = []
        until(lambda: came.extend(bus.drain()) or len(came) >= 50, 5.0)
        assert came == frames[:50]
        assert bus.drain() == []
        for frame in frames[50:]:
            bus.send(frame)
        assert taken(adapter, len(frames[50:])) == frames[50:]


def test_what_a_frame_cannot_hold_is_acknowledged_and_goes_nowhere(adapter):
    with python_can(adapter) as bus:
        for message in (
            can.Message(arbitration_id=0x61, is_remote_frame=True, dlc=8, is_extended_id=False),
            can.Message(arbitration_id=0x18DAF110, is_remote_frame=True, is_extended_id=True),
            can.Message(arbitration_id=0x61, data=[7], is_extended_id=False),
        ):
            bus.send(message)
        assert taken(adapter, 1) == [Frame(0x61, b"\x07")]
    assert opened().take(b"R18DAF1100\rr0618\r") == ([], b"Z\rz\r")
    assert opened().take(b"T18DAF11020102\r") == ([Frame(EXTENDED | 0x18DAF110, b"\x01\x02")], b"Z\r")


def test_it_says_who_it_is():
    dialogue = SlcanProtocol()
    assert re.fullmatch(rb"V\d{4}\rv\d{4}\rN\w{4}\rF[0-9A-F]{2}\r", dialogue.take(b"V\rv\rN\rF\r")[1])


@pytest.mark.parametrize(
    ("said", "answered"),
    [
        (b"O\r", b"\r"),
        (b"C\r", b"\a"),
        (b"O\rO\r", b"\r\a"),
        (b"O\rC\rC\r", b"\r\r\a"),
        (b"t0610\r", b"\a"),  # closed
        (b"S6\rs031C\rZ0\rM00000000\rmFFFFFFFF\r\r", b"\r" * 6),
        (b"Z1\rSX\rhello\rS\r", b"\a" * 4),
    ],
)
def test_it_answers_as_lawicel_says(said, answered):
    assert SlcanProtocol().take(said) == ([], answered)


@pytest.mark.parametrize(
    "line", ["t06", "t061", "t0619" + "00" * 9, "t0612AA", "t0611AAB", "t8000", "t061 1AA", "t061_1AA", "T200000000"]
)
def test_a_line_that_is_no_frame_is_refused(line):
    assert opened().take(line.encode() + b"\r") == ([], b"\a")


@given(st.lists(FRAMES, max_size=20), st.lists(st.integers(1, 40), min_size=1, max_size=40))
def test_however_the_stream_is_cut_the_frames_are_the_same(frames, cuts):
    stream, dialogue, taken = OPENING + b"".join(map(encode_frame, frames)), SlcanProtocol(), []
    for number in range(len(stream)):
        size = cuts[number % len(cuts)]
        taken += dialogue.take(stream[:size])[0]
        stream = stream[size:]
    assert taken == frames


@given(st.lists(st.binary(max_size=300), max_size=10), FRAMES)
def test_no_bytes_confuse_it_beyond_the_next_line_end(garbage, frame):
    dialogue = opened()
    for piece in garbage:
        dialogue.take(piece)
    dialogue.take(b"\rO\r")
    assert dialogue.take(encode_frame(frame)) == ([frame], b"Z\r" if frame.id & EXTENDED else b"z\r")


def test_nobody_reading_costs_the_oldest_lines_and_never_time(adapter):
    host = os.open(adapter.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    os.write(host, b"O\r")
    adapter.receive()
    total = 8 * QUEUE_SIZE
    for number in range(total):
        adapter.send([Frame(number & 0x7FF, number.to_bytes(4, "big"))])
    said = b""
    while select.select([host], [], [], 0.1)[0]:
        said += os.read(host, 65536)
        adapter.receive()  # as the car does at every step, whether anything came or not
    os.close(host)
    lines = said.removeprefix(b"\r").split(b"\r")
    assert lines.pop() == b""
    numbers = [int(line[5:], 16) for line in lines]
    assert all(re.fullmatch(rb"t[0-7][0-9A-F]{2}4[0-9A-F]{8}", line) for line in lines), "no line is cut"
    assert numbers == sorted(set(numbers)), "in order"
    assert numbers[-QUEUE_SIZE:] == list(range(total - QUEUE_SIZE, total)), "the newest are there"
    assert adapter.dropped == total - len(numbers) > 0


def test_a_host_that_died_leaves_nothing_to_the_next(adapter):
    first = os.open(adapter.name, os.O_RDWR | os.O_NOCTTY)
    os.write(first, OPENING)
    adapter.receive()
    adapter.send([Frame(1, b"old")] * 300)
    os.close(first)  # dies without a word
    adapter.send([Frame(1, b"old")] * 300)
    with python_can(adapter) as second:
        adapter.send([Frame(2, b"new")])
        assert heard(second) == [Frame(2, b"new")]


def test_frames_go_nowhere_before_a_host_opens_the_channel(adapter):
    adapter.send([Frame(1, b"early")])
    with python_can(adapter) as bus:
        adapter.send([Frame(2, b"")])
        assert heard(bus) == [Frame(2, b"")]
