"""The receivers' ends of their wires on this machine, on which the simulated vehicle sends: UDP.

Knows sockets; it must not know what the bytes mean. No call waits or raises: what cannot be sent now is lost, as a
receiver's would be.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket

from vve_sumo.errors import RigError


class UdpFarEnd:
    """Sends datagrams to one address; nobody needs to listen there."""

    def __init__(self, address: str, port: int) -> None:
        """Open a socket; raises RigError where there is no such address on this machine."""
        self._target = address, port
        family = socket.AF_INET if ipaddress.ip_address(address).version == 4 else socket.AF_INET6
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
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
