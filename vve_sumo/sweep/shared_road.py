"""The road that runs of a sweep share, loaded once in a process that is forked for each run.

Knows jobs and files; neither forks nor drives.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

from vve_sumo.drive.virtual_road import road_source
from vve_sumo.errors import ConfigError
from vve_sumo.sweep.input_cache import InputCache, resolve_job, stamp
from vve_sumo.sweep.job import Job
from vve_sumo.world.loaded_road import LoadedRoad


class RoadFiles(NamedTuple):
    """The names of a job's road files; equal for two jobs that name the same files."""

    beside: Path  #: the scenario's file, beside which names are looked up
    working: Path
    road: str  #: the scenario's table of that name

    @classmethod
    def of(cls, job: Job) -> RoadFiles:
        """Return the names of a job's road files."""
        return cls(job.file, job.working, json.dumps(job.table.get("road"), sort_keys=True))


class SharedRoad:
    """A loaded road, for the job that it was loaded for and for jobs that would load the same."""

    def __init__(self, job: Job, cache: InputCache) -> None:
        """Load a job's road; raises ConfigError or SimulationError where that fails or forks may not share the road."""
        source = road_source(resolve_job(job, cache))
        self._files, self._seed = RoadFiles.of(job), job.table.get("seed")
        self._read = [stamp(file) for file in (source.network, *source.demand)]
        self.loaded = LoadedRoad(source)
        if not self.loaded.forkable:
            raise ConfigError(f"{source.network}: expected traffic that SUMO only reads, so that forks can share it")

    def serves(self, job: Job) -> bool:
        """Whether a job's run would load this road, from files that are as they were."""
        if (RoadFiles.of(job), job.table.get("seed")) != (self._files, self._seed):
            return False
        try:
            return all(stamp(read.file) == read for read in self._read)
        except ConfigError:
            return False
