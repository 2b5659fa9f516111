"""The receivers' ends of their wires on this machine, on which the simulated vehicle sends: UDP, TCP, serial lines.

Knows sockets and terminals; it must not know what the bytes mean. No call waits or raises: what cannot be sent now is
lost, as a receiver's would be.
"""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import os
import socket
import tty
from typing import Final

from vve_sumo.errors import RigError
from vve_sumo.pty_link import PtyLink

#: clients of a TCP server at most; another one waits until one is gone
MAX_CLIENTS: Final = 8


def _family(address: str) -> socket.AddressFamily:
    return socket.AF_INET if ipaddress.ip_address(address).version == 4 else socket.AF_INET6


class UdpFarEnd:
    """Sends datagrams to one address; nobody needs to listen there."""

    def __init__(self, address: str, port: int) -> None:
        """Open a socket; raises RigError where there is no such address on this machine."""
        self._target = address, port
        self._socket = socket.socket(_family(address), socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            # A first send would bind the socket to every address of this machine, and other machines could reach it.
            self._socket.bind((address, 0))
        except OSError as error:
            self._socket.close()
            raise RigError(f"pose.address: nothing can be sent from {address}: {error.strerror}") from None

    def send(self, data: bytes) -> None:
        """Send a datagram."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, self._target)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class TcpFarEnd:
    """Serves a stream to every client that connects, as receivers do; one that does not read is cut off."""

    def __init__(self, address: str, port: int) -> None:
        """Open the port; raises RigError where another program serves it, or there is no such address here."""
        self._clients: list[socket.socket] = []
        self._server = socket.socket(_family(address), socket.SOCK_STREAM)
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._server.setblocking(False)
        try:
            self._server.bind((address, port))
            self._server.listen()
        except OSError as error:
            self._server.close()
            taken = error.errno == errno.EADDRINUSE
            text = "is in use by another program" if taken else f"cannot be served ({error.strerror})"
            raise RigError(f"pose.port: {address}:{port} {text}") from None

    def send(self, data: bytes) -> None:
        """Send to every client; one that does not take all of it is cut off, for half of it may have gone out."""
        self._accept()
        for client in list(self._clients):
            try:
                whole = client.send(data, socket.MSG_NOSIGNAL) == len(data)
            except OSError:
                whole = False
            if not whole:
                self._clients.remove(client)
                client.close()

    def close(self) -> None:
        """Close the port and every connection."""
        for each in (self._server, *self._clients):
            each.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while len(self._clients) < MAX_CLIENTS:
                client, _address = self._server.accept()
                self._clients.append(client)
                client.setblocking(False)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


class PtyFarEnd:
    """Writes to a pseudo-terminal that is found under a name, as a receiver's serial line."""

    def __init__(self, name: str) -> None:
        """Make the terminal and the link that `pty:FILE` names; raises RigError where FILE is something else."""
        # The other side stays open here too, so that a reader may end and another one open it.
        self._begun = b""  # of what was begun to be written, the rest
        try:
            self._ours, self._theirs = os.openpty()
        except OSError as error:
            raise RigError(f"{name}: no pseudo-terminal is left ({error.strerror})") from None
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        try:
            self._link = PtyLink(name, os.ttyname(self._theirs))
        except RigError:
            self._close_terminal()
            raise

    def send(self, data: bytes) -> None:
        """Write to the line; what it does not hold because nobody reads is lost, but never a part of a portion."""
        with contextlib.suppress(OSError):
            self._begun = self._begun[os.write(self._ours, self._begun) :] if self._begun else b""
            if not self._begun:
                self._begun = data[os.write(self._ours, data) :]

    def close(self) -> None:
        """Remove the link, and close the terminal."""
        self._link.remove()
        self._close_terminal()

    def _close_terminal(self) -> None:
        os.close(self._ours)
        os.close(self._theirs)
