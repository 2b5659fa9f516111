"""A run of a sweep on a worker of a Dask cluster: the worker's side.

The worker drives through its own server, as the engine for one machine does; knows nothing of the sweep's dataset.
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

from vve_sumo.drive.provenance import decisive_versions
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.sweep.job import DISK_FULL, DISK_FULL_ERRNOS, Job, RunResult
from vve_sumo.sweep.preflight import preview
from vve_sumo.sweep.worker import Worker

if TYPE_CHECKING:
    import distributed

POLL_INTERVAL = 0.2  #: between two checks whether the scheduler still needs a run [s]
#: states of a Dask worker in which it can still hand in a result
ALIVE = frozenset({"running", "paused", "closing_gracefully"})

#: idle servers, kept for the next run because their imports take seconds
_idle: deque[Worker] = deque()
#: hashes of sites that were verified to equal the client's
_verified: set[str] = set()


@dataclass(frozen=True, slots=True)
class Site:
    """Versions and files that must be equal on every machine of a sweep."""

    versions: dict[str, str]  #: of the software that determines a drive
    files_sha256: dict[str, str] = field(default_factory=dict)  #: of the files that the run reads, by role
    names: str = ""  #: hash of the names of the run's files; empty: they are not compared


class Reply(NamedTuple):
    """The reply of a worker."""

    result: str  #: a line of JSON
    record: str  #: name of the record's temporary folder; empty where none is kept


def drive(line: str, site: Site) -> Reply:
    """Drive a job and return its reply.

    Raises ConfigError where versions or files differ from the client's, SimulationError where this worker cannot drive.
    """
    import distributed

    dask_worker, job = distributed.get_worker(), Job.from_json(line)
    try:
        _verify(job, site, f"worker {dask_worker.address}")
        # A worker that the scheduler took for dead may still write the same record.
        temporary = None if job.keep is None else job.keep.with_name(f"{job.keep.name}.{uuid.uuid4().hex}")
        result = _driven(replace(job, keep=temporary), dask_worker)
    except SimulationError as error:
        raise SimulationError(f"worker {dask_worker.address}: {error}") from None
    except OSError as error:
        if error.errno not in DISK_FULL_ERRNOS:
            raise SimulationError(f"worker {dask_worker.address}: {error}") from None
        result = RunResult(job.key, error=f"{DISK_FULL}: {tempfile.gettempdir()}")
    if result.error.startswith(DISK_FULL):
        result = replace(result, error=f"{result.error}, seen from worker {dask_worker.address}")
    return Reply(result.to_json(), temporary.name if temporary else "")


def _driven(job: Job, dask_worker: distributed.Worker) -> RunResult:
    import distributed

    key = dask_worker.get_current_task()
    try:
        worker = _idle.pop()
    except IndexError:
        worker = Worker()
    try:
        worker.submit(job)
        while (result := worker.result()) is None:
            select.select([worker], [], [], POLL_INTERVAL)
            if not _awaited(dask_worker, key):
                raise distributed.Reschedule
    except BaseException:
        worker.kill()
        raise
    _idle.append(worker)
    return result


def _awaited(dask_worker: distributed.Worker, key: object) -> bool:
    """Return whether this worker's scheduler still waits for a task."""
    task = dask_worker.state.tasks.get(key)
    return task is not None and task.state != "cancelled" and dask_worker.status.name in ALIVE


def end_idle_servers() -> None:
    """End the idle servers."""
    while _idle:
        _idle.pop().kill()


def refuse_mixed(client: Mapping[str, str], worker: Mapping[str, str], where: str) -> None:
    """Raise ConfigError unless a worker has the versions that the client has."""
    for name in sorted({*client, *worker}):
        if client.get(name) != worker.get(name):
            raise ConfigError(
                f"mixed versions: {where} has {name} {worker.get(name, 'none')}, here {client.get(name, 'none')}"
            )


def _verify(job: Job, site: Site, where: str) -> None:
    """Raise ConfigError unless versions and files are the client's."""
    mark = hashlib.sha256(json.dumps([site.versions, site.files_sha256, site.names]).encode()).hexdigest()
    if mark in _verified:
        return
    refuse_mixed(site.versions, decisive_versions(), where)
    for run_preview in preview([job]) if site.names else ():
        if run_preview.complaint:
            raise ConfigError(f"{where}: {run_preview.complaint}; expected the same files as on the client")
        for role in sorted({*site.files_sha256, *run_preview.files_sha256}):
            if site.files_sha256.get(role) != run_preview.files_sha256.get(role):
                raise ConfigError(f"{where}: the file of {role} differs from the client's; share the file, or copy it")
    _verified.add(mark)
