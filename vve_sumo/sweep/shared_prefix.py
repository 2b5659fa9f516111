"""Which runs of a sweep are driven as one until they differ, and what each of the processes took into which that forks.

Such runs differ in the controller, its tuning, the scenario's actors and its criteria alone, and keep no record. Knows
jobs and processes; not how a drive is shared.
"""

from __future__ import annotations

import json
import os
import resource
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from vve_sumo.sweep import process_tree
from vve_sumo.sweep.job import Job, RunResult

#: keys of a scenario that need not matter from the first tick on; of `actors`, all but their ids
LATE = ("controller", "criteria")
#: jobs that are driven as one at most: each that still waits for others takes the memory that it has written to
MAX_JOBS = 32


def shared_key(job: Job) -> str | None:
    """Return what two jobs must have in common to be driven as one; None for a job that is driven alone."""
    actors = job.table.get("actors", ())
    alone = job.keep is not None or job.pose is not None or job.driver or job.progress or job.table.get("egos")
    if alone or not isinstance(actors, list | tuple) or not all(isinstance(one, dict) for one in actors):
        return None
    table: dict[str, Any] = {key: value for key, value in job.table.items() if key not in LATE}
    table["actors"] = [one.get("id") for one in actors]
    limits = job.time_limit_s, job.memory_limit_mb
    return json.dumps([job.name, job.file, job.working, job.rig, limits, table], sort_keys=True, default=str)


class ForkingRun:
    """One of the processes into which a run forks, each of which waits while those that it forked drive."""

    def __init__(self) -> None:
        self._begun, self._waited = time.monotonic(), 0.0

    def fork(self, _numbers: Sequence[int]) -> bool:
        """Fork; return true in the new process, and false in this one once the new one has ended."""
        parent, begun = os.getpid(), time.monotonic()
        pid = os.fork()
        if pid == 0:
            process_tree.die_with(parent)
            self._begun, self._waited = time.monotonic(), 0.0
            return True
        os.waitpid(pid, 0)
        self._waited += time.monotonic() - begun
        return False

    def with_cost(self, results: Sequence[RunResult]) -> list[RunResult]:
        """Return the results of the runs that this process drove as one, with an equal share of what it took each."""
        usage = resource.getrusage(resource.RUSAGE_SELF)
        wall, cpu = time.monotonic() - self._begun - self._waited, usage.ru_utime + usage.ru_stime
        share, peak = 1.0 / len(results), usage.ru_maxrss * 1024 / 1e6
        return [replace(one, wall_s=wall * share, cpu_s=cpu * share, peak_mb=peak) for one in results]
