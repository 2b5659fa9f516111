"""What drives the jobs of a sweep: the protocol of an engine, and the one that uses this machine.

Hands each result on as it comes, in no order; knows neither the sweep's cells nor where results are kept.
"""

from __future__ import annotations

import select
from collections.abc import Callable, Iterable, Iterator
from typing import Protocol

from vve_sumo.drive.progress import DriveProgress
from vve_sumo.errors import ConfigError
from vve_sumo.sweep.job import DISK_FULL, Job, RunResult, refused
from vve_sumo.sweep.worker import Worker

Done = Callable[[Job, RunResult], None]


class Engine(Protocol):
    """Drives jobs somewhere."""

    def run(self, jobs: Iterable[Job | None], done: Done) -> None:
        """Drive every job and call `done` once for each, in any order, from the caller's thread.

        Jobs are taken as they are needed, so there may be millions; None says that there is no other until one that
        is being driven is done. Raises ConfigError where the disk is full, SimulationError where runs can't be
        started. However it ends, nothing is left running.
        """
        ...


class Local:
    """Drives jobs on this machine, several at a time."""

    def __init__(self, workers: int, report: Callable[[DriveProgress], None] = lambda progress: None) -> None:
        """`workers` runs go on at the same time; raises ConfigError unless there is at least one.

        `report` takes the progress of jobs that ask for that.
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
        driven: dict[Worker, Job] = {}
        for worker in workers:
            _give(worker, driven, jobs, done)
        while driven:
            for worker in _spoken(driven):
                result = worker.result()
                if result is None:
                    continue
                check_room(result)
                job = driven.pop(worker)
                _give(worker, driven, jobs, done)
                done(job, result)
            for worker in workers:
                if worker not in driven:
                    _give(worker, driven, jobs, done)


def run_one(job: Job, report: Callable[[DriveProgress], None] = lambda progress: None) -> RunResult:
    """Drive a single job on this machine and return what came of it; `report` takes its progress."""
    results: list[RunResult] = []
    Local(1, report).run([job], lambda _job, result: results.append(result))
    return results[0]


def _give(worker: Worker, driven: dict[Worker, Job], jobs: Iterator[Job | None], done: Done) -> None:
    """Give a worker the next job that can be told at all; the others are done before they began."""
    for job in jobs:
        if job is None:
            return
        try:
            worker.submit(job)
        except ConfigError as error:
            done(job, refused(job, error))
        else:
            driven[worker] = job
            return


def _spoken(driven: Iterable[Worker]) -> list[Worker]:
    """Return the workers that have something to say, having waited for one."""
    by_descriptor = {worker.fileno(): worker for worker in driven}
    poll = select.poll()
    for descriptor in by_descriptor:
        poll.register(descriptor, select.POLLIN)
    return [by_descriptor[descriptor] for descriptor, _event in poll.poll()]


def check_room(result: RunResult) -> None:
    """Raise ConfigError for a result that says that there is no room left, as every further one would."""
    if result.error.startswith(DISK_FULL):
        folder = result.error.removeprefix(f"{DISK_FULL}: ")
        raise ConfigError(f"no space left on the disk of {folder}: make room, then resume")
