"""The fork server of runs: it imports all modules once, then drives one job at a time, each in a child process.

`python -m vve_sumo.sweep.server PARENT SCRATCH`: a list of jobs a line on stdin, a result a line on stdout for each of
them; lines of progress come before the result of a job with `progress` set. The server ends with its stdin or its
parent, and all processes that it started end with it. It has one thread, because forking would not be safe otherwise.

The jobs of one line are driven as one until they differ, by a child that forks; its processes drive one after the
other. Those that came to no result, or to an error, are driven again, each alone: an error is that of its own run.

The first run on a road's files loads the road itself, so an error in them is that run's error. After a successful run,
the server forks a process that loads the road and serves the same pipes in its place while jobs for this road come; the
runs forked from there find SUMO started. The fork hands back a job for another road. To other processes both are one:
where one dies, the other dies in the same way.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import importlib
import os
import re
import resource
import select
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NoReturn

from vve_sumo.drive.progress import DriveProgress
from vve_sumo.drive.provenance import decisive_versions, software
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.sweep import process_tree
from vve_sumo.sweep.input_cache import InputCache, resolve_job
from vve_sumo.sweep.job import CHUNK, READY, Job, RunResult, jobs_of, progress_line
from vve_sumo.sweep.run import driver_of, run_job, run_jobs, tidy
from vve_sumo.sweep.shared_prefix import ForkingRun
from vve_sumo.sweep.shared_road import RoadFiles, SharedRoad
from vve_sumo.vehicle import interface

POLL_INTERVAL = 0.05  #: between two checks of a run's time and memory [s]; in this time a run may take some 100 MB more
PROCESS_POLL_INTERVAL = 1.0  #: between two checks of a run's child processes, which take a millisecond or more [s]
IDLE_POLL_INTERVAL = 1.0  #: between two checks of the parent while there is no job [s]
MAX_OUTPUT_BYTES = 8192  #: bytes of the end of a run's output that are kept while it runs
MAX_OUTPUT_CHARACTERS = 2000  #: characters of them in the result of a run with an error

#: modules that every run imports: those for metrics and for the shipped controller, and the shipped interfaces
IMPORTED_AHEAD = (
    "pandas",
    "pyarrow.pandas_compat",
    "scipy.ndimage",
    "scipy.optimize",
    "scipy.spatial",
    *interface.PORT.shipped.values(),
)

#: exit code of the fork that serves on a loaded road, where the road cannot be loaded to be shared
NOT_LOADED = 3
MAX_LOAD_TIME = 3600.0  #: that loading a road may take, whatever a run may [s]

#: signals of a process' own defect; any other was sent from outside
OWN_ERROR = frozenset({"SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL", "SIGABRT", "SIGSYS", "SIGTRAP"})


class OrphanedError(Exception):
    """The parent is gone or has closed our stdin."""


class OtherRoadError(Exception):
    """A job is not for the road that this process has loaded."""


@dataclass(slots=True)
class Child:
    """A run in its process, as the server sees it."""

    pid: int
    handle: int  #: pidfd: readable once the process has ended
    result_pipe: int  #: pipe with its result
    output_pipe: int  #: pipe with its output
    begun: float  #: monotonic [s]
    tree_checked_at: float  #: time of the last check of its child processes, monotonic [s]
    received: bytes = b""  #: of its result
    output: bytes = b""  #: end of its output
    others_mb: float = 0.0  #: memory of its child processes at the last check [10^6 bytes]

    def read_pipes(self) -> None:
        """Read the pipes' present content, without waiting."""
        self.received += _drain(self.result_pipe)
        self.output = (self.output + _drain(self.output_pipe))[-MAX_OUTPUT_BYTES:]

    def lines(self) -> list[bytes]:
        """Return and remove the complete lines received; a result has no end of line."""
        *lines, self.received = self.received.split(b"\n")
        return lines

    def close(self) -> None:
        """Close the descriptors."""
        for descriptor in (self.handle, self.result_pipe, self.output_pipe):
            os.close(descriptor)


def _drain(descriptor: int) -> bytes:
    """Return a pipe's present content; one chunk at most, because a run may print without end."""
    try:
        return os.read(descriptor, CHUNK)
    except BlockingIOError:
        return b""


class ForkServer:
    """Forks a run for each job, watches its limits, and writes its result."""

    def __init__(self, parent: int, scratch: Path, jobs: int, results: int) -> None:
        self._parent, self._scratch = parent, scratch
        self._jobs, self._results = jobs, results
        self._waiting = b""  #: jobs that were read but not driven yet
        self._cache = InputCache()
        self._warmed: tuple[object, ...] = ()
        self._roads: dict[RoadFiles, bool] = {}  #: roads on which a run came through: whether forks may share one
        self._road: SharedRoad | None = None  #: of the fork that serves on a loaded road
        self._back = -1  #: pipe on which that fork hands back jobs for other roads

    def serve(self) -> None:
        """Drive jobs until the parent has ended or closed the pipe."""
        for module in IMPORTED_AHEAD:
            importlib.import_module(module)
        decisive_versions()
        gc.collect()
        self._write_line(READY)
        self._serve()

    def _serve(self) -> NoReturn:
        while True:
            line = self._next()
            jobs = jobs_of(line)
            job = jobs[0]
            if self._road is None and self._roads.get(RoadFiles.of(job)):
                self._put_back(line)
                self._delegate_to_fork(job)
            elif self._road is None or self._road.serves(job):
                done = self._drive_as_one(jobs) if len(jobs) > 1 else set()
                for job in jobs:
                    if job.key not in done:
                        self._write_line(self.run(job).to_json())
            else:
                self._put_back(line)
                raise OtherRoadError

    def _put_back(self, line: str) -> None:
        self._waiting = f"{line}\n".encode() + self._waiting

    def _drive_as_one(self, jobs: Sequence[Job]) -> set[str]:
        """Drive several jobs in a child and those that it forks; return the keys of those whose results were written.

        Each result is written as it comes, unless it is an error.
        """
        first, done = replace(jobs[0], time_limit_s=jobs[0].time_limit_s * len(jobs)), set[str]()

        def take(line: str) -> None:
            if not (result := RunResult.from_json(line)).error:
                self._write_line(line)
                done.add(result.key)

        tidy(first, self._scratch, keep=False)
        gc.freeze()
        child = self._fork(partial(self._drive_parts, jobs))
        try:
            self._watch(child, first, take, shares=True)
        finally:
            process_tree.end_descendants()
            child.read_pipes()
            child.close()
        for line in child.lines():
            take(line.decode())
        tidy(first, self._scratch, keep=True)
        if done:
            self._warm(first)
            self._roads.setdefault(RoadFiles.of(first), True)
        return done

    def _drive_parts(self, jobs: Sequence[Job], result_end: int) -> str:
        """Drive in a child what of several jobs it does not fork off; return the lines of the results."""
        process = ForkingRun()
        loaded = self._road.loaded if self._road else None
        results = process.with_cost(run_jobs(jobs, self._scratch, self._cache, process.fork, loaded))
        return "".join(f"{result.to_json()}\n" for result in results)

    def run(self, job: Job) -> RunResult:
        """Drive one job in a child and return its result; raises OrphanedError when the parent has ended."""
        tidy(job, self._scratch, keep=False)
        if job.keep is not None:
            software()  # for its record: once here, not in every run
        if job.driver:
            driver_of(job)  # imported once here
        gc.freeze()
        child = self._fork(partial(self._drive, job))
        try:
            limit = self._watch(child, job, self._write_line)
        finally:
            process_tree.kill([child.pid])
            _pid, status, usage = os.wait4(child.pid, 0)
            child.read_pipes()
            child.lines()
            child.close()
            process_tree.end_descendants()
        wall = time.monotonic() - child.begun
        result = _result(job, child, status, limit)
        tidy(job, self._scratch, keep=True)
        if not result.error:
            self._warm(job)
            self._roads.setdefault(RoadFiles.of(job), True)
        peak = usage.ru_maxrss * 1024 / 1e6
        return replace(result, wall_s=wall, cpu_s=usage.ru_utime + usage.ru_stime, peak_mb=peak)

    def _drive(self, job: Job, result_end: int) -> str:
        """Drive a job in a child; return the line of its result, which has no end."""
        loaded = self._road.loaded if self._road else None
        report = partial(_report, result_end) if job.progress else _no_report
        return run_job(job, self._scratch, self._cache, report, loaded).to_json()

    def _fork(self, drive: Callable[[int], str]) -> Child:
        """Fork a child that drives, and is passed the pipe on which it may report before it returns its results."""
        (result_pipe, result_end), (output_pipe, output_end) = os.pipe(), os.pipe()
        server, begun = os.getpid(), time.monotonic()
        pid = os.fork()
        if pid == 0:
            for pipe in (self._jobs, self._results, *([self._back] if self._road else ())):
                os.close(pipe)
            _run_child(drive, server, result_end, output_end)
        os.close(result_end)
        os.close(output_end)
        for pipe in (result_pipe, output_pipe):
            os.set_blocking(pipe, False)
        return Child(pid, os.pidfd_open(pid), result_pipe, output_pipe, begun, begun)

    def _delegate_to_fork(self, job: Job) -> None:
        """Let a fork load a job's road and serve in place of this process until it hands back a job; end as it ends."""
        if job.keep is not None:
            software()  # for the records of its runs
        (back, self._back), server = os.pipe(), os.getpid()
        gc.freeze()
        pid = os.fork()
        if pid == 0:
            os.close(back)
            self._parent = server
            self._serve_preloaded(job)
        os.close(self._back)
        self._waiting = self._handed_back(back)
        os.close(back)
        _pid, status = os.waitpid(pid, 0)
        if os.WIFSIGNALED(status):
            os.kill(os.getpid(), os.WTERMSIG(status))
        elif os.WEXITSTATUS(status) == NOT_LOADED:
            self._roads[RoadFiles.of(job)] = False
        elif os.WEXITSTATUS(status) != 0:
            os._exit(os.WEXITSTATUS(status))

    def _handed_back(self, back: int) -> bytes:
        """Return the lines that the fork hands back when it ends."""
        lines = b""
        while True:
            if select.select([back], [], [], IDLE_POLL_INTERVAL)[0]:
                chunk = os.read(back, CHUNK)
                if not chunk:
                    return lines
                lines += chunk
            self._check_parent()

    def _serve_preloaded(self, job: Job) -> NoReturn:
        """Serve in the fork with a loaded road; hand back a job for another road."""
        code = 1
        try:
            process_tree.die_with(self._parent)
            process_tree.adopt_orphans()
            # A run has loaded these files in time. With another seed loading may not end; then this process and the
            # server die, and the next server drives the job without a fork, so that the run itself times out.
            signal.setitimer(signal.ITIMER_REAL, min(job.time_limit_s, MAX_LOAD_TIME))
            self._road = SharedRoad(job, self._cache)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            gc.collect()
            self._serve()
        except OrphanedError:
            code = 0
        except OtherRoadError:
            code = self._hand_back(0)
        except (ConfigError, SimulationError):
            code = self._hand_back(NOT_LOADED)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)

    def _hand_back(self, code: int) -> int:
        """Hand back the lines that wait, and return the exit code that goes with them."""
        rest = memoryview(self._waiting)
        while rest:
            rest = rest[os.write(self._back, rest) :]
        return code

    def _watch(self, child: Child, job: Job, take: Callable[[str], None], *, shares: bool = False) -> str:
        """Wait for a child's end; return the error if it exceeded a limit, else an empty string.

        `take` receives its lines as they come. With `shares` it forks runs of the same memory.
        """
        poll = select.poll()
        for descriptor in (child.handle, child.output_pipe, child.result_pipe, self._jobs):
            poll.register(descriptor, select.POLLIN)
        while True:
            events = dict(poll.poll(1000.0 * POLL_INTERVAL))
            child.read_pipes()
            for line in child.lines():
                take(line.decode())
            for pipe in (child.output_pipe, child.result_pipe):
                if events.get(pipe, 0) & select.POLLHUP:
                    poll.unregister(pipe)
            if child.handle in events:
                return ""
            if self._jobs in events:
                self._read_jobs()
            self._check_parent()
            if not time.monotonic() - child.begun <= job.time_limit_s:
                return "timed_out"
            if not _memory_mb(child, shares) <= job.memory_limit_mb:
                return "memory"

    def _warm(self, job: Job) -> None:
        """Read a job's files for later jobs; its own run has ended with them, so reading them is safe."""
        others = [one.get("path") for name in ("actors", "egos") for one in job.table.get(name, ())]
        files = (job.file, job.working, job.table["road"], job.table["ego"]["path"], others)
        if files != self._warmed:
            self._warmed = files
            with contextlib.suppress(Exception):
                resolve_job(job, self._cache)

    def _next(self) -> str:
        """Return the next job's line."""
        while b"\n" not in self._waiting:
            if select.select([self._jobs], [], [], IDLE_POLL_INTERVAL)[0]:
                self._read_jobs()
            self._check_parent()
        line, _newline, self._waiting = self._waiting.partition(b"\n")
        return line.decode()

    def _read_jobs(self) -> None:
        chunk = os.read(self._jobs, CHUNK)
        if not chunk:
            raise OrphanedError
        self._waiting += chunk

    def _check_parent(self) -> None:
        if os.getppid() != self._parent:
            raise OrphanedError

    def _write_line(self, line: str) -> None:
        rest = memoryview(line.encode() + b"\n")
        try:
            while rest:
                rest = rest[os.write(self._results, rest) :]
        except BrokenPipeError:
            raise OrphanedError from None


def _memory_mb(child: Child, shares: bool) -> float:
    """Return the memory of a run and its child processes [10^6 bytes]; with `shares`, of the greatest of them."""
    now = time.monotonic()
    if now - child.tree_checked_at >= PROCESS_POLL_INTERVAL:
        child.tree_checked_at = now
        others = (one for one in process_tree.descendants(os.getpid()) if one != child.pid)
        resident = [process_tree.resident(one) / 1e6 for one in others]
        child.others_mb = max(resident, default=0.0) if shares else sum(resident)
    own = process_tree.resident(child.pid) / 1e6
    return max(own, child.others_mb) if shares else own + child.others_mb


def _result(job: Job, child: Child, status: int, limit: str) -> RunResult:
    """Return the result of a child that has ended."""
    if limit:
        error = limit
    elif os.WIFSIGNALED(status):
        name = _signal_name(os.WTERMSIG(status))
        error = f"{'crashed' if name in OWN_ERROR else 'killed'}: {name}"
    else:
        with contextlib.suppress(ConfigError, UnicodeDecodeError):
            result = RunResult.from_json(child.received.decode())
            return result if not result.error else replace(result, said=_text(child.output))
        error = f"exited: {os.WEXITSTATUS(status)}"
    return RunResult(job.key, error=error, said=_text(child.output))


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _text(output: bytes) -> str:
    # A crash ends with the names of a hundred extension modules, which do not help to find its cause.
    text = re.sub(r"(?m)^Extension modules: .*$", "", output.decode(errors="replace"))
    return text.strip()[-MAX_OUTPUT_CHARACTERS:]


def _no_report(progress: DriveProgress) -> None:
    """Nobody follows the run."""


def _report(result_end: int, progress: DriveProgress) -> None:
    os.write(result_end, progress_line(progress).encode() + b"\n")


def _run_child(drive: Callable[[int], str], server: int, result_end: int, output_end: int) -> NoReturn:
    """Drive in the child, write the result, and exit without closing what the server has open."""
    code = 1
    try:
        process_tree.die_with(server)
        os.setpgid(0, 0)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        nothing = os.open(os.devnull, os.O_RDONLY)
        for descriptor, number in ((nothing, 0), (output_end, 1), (output_end, 2)):
            os.dup2(descriptor, number)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        faulthandler.enable(file=2)
        line = memoryview(drive(result_end).encode())
        while line:
            line = line[os.write(result_end, line) :]
        code = 0
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def main() -> None:
    """Serve until the parent is gone; leave neither process nor file behind."""
    parent, scratch = int(sys.argv[1]), Path(sys.argv[2])
    process_tree.adopt_orphans()
    # Prints in this process must not mix with the lines of results.
    results = os.dup(1)
    os.dup2(2, 1)
    try:
        ForkServer(parent, scratch, os.dup(0), results).serve()
    except OrphanedError:
        pass
    finally:
        process_tree.end_descendants()
        shutil.rmtree(scratch, ignore_errors=True)
    # An ordinary exit would spend half a second on unloading modules.
    os._exit(0)


if __name__ == "__main__":
    main()
