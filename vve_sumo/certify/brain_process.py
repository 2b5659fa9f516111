"""The process of the brain under test: started for a case, watched while it computes or waits, ended after the case.

Knows processes and the kernel's tables of sockets; it must not know what a brain receives or answers. In lockstep, a
silent brain must not cost a time-out at every tick. This module therefore detects that a brain is idle: all of its
threads wait.
"""

from __future__ import annotations

import contextlib
import math
import os
import shlex
import signal
import subprocess
import time
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Final

from vve_sumo.errors import ConfigError, RigError

#: time for a brain to open its ports [s]
START_TIMEOUT: Final = 60.0
#: time all threads must have waited until no further port is expected to open [s]
OPEN_PORT_TIMEOUT: Final = 1.5
#: time for a brain to end after SIGTERM [s]
END_TIMEOUT: Final = 3.0
#: polls in a row that must find all threads waiting, and the time between them [s]
QUIET_POLLS: Final = 3
POLL_INTERVAL: Final = 0.001
#: states of a thread that waits for input (proc(5))
_WAITING: Final = frozenset("SIZXt")
_TABLES: Final = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
_MAX_OUTPUT_CHARACTERS: Final = 400  # of the end of the output that an error quotes


class BrainProcess:
    """One run of a brain's command, in a session of its own, with its output in a log file."""

    def __init__(
        self,
        command: str,
        ports: Collection[int],
        log: Path,
        working: Path,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Start the brain; `ports` are the local ports on which it may listen; `environment`: None for this process'.

        Raises ConfigError for a command that cannot be started, RigError where another program listens on a port.
        """
        if taken := sorted(set(ports) & _listened_on()):
            raise RigError(f"UDP port {taken[0]}: another program listens there, expected the brain alone; end it")
        if not command.strip():
            raise ConfigError("--brain: expected the command that starts the brain, got nothing")
        self._ports, self._log = frozenset(ports), log
        with log.open("wb") as output:
            try:
                self._process = subprocess.Popen(
                    shlex.split(command),
                    cwd=working,
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
            except (OSError, ValueError) as error:
                raise ConfigError(f"--brain: {command!r} cannot be started: {error}") from None

    def wait_until_it_listens(self, required_ports: Collection[int]) -> frozenset[int]:
        """Return the ports on which the brain does not listen, once it listens on the required ones.

        A port that is not open when all threads have waited for OPEN_PORT_TIMEOUT counts as not listened on.
        Raises RigError for a brain that ends or takes too long.
        """
        deadline, waits_since = time.monotonic() + START_TIMEOUT, math.inf
        while missing := self._ports - _listened_on():
            if self._process.poll() is not None:
                raise RigError(
                    f"--brain: ended with code {self._process.returncode} before it listened{self._last_output()}"
                )
            now = time.monotonic()
            if now > deadline:
                ports = ", ".join(map(str, sorted(missing)))
                raise RigError(f"--brain: does not listen on UDP port {ports} after {START_TIMEOUT:g} s")
            waits_since = min(waits_since, now) if self.quiet() else math.inf
            if not missing & set(required_ports) and now - waits_since > OPEN_PORT_TIMEOUT:
                return frozenset(missing)
            time.sleep(0.02)
        return frozenset()

    def _last_output(self) -> str:
        text = self._log.read_text(encoding="utf-8", errors="replace").strip()
        return f": {text[-_MAX_OUTPUT_CHARACTERS:].splitlines()[-1]}" if text else ""

    @property
    def ended(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    def quiet(self) -> bool:
        """Whether the brain waits for input and will send nothing before it comes.

        A thread that waits on a socket runs as soon as data arrives there. Unread data on a socket on which no thread
        waits makes no difference.
        """
        for poll in range(QUIET_POLLS):
            if poll:
                time.sleep(POLL_INTERVAL)
            if not all(state in _WAITING for state in _states(self._process.pid)):
                return self.ended
        return True

    def close(self) -> None:
        """End the process and all processes of its session."""
        self._signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_TIMEOUT)
        # A launcher may have ended while the brain that it started still runs.
        self._signal(signal.SIGKILL)
        self._process.wait()

    def _signal(self, number: signal.Signals) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, number)


def _listened_on() -> set[int]:
    """Return the UDP ports of this machine on which a program listens."""
    ports: set[int] = set()
    for table in _TABLES:
        with contextlib.suppress(OSError):
            lines = table.read_text(encoding="ascii").splitlines()[1:]
            ports |= {int(line.split()[1].rpartition(":")[2], 16) for line in lines}
    return ports


def _states(process: int) -> Iterator[str]:
    """Yield the state of every thread of a process and of all that it started (proc(5))."""
    # A process may end while its files are read.
    with contextlib.suppress(OSError):
        for thread in Path(f"/proc/{process}/task").iterdir():
            yield (thread / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()[0]
            for child in (thread / "children").read_text(encoding="ascii").split():
                yield from _states(int(child))
