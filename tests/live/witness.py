"""Watches whether the machine itself ran: a clock on each core that says when it was not let run in time, and a byte
sent through a pseudo-terminal that says when the kernel did not deliver it, as it does for the drive's bus.

`python -m tests.live.witness FILE`; a line for each stall: monotonic seconds of its beginning and of its end. It comes
before every process of a drive, so a stall that it sees is nothing that the drive could have done anything about.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
import tty
from collections.abc import Iterator
from pathlib import Path

from tests.conftest import REPOSITORY

PRIORITY = 50  # before all of `vve_sumo.live.priority`
PERIOD = 0.004  # of a look at the clock [s]
STALL = 0.015  # a sleep that ends so much too late is a stall [s]


@contextlib.contextmanager
def witness(file: Path) -> Iterator[None]:
    """Have the machine watched while the block runs."""
    command = [sys.executable, "-m", "tests.live.witness", str(file)]
    with subprocess.Popen(command, cwd=REPOSITORY, stdin=subprocess.PIPE):
        yield


def stalls(file: Path, begin: float, end: float) -> list[tuple[float, float]]:
    """Return the stalls (monotonic begin and end) that touched the time from `begin` to `end`."""
    lines = file.read_text().splitlines() if file.exists() else []
    seen = [(float(first), float(last)) for first, last in map(str.split, lines)]
    return sorted((first, last) for first, last in seen if last > begin and first < end)


def _watch(core: int, file: Path) -> None:
    os.sched_setaffinity(0, {core})
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    with file.open("a", buffering=1) as said:
        while True:
            before = time.monotonic()
            time.sleep(PERIOD)
            os.write(ours, b"!")
            os.read(theirs, 1)
            now = time.monotonic()
            if now - before > PERIOD + STALL:
                said.write(f"{before:.4f} {now:.4f}\n")


def main(file: Path) -> None:
    """Watch every core that this process may use, until whoever started it closes its standard input, or ends."""
    cores = sorted(os.sched_getaffinity(0))
    children = []
    for core in cores:
        if (child := os.fork()) == 0:
            _watch(core, file)
        children.append(child)
    sys.stdin.read()
    for child in children:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
