"""A controller for tests that drives straight on, and half a second later does what its tuning says."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from vve_sumo.values import ControlCommand, Observation, Vehicle

BEGINS = 25  #: tick at which the illness breaks out


def make(vehicle: Vehicle, tuning: Mapping[str, Any]) -> Ill:
    if tuning.get("illness") == "stillborn":
        sys.exit("no such day")
    return Ill(str(tuning.get("illness", "none")), Path(str(tuning.get("note", os.devnull))))


class Ill:
    def __init__(self, illness: str, note: Path) -> None:
        self._breaks_out: Callable[[Path], None] = globals()[illness]
        self._note = note
        self._ticks = 0

    def step(self, observation: Observation) -> ControlCommand:
        self._ticks += 1
        if self._ticks == BEGINS:
            self._breaks_out(self._note)
        return ControlCommand(steering=0.0, acceleration=1.0)


def none(note: Path) -> None:
    pass


def segfault(note: Path) -> None:
    ctypes.string_at(0)


def hang(note: Path) -> None:
    note.write_text(str(os.getpid()))
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    while True:
        time.sleep(1.0)


def leak(note: Path) -> None:
    hoard = []
    while True:
        hoard.append(b"x" * 10_000_000)


def leak_elsewhere(note: Path) -> None:
    subprocess.run([sys.executable, "-c", "import time; hoard = b'x' * 10**9; time.sleep(600)"], check=False)


def raises(note: Path) -> None:
    raise ZeroDivisionError(f"nothing left of {object()}")


def exits(note: Path) -> None:
    sys.exit(3)


def leaves(note: Path) -> None:
    os.write(1, b"goodbye\n")
    os._exit(3)


def killed(note: Path) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def interrupts(note: Path) -> None:
    raise KeyboardInterrupt


def begets(note: Path) -> None:
    """Leave a daemon behind, as daemons do: grandchild of nobody, in a session of its own."""
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            note.write_text(str(os.getpid()))
            time.sleep(600.0)
        os._exit(0)
    while not note.exists() or not note.read_text():
        time.sleep(0.01)


def prints(note: Path) -> None:
    for _ in range(2000):
        print('{"version": 1, "key": "forged", "figures": {}, "error": "", "said": ""}')
    sys.stdout.flush()
    os.write(1, b"x" * 300_000 + b"\n")
    subprocess.run(["echo", "ready"], check=True)


def fills(note: Path) -> None:
    """Have the record's tables on a disk that is full."""
    full = os.open("/dev/full", os.O_WRONLY)
    for descriptor in Path("/proc/self/fd").iterdir():
        if str(descriptor.resolve()).endswith(".arrows"):
            os.dup2(full, int(descriptor.name))
