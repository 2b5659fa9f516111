"""Runs on a road that a sweep's server has loaded once: the same as in processes of their own, and as isolated."""

from __future__ import annotations

import dataclasses
import os
import shutil
import signal
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.isolated import isolated
from tests.sweep.test_processes import REPOSITORY, alive, driven, eventually, in_process, job, seeded, written
from vve_sumo.sweep import process_tree
from vve_sumo.sweep.job import Job, RunResult
from vve_sumo.sweep.worker import Worker

SECONDS = 3.0  #: of a drive, in which the car engages and sets off
SCENARIO = REPOSITORY / "scenarios" / "parked_car.toml"


def in_town(key: str, seed: int, file: Path = SCENARIO, **road: Any) -> Job:
    """A short drive among the traffic of a town."""
    table = tomllib.loads(SCENARIO.read_text(encoding="utf-8")) | {"duration_s": SECONDS, "seed": seed}
    return Job(key, "in_town", table | {"road": table["road"] | road}, file, REPOSITORY)


@pytest.fixture
def worker() -> Iterator[Worker]:
    """A server's handle; nothing of it outlives the test."""
    made = Worker()
    yield made
    everyone = process_tree.descendants(made.pid)
    made.kill()
    eventually(lambda: not any(map(alive, everyone)))


def result_of(worker: Worker, one: Job) -> RunResult:
    """What comes of a job."""
    worker.submit(one)
    return eventually(worker.result)


def proxies(worker: Worker) -> list[int]:
    """The processes that stand in for a server while nothing is driven."""
    return process_tree.descendants(worker.pid)


@pytest.mark.thorough
def test_runs_on_a_shared_road_are_those_of_processes_of_their_own(tmp_path: Path, worker: Worker) -> None:
    # Of each seed two, one after the other and with others between; the last ones with other traffic.
    runs = [in_town(f"{number}", seed) for number, seed in enumerate((1, 1, 2, 2, 1))]
    runs.append(in_town("light", 1, demand=["linden_light"]))
    runs.append(in_town("light again", 1, demand=["linden_light"]))
    runs.append(dataclasses.replace(in_town("kept", 2), keep=tmp_path / "kept"))
    results = {one.key: result_of(worker, one) for one in runs}
    assert len(proxies(worker)) == 1
    for one in (runs[0], runs[2], runs[5]):
        summary = isolated(in_process, one, tmp_path / one.key)
        assert results[one.key].figures["record_sha256"] == summary["record_sha256"]
    same = [["0", "1", "4"], ["2", "3", "kept"], ["light", "light again"]]
    assert all(results[key].figures == results[first].figures for first, *others in same for key in others)
    hashes = {results[first].figures["record_sha256"] for first, *_others in same}
    assert len(hashes) == 3
    assert (tmp_path / "kept" / "ticks.parquet").is_file()


@pytest.mark.thorough
def test_a_road_that_changed_is_loaded_anew(tmp_path: Path, worker: Worker) -> None:
    demand = tmp_path / "cars.rou.xml"
    shutil.copy(REPOSITORY / "routes" / "linden_light.rou.xml", demand)
    runs = [in_town(name, 1, demand=[str(demand)]) for name in ("first", "second", "third")]
    before = [result_of(worker, one).figures["record_sha256"] for one in runs[:2]]
    shutil.copy(REPOSITORY / "routes" / "linden_moderate.rou.xml", demand)
    after = [result_of(worker, one).figures["record_sha256"] for one in (runs[2], runs[0])]
    assert before[0] == before[1] != after[0] == after[1]
    assert after[0] == isolated(in_process, runs[2], tmp_path / "alone")["record_sha256"]
    demand.unlink()
    assert result_of(worker, runs[0]).error.startswith("config: ")


@pytest.mark.thorough
def test_where_sumo_writes_every_run_starts_its_own(tmp_path: Path, worker: Worker) -> None:
    loops, out = tmp_path / "loops.add.xml", tmp_path / "out.xml"
    loops.write_text(f'<additional><edgeData id="all" file="{out}" excludeEmpty="true"/></additional>')
    runs = [in_town(str(number), 1, demand=["linden_light", str(loops)]) for number in range(3)]
    for one in runs:
        out.unlink(missing_ok=True)
        assert result_of(worker, one).error == ""
        assert out.read_text().rstrip().endswith("</meandata>")
    assert proxies(worker) == []


@pytest.mark.thorough
def test_a_crash_on_a_shared_road_costs_its_own_run() -> None:
    ills = ("segfault", "leaves", "killed", "interrupts")
    well = [seeded(str(number), 5) for number in range(2 * len(ills) + 1)]
    mixed = [one for pair in zip(well[1:], map(job, ills, ills), strict=False) for one in pair]
    results = driven(*well[:1], *mixed, *well[len(ills) + 1 :])
    errors = [results[ill].error for ill in ills]
    assert errors == ["crashed: SIGSEGV", "exited: 3", "killed: SIGKILL", "interrupted"]
    assert all(results[one.key].figures == results["0"].figures for one in well)


def test_what_a_run_on_a_shared_road_leaves_behind_ends(tmp_path: Path, worker: Worker) -> None:
    note = tmp_path / "note"
    for key in ("first", "second"):
        assert result_of(worker, job(key)).error == ""
    assert result_of(worker, job("begets", "begets", note)).error == ""
    assert not alive(int(note.read_text()))
    [stand_in] = proxies(worker)
    # A process that forks must have one thread, whatever SUMO would like.
    assert len(list(Path(f"/proc/{stand_in}/task").iterdir())) == 1


@pytest.mark.thorough
def test_a_killed_stand_in_takes_the_server_with_it_and_the_run_is_driven_again(tmp_path: Path, worker: Worker) -> None:
    note = tmp_path / "note"
    for key in ("first", "second"):
        assert result_of(worker, job(key)).error == ""
    worker.submit(job("hangs", "hang", note))
    run, server = written(note), worker.pid
    [stand_in] = [one for one in proxies(worker) if one != run]
    note.unlink()
    os.kill(stand_in, signal.SIGKILL)
    eventually(lambda: not any(map(alive, (run, stand_in, server))))
    assert eventually(lambda: worker.result() or worker.pid != server) is True
    assert alive(written(note))
