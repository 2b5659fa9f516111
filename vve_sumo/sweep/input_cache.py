"""Reads a job's scenario and the files that it names, once for all jobs that name the same files.

Needs neither SUMO nor a car; drives nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from vve_sumo.drive.path_in_network import LoadedPath, read_path
from vve_sumo.drive.resolved_scenario import ResolvedScenario, resolve_scenario
from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.scenario.load import parse
from vve_sumo.sweep.job import Job
from vve_sumo.world.network import Network, read_network

if TYPE_CHECKING:
    from vve_sumo.rig.schema import Rig

Read = TypeVar("Read")


class Stamp(NamedTuple):
    """The state of a file, by which a change is detected."""

    file: Path
    written: int  #: [ns]
    size: int


class InputCache:
    """Cached networks, paths and rigs; each is read again only after its file has changed."""

    MAX_ENTRIES = 32  #: of each kind; a sweep over more files reads them again

    def __init__(self) -> None:
        self._networks: dict[Stamp, Network] = {}
        self._paths: dict[tuple[Stamp, Stamp], LoadedPath] = {}
        self._rigs: dict[Stamp, Rig] = {}

    def network(self, file: Path) -> Network:
        """Return what `read_network` does."""
        return self._cached(self._networks, stamp(file), partial(read_network, file))

    def path(self, file: Path, street: MapFrame, network: Network) -> LoadedPath:
        """Return what `read_path` does; `street` is the network's."""
        stamps = stamp(file), stamp(network.path)
        return self._cached(self._paths, stamps, partial(read_path, file, street, network))

    def rig(self, file: Path, working: Path) -> Rig:
        """Return what `rig.load.load` does."""
        from vve_sumo.rig.load import load

        return self._cached(self._rigs, stamp(file), partial(load, file, working))

    def _cached(self, cache: dict[Any, Read], state: Any, read: Callable[[], Read]) -> Read:
        if state not in cache:
            value = read()
            if len(cache) >= self.MAX_ENTRIES:
                del cache[next(iter(cache))]
            cache[state] = value
        return cache[state]


def stamp(file: Path) -> Stamp:
    """Return the state of a file; raises ConfigError where there is none."""
    try:
        state = file.stat()
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from None
    return Stamp(file, state.st_mtime_ns, state.st_size)


def resolve_job(job: Job, cache: InputCache) -> ResolvedScenario:
    """Return the resolved scenario of a job; raises ConfigError for a missing file or a wrong value."""
    scenario = parse(job.table, job.file)
    resolved = resolve_scenario(job.name, scenario, job.file, job.working, network_in=cache.network, path_in=cache.path)
    return resolved if job.rig is None else resolved.with_rig(cache.rig(job.rig, job.working), job.working)
