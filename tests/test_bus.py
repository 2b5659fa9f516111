"""The bus: python-can's own devices and readers on the other side."""

from __future__ import annotations

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicle.car import Rig
from vve_sumo.bus import Bus, LoggedFrame, candump_lines, read_log, written_log
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.values import EXTENDED, Frame, identifier_text
from vve_sumo.vehicle.arming_machine import OperatorCommand

IDENTIFIERS = st.integers(0, 0x7FF) | st.integers(EXTENDED, EXTENDED + 0x1FFF_FFFF)  # of 11 and of 29 bits
FRAMES = st.builds(Frame, IDENTIFIERS, st.binary(max_size=8))


def test_the_gateways_frames_cross_a_bus_and_come_back_bit_identical():
    rig, sent, heard = Rig(), [], []
    with Bus("virtual", "crossing") as ours, can.Bus(interface="virtual", channel="crossing") as theirs:
        for tick in range(50):
            rig.step(command=OperatorCommand.ENGAGE if tick == 0 else None)
            for frame in rig.frames:
                ours.send(frame)
                sent.append(frame)
                message = theirs.recv(1.0)
                theirs.send(message)
                heard.append(ours.receive(1.0)[1])
    assert heard == sent
    assert len(sent) == 200


def test_what_a_frame_cannot_hold_is_passed_over():
    with Bus("virtual", "others") as ours, can.Bus(interface="virtual", channel="others") as theirs:
        for message in (
            can.Message(arbitration_id=0x61, is_remote_frame=True, is_extended_id=False),
            can.Message(arbitration_id=0x61, is_error_frame=True, is_extended_id=False),
            can.Message(arbitration_id=0x61, data=bytes(12), is_fd=True, is_extended_id=False),
            can.Message(arbitration_id=0x61, data=[7], is_extended_id=False),
        ):
            theirs.send(message)
        assert ours.receive(1.0)[1] == Frame(0x61, b"\x07")
        assert ours.receive(0.0) is None


def test_identifiers_of_11_and_29_bits_are_two_things_on_every_bus():
    frames = [Frame(0x61, b"\x01"), Frame(EXTENDED | 0x61, b"\x02"), Frame(EXTENDED | 0x18DAF110, bytes(8))]
    with Bus("virtual", "wide") as ours, can.Bus(interface="virtual", channel="wide") as theirs:
        for frame in frames:
            ours.send(frame)
        messages = [theirs.recv(1.0) for _ in frames]
        assert [(one.arbitration_id, one.is_extended_id) for one in messages] == [
            (0x61, False), (0x61, True), (0x18DAF110, True),
        ]  # fmt: skip
        for message in messages:
            theirs.send(message)
        assert ours.drain() == frames
    assert [identifier_text(frame.id) for frame in frames] == ["0x061", "0x00000061", "0x18DAF110"]


@pytest.mark.parametrize("form", ["asc", "blf"])
def test_logs_of_vectors_tools_hold_identifiers_of_both_lengths(tmp_path, form):
    frames = [Frame(0x61, b"\x01"), Frame(EXTENDED | 0x61, b"\x02"), Frame(EXTENDED | 0x1FFFFFFF, bytes(8))]
    file = tmp_path / f"log.{form}"
    file.write_bytes(written_log([LoggedFrame(100.0 + n, 0, one, n % 2 == 0) for n, one in enumerate(frames)], form))
    with can.LogReader(file) as reader:
        read = [(one.arbitration_id, one.is_extended_id, bytes(one.data)) for one in reader]
    assert read == [(one.id & ~EXTENDED, bool(one.id & EXTENDED), one.data) for one in frames]


def test_a_bus_that_cannot_be_opened_is_one_line_about_the_rig():
    with pytest.raises(RigError, match=r"^CAN bus socketcan:vve_none0 cannot be opened: ") as caught:
        Bus("socketcan", "vve_none0")
    assert "\n" not in str(caught.value)


def test_a_vendors_missing_library_is_one_line_about_the_rig():
    with pytest.raises(RigError, match=r"^CAN bus kvaser:0 cannot be opened: "):
        Bus("kvaser", "0")


def test_an_unknown_interface_is_a_mistake_in_the_file():
    with pytest.raises(ConfigError, match=r"bus interface: expected one of .*socketcan.*; got 'carrier_pigeon'"):
        Bus("carrier_pigeon", "coop")


def test_a_closed_bus_says_so_instead_of_breaking():
    bus = Bus("virtual", "closed")
    bus.close()
    with pytest.raises(RigError, match="virtual:closed cannot send"):
        bus.send(Frame(1, b""))
    with pytest.raises(RigError, match="virtual:closed cannot receive"):
        bus.receive(0.0)


@given(st.lists(st.tuples(st.integers(0, 2**51), st.sampled_from(["can0", "car", "0"]), FRAMES), max_size=8))
def test_candump_lines_are_read_back_identically_by_python_can(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("log") / "drive.log"
    path.write_text("".join(candump_lines(us / 1e6, channel, [frame]) for us, channel, frame in rows))
    read = list(can.CanutilsLogReader(path))
    assert [(m.arbitration_id, bytes(m.data), m.is_extended_id, str(m.channel)) for m in read] == [
        (frame.id & ~EXTENDED, frame.data, bool(frame.id & EXTENDED), channel) for _, channel, frame in rows
    ]
    assert [round(m.timestamp * 1e6) for m in read] == [us for us, _, _ in rows]
    assert [(channel, frame) for _, channel, frame in read_log(path)] == [row[1:] for row in rows]


def test_a_real_recording_is_written_back_as_it_was(shared_data):
    path = shared_data / "drives" / "ford_fusion" / "collision_assist_activated.log"
    lines = path.read_text().splitlines(keepends=True)
    assert len(lines) > 8000
    assert [candump_lines(time, channel, [frame]) for time, channel, frame in read_log(path)] == lines


def test_a_log_that_is_not_there_or_not_a_log_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.log: No such file"):
        list(read_log(tmp_path / "none.log"))
    broken = tmp_path / "broken.log"
    broken.write_text("(0000000001.000000) can0 060#00\nthis is prose\n")
    with pytest.raises(ConfigError, match=r"broken\.log: not a candump log after 1 frames"):
        list(read_log(broken))
