"""The far ends of receivers' wires that are served: readers that come, go and do not read, and names that are taken."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from vve_sumo.errors import RigError
from vve_sumo.pose.far_ends import MAX_CLIENTS, PtyFarEnd, TcpFarEnd
from vve_sumo.pose.sources import Source, open_serial, open_tcp

LINE = b"$GPZDA,120000.00,01,01,2026,00,00*6B\r\n"


@pytest.fixture
def served() -> Iterator[tuple[TcpFarEnd, int]]:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    far = TcpFarEnd("127.0.0.1", port)
    yield far, port
    far.close()


def heard(source: Source, size: int) -> bytes:
    """What has come to a source once it is so much, or after 5 s."""
    data, deadline = b"", time.monotonic() + 5.0
    while len(data) < size and time.monotonic() < deadline:
        data += b"".join(portion for _stamp, portion in source.receive())
        time.sleep(0.001)
    return data


@pytest.mark.thorough
def test_every_client_hears_the_stream_from_when_it_came(served: tuple[TcpFarEnd, int]) -> None:
    far, port = served
    far.send(b"before anybody listens")
    first = open_tcp("127.0.0.1", port)
    far.send(LINE)
    assert heard(first, len(LINE)) == LINE
    second = open_tcp("127.0.0.1", port)
    far.send(2 * LINE)
    assert heard(second, 2 * len(LINE)) == heard(first, 2 * len(LINE)) == 2 * LINE
    first.close()
    for _ in range(3):
        far.send(LINE)
    assert heard(second, 3 * len(LINE)) == 3 * LINE
    assert not second.lost
    far.close()
    heard(second, 1)
    assert second.lost
    second.close()


def test_a_client_that_does_not_read_is_cut_off_and_nobody_waits_for_it(served: tuple[TcpFarEnd, int]) -> None:
    far, port = served
    with socket.create_connection(("127.0.0.1", port)) as idle:
        far.send(LINE)
        begun = time.monotonic()
        for _ in range(400):
            far.send(bytes(100_000))
        assert time.monotonic() - begun < 5.0
        reader = open_tcp("127.0.0.1", port)
        far.send(LINE)
        assert heard(reader, len(LINE)) == LINE
        reader.close()
        idle.settimeout(5.0)
        while idle.recv(1 << 20):  # ends, for the connection is closed
            pass


def test_no_more_clients_are_served_than_a_receiver_serves(served: tuple[TcpFarEnd, int]) -> None:
    far, port = served
    clients = [open_tcp("127.0.0.1", port) for _ in range(MAX_CLIENTS + 1)]
    far.send(LINE)
    assert [heard(client, len(LINE)) for client in clients[:-1]] == [LINE] * MAX_CLIENTS
    assert clients[-1].receive() == []
    for client in clients:
        client.close()


def test_a_port_that_is_served_names_the_key(served: tuple[TcpFarEnd, int]) -> None:
    _far, port = served
    with pytest.raises(RigError, match=rf"^pose\.port: 127\.0\.0\.1:{port} is in use by another program$"):
        TcpFarEnd("127.0.0.1", port)
    with pytest.raises(RigError, match=r"^pose\.port: 192\.0\.2\.1:5000 cannot be served"):
        TcpFarEnd("192.0.2.1", 5000)


def test_a_line_that_nobody_reads_holds_nothing_up_and_gives_a_reader_the_new(tmp_path: Path) -> None:
    far, link = PtyFarEnd(f"pty:{tmp_path / 'gnss'}"), tmp_path / "gnss"
    begun = time.monotonic()
    for _ in range(1000):
        far.send(b"old " * 20)
    assert time.monotonic() - begun < 1.0
    for _ in range(2):  # a reader after another
        source = open_serial(str(link), 115_200)
        heard_so_far, deadline = b"", time.monotonic() + 5.0
        while LINE not in heard_so_far and time.monotonic() < deadline:
            far.send(LINE)
            heard_so_far += heard(source, 1)
        assert LINE in heard_so_far
        source.close()
    far.close()
    assert not link.is_symlink()


def test_a_line_that_was_full_gives_whole_portions(tmp_path: Path) -> None:
    far, link = PtyFarEnd(f"pty:{tmp_path / 'gnss'}"), tmp_path / "gnss"
    source, heard_so_far, number = open_serial(str(link), 115_200), b"", 0
    for _ in range(20):  # a reader that sleeps over hundreds of portions each time
        for _ in range(400):
            number += 1
            far.send(b"<%06d %s>\n" % (number, b"x" * (number % 90)))
        heard_so_far += heard(source, 1)
    portions = heard_so_far.split(b"\n")[:-1]
    assert len(portions) > 100
    assert all(one.startswith(b"<") and one.endswith(b">") and one.count(b"<") == 1 for one in portions)
    source.close()
    far.close()


def test_a_line_takes_the_place_of_nothing_else(tmp_path: Path) -> None:
    file = tmp_path / "mine"
    file.write_text("mine")
    with pytest.raises(RigError, match="File exists"):
        PtyFarEnd(f"pty:{file}")
    assert file.read_text() == "mine"
    with pytest.raises(RigError, match="expected pty:FILE"):
        PtyFarEnd(str(tmp_path / "ttyUSB7"))
    assert not os.path.lexists(tmp_path / "ttyUSB7")
    (tmp_path / "left").symlink_to("/dev/pts/none")  # of a drive that was killed
    far, later = PtyFarEnd(f"pty:{tmp_path / 'left'}"), PtyFarEnd(f"pty:{tmp_path / 'left'}")
    far.close()
    assert (tmp_path / "left").is_symlink()
    later.close()
    assert not (tmp_path / "left").is_symlink()
