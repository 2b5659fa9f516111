"""Listens at the far end of a drive's outgoing wires, and writes down when each message came and whether it is valid.

`python -m tests.live.wiretap FILE NCOM RADAR SLCAN`: two UDP ports of the loopback, and the link of a CAN adapter on
which an ESR sends. A line for each NCOM packet, radar datagram and whole ESR cycle: monotonic second, wire, 1 or 0 for
valid, counter. It runs before every process of a drive, so that its times are those of the wires.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from tests.conftest import REPOSITORY
from vve_sumo.bus import Bus
from vve_sumo.errors import RigError
from vve_sumo.pose import ncom
from vve_sumo.wire import esr
from vve_sumo.wire.datagrams import decode_radar

PRIORITY = 45
PERIOD = 0.002  # of a look at the bus [s]


class Heard(NamedTuple):
    """One message."""

    time: float  #: of its arrival, monotonic [s]
    wire: str  #: ncom, radar or esr
    valid: bool
    counter: int


@contextlib.contextmanager
def tapped(file: Path, gnss: int, radar: int, bus: Path) -> Iterator[None]:
    """Have the wires listened to while the block runs."""
    command = [sys.executable, "-m", "tests.live.wiretap", str(file), str(gnss), str(radar), str(bus)]
    with subprocess.Popen(command, cwd=REPOSITORY) as process:
        try:
            yield
        finally:
            process.terminate()


def heard(file: Path) -> list[Heard]:
    """Return what was written down, as far as its lines are whole."""
    text = file.read_text()
    lines = (line.split() for line in text[: text.rfind("\n") + 1].splitlines())
    return [Heard(float(when), wire, valid == "1", int(counter)) for when, wire, valid, counter in lines]


def _listen(port: int) -> socket.socket:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(("127.0.0.1", port))
    end.setblocking(False)
    return end


def _datagrams(end: socket.socket) -> Iterator[bytes]:
    with contextlib.suppress(BlockingIOError):
        while True:
            yield end.recv(4096)


def main(file: Path, gnss: int, radar: int, link: Path) -> None:
    """Listen until terminated."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    fixes, scans = _listen(gnss), _listen(radar)
    decoder, cycles, bus = ncom.Decoder(), esr.Decoder(), None
    with file.open("a", buffering=1) as said:

        def note(wire: str, valid: bool, counter: int) -> None:
            said.write(f"{time.monotonic():.4f} {wire} {int(valid)} {counter}\n")

        while True:
            select.select([fixes, scans], [], [], PERIOD)
            for number, data in enumerate(_datagrams(fixes)):
                for fix in decoder.feed(data, 0.0):
                    note("ncom", fix.locked, number)
            for data in _datagrams(scans):
                if (seen := decode_radar(data)) is not None:
                    note("radar", seen.valid, seen.sequence)
            bus = bus or _opened(link)
            bus = bus and _frames(bus, cycles, note)


def _opened(link: Path) -> Bus | None:
    if not link.exists():
        return None
    with contextlib.suppress(RigError):
        return Bus("slcan", str(link), 500_000)
    return None


def _frames(bus: Bus, cycles: esr.Decoder, note: Callable[[str, bool, int], None]) -> Bus | None:
    """Note the cycles that have come; None where the adapter is gone."""
    try:
        for cycle in cycles.feed(bus.drain()):
            note("esr", cycle.valid, cycle.scan_index)
    except RigError:
        bus.close()
        return None
    return bus


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
