"""The order in which the runs of a sweep are driven, which is not that of its design.

Runs that load the same road with the same seed follow each other, because a server loads it once for all of them. Among
these the longest come first, so that no worker is left with a long run while the others have nothing to do any more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice

from vve_sumo.sweep.job import Job
from vve_sumo.sweep.run_specs import RunSpec
from vve_sumo.sweep.shared_road import RoadFiles

#: runs that are put in order together: as many as a part of the dataset holds, so that part after part is written
WINDOW = 1000


def in_order(runs: Iterable[RunSpec], job_of: Callable[[RunSpec], Job]) -> Iterator[RunSpec]:
    """Return runs in the order in which to drive them; takes WINDOW of them at a time. `job_of` says what one needs."""
    left = iter(runs)
    while window := list(islice(left, WINDOW)):
        alike: dict[tuple[RoadFiles, int], list[tuple[tuple[float, float], RunSpec]]] = {}
        for run in window:
            job = job_of(run)
            alike.setdefault((RoadFiles.of(job), run.seed), []).append((_shortness(job), run))
        for some in alike.values():
            some.sort(key=lambda one: one[0])
            yield from (run for _shortness_of_it, run in some)


def _shortness(job: Job) -> tuple[float, float]:
    """Return what is less for a run that may take longer: one that may last longer, or whose car drives slower."""
    return -_number(job.table.get("duration_s")), _number(job.table["ego"].get("speed_mps"))


def _number(value: object) -> float:
    """Return a number, and 0 for what a run will be refused for."""
    return value if isinstance(value, (int, float)) else 0.0
