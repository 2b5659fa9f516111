"""Fills a sweep's folder: drives its unfinished runs on an engine and stores a row of the dataset for each.

Prints nothing: the caller receives the tally after every run.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from vve_sumo.errors import ConfigError, SimulationError, VveError
from vve_sumo.record.sweep_folder import read_tables
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
    """Drive the unfinished runs of a sweep into a folder; return the search, if the sweep is one.

    `notify` receives a line where there was nothing to resume. Raises KeyboardInterrupt and SimulationError with the
    number of stored runs and `resume_command`, which continues the sweep.
    """
    begun = (out / "sweep.json").exists()
    dataset = Dataset(out, query.plan, resume=resume)
    if resume and not begun:
        notify(f"{out}: no sweep to resume there; a new one begins")
    try:
        search = _search(query, dataset)
        _drive(engine, query, dataset, search, keep, progress)
        if search is not None and search.result is not None:
            dataset.settle(search.runs)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; {_progress_text(dataset)}; to continue: {resume_command}") from None
    except VveError as error:
        raise SimulationError(f"{error}; {_progress_text(dataset)}; to continue: {resume_command}") from error
    finally:
        dataset.close()
    if not dataset.complete:
        raise SimulationError(f"some runs were interrupted; {_progress_text(dataset)}; to continue: {resume_command}")
    return search


def _search(query: SweepQuery, dataset: Dataset) -> AdaptiveSearch | None:
    """Return the sweep's search with its finished rows; None for a sweep without a search."""
    if query.spec.search is None:
        return None
    finished_rows = {row["number"]: row for table in read_tables(dataset.folder) for row in table.to_pylist()}
    return AdaptiveSearch(query.cells, finished_rows, dataset.folder)


def _progress_text(dataset: Dataset) -> str:
    of = "" if "search" in dataset.plan.spec else f" of {dataset.plan.cells}"
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


def _drive(
    engine: Engine, query: SweepQuery, dataset: Dataset, search: AdaptiveSearch | None, keep: Keep, progress: Progress
) -> None:
    """Drive every run that the dataset does not hold, or every run that a search requests."""
    under_way: dict[str, RunSpec] = {}
    tally = _tally(dataset)

    def job(run: RunSpec) -> Job:
        return job_of(query.plan, query.spec, run, _record(dataset.folder, run.key, keep))

    def jobs() -> Iterator[Job | None]:
        for run in in_order(query.cells.unless(dataset.holds), job) if search is None else search.cells():
            if run is None:
                yield None
                continue
            under_way[run.key] = run
            yield job(run)

    def done(job: Job, result: RunResult) -> None:
        run = under_way.pop(job.key)
        if result.error == "interrupted":
            return  # not finished: it is driven when the sweep continues
        if keep == "failed" and job.keep is not None and result.figures.get("passed"):
            shutil.rmtree(job.keep, ignore_errors=True)
        row = dataset.add(run, result)
        if search is not None:
            search.take(row)
            tally.search = search.status
        tally.count(result.figures.get("passed") if not result.error else None, result.error)  # type: ignore[arg-type]
        progress(tally)

    progress(tally)
    engine.run(jobs(), done)


def _record(folder: Path, key: str, keep: Keep) -> Path | None:
    wanted = keep in ("failed", "all") or key in keep
    return (folder / "records" / key).absolute() if keep != "none" and wanted else None


def _tally(dataset: Dataset) -> Tally:
    failed = errors = 0
    for table in read_tables(dataset.folder):
        failed += table["passed"].to_pylist().count(False)
        errors += sum(map(bool, table["error"].to_pylist()))
    total = None if "search" in dataset.plan.spec else dataset.plan.cells
    return Tally(total, dataset.finished, failed, errors)
