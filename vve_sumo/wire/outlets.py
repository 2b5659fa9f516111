"""Opens what the outgoing wires send on: UDP, a TCP server, a serial line or a CAN bus.

It knows sockets and devices; it must not know what the bytes mean. No call waits, except for a CAN driver that is busy,
and for that no longer than `bus.SEND_TIMEOUT`. What cannot be sent now is lost and counted, for a control computer must
never get an old datagram late.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections.abc import Callable, Sequence
from typing import Final, Protocol, TypeVar

import serial

from vve_sumo.bus import Bus
from vve_sumo.errors import RigError
from vve_sumo.values import Frame

#: clients of a TCP outlet at most; another one is refused
MAX_CLIENTS: Final = 8
#: asked of the kernel for a TCP client's queue [bytes]: a client that is further behind is cut off
CLIENT_QUEUE: Final = 16_384
#: bytes that may wait on a serial line: more would be old before they are out
MAX_SERIAL_QUEUE: Final = 1024

Carried_contra = TypeVar("Carried_contra", bytes, Frame, contravariant=True)


class Outlet(Protocol[Carried_contra]):
    """Where one outgoing wire sends."""

    lost: int  #: datagrams, portions or frames that could not be sent

    def send(self, portions: Sequence[Carried_contra]) -> None:
        """Send what a step of an output returned, in order; never waits, never raises."""
        ...

    def close(self) -> None:
        """Close the socket or device."""
        ...


class UdpOutlet:
    """Sends datagrams to one address; nobody needs to listen there."""

    def __init__(self, host: str, port: int, seal: Callable[[bytes], bytes] = bytes) -> None:
        """Open a socket; raises RigError where the address cannot be reached at all.

        `seal` returns what is sent in place of a portion, such as one with a signature.
        """
        self.lost, self._seal = 0, seal
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        # Without leave to broadcast the kernel refuses a network's broadcast address: its digits do not show it.
        try:
            self._socket.connect((host, port))
        except PermissionError:
            self._socket.close()
            raise RigError(f"udp {host}:{port}: is everyone's, expected the address of one device") from None
        except OSError as error:
            self._socket.close()
            raise RigError(f"udp {host}:{port}: cannot be sent to ({error})") from None

    def send(self, portions: Sequence[bytes]) -> None:
        """Send each portion as a datagram."""
        for portion in map(self._seal, portions):
            try:
                self._socket.send(portion)
            except ConnectionRefusedError:
                # Reported by the kernel for the datagram before: nobody listened then, perhaps somebody does now.
                with contextlib.suppress(OSError):
                    self._socket.send(portion)
            except OSError:
                self.lost += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class TcpOutlet:
    """Serves a stream to every client that connects; one that does not read is cut off."""

    def __init__(self, host: str, port: int) -> None:
        """Open the port; raises RigError where it cannot be opened."""
        self.lost = 0
        self._clients: list[socket.socket] = []
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._server.setblocking(False)
        try:
            self._server.bind((host, port))
        except OSError as error:
            self._server.close()
            reason = (
                "is in use by another program" if error.errno == errno.EADDRINUSE else f"cannot be opened ({error})"
            )
            raise RigError(f"tcp {host}:{port}: {reason}") from None
        self._server.listen(MAX_CLIENTS)

    def send(self, portions: Sequence[bytes]) -> None:
        """Send all portions to every client; one that cannot take all of it at once is cut off."""
        self._accept()
        data = b"".join(portions)
        for client in list(self._clients) if data else ():
            try:
                whole = client.send(data, socket.MSG_NOSIGNAL) == len(data)
            except OSError:
                whole = False
            if not whole:
                # Half a portion has perhaps gone out: nothing but a closed connection tells the client so.
                self.lost += 1
                self._clients.remove(client)
                client.close()

    def _accept(self) -> None:
        for _ in range(MAX_CLIENTS):
            try:
                client, _address = self._server.accept()
            except OSError:
                return
            if len(self._clients) >= MAX_CLIENTS:
                client.close()
                continue
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, CLIENT_QUEUE)
            self._clients.append(client)

    def close(self) -> None:
        """Close the port and every connection."""
        for each in (self._server, *self._clients):
            each.close()


class SerialOutlet:
    """Writes to a serial line; a portion for which the line is not free is lost, one that is half out is cut there."""

    def __init__(self, device: str, baud: int) -> None:
        """Open the device; raises RigError where it cannot be opened."""
        self.lost = 0
        try:
            self._line = serial.Serial(device, baud, timeout=0.0, write_timeout=0.0)
        except (OSError, ValueError) as error:
            raise RigError(f"serial {device}: cannot be opened ({error})") from None

    def send(self, portions: Sequence[bytes]) -> None:
        """Write each portion."""
        for portion in portions:
            try:
                # Not by pyserial's `write`: where the line is full, that tries again without end.
                room = self._line.out_waiting <= MAX_SERIAL_QUEUE
                whole = room and os.write(self._line.fileno(), portion) == len(portion)
            except (OSError, serial.SerialException):
                whole = False
            self.lost += not whole

    def close(self) -> None:
        """Close the device."""
        with contextlib.suppress(OSError):
            self._line.close()


class CanOutlet:
    """Sends frames on a bus of its own."""

    def __init__(self, bus: Bus) -> None:
        self.lost = 0
        self._bus = bus

    def send(self, portions: Sequence[Frame]) -> None:
        """Send each frame; after one that the bus refuses, the rest of the cycle is lost."""
        for sent, frame in enumerate(portions):
            try:
                self._bus.send(frame)
            except RigError:
                self.lost += len(portions) - sent
                return

    def receive(self) -> list[Frame]:
        """Return the frames that others have sent since the last call, in order; none from a bus that is down."""
        try:
            return self._bus.drain()
        except RigError:
            return []

    def close(self) -> None:
        """Let go of the bus."""
        self._bus.close()
