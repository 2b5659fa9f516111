"""Drives a job: returns its metrics or its error, and handles the folder of its record.

A run is an ordinary drive; knows nothing of processes and their limits, or of the sweep that it belongs to.
"""

from __future__ import annotations

import importlib
import os
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from vve_sumo.drive import run as drives
from vve_sumo.drive.brain import ExternalController
from vve_sumo.drive.progress import DriveProgress, progress_callback
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.shared_prefix import Fork, Variants
from vve_sumo.drive.summary import invalidating_events, judged
from vve_sumo.drive.termination import Outcome
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.record.writer import require_empty_folder
from vve_sumo.scenario.schema import Criteria, Scenario
from vve_sumo.sweep.input_cache import InputCache, resolve_job
from vve_sumo.sweep.job import DISK_FULL, DISK_FULL_ERRNOS, RIG, Job, MetricValue, RunResult, finite, refused
from vve_sumo.world.loaded_road import LoadedRoad

#: entries of a summary that identify the drive, or that depend on the machine
NOT_FIGURES = frozenset(
    {"scenario", "title", "seed", "controller", "versions", "record_parts_sha256", "record_files_sha256", "egos"}
)
#: starts a job's external controller, drives with it, and returns the drive and more columns of its row
Driver = Callable[
    [Job, ResolvedScenario, Callable[[ExternalController], drives.Drive]], tuple[drives.Drive, dict[str, MetricValue]]
]
MAX_TEXT_LENGTH = 500  #: characters of an error message
#: an object's address, which differs between processes
ADDRESS = re.compile(r"\b0x[0-9a-fA-F]+\b")


def run_job(
    job: Job,
    scratch: Path,
    cache: InputCache,
    report: Callable[[DriveProgress], None] = lambda progress: None,
    loaded: LoadedRoad | None = None,
) -> RunResult:
    """Drive a job in this process, which SUMO allows once, and return its metrics or its error.

    `scratch` is an exclusive folder for temporary files; call `tidy` with it afterwards in any case. `report` receives
    the progress at intervals. `loaded` is the job's road, if the parent process has loaded it.
    """
    try:
        resolved = resolve_job(job, cache)
        require_record_folder(job)
        folder, keep_record = growing(job, scratch), job.keep is not None
        watch = progress_callback(resolved.path.length, report)

        def drive(brain: ExternalController | None = None) -> drives.Drive:
            return drives.run(
                resolved,
                folder,
                job.working,
                pose=job.pose,
                brain=brain,
                keep_record=keep_record,
                on_tick=watch,
                loaded=loaded,
            )

        done, more = driver_of(job)(job, resolved, drive) if job.driver else (drive(), {})
        summary = done.summary
    except ConfigError as error:
        return refused(job, error)
    except RigError as error:
        return RunResult(job.key, error=f"{RIG}{error}")
    except Exception as error:
        return _broken(job, scratch, f"{type(error).__name__}: {error}")
    return _result(job, resolved, summary, scratch, more)


def run_jobs(
    jobs: Sequence[Job], scratch: Path, cache: InputCache, fork: Fork, loaded: LoadedRoad | None = None
) -> list[RunResult]:
    """Drive jobs as one until they differ; return the results of those that this process drove to their end.

    The jobs have one `shared_key`, and `fork` is as `drive.shared_prefix.Fork` says. Raises ConfigError where one of
    the jobs cannot be driven.
    """
    variants, shared = Variants([resolve_job(job, cache) for job in jobs], fork), 0.0

    def watch(_tick: int, now: float, _speed: float, _s: float) -> None:
        nonlocal shared
        if len(variants.together) > 1:
            shared = now

    summaries = drives.run_variants(variants, jobs[0].working, on_tick=watch, loaded=loaded)
    results = (_result(jobs[one], variants.scenarios[one], its, scratch, {}) for one, its in summaries.items())
    return [replace(result, shared_s=shared) for result in results]


def _result(
    job: Job, resolved: ResolvedScenario, summary: dict[str, Any], scratch: Path, more: dict[str, MetricValue]
) -> RunResult:
    """Return a job's result by the summary of its drive."""
    text = _portable_text(
        "; ".join(filter(None, [summary["text"], *summary.get("metric_errors", {}).values()])), scratch
    )
    if summary["outcome"] == Outcome.BROKEN:
        return _broken(job, scratch, text)
    if summary["outcome"] == Outcome.INTERRUPTED:
        return RunResult(job.key, error="interrupted")
    return RunResult(job.key, figures_of(resolved.scenario, summary | {"text": text}) | more)


def driver_of(job: Job) -> Driver:
    """Return the function that drives a job with an external controller; it belongs to a package above this one."""
    module, _, function = job.driver.partition(":")
    driver: Driver = getattr(importlib.import_module(module), function)
    return driver


def _broken(job: Job, scratch: Path, text: str) -> RunResult:
    if any(f"[Errno {number}]" in text for number in DISK_FULL_ERRNOS):
        return RunResult(job.key, error=f"{DISK_FULL}: {scratch.parent if job.keep is None else job.keep.parent}")
    return RunResult(job.key, error=f"broken: {_portable_text(text, scratch)}")


def figures_of(scenario: Scenario, summary: dict[str, Any]) -> dict[str, MetricValue]:
    """Return the entries of a summary that do not depend on the machine, and the verdicts of the criteria.

    Lists of failed criteria and of reasons become one string each; other lists and tables their length. Of further egos
    only what they failed is among them.
    """
    figures: dict[str, MetricValue] = {}
    for name, value in summary.items():
        if name in ("failed", "reasons"):
            figures[name] = "; ".join(value)
        elif name not in NOT_FIGURES:
            figures[name] = len(value) if isinstance(value, (list, tuple, dict)) else finite(value)
    return figures | verdicts(scenario.criteria, summary)


def verdicts(criteria: Criteria, summary: dict[str, Any]) -> dict[str, bool | None]:
    """Return whether the drive met each stated criterion, and whether it was undisturbed.

    A playback is not judged.
    """
    lines = judged(criteria, summary)
    if summary["passed"] is None:
        return dict.fromkeys(["undisturbed", *(f"meets_{name}" for name in lines)])
    # A gateway fault is planned only if the criterion asks for it; else it is a disturbance.
    planned = summary["outcome"] != Outcome.FAULT or criteria.outcome == "fault"
    met: dict[str, bool | None] = {f"meets_{name}": not line for name, line in lines.items()}
    return {"undisturbed": planned and not invalidating_events(criteria, summary)} | met


def _portable_text(text: str, scratch: Path) -> str:
    """Return a message as one line that does not depend on machine or folder."""
    return ADDRESS.sub("0x...", " ".join(text.split()).replace(str(scratch), "record"))[:MAX_TEXT_LENGTH]


def growing(job: Job, scratch: Path) -> Path:
    """Return the temporary folder of a run's record: beside the final one, so that it can be renamed."""
    return scratch / "record" if job.keep is None else job.keep.with_name(f"{job.keep.name}.part")


def require_record_folder(job: Job) -> None:
    """Raise ConfigError where the record's folder holds other files."""
    if job.keep is not None and job.keep.exists() and not (job.keep / "scenario.json").is_file():
        require_empty_folder(job.keep)


def tidy(job: Job, scratch: Path, *, keep: bool) -> None:
    """Move a run's record, complete or not, to its folder; delete everything else that the run left."""
    left = growing(job, scratch)
    if keep and job.keep is not None and left.is_dir():
        shutil.rmtree(job.keep, ignore_errors=True)
        os.replace(left, job.keep)  # noqa: PTH105 - onto an empty folder too
    shutil.rmtree(left, ignore_errors=True)
    for place in scratch.iterdir():
        shutil.rmtree(place, ignore_errors=True) if place.is_dir() else place.unlink(missing_ok=True)
