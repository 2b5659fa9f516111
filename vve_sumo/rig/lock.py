"""Locks a rig and its buses for one process at a time: two drives would command the same car.

A lock is a name in the kernel (an abstract Unix socket), not a file: it cannot be replaced, belongs to all users of the
computer, and ends with the last process that holds it. The names are those of the rig file's place and of what the rig
opens alone: buses and serial lines. They hold within one network namespace, as SocketCAN's interfaces do.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from vve_sumo.errors import RigError
from vve_sumo.rig.schema import Rig
from vve_sumo.rig.validation import PTY

#: longest name in the kernel that is not shortened to its hash [bytes]; `sun_path` of unix(7) takes 107
MAX_NAME_LENGTH: Final = 100
CREDENTIALS: Final = struct.Struct("3i")  #: struct ucred of unix(7): process, user, group
CONNECT_TIMEOUT: Final = 0.5  #: to ask the kernel who holds a lock [s]


@contextlib.contextmanager
def rig_lock(rig_file: Path, rig: Rig) -> Iterator[tuple[int, ...]]:
    """Lock a rig, its buses and its serial lines while in the block.

    Yields the locks' file descriptors: a process that inherits them holds the locks as well, until it ends. The system
    releases the locks however the processes end. Raises RigError where another process holds one of them.
    """
    with contextlib.ExitStack() as stack:
        locks = [stack.enter_context(_named(f"rig {os.path.realpath(rig_file)}", f"{rig_file}: this rig"))]
        for name in shared_names(rig):
            locks.append(stack.enter_context(_named(name, f"{rig_file}: {name}")))
        yield tuple(lock.fileno() for lock in locks)


def shared_names(rig: Rig) -> tuple[str, ...]:
    """Return the names of what one process alone may open: the car's bus, its far end, the receiver's serial line.

    A pseudo-terminal has no name, for every drive makes its own. A receiver's UDP port is locked by being opened.
    """
    names = [] if rig.bus.channel == PTY else [_bus_name(rig.bus.interface, rig.bus.channel)]
    if rig.car_start is not None and rig.car_start.channel is not None:
        names.append(_bus_name(rig.bus.interface, rig.car_start.channel))
    device = getattr(rig.pose, "device", None)
    names += [] if device is None else [_device_name(str(device))]
    return tuple(dict.fromkeys(names))


def _bus_name(interface: str, channel: str) -> str:
    """Return a bus's name; of a device file it is the same whatever link and whatever interface it is opened by."""
    return _device_name(channel.partition("@")[0]) if channel.startswith("/") else f"bus {interface}:{channel}"


def _device_name(device: str) -> str:
    return f"device {os.path.realpath(device)}"


@contextlib.contextmanager
def _named(name: str, what: str) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as lock:
        address = _address(name)
        try:
            lock.bind(address)
            lock.listen()  # so that another process can ask who holds it
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise RigError(f"{what} cannot be locked: {error.strerror}") from None
            raise RigError(
                f"{what} is in use by another drive, doctor or align{_holder(address)}; wait for its end"
            ) from None
        yield lock


def _address(name: str) -> bytes:
    """Return the address in the kernel's own space of names, which begins with a zero."""
    whole = f"vve_sumo {name}".encode()
    return b"\0" + (whole if len(whole) <= MAX_NAME_LENGTH else hashlib.sha256(whole).hexdigest().encode())


def _holder(address: bytes) -> str:
    """Return which process made a lock, as the kernel tells; empty where it has just ended."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
        asking.settimeout(CONNECT_TIMEOUT)
        asking.connect(address)
        process, _user, _group = CREDENTIALS.unpack(
            asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, CREDENTIALS.size)
        )
        return f" (process {process})"
    return ""
