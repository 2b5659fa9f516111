"""The receivers' ends of their wires on this machine, on which the simulated vehicle sends.

Knows sockets; it must not know what the bytes mean. No call waits or raises: what cannot be sent now is lost, as a
receiver's would be.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from collections.abc import Callable
from typing import Final

from vve_sumo.errors import RigError

#: clients of a TCP server at most; another one is cut off
MAX_CLIENTS: Final = 4


class UdpFarEnd:
    """Sends datagrams to one address; nobody needs to listen there."""

    def __init__(self, address: str, port: int) -> None:
        """Open a socket; raises RigError where there is no such address on this machine."""
        self._target = address, port
        self._socket = socket.socket(_family(address), socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        # A first send would bind the socket to every address of this machine, and other machines could reach it.
        _opened(self._socket, lambda: self._socket.bind((address, 0)), "pose.address")

    def send(self, data: bytes) -> None:
        """Send a datagram."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, self._target)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class TcpFarEnd:
    """Serves a stream; a client that comes gets what is sent from then on."""

    def __init__(self, address: str, port: int) -> None:
        """Listen; raises RigError where the port cannot be had."""
        self._server = socket.socket(_family(address), socket.SOCK_STREAM)
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._server.setblocking(False)
        _opened(self._server, lambda: self._server.bind((address, port)), "pose.port")
        self._server.listen(MAX_CLIENTS)
        self._clients: list[socket.socket] = []

    def send(self, data: bytes) -> None:
        """Send to every client; one that is gone, or does not keep up, is cut off."""
        with contextlib.suppress(OSError):
            client, _ = self._server.accept()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients.append(client)
        for client in self._clients[:]:
            if len(self._clients) > MAX_CLIENTS or not _sent(client, data):
                self._clients.remove(client)
                client.close()

    def close(self) -> None:
        """Close all connections."""
        for one in (*self._clients, self._server):
            one.close()


def _family(address: str) -> socket.AddressFamily:
    return socket.AF_INET if ipaddress.ip_address(address).version == 4 else socket.AF_INET6


def _opened(end: socket.socket, bind: Callable[[], None], key: str) -> None:
    try:
        bind()
    except OSError as error:
        end.close()
        raise RigError(f"{key}: the simulated receiver cannot open it: {error.strerror}") from None


def _sent(client: socket.socket, data: bytes) -> bool:
    """Whether a client took all of the data; a part of a message would spoil the stream."""
    try:
        return client.send(data) == len(data)
    except OSError:
        return False
