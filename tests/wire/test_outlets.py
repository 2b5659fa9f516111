"""Outlets over real sockets, a pty and a virtual bus: what is sent arrives, and nobody can make them wait."""

from __future__ import annotations

import os
import pty
import select
import socket
import time
import tty

import pytest

from vve_sumo.bus import Bus
from vve_sumo.errors import RigError
from vve_sumo.values import Frame
from vve_sumo.wire.outlets import CanOutlet, SerialOutlet, TcpOutlet, UdpOutlet


@pytest.fixture
def port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        number: int = probe.getsockname()[1]
    return number


def test_udp_keeps_the_boundaries_of_datagrams(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", port))
        end.settimeout(5.0)
        outlet = UdpOutlet("127.0.0.1", port)
        outlet.send((b"one", b"other"))
        assert [end.recv(100), end.recv(100)] == [b"one", b"other"]
        outlet.close()


def test_udp_does_not_broadcast(port: int) -> None:
    with pytest.raises(RigError, match=rf"^udp 127\.255\.255\.255:{port}: is everyone's, expected the address of one"):
        UdpOutlet("127.255.255.255", port)


def test_udp_sends_what_a_seal_makes_of_each_portion(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", port))
        end.settimeout(5.0)
        outlet = UdpOutlet("127.0.0.1", port, lambda portion: portion + b"!")
        outlet.send((b"one", b""))
        assert [end.recv(100), end.recv(100)] == [b"one!", b"!"]
        outlet.close()


def test_udp_reaches_a_listener_that_comes_later(port: int) -> None:
    outlet = UdpOutlet("127.0.0.1", port)
    for _ in range(3):
        outlet.send((b"nobody",))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", port))
        end.settimeout(5.0)
        outlet.send((b"somebody",))
        assert end.recv(100) == b"somebody"
    outlet.close()


def test_tcp_serves_every_client_and_cuts_off_one_that_does_not_read(port: int) -> None:
    outlet = TcpOutlet("127.0.0.1", port)
    reader, sleeper = (socket.create_connection(("127.0.0.1", port), timeout=5.0) for _ in range(2))
    sleeper.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    line, heard, begun = b"x" * 999 + b"\n", 0, time.monotonic()
    reader.setblocking(False)
    while outlet.lost == 0 and time.monotonic() - begun < 20.0:
        outlet.send((line,))
        try:
            heard += len(reader.recv(1 << 20))
        except BlockingIOError:
            time.sleep(1e-4)
    assert outlet.lost == 1
    assert heard > 0
    reader.setblocking(True)
    outlet.send((b"end\n",))
    assert b"end\n" in reader.recv(1 << 20)
    for end in (reader, sleeper, outlet):
        end.close()


def test_tcp_port_in_use_is_one_line(port: int) -> None:
    outlet = TcpOutlet("127.0.0.1", port)
    with pytest.raises(RigError, match=f"tcp 127.0.0.1:{port}: is in use by another program"):
        TcpOutlet("127.0.0.1", port)
    outlet.close()


def test_serial_line_carries_the_bytes() -> None:
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    outlet = SerialOutlet(os.ttyname(theirs), 115_200)
    outlet.send((b"$GP,one\r\n", b"$GP,two\r\n"))
    assert _waiting(ours) == b"$GP,one\r\n$GP,two\r\n"
    outlet.close()
    os.close(ours)
    os.close(theirs)


def _waiting(end: int) -> bytes:
    """Read what comes until nothing has come for a while."""
    taken = b""
    while select.select([end], [], [], 0.3)[0]:
        taken += os.read(end, 1 << 16)
    return taken


def test_serial_line_that_nobody_reads_loses_and_makes_nobody_wait() -> None:
    """A pseudo-terminal takes some kilobytes and says of none of them that they wait."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    outlet, portion = SerialOutlet(os.ttyname(theirs), 115_200), b"x" * 71 + b"\n"
    outlet.send([portion] * 2000)
    assert 0 < outlet.lost < 2000
    lost, taken = outlet.lost, _waiting(ours)
    assert taken.count(portion) == 2000 - lost
    outlet.send((b"again",))
    assert _waiting(ours) == b"again"
    assert outlet.lost == lost
    outlet.close()
    os.close(ours)
    os.close(theirs)


def test_serial_line_that_is_gone_loses_and_does_not_raise() -> None:
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    outlet = SerialOutlet(os.ttyname(theirs), 115_200)
    os.close(theirs)
    os.close(ours)
    outlet.send((b"gone",))
    assert outlet.lost == 1
    outlet.close()


def test_serial_device_that_is_not_there_is_one_line() -> None:
    with pytest.raises(RigError, match="serial /dev/nowhere: cannot be opened"):
        SerialOutlet("/dev/nowhere", 115_200)


def test_frames_go_out_in_order() -> None:
    with Bus("virtual", "outlets") as listener:
        outlet = CanOutlet(Bus("virtual", "outlets"))
        frames = [Frame(0x500 + n, bytes((n,))) for n in range(64)]
        outlet.send(frames)
        assert listener.drain() == frames
        outlet.close()
