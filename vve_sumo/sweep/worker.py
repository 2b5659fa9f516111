"""The handle on one server of runs: gives it jobs, takes its results, starts it anew when it dies.

One job at a time. Never waits, except for a process to die; whoever holds several workers waits for their descriptors.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import IO

from vve_sumo.drive.progress import DriveProgress
from vve_sumo.errors import SimulationError
from vve_sumo.sweep import process_tree
from vve_sumo.sweep.job import CHUNK, READY, Job, RunResult, progress_of

MAX_ATTEMPTS = 2  #: how often a job is begun: a server that is killed from outside is not the run's fault
SHUTDOWN_TIMEOUT = 5.0  #: for a server to tidy up after its stdin was closed, before it is killed [s]

#: One thread, or forking would not be safe; and the same order of a set's texts in every process.
SINGLE = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "JE_ARROW_MALLOC_CONF": "background_thread:false",
    "PYTHONHASHSEED": "0",
}


@dataclass(slots=True)
class _Server:
    """A server that was started."""

    process: subprocess.Popen[bytes]
    jobs: IO[bytes]  #: its stdin
    results: IO[bytes]  #: its stdout, which is read without waiting
    log: IO[bytes]  #: what it says besides
    scratch: Path  #: its folder
    heard: bytes = b""  #: of a result
    ready: bool = False  #: whether it came through its imports

    def last_word(self) -> str:
        """Return the last line that it said besides its results."""
        self.log.seek(0)
        return (self.log.read().decode(errors="replace").strip().splitlines() or ["it said nothing"])[-1]

    def end(self) -> None:
        """End it and all that it started, leave no file."""
        self.jobs.close()
        try:
            self.process.wait(SHUTDOWN_TIMEOUT)
        except subprocess.TimeoutExpired:
            pass
        finally:
            self.process.kill()
            self.process.wait()
            process_tree.end_session(self.process.pid)
            shutil.rmtree(self.scratch, ignore_errors=True)
            self.results.close()
            self.log.close()


def _start() -> _Server:
    scratch = Path(tempfile.mkdtemp(prefix="vve_sumo_sweep_"))
    log = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the server
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "vve_sumo.sweep.server", str(os.getpid()), str(scratch)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=log,
        bufsize=0,
        # What a run puts among the temporary files and does not live to take away is taken away with its record.
        env={**os.environ, **SINGLE, "PYTHONPATH": search_path(), "TMPDIR": str(scratch)},
        start_new_session=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    return _Server(process, process.stdin, process.stdout, log, scratch)


def search_path() -> str:
    """Return where modules are looked for before the standard library, for a process that doesn't look where it is."""
    own = takewhile(lambda place: place != sysconfig.get_path("stdlib") and not place.endswith(".zip"), sys.path)
    return os.pathsep.join(str(Path(place).absolute()) for place in own)


class Worker:
    """One server, and the job that it drives; it is started when it is given its first."""

    def __init__(self, report: Callable[[DriveProgress], None] = lambda progress: None) -> None:
        """`report` is called with the progress of a job that asks for that, whenever `result` hears of some."""
        self._report = report
        self._server: _Server | None = None
        self._job: Job | None = None
        self._tries = 0  #: how often the job was begun

    @property
    def busy(self) -> bool:
        """Whether a job is being driven."""
        return self._job is not None

    @property
    def pid(self) -> int:
        """Process id of the server; 0 while there is none."""
        return self._server.process.pid if self._server else 0

    def fileno(self) -> int:
        """Return what becomes readable when `result` has something to do: of a started server, another each time."""
        return self.start().results.fileno()

    def start(self) -> _Server:
        """Start the server unless it runs; its imports take a second, which nobody waits for here."""
        self._server = self._server or _start()
        return self._server

    def submit(self, job: Job) -> None:
        """Have a job driven; raises ConfigError where it can't be told, and then nothing is."""
        assert not self.busy
        line = job.to_json()
        self._job, self._tries = job, 0
        self._tell(line)

    def _tell(self, line: str) -> None:
        self._tries += 1
        server, rest = self.start(), memoryview(line.encode() + b"\n")
        # A server that is dead already is found by its closed stdout.
        with contextlib.suppress(BrokenPipeError):
            while rest:
                rest = rest[server.jobs.write(rest) :]

    def result(self) -> RunResult | None:
        """Return what came of the job, once there is something; None until then.

        A server that died is started anew with the same job, once. Raises SimulationError where it can't be started.
        """
        server = self.start()
        data: bytes | None = server.results.read(CHUNK)
        if data is None:
            return None
        if data == b"":
            return self._died(server)
        server.heard += data
        while b"\n" in server.heard:
            line, _newline, server.heard = server.heard.partition(b"\n")
            if line.decode() == READY:
                server.ready = True
            elif (progress := progress_of(line.decode())) is not None:
                self._report(progress)
            else:
                self._job = None
                return RunResult.from_json(line.decode())
        return None

    def dismiss(self) -> None:
        """Tell the server to end, and what it drives; `kill` waits for that."""
        if self._server is not None:
            self._server.jobs.close()

    def kill(self) -> None:
        """End the server and all that it started; what it was driving is lost."""
        if self._server is not None:
            self._server.end()
        self._server, self._job = None, None

    def _died(self, server: _Server) -> RunResult | None:
        """Clear away a dead server; give its job to another one, or up."""
        job, code, word = self._job, server.process.wait(), server.last_word()
        self.kill()
        if code >= 0 and not server.ready:
            raise SimulationError(f"sweep: the process that forks runs ended at its start with code {code}: {word}")
        if job is None:
            return None
        if self._tries < MAX_ATTEMPTS:
            self._job = job
            self._tell(job.to_json())
            return None
        return RunResult(job.key, error=f"killed: {signal.Signals(-code).name}" if code < 0 else f"server: {word}")
