"""The engine that drives a sweep's jobs on the workers of a Dask cluster: the client's side of it.

Who died, who is slow and who runs what next is Dask's to decide; knows neither the sweep's cells nor its dataset.
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

from vve_sumo.drive.provenance import deciding
from vve_sumo.errors import ConfigError, SimulationError, VveError
from vve_sumo.sweep import remote
from vve_sumo.sweep.engine import Done, check_room
from vve_sumo.sweep.job import Job, RunResult, refused
from vve_sumo.sweep.preflight import look
from vve_sumo.sweep.remote import Site, refuse_mixed

if TYPE_CHECKING:
    from distributed import Client, Future

KNOCK = 3.0  #: for anything to listen at the address [s]
CONNECT = 10.0  #: for the scheduler to answer [s]
JOIN = 60.0  #: for a first worker [s]
QUERY_TIMEOUT = 10.0  #: for all workers to say something; one that is stuck keeps nobody longer [s]
POLL_INTERVAL = 5.0  #: between two looks how many workers there are [s]
PREFETCHED_JOBS = 2  #: jobs that a thread of a worker holds, so that it never waits for its next
DIED = "killed: worker died"  #: error of a run under which as many workers died as the scheduler allows


class Cluster:
    """Drives jobs on the workers of a Dask scheduler, as many at a time as they have threads."""

    def __init__(self, address: str) -> None:
        """`address` is the scheduler's, such as `tcp://10.0.0.1:8786`.

        Raises ConfigError where no scheduler answers, no worker joins, or one has other versions than this machine.
        """
        self._address = address
        self._sites: dict[str, Site] = {}  #: by the hash of all that a run calls by a name
        with self._client() as client:
            for worker, there in _everyone(client, deciding).items():
                if isinstance(there, Exception):
                    raise ConfigError(f"worker {worker} cannot run vve_sumo: {_line(there)}")
                refuse_mixed(deciding(), there, f"worker {worker}")

    def run(self, jobs: Iterable[Job | None], done: Done) -> None:
        """Drive every job; see `Engine.run`. Raises SimulationError when the scheduler is lost."""
        with self._client() as client:
            shift = _Shift(client, self._address, self._sites)
            try:
                shift.drive(iter(jobs), done)
            finally:
                shift.end()

    @contextlib.contextmanager
    def _client(self) -> Iterator[Client]:
        try:
            from distributed import Client
            from distributed.versions import VersionMismatchWarning
        except ImportError:
            raise ConfigError("--cluster: wants Dask: pip install 'vve-sumo[cluster]'") from None
        # What it has to say of a cluster's troubles is said here, in a line.
        for name in ("distributed", "distributed.client", "tornado", "tornado.application"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        warnings.simplefilter("ignore", VersionMismatchWarning)
        _knock(self._address)
        client = _connected(Client, self._address)
        try:
            try:
                client.wait_for_workers(1, timeout=JOIN)
            except TimeoutError:
                raise ConfigError(f"cluster {self._address}: no worker has joined it within {JOIN:.0f} s") from None
            yield client
        finally:
            _within(QUERY_TIMEOUT, client.close)


def _knock(address: str) -> None:
    """Raise ConfigError where an address is none, or nothing listens there; Dask would try again for many seconds."""
    from distributed.comm.addressing import parse_address, parse_host_port

    try:
        host, port = parse_host_port(parse_address(address)[1])
    except ValueError:
        raise ConfigError(
            f"--cluster: expected a scheduler's address with its port, such as tcp://10.0.0.1:8786, got {address!r}"
        ) from None
    try:
        socket.create_connection((host, port), timeout=KNOCK).close()
    except (OSError, OverflowError) as error:
        raise ConfigError(f"cluster {address}: no scheduler answers there: {_line(error)}") from None


def _connected(client_type: Any, address: str) -> Client:
    """Return a client of the scheduler at an address; raises ConfigError where none answers in time."""
    client: Client = client_type.__new__(client_type)
    failures: list[Exception] = [TimeoutError("nothing there speaks as a scheduler does")]

    def connect() -> None:
        try:
            client_type.__init__(client, address, timeout=CONNECT, set_as_default=False)
            failures.clear()
        except Exception as error:
            failures.insert(0, error)

    # In a thread of its own: where something else than a scheduler listens, Dask waits for ever.
    thread = Thread(target=connect, daemon=True)
    thread.start()
    try:
        thread.join(CONNECT + KNOCK)
        if failures:
            raise ConfigError(f"cluster {address}: no scheduler answers there: {_line(failures[0])}")
    except BaseException:
        # A client that never connected would else wait 20 s for its end when it is collected, and print why.
        client.status = "closed"
        raise
    return client


class _Shift:
    """The jobs of one sweep on a cluster, from the first to the last."""

    def __init__(self, client: Client, address: str, sites: dict[str, Site]) -> None:
        self._client, self._address, self._sites = client, address, sites
        self._token, self._begun = uuid.uuid4().hex, 0
        self._under_way: dict[object, tuple[Job, Future[remote.Came]]] = {}
        self._finished: SimpleQueue[Future[remote.Came]] = SimpleQueue()
        self._places, self._counted = 0, -POLL_INTERVAL

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
        """Have the workers drop what is not finished, and end the servers that they keep."""
        futures = [future for _job, future in self._under_way.values()]
        _within(QUERY_TIMEOUT, lambda: self._client.cancel(futures))
        _everyone(self._client, remote.dismiss)

    def _ended(self) -> list[Future[remote.Came]]:
        """Return the next task that came to an end; none where that takes so long that workers are to be counted."""
        try:
            return [self._finished.get(timeout=POLL_INTERVAL)]
        except Empty:
            return []

    def _fill(self, jobs: Iterator[Job | None], done: Done) -> None:
        """Begin jobs until every worker has enough; those that can't be told are done before they began."""
        self._count()
        while len(self._under_way) < self._places and (job := next(jobs, None)) is not None:
            try:
                self._begin(job)
            except ConfigError as error:
                done(job, refused(job, error))

    def _count(self) -> None:
        if time.monotonic() - self._counted >= POLL_INTERVAL:
            # While there is no worker at all one job waits for the next to come.
            try:
                threads = sum(self._client.nthreads().values())
            except OSError:
                raise _lost(self._address) from None
            self._places = max(1, PREFETCHED_JOBS * threads)
            self._counted = time.monotonic()

    def _begin(self, job: Job) -> None:
        line = job.to_json()
        key = (f"run-{self._token}", self._begun)
        self._begun += 1
        future: Future[remote.Came] = self._client.submit(remote.drive, line, self._site(job), key=key, pure=False)
        self._under_way[future.key] = job, future
        future.add_done_callback(self._finished.put)

    def _site(self, job: Job) -> Site:
        """Return what a job's worker must have; files are read once for all jobs that call them by the same names."""
        said = [str(job.file), str(job.working), _texts(job.table)]
        names = hashlib.sha256(json.dumps(said).encode()).hexdigest()
        if names not in self._sites:
            seen = look([job])
            fit = bool(seen) and not seen[0].complaint
            self._sites[names] = Site(deciding(), seen[0].files_sha256, names) if fit else Site(deciding())
        return self._sites[names]

    def _result(self, job: Job, future: Future[remote.Came]) -> RunResult:
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        try:
            came = future.result()
        except KilledWorker:
            return RunResult(job.key, error=DIED)
        except VveError:
            raise
        except (OSError, CancelledError):
            raise _lost(self._address) from None
        except Exception as error:
            raise SimulationError(f"cluster {self._address}: run {job.key}: {_line(error)}") from error
        result = RunResult.from_json(came.result)
        if job.keep is not None:
            _place(job.keep, job.keep.with_name(came.record), result)
        return result


def _place(keep: Path, aside: Path, result: RunResult) -> None:
    """Put a run's record into its place and take away what other workers, that were given up, wrote of it."""
    if aside.is_dir():
        shutil.rmtree(keep, ignore_errors=True)
        aside.replace(keep)
    elif not result.error:
        raise SimulationError(f"{aside}: a worker wrote this record, but it is not here: records want a shared folder")
    for left in keep.parent.glob(f"{keep.name}.*"):
        shutil.rmtree(left, ignore_errors=True)


def _texts(value: Any) -> Any:
    """Return the texts in a table where they stand: what a run reads is called by one of them."""
    if isinstance(value, dict):
        return {key: _texts(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_texts(item) for item in value]
    return value if isinstance(value, str) else None


def _everyone(client: Client, call: Callable[[], Any]) -> dict[str, Any]:
    """Have every worker make a call; return their answers, or the error, without those of workers that are stuck."""
    answers: dict[str, Any] = {}
    _within(QUERY_TIMEOUT, lambda: answers.update(client.run(call, on_error="return")))
    return answers


def _within(seconds: float, call: Callable[[], Any]) -> None:
    """Make a call; leave it to itself when it takes longer, and don't mind its failure."""

    def attempt() -> None:
        with contextlib.suppress(Exception):
            call()

    thread = Thread(target=attempt, daemon=True)
    thread.start()
    thread.join(seconds)


def _lost(address: str) -> SimulationError:
    return SimulationError(f"cluster {address}: the scheduler was lost")


def _line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
