"""Drives several brains in parallel, one worker process for each; a drive's outcome is on the disk.

It knows processes and pipes; it must not know what is driven.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from types import FrameType
from typing import Final, Generic, TypeVar

from vve_sumo.errors import SimulationError, VveError

Job = TypeVar("Job")
#: time for a worker to end its brain when the certificate is interrupted [s]
END_TIMEOUT: Final = 20.0


class Pool(Generic[Job]):
    """Worker processes, forked from this one, each with a function that drives a job."""

    def __init__(self, drives: Sequence[Callable[[Job], None]]) -> None:
        """Start a worker for each function; it raises VveError for a job that cannot be driven."""
        context = multiprocessing.get_context("fork")
        self._workers = []
        for drive in drives:
            parent_end, child_end = context.Pipe()
            process = context.Process(target=_work, args=(drive, child_end, parent_end), daemon=False)
            process.start()
            child_end.close()
            self._workers.append((process, parent_end))

    def run(self, jobs: Sequence[Job], done: Callable[[Job], Sequence[Job]]) -> None:
        """Drive all jobs; `done` is called after each, in any order, and returns jobs that follow from it.

        Raises what a worker raised, and SimulationError for one that died.
        """
        queue = list(jobs)
        driven: dict[Connection, Job] = {}
        idle = [pipe for _process, pipe in self._workers]
        while queue or driven:
            while queue and idle:
                pipe, job = idle.pop(), queue.pop(0)
                driven[pipe] = job
                pipe.send(job)
            for ready in wait(list(driven)):
                assert isinstance(ready, Connection)
                job = driven.pop(ready)
                _check(ready, job)
                idle.append(ready)
                queue.extend(done(job))

    def close(self) -> None:
        """End every worker and its brain; a driving worker receives SIGINT."""
        for process, pipe in self._workers:
            pipe.close()
            if process.is_alive() and process.pid is not None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process.pid, signal.SIGINT)
        for process, _pipe in self._workers:
            process.join(END_TIMEOUT)
            if process.is_alive():
                process.kill()
                process.join()


def _check(pipe: Connection, job: object) -> None:
    try:
        raised = pipe.recv()
    except EOFError:
        raise SimulationError(f"the process that drove {job} died") from None
    if raised is not None:
        raise raised


def _work(drive: Callable[[Job], None], pipe: Connection, other_end: Connection) -> None:
    """Drive jobs until the pipe is closed."""
    signal.signal(signal.SIGINT, _interrupt)
    other_end.close()
    with contextlib.suppress(KeyboardInterrupt, EOFError, BrokenPipeError):
        while True:
            job = pipe.recv()
            raised: BaseException | None = None
            try:
                drive(job)
            except (VveError, KeyboardInterrupt) as error:
                raised = error
            pipe.send(raised)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    """Interrupt the drive once: a second signal must not interrupt the end of its brain."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise KeyboardInterrupt
