"""A job driven: its figures, or the error that kept it from any, and where its record lies meanwhile.

A run is a drive like any other; knows nothing of processes and their limits, or of the sweep that it belongs to.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vve_sumo.drive import run as drives
from vve_sumo.drive.progress import DriveProgress, progress_watch
from vve_sumo.drive.summary import disturbances, judged
from vve_sumo.drive.termination import Outcome
from vve_sumo.errors import ConfigError
from vve_sumo.record.writer import claim as claim_folder
from vve_sumo.scenario.schema import Criteria, Scenario
from vve_sumo.sweep.input_cache import InputCache, resolve_job
from vve_sumo.sweep.job import DISK_FULL, DISK_FULL_ERRNOS, Figure, Job, RunResult, finite, refused
from vve_sumo.world.loaded_road import LoadedRoad

#: of a summary, what says which drive it was, not how it went, or differs with the place where it was driven
NOT_FIGURES = frozenset(
    {"scenario", "title", "seed", "controller", "versions", "record_parts_sha256", "record_files_sha256"}
)
MAX_TEXT_LENGTH = 500  #: characters of what went wrong, in its own words
#: an object's place in memory, which is another in every process
ADDRESS = re.compile(r"\b0x[0-9a-fA-F]+\b")


def run_job(
    job: Job,
    scratch: Path,
    cache: InputCache,
    report: Callable[[DriveProgress], None] = lambda progress: None,
    loaded: LoadedRoad | None = None,
) -> RunResult:
    """Drive a job in this process, which SUMO allows once, and return its figures, or the error that kept it from any.

    `scratch` is a folder of nobody else's for temporary files; `tidy` is to be called with it afterwards in any case.
    `report` is called now and then with how far the drive has come. `loaded` is the job's road, where the process of
    which this one is a fork has loaded it.
    """
    try:
        resolved = resolve_job(job, cache)
        claim(job)
        folder, kept = growing(job, scratch), job.keep is not None
        watch = progress_watch(resolved.path.length, report)
        drive = drives.run(resolved, folder, job.working, pose=job.pose, kept=kept, watch=watch, loaded=loaded)
        summary = drive.summary
    except ConfigError as error:
        return refused(job, error)
    except Exception as error:
        return _broken(job, scratch, f"{type(error).__name__}: {error}")
    text = _told("; ".join(filter(None, [summary["text"], *summary.get("metric_errors", {}).values()])), scratch)
    if summary["outcome"] == Outcome.BROKEN:
        return _broken(job, scratch, text)
    if summary["outcome"] == Outcome.INTERRUPTED:
        return RunResult(job.key, error="interrupted")
    return RunResult(job.key, figures_of(resolved.scenario, summary | {"text": text}))


def _broken(job: Job, scratch: Path, text: str) -> RunResult:
    if any(f"[Errno {number}]" in text for number in DISK_FULL_ERRNOS):
        return RunResult(job.key, error=f"{DISK_FULL}: {scratch.parent if job.keep is None else job.keep.parent}")
    return RunResult(job.key, error=f"broken: {_told(text, scratch)}")


def figures_of(scenario: Scenario, summary: dict[str, Any]) -> dict[str, Figure]:
    """Return what a summary holds that is the same whenever and wherever the drive is driven, and what it met.

    Lists of what failed and why are one text each; of other lists and tables only the length counts.
    """
    figures: dict[str, Figure] = {}
    for name, value in summary.items():
        if name in ("failed", "reasons"):
            figures[name] = "; ".join(value)
        elif name not in NOT_FIGURES:
            figures[name] = len(value) if isinstance(value, (list, tuple, dict)) else finite(value)
    return figures | verdicts(scenario.criteria, summary)


def verdicts(criteria: Criteria, summary: dict[str, Any]) -> dict[str, bool | None]:
    """Return whether the drive met each criterion that is stated, and whether it was a test of them at all.

    Nothing of a playback is judged.
    """
    lines = judged(criteria, summary)
    if summary["passed"] is None:
        return dict.fromkeys(["undisturbed", *(f"meets_{name}" for name in lines)])
    # A gateway fault where another outcome is asked for is no plan either: it misses the criterion and disturbs.
    planned = summary["outcome"] != Outcome.FAULT or criteria.outcome == "fault"
    met: dict[str, bool | None] = {f"meets_{name}": not line for name, line in lines.items()}
    return {"undisturbed": planned and not disturbances(criteria, summary)} | met


def _told(text: str, scratch: Path) -> str:
    """Return what a drive said as one line that does not depend on where it was driven."""
    return ADDRESS.sub("0x...", " ".join(text.split()).replace(str(scratch), "record"))[:MAX_TEXT_LENGTH]


def growing(job: Job, scratch: Path) -> Path:
    """Return where a run's record grows: beside its later place, so that it can be moved there whole."""
    return scratch / "record" if job.keep is None else job.keep.with_name(f"{job.keep.name}.part")


def claim(job: Job) -> None:
    """Raise ConfigError where something that is no record lies in the way of the one to keep."""
    if job.keep is not None and job.keep.exists() and not (job.keep / "scenario.json").is_file():
        claim_folder(job.keep)


def tidy(job: Job, scratch: Path, *, keep: bool) -> None:
    """Put a run's record, whole or torn, where it is to be kept; take away everything else that a run has left."""
    left = growing(job, scratch)
    if keep and job.keep is not None and left.is_dir():
        shutil.rmtree(job.keep, ignore_errors=True)
        os.replace(left, job.keep)  # noqa: PTH105 - onto an empty folder too
    shutil.rmtree(left, ignore_errors=True)
    for place in scratch.iterdir():
        shutil.rmtree(place, ignore_errors=True) if place.is_dir() else place.unlink(missing_ok=True)
