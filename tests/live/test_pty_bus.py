"""Buses on pseudo-terminals under names of one's own: python-can's own slcan driver on the other ends."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from tests.live.patience import until
from vve_sumo.errors import RigError
from vve_sumo.live.pty_bus import PtyOutlet, TwoPortBus
from vve_sumo.live.slcan import Adapter
from vve_sumo.values import Frame


def opened(port: str) -> can.BusABC:
    return can.Bus(interface="slcan", channel=port, bitrate=500_000, sleep_after_open=0)


def message(frame: Frame) -> can.Message:
    return can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False)


def received(bus: can.BusABC) -> Frame:
    """The next frame; an adapter's answer to one that was sent is none."""
    for _ in range(100):
        if (found := bus.recv(0.1)) is not None:
            return Frame(found.arbitration_id, bytes(found.data))
    raise AssertionError("nothing came")


@pytest.fixture
def log() -> io.StringIO:
    return io.StringIO()


@pytest.fixture
def ports(tmp_path: Path, log: io.StringIO) -> Iterator[tuple[TwoPortBus, can.BusABC, can.BusABC]]:
    bus = TwoPortBus(f"pty:{tmp_path / 'brain.pty'}", log, lambda: 1.5)
    gateway, brain = opened(bus.name), opened(str(tmp_path / "brain.pty"))
    assert bus.receive() == []
    yield bus, gateway, brain
    gateway.shutdown()
    brain.shutdown()
    bus.close()


def test_every_node_hears_every_other_one_and_the_log_says_who_sent_what(
    ports: tuple[TwoPortBus, can.BusABC, can.BusABC], log: io.StringIO
) -> None:
    bus, gateway, brain = ports
    of_car, of_brain, of_gateway = Frame(0x061, b"\x01"), Frame(0x060, b"\x02"), Frame(0x3F0, b"\x03")
    bus.send([of_car])
    assert received(gateway) == received(brain) == of_car
    brain.send(message(of_brain))
    gateway.send(message(of_gateway))
    heard: list[Frame] = []
    until(lambda: bool(heard.extend(bus.receive()) or len(heard) == 2), 5.0)
    assert sorted(heard) == [of_brain, of_gateway]
    assert received(gateway) == of_brain
    assert received(brain) == of_gateway
    assert sorted(log.getvalue().splitlines()) == [
        "(0000000001.500000) brain 060#02",
        "(0000000001.500000) car 061#01",
        "(0000000001.500000) gateway 3F0#03",
    ]


def test_a_link_lives_as_long_as_its_bus_and_one_left_by_a_killed_drive_is_replaced(tmp_path: Path) -> None:
    link = tmp_path / "esr.pty"
    link.symlink_to("/dev/pts/none")
    outlet = PtyOutlet(f"pty:{link}")
    with opened(str(link)) as bus:
        outlet.send([])
        outlet.send([Frame(0x500, bytes(8))])
        assert received(bus) == Frame(0x500, bytes(8))
        bus.send(message(Frame(0x4F0, b"\x07")))
        heard: list[Frame] = []
        until(lambda: bool(heard.extend(outlet.receive()) or heard), 5.0)
        assert heard == [Frame(0x4F0, b"\x07")]
    outlet.close()
    assert not link.is_symlink()


def test_a_later_drives_link_is_not_removed(tmp_path: Path) -> None:
    link = f"pty:{tmp_path / 'esr.pty'}"
    first, second = PtyOutlet(link), PtyOutlet(link)
    first.close()
    assert (tmp_path / "esr.pty").is_symlink()
    second.close()


def test_a_file_that_is_no_link_stays_and_is_named(tmp_path: Path) -> None:
    file = tmp_path / "esr.pty"
    file.write_text("mine")
    with pytest.raises(RigError, match=r"esr\.pty"):
        PtyOutlet(f"pty:{file}")
    assert file.read_text() == "mine"


def test_a_link_to_something_else_than_a_terminal_stays_and_is_named(tmp_path: Path) -> None:
    link = tmp_path / "esr.pty"
    link.symlink_to(tmp_path / "mine")
    with pytest.raises(RigError, match=r"esr\.pty"):
        PtyOutlet(f"pty:{link}")
    assert link.readlink() == tmp_path / "mine"


def test_a_reader_that_is_late_gets_the_newest_frames_and_the_rest_counts_as_lost() -> None:
    with Adapter(queue=3) as adapter, opened(adapter.name) as bus:
        assert adapter.receive() == []
        adapter.send(Frame(number & 0x7FF, bytes(8)) for number in range(2000))
        assert adapter.dropped > 0
        until(lambda: bool(adapter.receive() or adapter.send([]) or received(bus).id == 1999 & 0x7FF), 20.0)
