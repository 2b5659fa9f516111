"""A run of a sweep on somebody else's machine: what a worker of a Dask cluster does when it is sent one.

Drives through a server of its own, as the engine for one machine does; knows nothing of the sweep and its dataset.
"""

from __future__ import annotations

import hashlib
import json
import select
import tempfile
import uuid
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

from vve_sumo.drive.provenance import deciding
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.sweep.job import DISK_FULL, DISK_FULL_ERRNOS, Job, RunResult
from vve_sumo.sweep.preflight import look
from vve_sumo.sweep.worker import Worker

if TYPE_CHECKING:
    import distributed

POLL_INTERVAL = 0.2  #: between two looks whether a run is still wanted [s]
#: states of a Dask worker in which it can still hand in a result
ALIVE = frozenset({"running", "paused", "closing_gracefully"})

#: servers that have nothing to do: their imports took seconds, and the next run can use them
_idle: deque[Worker] = deque()
#: what was found to be the same here as where the sweep was started
_agreed: set[str] = set()


@dataclass(frozen=True, slots=True)
class Site:
    """What must be the same wherever a run is driven."""

    versions: dict[str, str]  #: of what decides how a drive goes
    files_sha256: dict[str, str] = field(default_factory=dict)  #: of what the run reads, by role
    names: str = ""  #: hash of all that the run calls by a name; empty: its files are not compared


class Came(NamedTuple):
    """What a worker sends back."""

    result: str  #: a line
    record: str  #: name of the folder beside the one for the record in which it lies; empty where none is kept


def drive(line: str, site: Site) -> Came:
    """Drive a job and return what came of it.

    Raises ConfigError where this worker would drive it otherwise than the client, SimulationError where it can't drive.
    """
    import distributed

    me, job = distributed.get_worker(), Job.from_json(line)
    try:
        _agree(job, site, f"worker {me.address}")
        # A worker that was given up, wrongly, may be writing the record of the same run.
        aside = None if job.keep is None else job.keep.with_name(f"{job.keep.name}.{uuid.uuid4().hex}")
        result = _driven(replace(job, keep=aside), me)
    except SimulationError as error:
        raise SimulationError(f"worker {me.address}: {error}") from None
    except OSError as error:
        if error.errno not in DISK_FULL_ERRNOS:
            raise SimulationError(f"worker {me.address}: {error}") from None
        result = RunResult(job.key, error=f"{DISK_FULL}: {tempfile.gettempdir()}")
    if result.error.startswith(DISK_FULL):
        result = replace(result, error=f"{result.error}, seen from worker {me.address}")
    return Came(result.to_json(), aside.name if aside else "")


def _driven(job: Job, me: distributed.Worker) -> RunResult:
    import distributed

    key = me.get_current_task()
    try:
        worker = _idle.pop()
    except IndexError:
        worker = Worker()
    try:
        worker.submit(job)
        while (result := worker.result()) is None:
            select.select([worker], [], [], POLL_INTERVAL)
            if not _wanted(me, key):
                raise distributed.Reschedule
    except BaseException:
        worker.kill()
        raise
    _idle.append(worker)
    return result


def _wanted(me: distributed.Worker, key: object) -> bool:
    """Return whether the scheduler, to whom this worker still belongs, waits for a task."""
    task = me.state.tasks.get(key)
    return task is not None and task.state != "cancelled" and me.status.name in ALIVE


def dismiss() -> None:
    """End the servers that have nothing to do."""
    while _idle:
        _idle.pop().kill()


def refuse_mixed(here: Mapping[str, str], there: Mapping[str, str], where: str) -> None:
    """Raise ConfigError unless a worker has the versions that the client has."""
    for name in sorted({*here, *there}):
        if here.get(name) != there.get(name):
            raise ConfigError(
                f"mixed versions: {where} has {name} {there.get(name, 'none')}, here {here.get(name, 'none')}"
            )


def _agree(job: Job, site: Site, where: str) -> None:
    """Raise ConfigError unless versions and files are the client's."""
    mark = hashlib.sha256(json.dumps([site.versions, site.files_sha256, site.names]).encode()).hexdigest()
    if mark in _agreed:
        return
    refuse_mixed(site.versions, deciding(), where)
    for seen in look([job]) if site.names else ():
        if seen.complaint:
            raise ConfigError(f"{where}: {seen.complaint}; it must see the files that the client sees")
        for role in sorted({*site.files_sha256, *seen.files_sha256}):
            if site.files_sha256.get(role) != seen.files_sha256.get(role):
                raise ConfigError(f"{where}: the file of {role} differs from the one here: share it, or copy it")
    _agreed.add(mark)
