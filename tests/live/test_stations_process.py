"""The process that hears a real on-board unit: datagrams in, what they say out, and no more than it should read."""

from __future__ import annotations

import select
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.live.command_line import free_port
from tests.live.patience import until
from tests.stations.messages import EPOCH, car, walker
from vve_sumo.live import messages, spawn
from vve_sumo.live.channel import pair
from vve_sumo.live.stations import MAX_PACKETS, PERIOD
from vve_sumo.live.stations_link import StationsFeed
from vve_sumo.stations.reports import StationReport, read

START = 30.0  #: within it a process compiles its codecs on a busy machine [s]


@contextmanager
def running(folder: Path, port: int) -> Iterator[tuple[StationsFeed, float, subprocess.Popen[bytes]]]:
    """A process that listens; gives the drive's end, the monotonic second of drive time 0, and the process."""
    drive, theirs = pair()
    console, console_theirs = pair()
    t0 = time.monotonic()
    config = {
        "listen": f"127.0.0.1:{port}", "sender": None, "t0": t0, "epoch": EPOCH, "folder": str(folder),
        "log": str(folder / "stations.log"),
    }  # fmt: skip
    process = spawn.start("stations", config, {"drive": theirs, "console": console_theirs}, own_session=True)
    select.select([console], [], [], START)
    assert isinstance(messages.decode((console.receive() or [b""])[0]), messages.Ready)
    console.close()
    feed = StationsFeed(drive)
    try:
        yield feed, t0, process
    finally:
        feed.close()
        process.wait(START)


def heard(feed: StationsFeed, count: int) -> list[tuple[float, bytes, StationReport | str]]:
    found: list[tuple[float, bytes, StationReport | str]] = []

    def enough() -> bool:
        found.extend(feed.receive())
        return len(found) >= count

    until(enough)
    return found


def test_each_datagram_comes_with_its_time_and_what_it_says(tmp_path: Path) -> None:
    port = free_port()
    with running(tmp_path, port) as (feed, t0, _process), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        begun = time.monotonic() - t0
        sent = [car(begun, 1.0), walker(begun, 2.0, 3.0, 0.0, 1.0), b"no packet", car(begun, 4.0, station=8)]
        for datagram in sent:
            sender.sendto(datagram, ("127.0.0.1", port))
        found = heard(feed, len(sent))
        ended = time.monotonic() - t0
        assert [datagram for _received, datagram, _said in found] == sent
        for received, datagram, said in found:
            assert begun - 1e-3 <= received <= ended
            # Bit for bit what a replay makes of the same bytes.
            assert repr(said) == repr(read(datagram, received, EPOCH))
    assert "'malformed': 1, 'read': 3" in (tmp_path / "stations.log").read_text(encoding="utf-8")


@pytest.mark.thorough
def test_who_sends_the_first_sound_packet_is_the_unit_and_nobody_else_is_heard(tmp_path: Path) -> None:
    port = free_port()
    with (
        running(tmp_path, port) as (feed, t0, _process),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unit,
    ):
        stranger.sendto(b"no packet", ("127.0.0.1", port))
        genuine = car(time.monotonic() - t0, 1.0)
        unit.sendto(genuine, ("127.0.0.1", port))
        assert heard(feed, 2)[0][2] == "malformed"
        stranger.sendto(genuine, ("127.0.0.1", port))
        unit.sendto(genuine, ("127.0.0.1", port))
        time.sleep(0.2)
        assert len(heard(feed, 1)) == 1
    assert "'refused': {'127.0.0.1:" in (tmp_path / "stations.log").read_text(encoding="utf-8")


@pytest.mark.thorough
def test_a_flood_is_dropped_and_counted(tmp_path: Path) -> None:
    """Of a thousand packets at once a period's worth is read for each period that they take to come."""
    port = free_port()
    with running(tmp_path, port) as (feed, t0, _process), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        begun = time.monotonic()
        datagram = car(begun - t0, 1.0)
        for _ in range(1000):
            sender.sendto(datagram, ("127.0.0.1", port))
        took = time.monotonic() - begun
        time.sleep(1.0)
        found = heard(feed, MAX_PACKETS)
        assert MAX_PACKETS <= len(found) <= MAX_PACKETS * (2 + took / PERIOD)
    assert "dropped" in (tmp_path / "stations.log").read_text(encoding="utf-8")


@pytest.mark.thorough
def test_a_port_that_is_taken_is_one_line(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        console, theirs = pair()
        drive, of_process = pair()
        config = {"listen": f"127.0.0.1:{port}", "sender": None, "t0": 0.0, "epoch": EPOCH, "folder": str(tmp_path),
                  "log": str(tmp_path / "stations.log")}  # fmt: skip
        process = spawn.start("stations", config, {"drive": of_process, "console": theirs}, own_session=True)
        select.select([console], [], [], START)
        refused = messages.decode((console.receive() or [b""])[0])
        assert isinstance(refused, messages.Refused)
        assert refused.text.startswith("v2x.listen.port: UDP port")
        assert process.wait(START) == refused.exit_code == 3
        drive.close()


@pytest.mark.thorough
def test_the_process_ends_with_the_drive(tmp_path: Path) -> None:
    with running(tmp_path, free_port()) as (_feed, _t0, process):
        assert process.poll() is None
    assert process.returncode == 0
