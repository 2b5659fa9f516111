"""The client of one fork server: submits jobs, reads results, restarts the server when it dies.

One job at a time, or several that are driven as one. Never blocks, except for the end of a process; the caller waits on
the workers' descriptors.
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
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import IO

from vve_sumo.drive.progress import DriveProgress
from vve_sumo.errors import SimulationError
from vve_sumo.sweep import process_tree
from vve_sumo.sweep.job import CHUNK, READY, Job, RunResult, line_of, progress_of

MAX_ATTEMPTS = 2  #: largest number of starts of a job, because a server may be killed from outside
SHUTDOWN_TIMEOUT = 5.0  #: time for a server to clean up after its stdin was closed, before it is killed [s]

#: environment: one thread, for safe forks; a fixed hash seed, for the same order of sets in every process
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
    log: IO[bytes]  #: its stderr
    scratch: Path  #: its folder
    buffer: bytes = b""  #: of a result
    ready: bool = False  #: whether it came through its imports

    def last_output(self) -> str:
        """Return the last line of its stderr."""
        self.log.seek(0)
        return (self.log.read().decode(errors="replace").strip().splitlines() or ["no output"])[-1]

    def end(self) -> None:
        """End the server and all its processes, and delete its files."""
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
        # Temporary files that a killed run leaves are deleted with the scratch folder.
        env={**os.environ, **SINGLE, "PYTHONPATH": search_path(), "TMPDIR": str(scratch)},
        start_new_session=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    return _Server(process, process.stdin, process.stdout, log, scratch)


def search_path() -> str:
    """Return where modules are looked for before the standard library, for a process started with -P."""
    own = takewhile(lambda place: place != sysconfig.get_path("stdlib") and not place.endswith(".zip"), sys.path)
    return os.pathsep.join(str(Path(place).absolute()) for place in own)


class Worker:
    """One server, and the jobs that it drives as one; the first job starts the server."""

    def __init__(self, report: Callable[[DriveProgress], None] = lambda progress: None) -> None:
        """`report` receives the progress of a job with `progress` set, while `result` reads it."""
        self._report = report
        self._server: _Server | None = None
        self._jobs: dict[str, Job] = {}  #: those that the server drives, by their keys
        self._later: list[Job] = []  #: of those that died together: each is driven alone
        self._tries = 0  #: how often the server's jobs were begun

    @property
    def busy(self) -> bool:
        """Whether a job is being driven."""
        return bool(self._jobs or self._later)

    @property
    def pid(self) -> int:
        """Process id of the server; 0 while there is none."""
        return self._server.process.pid if self._server else 0

    def fileno(self) -> int:
        """Return the descriptor that is readable when `result` has data; another one after each start of the server."""
        return self.start().results.fileno()

    def start(self) -> _Server:
        """Start the server unless it runs; this call does not wait for its imports, which take a second."""
        self._server = self._server or _start()
        return self._server

    def submit(self, *jobs: Job) -> None:
        """Submit a job, or several of one `shared_key`.

        Raises ConfigError where one cannot be serialized, and then submits nothing.
        """
        assert not self.busy
        self._begin(jobs)

    def _begin(self, jobs: Sequence[Job]) -> None:
        line = line_of(jobs)
        self._jobs, self._tries = {job.key: job for job in jobs}, 0
        self._send(line)

    def _send(self, line: str) -> None:
        self._tries += 1
        server, rest = self.start(), memoryview(line.encode() + b"\n")
        # The closed stdout of a dead server is detected in `result`.
        with contextlib.suppress(BrokenPipeError):
            while rest:
                rest = rest[server.jobs.write(rest) :]

    def result(self) -> RunResult | None:
        """Return the next result of a job, or None while there is none yet.

        A server that died is restarted with the same jobs, once. Raises SimulationError where it cannot be started.
        """
        server = self.start()
        if (done := self._next(server)) is not None:
            return done
        data: bytes | None = server.results.read(CHUNK)
        if data is None:
            return None
        if data == b"":
            return self._died(server)
        server.buffer += data
        return self._next(server)

    @property
    def has_result(self) -> bool:
        """Whether `result` returns one that was read already."""
        return self._server is not None and b"\n" in self._server.buffer

    def _next(self, server: _Server) -> RunResult | None:
        """Return the first result of what was read; pass on the progress before it."""
        while b"\n" in server.buffer:
            line, _newline, server.buffer = server.buffer.partition(b"\n")
            if line.decode() == READY:
                server.ready = True
            elif (progress := progress_of(line.decode())) is not None:
                self._report(progress)
            else:
                result = RunResult.from_json(line.decode())
                del self._jobs[result.key]
                self._go_on()
                return result
        return None

    def _go_on(self) -> None:
        """Submit the next of the jobs that died together, once the server drives none."""
        if not self._jobs and self._later:
            job, *self._later = self._later
            self._begin([job])

    def dismiss(self) -> None:
        """Close the server's stdin, which ends it and its run; `kill` waits for the end."""
        if self._server is not None:
            self._server.jobs.close()

    def kill(self) -> None:
        """End the server and all its processes; its present run is lost."""
        if self._server is not None:
            self._server.end()
        self._server, self._jobs, self._later = None, {}, []

    def _died(self, server: _Server) -> RunResult | None:
        """Remove a dead server; submit its jobs to a new one, each alone, or give a job up that was alone twice."""
        jobs, later, code, output = list(self._jobs.values()), self._later, server.process.wait(), server.last_output()
        self.kill()
        self._later = later
        if code >= 0 and not server.ready:
            raise SimulationError(f"sweep: the process that forks runs ended at its start with code {code}: {output}")
        if not jobs:
            return None
        if len(jobs) > 1:
            self._later = [*jobs, *later]
            self._go_on()
            return None
        [job] = jobs
        if self._tries < MAX_ATTEMPTS:
            self._jobs = {job.key: job}
            self._send(line_of(jobs))
            return None
        self._go_on()
        return RunResult(job.key, error=f"killed: {signal.Signals(-code).name}" if code < 0 else f"server: {output}")
