"""Fills the folder of a design: drives its unfinished runs on an engine and stores a row of the dataset for each.

A design says which runs there are and what a run is judged by: a sweep, a suite, a certificate. Prints nothing: the
caller receives the tally after every run.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from vve_sumo.errors import ConfigError, RigError, SimulationError, VveError
from vve_sumo.record.sweep_folder import Row, SweepPlan, earlier_layout
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.engine import Engine, Local
from vve_sumo.sweep.job import Job, RunResult
from vve_sumo.sweep.plan import SweepQuery, job_of
from vve_sumo.sweep.progress import Tally
from vve_sumo.sweep.run_specs import RunSpec
from vve_sumo.sweep.schedule import in_order
from vve_sumo.sweep.search import AdaptiveSearch
from vve_sumo.sweep.spec import Keep

#: takes the tally before the first run and after every run
Progress = Callable[[Tally], None]


class Settled(NamedTuple):
    """A run whose result is known without a drive."""

    run: RunSpec
    result: RunResult


class Design:
    """Many drives that share one dataset: which runs there are, and what each is judged by."""

    judges_records = False  #: whether `judged` reads the records of runs, so that all are written
    status = ""  #: progress of a design that chooses its runs as it goes

    def __init__(self, plan: SweepPlan) -> None:
        self.plan = plan

    def hold(self, rows: Iterator[Row]) -> list[Row]:
        """Take in the rows of finished runs; return those that change: each one's number and its new columns.

        Called before anything is written; raises ConfigError where they cannot be continued.
        """
        return []

    def runs(self, dataset: Dataset) -> Iterator[RunSpec | Settled | None]:
        """Yield the runs that the dataset does not hold; None while the next one waits for another's row."""
        raise NotImplementedError

    def job(self, run: RunSpec, record: Path | None) -> Job:
        """Return the job of a run, whose record is kept in a folder."""
        raise NotImplementedError

    def judged(self, run: RunSpec, job: Job, result: RunResult) -> RunResult:
        """Return a run's result with the design's own columns; raises VveError for one that ends the design."""
        return result

    def take(self, row: Row) -> None:
        """Take a stored row."""


class Varied(Design):
    """A sweep: every combination of its parameters' values, or those that a search chooses."""

    def __init__(self, query: SweepQuery) -> None:
        super().__init__(query.plan)
        self._query = query
        self.search: AdaptiveSearch | None = None  #: once it has begun, where the sweep is one

    def runs(self, dataset: Dataset) -> Iterator[RunSpec | Settled | None]:
        cells = self._query.cells
        if self._query.spec.search is None:
            yield from in_order(cells.unless(dataset.holds), lambda run: self.job(run, None))
            return
        self.search = AdaptiveSearch(cells, {row["number"]: row for row in dataset.rows()}, dataset.folder)
        yield from self.search.cells()
        dataset.settle(self.search.runs)

    def job(self, run: RunSpec, record: Path | None) -> Job:
        return job_of(self.plan, self._query.spec, run, record)

    def take(self, row: Row) -> None:
        if self.search is not None:
            self.search.take(row)
            self.status = self.search.status


def fill(
    out: Path,
    query: SweepQuery,
    engine: Engine,
    keep: Keep,
    *,
    resume: bool,
    resume_command: str,
    progress: Progress,
    notify: Callable[[str], None],
) -> AdaptiveSearch | None:
    """Drive the unfinished runs of a sweep into a folder, as `drive_into` does; return the search, if it is one.

    `notify` receives a line where there was nothing to resume.
    """
    if resume and not (out / "sweep.json").exists():
        notify(f"{out}: no sweep to resume there; a new one begins")
    design = Varied(query)
    drive_into(out, design, engine, keep, resume=resume, resume_command=resume_command, progress=progress)
    return design.search


def drive_into(
    out: Path, design: Design, engine: Engine, keep: Keep, *, resume: bool, resume_command: str, progress: Progress
) -> None:
    """Drive the unfinished runs of a design into a folder.

    Raises ConfigError for a folder that cannot be driven into, and for what is wrong before the first run of a new one
    is finished: then nothing of it remains. Raises KeyboardInterrupt, RigError and SimulationError with the number of
    stored runs and `resume_command`, which continues the design.
    """
    if resume and design.plan.design != "sweep":
        require_begun(out, design.plan.design)
    existed, new = out.exists(), not (out / "sweep.json").exists()
    dataset, refused = Dataset(out, design.plan, resume=resume, hold=design.hold), False
    try:
        whole = _drive(engine, design, dataset, keep, progress)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; {_progress_text(dataset)}; to continue: {resume_command}") from None
    except VveError as error:
        refused = isinstance(error, ConfigError) and new and not dataset.finished
        if refused:
            raise
        kind = RigError if isinstance(error, RigError) else SimulationError
        raise kind(f"{error}; {_progress_text(dataset)}; to continue: {resume_command}") from error
    finally:
        dataset.close()
        if refused:
            _remove(out, existed=existed)
    if not whole:
        raise SimulationError(f"some runs were interrupted; {_progress_text(dataset)}; to continue: {resume_command}")


def require_begun(out: Path, design: str) -> None:
    """Raise ConfigError unless a folder holds a begun suite or certificate."""
    if not (out / "sweep.json").is_file():
        found = earlier_layout(out) or "has no sweep.json"
        raise ConfigError(f"--resume: {out}: {found}; expected the folder of a begun {design}")


def _remove(out: Path, *, existed: bool) -> None:
    """Remove what a design put into a new folder, which was empty or absent before."""
    if not existed:
        shutil.rmtree(out, ignore_errors=True)
        return
    for file in out.iterdir():
        shutil.rmtree(file) if file.is_dir() else file.unlink()


def _progress_text(dataset: Dataset) -> str:
    of = "" if "search" in dataset.plan.spec else f" of {dataset.plan.planned}"
    return f"{dataset.finished}{of} runs are finished and stored in {dataset.folder}"


def engine_of(workers: int | None, cluster: str | None) -> Engine:
    """Return the engine: `workers` processes on this machine, or a cluster; raises ConfigError if both are given."""
    if cluster is None:
        return Local(len(os.sched_getaffinity(0)) if workers is None else workers)
    if workers is not None:
        raise ConfigError(
            "--workers: a cluster sets the number of its workers; leave out one of --workers and --cluster"
        )
    from vve_sumo.sweep.cluster import Cluster

    return Cluster(cluster)


def _drive(engine: Engine, design: Design, dataset: Dataset, keep: Keep, progress: Progress) -> bool:
    """Drive every run that the dataset does not hold; return whether none was interrupted."""
    under_way: dict[str, RunSpec] = {}
    tally, whole = _tally(design, dataset), True

    def jobs() -> Iterator[Job | None]:
        for run in design.runs(dataset):
            if isinstance(run, Settled):
                store(*run)
                continue
            if run is not None:
                under_way[run.key] = run
            yield None if run is None else design.job(run, _record(dataset.folder, run.key, design, keep))

    def done(job: Job, result: RunResult) -> None:
        nonlocal whole
        run = under_way.pop(job.key)
        if result.error == "interrupted":
            whole = False  # not finished: it is driven when the design continues
            return
        result = design.judged(run, job, result)
        if job.keep is not None and not _keeps_record(job.key, keep, result.figures.get("passed")):
            shutil.rmtree(job.keep, ignore_errors=True)
        store(run, result)

    def store(run: RunSpec, result: RunResult) -> None:
        row = dataset.add(run, result)
        design.take(row)
        tally.search = design.status
        tally.count(row["passed"] if not result.error else None, result.error)
        progress(tally)

    progress(tally)
    engine.run(jobs(), done)
    return whole


def _record(folder: Path, key: str, design: Design, keep: Keep) -> Path | None:
    wanted = design.judges_records or _keeps_record(key, keep, passed=False)
    return (folder / "records" / key).absolute() if wanted else None


def _keeps_record(key: str, keep: Keep, passed: object) -> bool:
    return keep == "all" or (keep == "failed" and not passed) or (isinstance(keep, tuple) and key in keep)


def _tally(design: Design, dataset: Dataset) -> Tally:
    total = None if "search" in design.plan.spec else design.plan.planned
    tally = Tally(total, 0, 0, 0)
    for row in dataset.rows(["passed", "error"]):
        tally.count(row["passed"], row["error"])
    tally.before = tally.finished
    return tally
