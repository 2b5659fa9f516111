"""The order in which the runs of a sweep are driven, which is not that of its design.

Runs that load the same road with the same seed follow each other, because a server loads the road once for all of them.
Among these the longest come first, so that no worker drives a long run at the end while the others are idle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice

from vve_sumo.sweep.job import Job
from vve_sumo.sweep.run_specs import RunSpec
from vve_sumo.sweep.shared_road import RoadFiles

#: runs that are sorted together: the size of a part of the dataset, so that parts are written one after the other
WINDOW = 1000


def in_order(runs: Iterable[RunSpec], job_of: Callable[[RunSpec], Job]) -> Iterator[RunSpec]:
    """Return runs in the order in which to drive them; takes WINDOW at a time. `job_of` returns a run's job."""
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
    """Return a sort key that is smaller for a run that may take longer: by its duration, then by a slower car."""
    return -_number(job.table.get("duration_s")), _number(job.table["ego"].get("speed_mps"))


def _number(value: object) -> float:
    """Return a number, and 0 for another value, with which the run will be refused."""
    return value if isinstance(value, (int, float)) else 0.0
