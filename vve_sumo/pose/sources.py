"""Sources of pose bytes: UDP, TCP, a serial line, or a recording played in real time.

It opens sockets and devices and knows when each portion arrived; it must not know what the bytes mean. The reader may
be busy elsewhere (SUMO holds the interpreter while it steps), so arrivals are the kernel's own stamps where it gives
them: a portion that is read late still has its true time of arrival.
"""

from __future__ import annotations

import contextlib
import errno
import math
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Protocol

import serial

from vve_sumo.errors import RigError
from vve_sumo.pose.recording import portions
from vve_sumo.pose.senders import Senders
from vve_sumo.pose.stamps import Stamps

PORTION: Final = 4096  #: most bytes taken as one portion; no pose message is as long
PORTIONS: Final = 256  #: most portions taken at once, refused ones counted, so that a flood cannot block the caller
BYTES: Final = 16_384  #: most bytes taken at once, for the same reason: 2 s of NCOM at 100 Hz
RECEIVE_BUFFER: Final = 1 << 20  #: asked of the kernel [bytes]; it grants less where its own limit is lower
CONNECT_TIMEOUT: Final = 3.0  #: [s]
SO_TIMESTAMPNS: Final = 35  #: Linux, asm-generic/socket.h
STAMP: Final = struct.Struct("@qq")

REASONS: Final = {
    errno.EADDRINUSE: "is in use by another program",
    errno.EADDRNOTAVAIL: "is no address of this machine",
    errno.EACCES: "may not be opened by this user",
    errno.EPERM: "may not be opened by this user",
    errno.ENOENT: "does not exist: is the receiver plugged in?",
    errno.ENODEV: "does not exist: is the receiver plugged in?",
    errno.EBUSY: "is in use by another program",
    errno.EAGAIN: "is in use by another program",
    errno.EWOULDBLOCK: "is in use by another program",
    errno.ENOTTY: "is no serial line",
    errno.ECONNREFUSED: "refuses the connection: does the receiver serve this port?",
    errno.EHOSTUNREACH: "cannot be reached",
    errno.ENETUNREACH: "cannot be reached",
    errno.ETIMEDOUT: "does not answer",
}


class Source(Protocol):
    """A source of pose bytes."""

    @property
    def lost(self) -> bool:
        """Whether nothing will arrive any more: the peer closed, the device is gone, the recording is over."""

    def fileno(self) -> int:
        """Return the file descriptor to wait on; once `lost` do not wait on it, as it is then always ready."""

    def next_due(self) -> float:
        """Return the monotonic second at which `receive` will have something that `fileno` does not signal, or inf."""

    def receive(self) -> list[tuple[float, bytes]]:
        """Return waiting portions, each with its monotonic arrival time [s]; never blocks, never raises."""

    def sender_faults(self) -> tuple[str, ...]:
        """Return reason codes of others that send in the receiver's place now."""

    def sender_report(self) -> dict[str, Any]:
        """Return the accepted sender and the refused ones with counts, as plain JSON; empty where only one can send."""

    def close(self) -> None:
        """Close the socket or device."""


class _Alone:
    """A source to which no other sender can send."""

    def sender_faults(self) -> tuple[str, ...]:
        return ()

    def sender_report(self) -> dict[str, Any]:
        return {}


def _refused(where: str, what: str, error: OSError) -> RigError:
    reason = REASONS.get(error.errno or 0)
    return RigError(f"{where}: {what} {reason}" if reason else f"{where}: {what} cannot be opened ({error})")


class _Socket:
    """A socket, read with the kernel's stamps; of datagrams only those that `senders` accepts."""

    def __init__(self, opened: socket.socket, senders: Senders | None = None) -> None:
        self._socket, self._senders = opened, senders
        self.lost = False
        self._stamps = Stamps()
        opened.setblocking(False)
        if sys.platform == "linux":
            opened.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)

    def fileno(self) -> int:
        return self._socket.fileno()

    def next_due(self) -> float:
        return math.inf

    def sender_faults(self) -> tuple[str, ...]:
        return () if self._senders is None else self._senders.faults(time.monotonic())

    def sender_report(self) -> dict[str, Any]:
        return {} if self._senders is None else self._senders.sender_report()

    def close(self) -> None:
        self._socket.close()

    def receive(self) -> list[tuple[float, bytes]]:
        self._stamps.begin()
        taken: list[tuple[float, bytes]] = []
        size, emptied = 0, False
        for _ in range(PORTIONS):
            if self.lost or size >= BYTES:
                break
            try:
                data, ancillary, _flags, sender = self._socket.recvmsg(PORTION, socket.CMSG_SPACE(STAMP.size))
            except BlockingIOError:
                emptied = True
                break
            except OSError:
                self.lost = self._senders is None  # on a datagram socket: one datagram's error, or the link is down
                break
            if self._senders is None:
                self.lost = not data
            elif not self._senders.accepts(time.monotonic(), sender, data):
                continue
            if data:
                taken.append((_stamp(ancillary), data))
                size += len(data)
        return self._stamps.dated(taken, emptied)


def _stamp(ancillary: list[tuple[int, int, bytes]]) -> float:
    """The kernel's stamp [s of its wall clock]; NaN without one."""
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS and len(data) == STAMP.size:
            seconds, nanoseconds = STAMP.unpack(data)
            return float(seconds + nanoseconds * 1e-9)
    return math.nan


class _Serial(_Alone):
    """A serial line; the kernel gives no stamps here, so a portion's arrival is the time of reading."""

    def __init__(self, opened: serial.Serial) -> None:
        self._serial = opened
        self.lost = False

    def fileno(self) -> int:
        return int(self._serial.fileno())

    def next_due(self) -> float:
        return math.inf

    def close(self) -> None:
        self._serial.close()

    def receive(self) -> list[tuple[float, bytes]]:
        if self.lost:
            return []
        try:
            data = self._serial.read(PORTION)
        except (OSError, TypeError):  # SerialException is an OSError; TypeError is what a closed descriptor gives
            self.lost = True
            return []
        return [(time.monotonic(), data)] if data else []


class _Playback(_Alone):
    """A recording, each portion released when it is due, as if it arrived just then."""

    def __init__(self, path: Path, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._waiting = deque(portions(path))
        self._start = clock()
        self._silent = socket.socketpair()  # nothing is ever written to it, so it never becomes readable

    @property
    def lost(self) -> bool:
        return not self._waiting

    def fileno(self) -> int:
        return self._silent[0].fileno()

    def next_due(self) -> float:
        return self._start + self._waiting[0][0] if self._waiting else math.inf

    def close(self) -> None:
        for end in self._silent:
            end.close()

    def receive(self) -> list[tuple[float, bytes]]:
        now, released = self._clock(), []
        while self.next_due() <= now:
            due, data = self._waiting.popleft()
            released.append((self._start + due, data))
        return released


def open_udp(
    address: str,
    port: int,
    source: str | None = None,
    where: str = "pose",
    *,
    genuine: Callable[[bytes], bool] = bool,
) -> Source:
    """Listen on `address`, `port` (IPv4; 0.0.0.0 receives broadcasts) to the datagrams of `source` only.

    `source` is an IPv4 address, None the first sender of this machine, `genuine` says which datagrams make a sender
    the one that is heard (by default any that is not empty): see `Senders`. `where` names the rig's table in errors.
    Raises RigError naming the key.
    """
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        # Several programs may listen to one broadcast. On loopback they would take each other's datagrams instead.
        if not address.startswith("127."):
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        opened.bind((address, port))
    except OSError as error:
        opened.close()
        key = "port" if error.errno in (errno.EADDRINUSE, errno.EACCES) else "address"
        what = f"UDP port {port}" if key == "port" else repr(address)
        raise _refused(f"{where}.{key}", what, error) from None
    return _Socket(opened, Senders(source, genuine))


def open_tcp(address: str, port: int, where: str = "pose") -> Source:
    """Connect to a server of pose bytes; `lost` once the server closes. Raises RigError naming the key."""
    try:
        opened = socket.create_connection((address, port), CONNECT_TIMEOUT)
    except OSError as error:
        key, reached = (
            ("address", repr(address)) if isinstance(error, socket.gaierror) else ("port", f"{address}:{port}")
        )
        if isinstance(error, TimeoutError):
            error = TimeoutError(errno.ETIMEDOUT, "no answer")
        raise _refused(f"{where}.{key}", reached, error) from None
    return _Socket(opened)


def open_serial(device: str, baud: int, where: str = "pose") -> Source:
    """Open a serial line, 8N1, exclusively for this process. Raises RigError naming the key."""
    try:
        opened = serial.Serial(device, baud, timeout=0, exclusive=True)
    except ValueError:
        raise RigError(f"{where}.baud: {device} cannot do {baud} baud") from None
    except OSError as error:
        raise _refused(f"{where}.device", device, error) from None
    with contextlib.suppress(OSError, ValueError, NotImplementedError):
        opened.set_low_latency_mode(True)  # otherwise USB converters hold bytes back for up to 16 ms
    return _Serial(opened)


def open_file(path: Path, clock: Callable[[], float] = time.monotonic) -> Source:
    """Play a recording (CSV, NCOM or its hexadecimal text) from now on by `clock`, as NCOM bytes.

    No car may be armed on a recording, so its trust profile is `trust.PLAYBACK`. Raises ConfigError naming the file,
    line and column.
    """
    return _Playback(path, clock)
