"""The protocol of an engine, which drives the jobs of a sweep, and the engine for this machine.

Passes each result on as it comes, in any order; knows neither the sweep's cells nor where results are kept.
"""

from __future__ import annotations

import math
import select
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Protocol

from vve_sumo.drive.progress import DriveProgress
from vve_sumo.errors import ConfigError
from vve_sumo.sweep.job import DISK_FULL, Job, RunResult, refused
from vve_sumo.sweep.shared_prefix import MAX_JOBS, shared_key
from vve_sumo.sweep.worker import Worker

Done = Callable[[Job, RunResult], None]


class Engine(Protocol):
    """Drives jobs, on this machine or elsewhere."""

    def run(self, jobs: Iterable[Job | None], done: Done) -> None:
        """Drive every job and call `done` once for each, in any order, from the caller's thread.

        Jobs are taken as needed, so there may be millions; None means that the next job depends on one that is still
        being driven. Raises ConfigError where the disk is full, SimulationError where runs cannot be started. In
        every case no process is left running.
        """
        ...


class Local:
    """Drives jobs on this machine, several at a time."""

    def __init__(self, workers: int, report: Callable[[DriveProgress], None] = lambda progress: None) -> None:
        """`workers` runs are driven in parallel; raises ConfigError unless there is at least one.

        `report` receives the progress of jobs with `progress` set.
        """
        if workers < 1:
            raise ConfigError(f"workers: expected 1 or more, got {workers}")
        self._workers, self._report = workers, report

    def run(self, jobs: Iterable[Job | None], done: Done) -> None:
        """Drive every job; see `Engine.run`."""
        workers = [Worker(self._report) for _ in range(self._workers)]
        try:
            self._drive(workers, iter(jobs), done)
        finally:
            for worker in workers:
                worker.dismiss()
            for worker in workers:
                worker.kill()

    def _drive(self, workers: list[Worker], jobs: Iterator[Job | None], done: Done) -> None:
        driven: dict[Worker, dict[str, Job]] = {}
        queue = JobQueue(jobs, len(workers))
        for worker in workers:
            _submit_next(worker, driven, queue, done)
        while driven:
            for worker in _ready(driven):
                while (result := worker.result()) is not None:
                    check_room(result)
                    job = driven[worker].pop(result.key)
                    if not worker.busy:
                        del driven[worker]
                        _submit_next(worker, driven, queue, done)
                    done(job, result)
                    if not worker.has_result:
                        break
            for worker in workers:
                if worker not in driven:
                    _submit_next(worker, driven, queue, done)


class JobQueue:
    """The jobs that come, and those among them that are driven as one."""

    def __init__(self, jobs: Iterator[Job | None], workers: int) -> None:
        """`jobs` are as `Engine.run` says; they are taken as needed."""
        self._jobs, self._workers = jobs, workers
        self._alike: deque[Job] = deque()  #: of one `shared_key`
        self._share = 0  #: of each worker
        self._next: Job | None = None  #: the first of another, which has been taken already

    def take(self) -> list[Job]:
        """Return the next jobs to be driven as one, so many that all workers have some; none where there are none."""
        if not self._alike:
            self._fill()
            self._share = math.ceil(len(self._alike) / self._workers)
        return [self._alike.popleft() for _ in range(min(self._share, len(self._alike)))]

    def _fill(self) -> None:
        first = self._next or next(self._jobs, None)
        self._next = None
        if first is None:
            return
        self._alike.append(first)
        key = shared_key(first)
        while key is not None and len(self._alike) < MAX_JOBS * self._workers:
            job = next(self._jobs, None)
            if job is None:
                return
            if shared_key(job) != key:
                self._next = job
                return
            self._alike.append(job)


def run_one(job: Job, report: Callable[[DriveProgress], None] = lambda progress: None) -> RunResult:
    """Drive a single job on this machine and return its result; `report` receives its progress."""
    results: list[RunResult] = []
    Local(1, report).run([job], lambda _job, result: results.append(result))
    return results[0]


def _submit_next(worker: Worker, driven: dict[Worker, dict[str, Job]], queue: JobQueue, done: Done) -> None:
    """Submit the next jobs to a worker; those that cannot be serialized are done with an error at once."""
    while jobs := queue.take():
        try:
            worker.submit(*jobs)
        except ConfigError as error:
            for job in jobs:
                done(job, refused(job, error))
        else:
            driven[worker] = {job.key: job for job in jobs}
            return


def _ready(driven: Iterable[Worker]) -> list[Worker]:
    """Wait until a worker has data, and return all workers that have."""
    by_descriptor = {worker.fileno(): worker for worker in driven}
    poll = select.poll()
    for descriptor in by_descriptor:
        poll.register(descriptor, select.POLLIN)
    return [by_descriptor[descriptor] for descriptor, _event in poll.poll()]


def check_room(result: RunResult) -> None:
    """Raise ConfigError for the error of a full disk, which every further run would have as well."""
    if result.error.startswith(DISK_FULL):
        folder = result.error.removeprefix(f"{DISK_FULL}: ")
        raise ConfigError(f"no space left on the disk of {folder}: free some space, then resume")
