"""A command on a pseudo-terminal, with somebody at the keys and somebody who notes when each piece was written."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.conftest import REPOSITORY


class Desk:
    """The terminal of a drive's command."""

    def __init__(self, process: subprocess.Popen[bytes], master: int, record: Path) -> None:
        self.process, self.record = process, record
        self.pieces: list[tuple[float, str]] = []  #: monotonic second and what was written then
        self._master = master

    @property
    def text(self) -> str:
        """Everything written so far."""
        return "".join(piece for _time, piece in self.pieces)

    @property
    def picture(self) -> str:
        """What stands on the terminal since it was last wiped."""
        return self.text.rpartition("\x1b[J")[2]

    def press(self, key: str) -> None:
        """Press a key."""
        os.write(self._master, key.encode())

    def kill(self, name: str, number: int) -> None:
        """Send a signal to one of the drive's processes."""
        os.kill(self.processes[name], number)

    @property
    def processes(self) -> dict[str, Any]:
        """The numbers of the drive's processes."""
        return dict(json.loads((self.record / "processes.json").read_text()))

    def until(self, condition: Callable[[], bool], patience: float = 40.0) -> None:
        """Read on until a condition holds."""
        deadline = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < deadline, self.text[-3000:]
            self._read()
            assert self.process.poll() is None or condition(), self.text[-3000:]

    def shows(self, words: str) -> None:
        """Read on until the picture begins with these words."""
        self.until(lambda: words in self.picture.split("\n")[-8:][0] or f"\n{words}" in f"\n{self.picture}")

    def ends(self, patience: float = 60.0) -> int:
        """Read on to the command's end, and return its exit code."""
        self.until(lambda: self.process.poll() is not None, patience)
        self._read()
        return self.process.returncode

    def _read(self) -> None:
        if select.select([self._master], [], [], 0.01)[0]:
            with contextlib.suppress(OSError):  # nobody holds the other end any more
                self.pieces.append((time.monotonic(), os.read(self._master, 65536).decode().replace("\r\n", "\n")))


#: what of the command drives: the picture after the drive takes as long as a short drive
DRIVES = [
    "-c",
    """
import sys
from pathlib import Path
from vve_sumo.cli.live_drive import drive
from vve_sumo.live.session import plan
scenario, _, rig, _, out = sys.argv[1:]
drive(plan(scenario, rig, Path.cwd(), out=Path(out), seed=None, controller=None, shadow=False))
""",
]


@contextlib.contextmanager
def desk(*arguments: str, record: Path, program: Sequence[str] = tuple(DRIVES)) -> Iterator[Desk]:
    """Drive with these arguments on a terminal of its own; what still runs afterwards is killed."""
    master, slave = pty.openpty()
    termios.tcsetwinsize(slave, (40, 160))
    process = subprocess.Popen(
        [sys.executable, *program, *arguments, "--out", str(record)],
        cwd=REPOSITORY,
        stdin=slave,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
    )
    os.close(slave)
    at = Desk(process, master, record)
    try:
        yield at
    finally:
        with contextlib.suppress(OSError, ValueError):
            for name in ("gateway", "drive", "recorder", "car"):
                with contextlib.suppress(ProcessLookupError, KeyError):
                    os.kill(at.processes[name], signal.SIGKILL)
        process.kill()
        process.wait()
        os.close(master)
