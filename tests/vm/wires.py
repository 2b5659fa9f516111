"""SocketCAN interfaces of the virtual machine, and a witness of all that passes on one, who doesn't use our code."""

from __future__ import annotations

import socket
import struct
import subprocess
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from vve_sumo.values import Frame

FRAME = struct.Struct("=IB3x8s")  # struct can_frame of linux/can.h
FILTER = struct.Struct("=II")  # struct can_filter of linux/can.h
STAMP = struct.Struct("=qq")  # struct timespec
SO_TIMESTAMPNS = 35  # asm-generic/socket.h; Python doesn't name it
QUEUE = 1 << 20


class Heard(NamedTuple):
    """A frame on the wire."""

    time: float  #: monotonic, of the kernel's stamp [s]
    frame: Frame


def ip(*arguments: str) -> None:
    """Run iproute2."""
    subprocess.run(["ip", *arguments], check=True)


@dataclass(frozen=True)
class Wire:
    """A bus with the gateway's interface on one end and the car's on the other."""

    gateway: str
    car: str
    kind: tuple[str, ...] = field(repr=False)  # what `ip link` wants to know

    def set_up(self) -> None:
        """Make or configure both interfaces, and open them."""
        for name in dict.fromkeys((self.gateway, self.car)):
            ip("link", "add" if "vcan" in self.kind else "set", "dev", name, "type", *self.kind)
            ip("link", "set", name, "up")


WIRES = {
    "vcan": Wire("vcan0", "vcan0", ("vcan",)),
    "cards": Wire("can0", "can1", ("can", "bitrate", "500000", "restart-ms", "100")),
}


def open_raw(name: str) -> socket.socket:
    """Return the kernel's own raw CAN socket on an interface; it takes everything and also hears its neighbours."""
    raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    raw.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, QUEUE)
    raw.bind((name,))
    return raw


def transmitted(name: str) -> int:
    """Return how many frames the kernel has sent on an interface so far."""
    return int(Path(f"/sys/class/net/{name}/statistics/tx_packets").read_text())


class Witness:
    """Keeps the frames with some identifiers that pass on an interface, on the monotonic clock."""

    def __init__(self, name: str, identifiers: Iterable[int]) -> None:
        self.heard: list[Heard] = []
        self._raw = open_raw(name)
        self._raw.setblocking(False)
        every_bit = socket.CAN_SFF_MASK | socket.CAN_EFF_FLAG | socket.CAN_RTR_FLAG
        filters = b"".join(FILTER.pack(identifier, every_bit) for identifier in identifiers)
        self._raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
        self._monotonic = time.monotonic() - time.time()

    def listen(self) -> None:
        """Take what waits; has to be called now and then."""
        while True:
            try:
                data, extra, _, _ = self._raw.recvmsg(FRAME.size, 64)
            except BlockingIOError:
                return
            except OSError:
                continue  # said once by the kernel when the interface goes down
            identifier, size, payload = FRAME.unpack(data)
            seconds, nanoseconds = STAMP.unpack(extra[0][2])
            moment = seconds + nanoseconds * 1e-9 + self._monotonic
            self.heard.append(Heard(moment, Frame(identifier, payload[:size])))

    def close(self) -> None:
        """Stop listening."""
        self._raw.close()
