"""The engine that drives a sweep's jobs on the workers of a Dask cluster: the client's side of it.

Dask handles dead and slow workers and assigns the jobs; knows neither the sweep's cells nor its dataset.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import shutil
import socket
import time
import uuid
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any

from vve_sumo.drive.provenance import decisive_versions
from vve_sumo.errors import ConfigError, SimulationError, VveError
from vve_sumo.sweep import remote
from vve_sumo.sweep.engine import Done, check_room
from vve_sumo.sweep.job import Job, RunResult, refused
from vve_sumo.sweep.preflight import preview
from vve_sumo.sweep.remote import Site, refuse_mixed

if TYPE_CHECKING:
    from distributed import Client, Future

PROBE_TIMEOUT = 3.0  #: time for a TCP connection to the address [s]
CONNECT_TIMEOUT = 10.0  #: time for the scheduler to answer [s]
JOIN_TIMEOUT = 60.0  #: time for a first worker to join [s]
QUERY_TIMEOUT = 10.0  #: time for all workers to answer; a stuck worker is left out [s]
POLL_INTERVAL = 5.0  #: time between two counts of the workers [s]
PREFETCHED_JOBS = 2  #: jobs in the queue of a worker's thread, so that it never waits for the next
DIED = "killed: worker died"  #: error of a run during which more workers died than the scheduler allows


class Cluster:
    """Drives jobs on the workers of a Dask scheduler, as many at a time as they have threads."""

    def __init__(self, address: str) -> None:
        """`address` is the scheduler's, such as `tcp://10.0.0.1:8786`.

        Raises ConfigError where no scheduler answers, no worker joins, or one has other versions than this machine.
        """
        self._address = address
        self._sites: dict[str, Site] = {}  #: by the hash of the names of all files of a run
        with self._client() as client:
            for worker, versions in _on_all_workers(client, decisive_versions).items():
                if isinstance(versions, Exception):
                    raise ConfigError(f"worker {worker} cannot run vve_sumo: {_line(versions)}")
                refuse_mixed(decisive_versions(), versions, f"worker {worker}")

    def run(self, jobs: Iterable[Job | None], done: Done) -> None:
        """Drive every job; see `Engine.run`. Raises SimulationError when the scheduler is lost."""
        with self._client() as client:
            cluster_run = _ClusterRun(client, self._address, self._sites)
            try:
                cluster_run.drive(iter(jobs), done)
            finally:
                cluster_run.end()

    @contextlib.contextmanager
    def _client(self) -> Iterator[Client]:
        try:
            from distributed import Client
            from distributed.versions import VersionMismatchWarning
        except ImportError:
            raise ConfigError("--cluster: needs Dask: pip install 'vve-sumo[cluster]'") from None
        # This module reports a cluster's errors itself, in one line.
        for name in ("distributed", "distributed.client", "tornado", "tornado.application"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        warnings.simplefilter("ignore", VersionMismatchWarning)
        _probe(self._address)
        client = _connected(Client, self._address)
        try:
            try:
                client.wait_for_workers(1, timeout=JOIN_TIMEOUT)
            except TimeoutError:
                raise ConfigError(
                    f"cluster {self._address}: expected a worker to join within {JOIN_TIMEOUT:.0f} s"
                ) from None
            yield client
        finally:
            _with_timeout(QUERY_TIMEOUT, client.close)


def _probe(address: str) -> None:
    """Raise ConfigError for an invalid address, or where nothing listens; Dask would retry for many seconds."""
    from distributed.comm.addressing import parse_address, parse_host_port

    try:
        host, port = parse_host_port(parse_address(address)[1])
    except ValueError:
        raise ConfigError(
            f"--cluster: expected a scheduler's address with its port, such as tcp://10.0.0.1:8786, got {address!r}"
        ) from None
    try:
        socket.create_connection((host, port), timeout=PROBE_TIMEOUT).close()
    except (OSError, OverflowError) as error:
        raise ConfigError(f"cluster {address}: no scheduler answers there: {_line(error)}") from None


def _connected(client_type: Any, address: str) -> Client:
    """Return a client of the scheduler at an address; raises ConfigError where none answers in time."""
    client: Client = client_type.__new__(client_type)
    failures: list[Exception] = [TimeoutError("no reply of a scheduler")]

    def connect() -> None:
        try:
            client_type.__init__(client, address, timeout=CONNECT_TIMEOUT, set_as_default=False)
            failures.clear()
        except Exception as error:
            failures.insert(0, error)

    # In a thread of its own: Dask waits forever where another program listens.
    thread = Thread(target=connect, daemon=True)
    thread.start()
    try:
        thread.join(CONNECT_TIMEOUT + PROBE_TIMEOUT)
        if failures:
            raise ConfigError(f"cluster {address}: no scheduler answers there: {_line(failures[0])}")
    except BaseException:
        # Otherwise a client without connection waits 20 s in its finalizer, and prints a warning.
        client.status = "closed"
        raise
    return client


class _ClusterRun:
    """The jobs of one sweep on a cluster."""

    def __init__(self, client: Client, address: str, sites: dict[str, Site]) -> None:
        self._client, self._address, self._sites = client, address, sites
        self._token, self._begun = uuid.uuid4().hex, 0
        self._under_way: dict[object, tuple[Job, Future[remote.Reply]]] = {}
        self._finished: SimpleQueue[Future[remote.Reply]] = SimpleQueue()
        self._capacity, self._counted = 0, -POLL_INTERVAL

    def drive(self, jobs: Iterator[Job | None], done: Done) -> None:
        """Drive every job."""
        self._fill(jobs, done)
        while self._under_way:
            for future in self._ended():
                job, _future = self._under_way.pop(future.key)
                result = self._result(job, future)
                check_room(result)
                done(job, result)
            self._fill(jobs, done)

    def end(self) -> None:
        """Cancel the unfinished jobs, and end the workers' idle servers."""
        futures = [future for _job, future in self._under_way.values()]
        _with_timeout(QUERY_TIMEOUT, lambda: self._client.cancel(futures))
        _on_all_workers(self._client, remote.end_idle_servers)

    def _ended(self) -> list[Future[remote.Reply]]:
        """Return the next finished task; none after POLL_INTERVAL, when the workers are counted again."""
        try:
            return [self._finished.get(timeout=POLL_INTERVAL)]
        except Empty:
            return []

    def _fill(self, jobs: Iterator[Job | None], done: Done) -> None:
        """Submit jobs until every worker has enough; a job that cannot be serialized is done with an error at once."""
        self._count()
        while len(self._under_way) < self._capacity and (job := next(jobs, None)) is not None:
            try:
                self._begin(job)
            except ConfigError as error:
                done(job, refused(job, error))

    def _count(self) -> None:
        if time.monotonic() - self._counted >= POLL_INTERVAL:
            # Without any worker, one job waits for the next worker.
            try:
                threads = sum(self._client.nthreads().values())
            except OSError:
                raise _lost(self._address) from None
            self._capacity = max(1, PREFETCHED_JOBS * threads)
            self._counted = time.monotonic()

    def _begin(self, job: Job) -> None:
        line = job.to_json()
        key = (f"run-{self._token}", self._begun)
        self._begun += 1
        future: Future[remote.Reply] = self._client.submit(remote.drive, line, self._site(job), key=key, pure=False)
        self._under_way[future.key] = job, future
        future.add_done_callback(self._finished.put)

    def _site(self, job: Job) -> Site:
        """Return the requirements on a job's worker; files are read once for all jobs with the same names of files."""
        references = [str(job.file), str(job.working), _texts(job.table)]
        names = hashlib.sha256(json.dumps(references).encode()).hexdigest()
        if names not in self._sites:
            previews = preview([job])
            fit = bool(previews) and not previews[0].complaint
            self._sites[names] = (
                Site(decisive_versions(), previews[0].files_sha256, names) if fit else Site(decisive_versions())
            )
        return self._sites[names]

    def _result(self, job: Job, future: Future[remote.Reply]) -> RunResult:
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        try:
            reply = future.result()
        except KilledWorker:
            return RunResult(job.key, error=DIED)
        except VveError:
            raise
        except (OSError, CancelledError):
            raise _lost(self._address) from None
        except Exception as error:
            raise SimulationError(f"cluster {self._address}: run {job.key}: {_line(error)}") from error
        result = RunResult.from_json(reply.result)
        if job.keep is not None:
            _place(job.keep, job.keep.with_name(reply.record), result)
        return result


def _place(keep: Path, temporary: Path, result: RunResult) -> None:
    """Move a run's record to its folder and remove incomplete records of abandoned workers."""
    if temporary.is_dir():
        shutil.rmtree(keep, ignore_errors=True)
        temporary.replace(keep)
    elif not result.error:
        raise SimulationError(
            f"{temporary}: a worker wrote this record, but it is not here: expected a folder shared with the workers"
        )
    for left in keep.parent.glob(f"{keep.name}.*"):
        shutil.rmtree(left, ignore_errors=True)


def _texts(value: Any) -> Any:
    """Return a table with its strings alone: every file of a run is named by one of them."""
    if isinstance(value, dict):
        return {key: _texts(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_texts(item) for item in value]
    return value if isinstance(value, str) else None


def _on_all_workers(client: Client, call: Callable[[], Any]) -> dict[str, Any]:
    """Make a call on every worker; return the answers or errors by worker, without those of stuck workers."""
    answers: dict[str, Any] = {}
    _with_timeout(QUERY_TIMEOUT, lambda: answers.update(client.run(call, on_error="return")))
    return answers


def _with_timeout(seconds: float, call: Callable[[], Any]) -> None:
    """Make a call in a thread, wait for it at most `seconds` [s], and ignore its failure."""

    def attempt() -> None:
        with contextlib.suppress(Exception):
            call()

    thread = Thread(target=attempt, daemon=True)
    thread.start()
    thread.join(seconds)


def _lost(address: str) -> SimulationError:
    return SimulationError(f"cluster {address}: lost the connection to the scheduler")


def _line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
