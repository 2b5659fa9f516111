"""What a port of the bridge hears: this machine over the loopback, and nobody else. The kernel's own filter."""

from __future__ import annotations

import os
import socket
from contextlib import closing

import pytest

from vve_sumo.bridges.ros2.loopback import hear_this_machine_alone, udp_sockets
from vve_sumo.errors import RigError


def _own_address() -> str:
    """Return an address of this machine on a network; skips where it is on none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing
        except OSError:
            pytest.skip("this machine has no address but the loopback's")
        address = str(probe.getsockname()[0])
    if address.startswith("127."):
        pytest.skip("this machine has no address but the loopback's")
    return address


def _everywhere() -> socket.socket:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(("0.0.0.0", 0))  # as DDS does
    end.settimeout(0.2)
    return end


def _sent(end: socket.socket, source: str, target: str) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((source, 0))
        sender.sendto(b"command", (target, end.getsockname()[1]))
    try:
        return end.recv(100) == b"command"
    except TimeoutError:
        return False


def test_a_filtered_port_hears_the_loopback_alone() -> None:
    own = _own_address()
    with closing(_everywhere()) as end:
        assert _sent(end, own, own)  # without the filter anybody is heard
        hear_this_machine_alone(frozenset({end.fileno()}))
        assert not _sent(end, own, own)
        assert _sent(end, "127.0.0.1", "127.0.0.1")
        assert _sent(end, "127.8.9.10", "127.0.0.1")


def test_udp_sockets_are_found_and_nothing_else() -> None:
    read, write = os.pipe()
    with closing(_everywhere()) as end, socket.socket(socket.AF_INET, socket.SOCK_STREAM) as stream:
        found = udp_sockets()
        assert end.fileno() in found
        assert not {read, write, stream.fileno()} & found
    os.close(read)
    os.close(write)
    assert end.fileno() not in udp_sockets()


def test_a_socket_that_cannot_be_filtered_is_refused() -> None:
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as end, pytest.raises(RigError, match="cannot be kept"):
        hear_this_machine_alone(frozenset({end.fileno()}))
