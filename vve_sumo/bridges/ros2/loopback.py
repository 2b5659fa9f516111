"""A filter on sockets that are bound to every address: what does not come from this machine is dropped by the kernel.

DDS opens its ports on every network of the computer, whatever interface it is told to use, and takes anybody's word.
The kernel passes packets from 127.0.0.0/8 over the loopback alone. Linux only.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from vve_sumo.errors import RigError

_SO_ATTACH_FILTER: Final = 26  # of asm-generic/socket.h
#: where a filter finds the IP header of a datagram (SKF_NET_OFF of linux/filter.h), and the source address in it
_SOURCE: Final = 0xFFF00000 + 12
# Classic BPF: load the source address, keep its first byte, pass the datagram where it is 127, else nothing.
_PROGRAM: Final = (
    (0x20, 0, 0, _SOURCE),
    (0x54, 0, 0, 0xFF000000),
    (0x15, 0, 1, 0x7F000000),
    (0x06, 0, 0, 0xFFFFFFFF),
    (0x06, 0, 0, 0),
)


def udp_sockets() -> frozenset[int]:
    """Return the file descriptors of this process' UDP sockets."""
    numbers = [int(entry.name) for entry in Path("/proc/self/fd").iterdir()]
    return frozenset(number for number in numbers if _is_udp(number))


def _is_udp(number: int) -> bool:
    with contextlib.suppress(OSError):
        if not str(Path(f"/proc/self/fd/{number}").readlink()).startswith("socket:"):
            return False
        with _opened(number) as end:
            return end.family in (socket.AF_INET, socket.AF_INET6) and end.type == socket.SOCK_DGRAM
    return False


@contextlib.contextmanager
def _opened(number: int) -> Iterator[socket.socket]:
    end = socket.socket(fileno=os.dup(number))
    try:
        yield end
    finally:
        end.close()


def hear_this_machine_alone(numbers: frozenset[int]) -> None:
    """Let UDP sockets take what comes from 127.0.0.0/8 and nothing else; raises RigError where one cannot."""
    code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *line) for line in _PROGRAM))
    program = struct.pack("@HP", len(_PROGRAM), ctypes.addressof(code))
    for number in numbers:
        with _opened(number) as end:
            try:
                if end.family != socket.AF_INET:
                    raise OSError("it is of IPv6")
                end.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, program)
            except OSError as error:
                raise RigError(f"ros2: a port of DDS cannot be kept to this machine ({error})") from None
