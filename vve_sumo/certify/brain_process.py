"""The brain under test as a process: started for a case, seen to think or to wait, ended with the case.

Knows processes and the kernel's tables of sockets; it must not know what a brain hears or answers. In lockstep a brain
that says nothing must not cost a time-out at every tick, so this module finds out that it has nothing more to say: all
its threads wait.
"""

from __future__ import annotations

import contextlib
import math
import os
import shlex
import signal
import subprocess
import time
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from vve_sumo.errors import ConfigError, RigError

#: for a brain to listen on its ports [s]
START_TIMEOUT: Final = 60.0
#: a brain whose threads have all waited for so long opens no further port [s]
DEAF_AFTER: Final = 1.5
#: for a brain to end when it is asked to [s]
END_TIMEOUT: Final = 3.0
#: a brain is quiet when it was seen so as often in a row, so far apart [s]
QUIET_POLLS: Final = 3
POLL_INTERVAL: Final = 0.001
#: states of a thread that waits for something to come (proc(5))
_WAITING: Final = frozenset("SIZXt")
_TABLES: Final = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
_LAST_LINES: Final = 400  # characters of what a brain that ended wrote last


class BrainProcess:
    """One run of a brain's command, in a session of its own, its words in a log file."""

    def __init__(self, command: str, ports: Collection[int], log: Path, working: Path) -> None:
        """Start it; `ports` are those of this machine that it may listen on. Raises ConfigError for no such program.

        RigError where somebody else listens on one of the ports.
        """
        if taken := sorted(set(ports) & _listened_on()):
            raise RigError(f"UDP port {taken[0]}: another program listens there, expected the brain alone; end it")
        if not command.strip():
            raise ConfigError("--brain: expected the command that starts the brain, got nothing")
        self._ports, self._log = frozenset(ports), log
        with log.open("wb") as words:
            try:
                self._process = subprocess.Popen(
                    shlex.split(command),
                    cwd=working,
                    stdin=subprocess.DEVNULL,
                    stdout=words,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
            except (OSError, ValueError) as error:
                raise ConfigError(f"--brain: {command!r} cannot be started: {error}") from None

    def wait_until_it_listens(self, wanted: Collection[int]) -> frozenset[int]:
        """Return the ports that it does not listen on, once it listens on those that are `wanted`.

        A port that it has not opened when all of its threads have waited for DEAF_AFTER counts as not listened on.
        Raises RigError for a brain that ends or takes too long.
        """
        deadline, waits_since = time.monotonic() + START_TIMEOUT, math.inf
        while missing := self._ports - _listened_on():
            if self._process.poll() is not None:
                raise RigError(f"--brain: ended with code {self._process.returncode} before it listened{self._words()}")
            now = time.monotonic()
            if now > deadline:
                ports = ", ".join(map(str, sorted(missing)))
                raise RigError(f"--brain: does not listen on UDP port {ports} after {START_TIMEOUT:g} s")
            waits_since = min(waits_since, now) if self.quiet() else math.inf
            if not missing & set(wanted) and now - waits_since > DEAF_AFTER:
                return frozenset(missing)
            time.sleep(0.02)
        return frozenset()

    def _words(self) -> str:
        text = self._log.read_text(encoding="utf-8", errors="replace").strip()
        return f": {text[-_LAST_LINES:].splitlines()[-1]}" if text else ""

    @property
    def ended(self) -> bool:
        """Whether the process is over."""
        return self._process.poll() is not None

    def quiet(self) -> bool:
        """Whether it waits for something to come, and will say nothing before that.

        A thread that waits on a socket runs from the moment at which something comes there. What lies unread elsewhere
        is what nobody waits for, and so says nothing.
        """
        for poll in range(QUIET_POLLS):
            if poll:
                time.sleep(POLL_INTERVAL)
            if not all(state in _WAITING for state in _states(self._process.pid)):
                return self.ended
        return True

    def close(self) -> None:
        """End the process and all that it started in its session."""
        self._signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_TIMEOUT)
        # A launcher may be over while the brain that it started is not.
        self._signal(signal.SIGKILL)
        self._process.wait()

    def _signal(self, number: signal.Signals) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, number)


def _listened_on() -> set[int]:
    """Return the UDP ports of this machine that somebody listens on."""
    ports: set[int] = set()
    for table in _TABLES:
        with contextlib.suppress(OSError):
            lines = table.read_text(encoding="ascii").splitlines()[1:]
            ports |= {int(line.split()[1].rpartition(":")[2], 16) for line in lines}
    return ports


def _states(process: int) -> Iterator[str]:
    """Yield the state of every thread of a process and of all that it started (proc(5))."""
    # A process may end while it is looked at.
    with contextlib.suppress(OSError):
        for thread in Path(f"/proc/{process}/task").iterdir():
            yield (thread / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()[0]
            for child in (thread / "children").read_text(encoding="ascii").split():
                yield from _states(int(child))
