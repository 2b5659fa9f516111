"""Sweeps on a real Dask cluster on loopback: the same rows as here, whoever dies, stalls or is of another version."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread, main_thread

import pytest

from tests.sweep.test_processes import REPOSITORY, alive, driven, eventually, job, seeded, written
from vve_sumo.drive.provenance import decisive_versions
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.sweep import process_tree
from vve_sumo.sweep.cluster import Cluster
from vve_sumo.sweep.engine import Engine
from vve_sumo.sweep.job import Job, RunResult

TTL = 10  #: after which a worker that says nothing is given up [s]; of a busy machine a shorter one may give up any


class Machines:
    """A scheduler and workers, each a process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.workers: list[subprocess.Popen[bytes]] = []
        self._every: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--port", "0", "--scheduler-file", str(file))
        eventually(lambda: file.exists() and file.read_text().endswith("}"))
        self.address = str(json.loads(file.read_text())["address"])

    def _start(self, role: str, *options: str, search: Path | None = None) -> subprocess.Popen[bytes]:
        environment = {
            **os.environ,
            "PYTHONPATH": f"{search}:{REPOSITORY}" if search else str(REPOSITORY),
            "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": f"{TTL}s",
        }
        command = [sys.executable, "-m", "dask", role, *options, "--host", "127.0.0.1", "--no-dashboard"]
        with (self.folder / f"{role}{len(self._every)}.log").open("wb") as log:
            process = subprocess.Popen(command, env=environment, cwd=self.folder, stdout=log, stderr=log)
        self._every.append(process)
        return process

    def join(self, *, nanny: bool = False, search: Path | None = None) -> subprocess.Popen[bytes]:
        """Have another worker join."""
        options = ["--nthreads", "1", "--memory-limit", "0", "--nanny" if nanny else "--no-nanny"]
        worker = self._start("worker", self.address, *options, search=search)
        self.workers.append(worker)
        return worker

    def wait_for(self, count: int) -> None:
        """Wait until so many workers have joined."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(count)

    def runs(self) -> list[int]:
        """Processes that the workers have started."""
        return [run for worker in self.workers for run in process_tree.descendants(worker.pid)]

    def end(self) -> None:
        """End all of them, and see that what they started ends as well."""
        runs = self.runs()
        for process in self._every:
            process.kill()
            process.wait()
        eventually(lambda: not any(map(alive, runs)))


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[Machines]:
    one = Machines(tmp_path)
    try:
        yield one
    finally:
        one.end()


@pytest.fixture(autouse=True)
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where workers put temporary files."""
    place = tmp_path / "scratch"
    place.mkdir()
    monkeypatch.setenv("TMPDIR", str(place))
    return place


def collected(
    engine: Engine, jobs: list[Job], then: Callable[[int], None] = lambda count: None
) -> dict[str, RunResult]:
    """What came of jobs, by key, each once; `then` is told after each how many there are."""
    results: dict[str, RunResult] = {}

    def done(given: Job, result: RunResult) -> None:
        assert result.key == given.key
        assert given.key not in results
        results[given.key] = result
        then(len(results))

    engine.run(iter(jobs), done)
    return results


@pytest.mark.slow
def test_rows_are_the_same_when_a_worker_is_killed_and_one_stalls(machines: Machines, tmp_path: Path) -> None:
    jobs = [seeded(str(number), number) for number in range(5)]
    kept = dataclasses.replace(jobs[4], keep=tmp_path / "records" / "4")
    for _ in range(3):
        machines.join()
    machines.wait_for(3)

    def trouble(count: int) -> None:
        if count in (1, 2):
            victim = machines.workers[count - 1]
            victim.send_signal(signal.SIGKILL if count == 1 else signal.SIGSTOP)

    came = collected(Cluster(machines.address), [*jobs[:4], kept], trouble)
    assert {key: result.error for key, result in came.items()} == {one.key: "" for one in jobs}
    for workers in (1, 2):
        here = driven(*jobs, workers=workers)
        assert {key: result.figures for key, result in came.items()} == {key: here[key].figures for key in came}
    assert [place.name for place in (tmp_path / "records").iterdir()] == ["4"]
    summary = json.loads((tmp_path / "records" / "4" / "summary.json").read_text())
    assert summary["record_sha256"] == came["4"].figures["record_sha256"]
    assert machines.workers[0].wait() == -signal.SIGKILL
    machines.workers[1].kill()
    eventually(lambda: machines.runs() == [])


@pytest.mark.slow
def test_what_ends_a_sweep_is_one_line_and_leaves_nothing_running(machines: Machines, tmp_path: Path) -> None:
    note = tmp_path / "note"
    hangs, full = job("hangs", "hang", note), job("fills", "fills", keep=tmp_path / "kept" / "fills")
    machines.join(nanny=True)
    cluster = Cluster(machines.address)

    with pytest.raises(ConfigError, match=rf"^no space left on the disk of {full.keep.parent}, seen from worker tcp:"):
        collected(cluster, [full])

    def once_it_hangs(call: Callable[[], None]) -> None:
        """Have something happen while the run is under way, and see the run end."""
        note.unlink(missing_ok=True)
        happening = Thread(target=lambda: (written(note), call()))
        happening.start()
        try:
            collected(cluster, [hangs])
        finally:
            happening.join()
            child = written(note)
            eventually(lambda: not alive(child))

    with pytest.raises(KeyboardInterrupt):
        once_it_hangs(lambda: signal.pthread_kill(main_thread().ident, signal.SIGINT))
    with pytest.raises(SimulationError, match=rf"^cluster {machines.address}: lost the connection to the scheduler$"):
        once_it_hangs(machines.scheduler.kill)
    with pytest.raises(ConfigError, match=rf"^cluster {machines.address}: no scheduler answers there: [^\n]*$"):
        Cluster(machines.address)


@pytest.mark.thorough
def test_other_versions_and_other_files_are_refused(machines: Machines, tmp_path: Path) -> None:
    from distributed import Client

    from vve_sumo.sweep import remote

    other = tmp_path / "other"
    (other / "numpy-0.1.dist-info").mkdir(parents=True)
    (other / "numpy-0.1.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: numpy\nVersion: 0.1\n")
    machines.join()
    late = Cluster(machines.address)
    line = seeded("one", 1).to_json()
    with Client(machines.address, set_as_default=False) as client:
        site = remote.Site(decisive_versions(), {"network": "0" * 64}, "names")
        with pytest.raises(ConfigError, match=r"^worker tcp://\S+: the file of \w+ differs from the client's"):
            client.submit(remote.drive, line, site).result()
        elsewhere = seeded("one", 1)
        elsewhere = dataclasses.replace(elsewhere, table=elsewhere.table | {"road": {"network": "/none.net.xml"}})
        with pytest.raises(ConfigError, match=r"^worker tcp://\S+: .*road.network: .*expected the same files as"):
            client.submit(remote.drive, elsewhere.to_json(), site).result()
    machines.join(search=other)
    machines.wait_for(2)
    said = rf"mixed versions: worker tcp://\S+ has numpy 0\.1, here {decisive_versions()['numpy']}$"
    with pytest.raises(ConfigError, match=f"^{said}"):
        collected(late, [dataclasses.replace(seeded(str(n), n), table={}) for n in range(4)])
    with pytest.raises(ConfigError, match=f"^{said}"):
        Cluster(machines.address)
