"""Runs of a sweep that are driven as one until they differ: their rows are those of runs driven alone."""

from __future__ import annotations

import copy
import dataclasses
import os
import signal
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.isolated import isolated
from tests.sweep.test_processes import REPOSITORY, driven, in_process, job, seeded, table
from vve_sumo.sweep.engine import JobQueue
from vve_sumo.sweep.job import Job
from vve_sumo.sweep.shared_prefix import MAX_JOBS, shared_key
from vve_sumo.sweep.worker import Worker

CUT_IN = REPOSITORY / "scenarios" / "cut_in.toml"


def cut_in(key: str, **changes: Any) -> Job:
    """The scenario of that name, with some of its actor's settings changed."""
    scenario = tomllib.loads(CUT_IN.read_text(encoding="utf-8"))
    scenario["actors"][0] |= changes
    return Job(key, "cut_in", scenario, CUT_IN, REPOSITORY)


def _with(**changes: Any) -> Job:
    return Job("key", "straight_on", table(**changes), REPOSITORY / "straight_on.toml", REPOSITORY)


CRITERIA = {"met": {"collision": False}, "missed": {"outcome": "stopped"}}  #: of a drive that its duration ends
WALKER = {"id": "walker", "kind": "pedestrian", "at_m": 50.0, "speed_mps": 1.0}


@pytest.mark.parametrize(
    ("other", "shares"),
    [
        (_with(controller={"name": "follow_and_stop", "tuning": {"gap_m": 6.0}}), True),
        (_with(criteria={"outcome": "arrived"}), True),
        (_with(actors=[WALKER | {"speed_mps": 2.0, "kind": "child"}]), True),
        (_with(actors=[WALKER | {"id": "runner"}]), False),
        (_with(actors=[]), False),
        (_with(duration_s=2.0), False),
        (_with(seed=7), False),
        (_with(sensors=[{"name": "front", "kind": "camera"}]), False),
        (dataclasses.replace(_with(), time_limit_s=5.0), False),
        (dataclasses.replace(_with(), rig=Path("/rig.toml")), False),
    ],
)
def test_what_runs_may_differ_in_to_be_driven_as_one(other: Job, shares: bool) -> None:
    one = _with() if not other.table.get("actors") else _with(actors=[WALKER])
    if other.table.get("actors") == []:
        one = _with(actors=[WALKER])
    assert (shared_key(one) == shared_key(other)) is shares


@pytest.mark.parametrize(
    "alone", [{"keep": Path("/kept")}, {"pose": Path("/pose.ncom")}, {"driver": "a:b"}, {"progress": True}]
)
def test_some_runs_are_driven_alone(alone: dict[str, Any]) -> None:
    assert shared_key(dataclasses.replace(_with(), **alone)) is None
    assert shared_key(_with(actors=["not a table"])) is None


@pytest.mark.thorough
def test_rows_are_those_of_runs_driven_alone(tmp_path: Path) -> None:
    gaps = [12.0, 14.0, 14.0, 16.0, 30.0]
    runs = [cut_in(str(number), ahead_m=gap) for number, gap in enumerate(gaps)]
    tuned = [copy.deepcopy(runs[0]) for _ in range(2)]
    for one, headway in zip(tuned, (1.0, 2.5), strict=True):
        one.table["controller"] = {"name": "follow_and_stop", "tuning": {"time_headway_s": headway}}
    runs += [dataclasses.replace(one, key=f"tuned {number}") for number, one in enumerate(tuned)]
    results = driven(*runs)
    for one in runs:
        assert results[one.key].error == ""
        # The actor enters at 100 m, which the car reaches some ten seconds after it drove off.
        assert results[one.key].shared_s > 5.0
        alone = isolated(in_process, one, tmp_path / one.key)
        assert results[one.key].figures["record_sha256"] == alone["record_sha256"]
        assert results[one.key].figures["min_gap_m"] == alone["min_gap_m"]
        assert results[one.key].figures["passed"] == alone["passed"]
    assert results["1"].figures == results["2"].figures
    assert len({result.figures["record_sha256"] for result in results.values()}) == len(runs) - 1
    assert all(result.cpu_s > 0.0 and result.wall_s > 0.0 and result.peak_mb > 10.0 for result in results.values())


def test_what_drives_as_one_to_the_end_is_one_drive() -> None:
    well, ill = (dataclasses.replace(job(key), table=table(criteria=criteria)) for key, criteria in CRITERIA.items())
    results = driven(well, ill)
    assert [results[one.key].figures["passed"] for one in (well, ill)] == [True, False]
    assert results["met"].cpu_s == results["missed"].cpu_s
    assert results["met"].shared_s == results["missed"].shared_s == pytest.approx(0.98)


def test_an_illness_costs_its_own_run(tmp_path: Path) -> None:
    ills = ("none", "segfault", "leaves", "killed", "raises")
    runs = [job(ill, ill, tmp_path / "note") for ill in ills]
    assert len({shared_key(one) for one in runs}) == 1
    results = driven(*runs)
    errors = [results[ill].error for ill in ills]
    assert errors == ["", "crashed: SIGSEGV", "exited: 3", "killed: SIGKILL", ""]
    assert results["raises"].figures["reasons"] != results["none"].figures["reasons"]
    assert results["leaves"].said == "goodbye"


@pytest.mark.thorough
def test_a_run_that_hangs_does_not_take_the_others_with_it(tmp_path: Path) -> None:
    runs = [job(ill, ill, tmp_path / "note", time_limit_s=4.0) for ill in ("hang", "none")]
    results = driven(*runs)
    assert [results[one.key].error for one in runs] == ["timed_out", ""]


@pytest.mark.parametrize(
    ("keys", "workers", "expected"),
    [
        ("aaaa", 1, ["aaaa"]),
        ("aaaa", 2, ["aa", "aa"]),
        ("aaab", 2, ["aa", "a", "b"]),
        ("abab", 1, ["a", "b", "a", "b"]),
        ("a" * (MAX_JOBS + 1), 1, ["a" * MAX_JOBS, "a"]),
        ("--aa", 1, ["-", "-", "aa"]),
        ("", 1, []),
    ],
)
def test_workers_get_their_share_of_what_is_driven_as_one(keys: str, workers: int, expected: list[str]) -> None:
    def one(number: int, kind: str) -> Job:
        made = seeded(f"{kind}{number}", ord(kind))
        return made if kind != "-" else dataclasses.replace(made, keep=Path("/kept"))

    queue, taken = JobQueue((one(*each) for each in enumerate(keys)), workers), []
    while jobs := queue.take():
        taken.append("".join(job.key[0] for job in jobs))
    assert taken == expected


def test_a_job_that_waits_for_another_ends_what_is_taken_now() -> None:
    queue = JobQueue(iter([seeded("a", 1), None, seeded("b", 1)]), 1)
    assert [[job.key for job in queue.take()] for _ in range(3)] == [["a"], ["b"], []]


@pytest.mark.thorough
def test_jobs_whose_server_died_are_driven_alone(tmp_path: Path) -> None:
    note, worker, results = tmp_path / "note", Worker(), {}
    try:
        worker.submit(job("none"), job("hang", "hang", note))
        while worker.busy:
            if note.exists() and note.read_text():
                note.unlink()
                os.kill(worker.pid, signal.SIGKILL)
            if (result := worker.result()) is not None:
                results[result.key] = result.error
            time.sleep(0.01)
    finally:
        worker.kill()
    assert results == {"none": "", "hang": "killed: SIGKILL"}
