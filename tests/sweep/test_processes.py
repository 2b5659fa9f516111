"""Runs of a sweep in processes of their own: right results, and each kind of end reported without hurting another."""

from __future__ import annotations

import dataclasses
import multiprocessing.util
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.isolated import isolated
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.sweep import process_tree
from vve_sumo.sweep.engine import Local
from vve_sumo.sweep.job import Job, RunResult
from vve_sumo.sweep.worker import Worker

REPOSITORY = Path(__file__).parent.parent.parent
ILL = Path(__file__).parent / "ill.py"
PATIENCE = 120.0  #: for what must happen at once on a machine that is not overloaded [s]


def table(illness: str = "none", note: Path = Path(os.devnull), **changes: Any) -> dict[str, Any]:
    """A drive of a second on the proving ground."""
    return {
        "title": "straight on",
        "duration_s": 1.0,
        "road": {"network": "proving_ground"},
        "ego": {
            "path": "proving_ground",
            "speed_mps": 8.0,
            "lot": {"latitude_deg": 40.0041, "longitude_deg": -83.0186, "heading_deg": 85.0},
        },
        "controller": {"name": f"{ILL}:make", "tuning": {"illness": illness, "note": str(note)}},
        "criteria": {"outcome": "stopped", "collision": False},
    } | changes


def job(key: str, illness: str = "none", note: Path = Path(os.devnull), **limits: Any) -> Job:
    return Job(key, "straight_on", table(illness, note), REPOSITORY / "straight_on.toml", REPOSITORY, **limits)


def seeded(key: str, seed: int, **limits: Any) -> Job:
    made = job(key, **limits)
    return dataclasses.replace(made, table=made.table | {"seed": seed})


def driven(*jobs: Job, workers: int = 1) -> dict[str, RunResult]:
    """What came of jobs, by key; each exactly once."""
    results: dict[str, RunResult] = {}

    def done(given: Job, result: RunResult) -> None:
        assert result.key == given.key
        assert given.key not in results
        results[given.key] = result

    Local(workers).run(iter(jobs), done)
    assert results.keys() == {one.key for one in jobs}
    return results


def in_process(one: Job, folder: Path) -> dict[str, Any]:
    """The summary of a job's drive without any of the sweep's processes; call it through `isolated`."""
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.scenario.load import parse

    resolved = resolve_scenario(one.name, parse(one.table, one.file), one.file, one.working)
    return drives.run(resolved, folder, one.working).summary


def eventually(condition: Callable[[], Any]) -> Any:
    """Return what a condition comes to, once it is true."""
    deadline = time.monotonic() + PATIENCE
    while not (value := condition()):
        assert time.monotonic() < deadline, "it never came about"
        time.sleep(0.01)
    return value


def alive(process: int) -> bool:
    """Whether a process is there and more than a zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def written(note: Path) -> int:
    """The process id in a file, once there is one."""
    return int(eventually(lambda: note.exists() and note.read_text()))


@pytest.fixture(autouse=True)
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A place for temporary files, in which no test may leave any."""
    place = tmp_path / "scratch"
    place.mkdir()
    multiprocessing.util.get_temp_dir()  # of tests/isolated.py, which keeps it as long as this process lives
    monkeypatch.setattr("tempfile.tempdir", str(place))
    yield place
    assert list(place.iterdir()) == []


@pytest.mark.thorough
def test_results_are_those_of_a_drive_in_a_process_of_its_own(tmp_path: Path) -> None:
    jobs = [seeded("five", 5), seeded("six", 6, keep=tmp_path / "kept"), seeded("five again", 5)]
    results = driven(*jobs, workers=2)
    for one in jobs[:2]:
        summary = isolated(in_process, one, tmp_path / one.key)
        figures = results[one.key].figures
        assert results[one.key].error == ""
        assert figures["record_sha256"] == summary["record_sha256"]
        assert figures["ticks"] == 50
        assert figures["stop_gap_m"] is None
        assert figures["meets_collision"] is True
        assert figures["meets_outcome"] is False
        assert figures["failed"] == "; ".join(summary["failed"])
        assert figures["max_speed_mps"] == summary["max_speed_mps"]
    assert results["five"].figures["record_sha256"] != results["six"].figures["record_sha256"]
    assert results["five"].figures == results["five again"].figures
    assert (tmp_path / "kept" / "ticks.parquet").is_file()
    assert [place.name for place in tmp_path.iterdir() if "part" in place.name] == []
    assert 20.0 < results["five"].peak_mb < 1000.0
    assert results["five"].cpu_s > 0.0


@pytest.mark.thorough
def test_each_end_has_its_reason_and_neighbours_are_right() -> None:
    results = driven(
        seeded("before", 5),
        job("segfault", "segfault"),
        job("hang", "hang", time_limit_s=2.0),
        job("leak", "leak", memory_limit_mb=600.0),
        job("leak elsewhere", "leak_elsewhere", memory_limit_mb=600.0, time_limit_s=PATIENCE),
        job("raises", "raises"),
        job("exits", "exits"),
        job("leaves", "leaves"),
        job("killed", "killed"),
        job("interrupts", "interrupts"),
        job("stillborn", "stillborn"),
        job("prints", "prints"),
        dataclasses.replace(job("bad"), table=table(after_stop_s=-1.0)),
        dataclasses.replace(job("unspeakable"), table=table(duration_s=float("nan"))),
        seeded("after", 5),
        workers=2,
    )
    errors = {key: result.error for key, result in results.items()}
    assert {key: error for key, error in errors.items() if not error.startswith("config: ")} == {
        "before": "",
        "segfault": "crashed: SIGSEGV",
        "hang": "timed_out",
        "leak": "memory",
        "leak elsewhere": "memory",
        "raises": "",
        "exits": "",
        "leaves": "exited: 3",
        "killed": "killed: SIGKILL",
        "interrupts": "interrupted",
        "prints": "",
        "after": "",
    }
    assert errors["bad"].startswith("config: straight_on.toml: after_stop_s: ")
    assert "duration_s" in errors["unspeakable"] or "finite" in errors["unspeakable"]
    assert "no such day" in errors["stillborn"]
    for key, text in (
        ("raises", "ZeroDivisionError: nothing left of <object object at 0x...>"),
        ("exits", "SystemExit: 3"),
    ):
        assert results[key].figures["reasons"] == "controller_raised"
        assert str(results[key].figures["text"]).startswith(text)
    assert "goodbye" in results["leaves"].said
    assert "ill.py" in results["segfault"].said
    assert results["before"].figures == results["after"].figures
    assert all(not result.figures for result in results.values() if result.error)


@pytest.mark.thorough
def test_a_kept_record_replaces_a_record_and_nothing_else(tmp_path: Path) -> None:
    kept, other = tmp_path / "kept", tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").touch()
    torn = job("torn", "segfault", keep=kept)
    evidence = dataclasses.replace(torn, key="evidence", keep=tmp_path / "evidence")
    results = driven(torn, seeded("whole", 5, keep=kept), seeded("other", 5, keep=other), evidence)
    assert results["whole"].error == ""
    assert (kept / "summary.json").is_file()
    assert results["other"].error == f"config: {other} is not empty, expected an empty or absent folder for the record"
    assert sorted(place.name for place in tmp_path.iterdir()) == ["evidence", "kept", "other", "scratch"]
    assert (tmp_path / "evidence" / "ticks.arrows").is_file()


def spoil(worker: Worker, note: Path) -> int:
    """Kill a worker's server once its run is under way, see the run die with it, and return which it was."""
    child, server = written(note), worker.pid
    note.unlink()
    os.kill(server, signal.SIGKILL)
    eventually(lambda: not alive(child))
    return server


@pytest.mark.thorough
def test_a_server_killed_from_outside_is_replaced(tmp_path: Path) -> None:
    note, worker = tmp_path / "note", Worker()
    try:
        worker.submit(job("stubborn", "hang", note))
        first = spoil(worker, note)
        assert eventually(lambda: worker.result() or worker.pid != first) is True
        spoil(worker, note)
        assert eventually(worker.result) == RunResult("stubborn", error="killed: SIGKILL")
        worker.submit(job("next", "begets", note))
        assert eventually(worker.result).error == ""
        assert not alive(int(note.read_text()))
        # A process that forks must have one thread, whatever numpy or Arrow would like.
        assert len(list(Path(f"/proc/{worker.pid}/task").iterdir())) == 1
    finally:
        worker.kill()


def test_a_server_that_does_not_start_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(SimulationError, match="ended at its start with code 1: no output"):
        driven(seeded("never", 5))


SCRIPT = """
import sys, tempfile
from pathlib import Path
from tests.sweep.test_processes import driven, job
tempfile.tempdir = sys.argv[1]
try:
    driven(job("hangs", "hang", Path(sys.argv[2])))
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_nothing_outlives_the_engine(number: signal.Signals, tmp_path: Path, scratch: Path) -> None:
    note = tmp_path / "note"
    command = [sys.executable, "-c", SCRIPT, str(scratch), str(note)]
    engine = subprocess.Popen(command, cwd=REPOSITORY, stderr=subprocess.PIPE)
    child = written(note)
    everyone = process_tree.descendants(engine.pid)
    assert child in everyone
    assert len(everyone) == 2
    engine.send_signal(number)
    assert engine.wait(PATIENCE) == (-signal.SIGKILL if number == signal.SIGKILL else 130)
    assert engine.stderr is not None
    assert engine.stderr.read() == b""
    eventually(lambda: not any(map(alive, everyone)) and list(scratch.iterdir()) == [])


@pytest.mark.thorough
def test_jobs_are_taken_as_they_are_needed() -> None:
    taken = []

    def endless() -> Iterator[Job]:
        for number in range(10**9):
            taken.append(number)
            made = job(str(number), "stillborn")
            yield dataclasses.replace(made, table=made.table | {"seed": number})

    def done(given: Job, result: RunResult) -> None:
        # One more is being driven, and the one behind it has been asked whether it begins alike.
        assert len(taken) <= int(given.key) + 3
        if given.key == "5":
            raise InterruptedError

    with pytest.raises(InterruptedError):
        Local(1).run(endless(), done)


@pytest.mark.thorough
def test_a_full_disk_ends_the_sweep(tmp_path: Path) -> None:
    kept = tmp_path / "records" / "kept"
    with pytest.raises(
        ConfigError, match=f"^no space left on the disk of {kept.parent}: free some space, then resume$"
    ):
        driven(job("fills", "fills", keep=kept), job("never"))


FIGURE = st.none() | st.booleans() | st.integers() | st.floats() | st.text()


@given(st.dictionaries(st.text(), FIGURE), st.text(), st.text())
def test_results_travel_as_one_line(figures: dict[str, Any], error: str, said: str) -> None:
    result = RunResult("key", figures, error, 1.5, 1.25, 180.0, said)
    line = result.to_json()
    assert "\n" not in line
    received = {name: None if isinstance(it, float) and it - it != 0.0 else it for name, it in figures.items()}
    assert RunResult.from_json(line) == dataclasses.replace(result, figures=received)


def test_lines_that_are_no_jobs_are_refused() -> None:
    made = job("key", keep=Path("/kept"))
    assert Job.from_json(made.to_json()) == made
    line = made.to_json()
    for wrong, message in (
        (line.replace('"version": 6', '"version": 1'), "expected version 6, got 1"),
        (line.replace('"name": "straight_on"', '"name": 3'), "name: expected a str, got 3"),
        (line.replace('"working"', '"walking"'), "expected the keys"),
        (line.replace("1.0", "NaN"), "NaN is no number"),
        (line[:-3], "expected a line of JSON"),
        ("[]", "expected version 6, got None"),
    ):
        with pytest.raises(ConfigError, match=message):
            Job.from_json(wrong)


def test_workers_are_one_or_more() -> None:
    with pytest.raises(ConfigError, match="workers: expected 1 or more, got 0"):
        Local(0)
