"""A sweep's folder: nothing finished is lost, whenever the process is killed, and the rows are the same bytes."""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.dataset
import pyarrow.parquet as pq
import pytest

from tests.isolated import isolated
from tests.sweep.reading import load_rows
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.record import sweep_folder
from vve_sumo.record.sweep_folder import MACHINE, Row, SweepPlan, SweepSnapshot
from vve_sumo.sweep.dataset import Dataset, refuse_mixed
from vve_sumo.sweep.job import RunResult
from vve_sumo.sweep.run_specs import RunSpec

COUNT, PER_PART = 5, 2
#: the order in which runs finish: the second part is whole before the first, and one is long in coming
ORDER = (2, 0, 3, 4, 1)

PLAN = SweepPlan(
    spec={"scenario": "s", "parameters": {"speed": [1.0, 2.0]}},
    scenario="s",
    table={"title": "t"},
    file="/nowhere/s.toml",
    working="/nowhere",
    cells=COUNT,
    parameters={"speed": "float", "kind": "str"},
    criteria=["stop_gap_m"],
    files_sha256={"network": ["0"]},
    versions={"vve-sumo": "1", "libsumo": "2"},
)


def cell(number: int) -> RunSpec:
    return RunSpec(number, f"{number:016x}", {"speed": 0.1 * number, "kind": "a"}, 1 + number)


def result(number: int) -> RunResult:
    if number == 3:
        return RunResult(cell(number).key, error="crashed: SIGSEGV", said="…")
    figures = {"outcome": "stopped", "passed": number % 2 == 0, "stop_gap_m": 5.0 / (1 + number), "min_ttc_s": None}
    return RunResult(cell(number).key, {**figures, "ticks": number, "record_sha256": f"{number}"}, wall_s=1.5)


def begun(folder: Path, **changes: Any) -> Dataset:
    return Dataset(folder, replace(PLAN, **changes), resume=True, rows_per_part=PER_PART)


def fill(folder: Path, finished: Callable[[int], None] = lambda number: None, most: int = COUNT) -> Dataset:
    dataset = begun(folder)
    for number in ORDER[:most]:
        if not dataset.holds(number):
            dataset.add(cell(number), result(number))
            finished(number)
    return dataset


def content(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


SYSTEM_CALLS = {
    os.open, os.write, os.fsync, os.fdatasync, os.replace, os.rename, os.unlink, os.close, os.mkdir, os.ftruncate
}  # fmt: skip


#: fills or changes a folder; calls what it is passed with the number of every run that is finished from then on
Work = Callable[[Path, Callable[[int], None]], None]


def _filled(folder: Path, finished: Callable[[int], None]) -> None:
    fill(folder, finished).close()


def _killed_at(folder: Path, instant: int, pipe: int, work: Work) -> None:
    """Work on a folder, and be killed at one instant: before one of the calls that touch the disk."""
    left = instant

    def look(_frame: object, event: str, called: object) -> None:
        nonlocal left
        if event == "c_call" and called in SYSTEM_CALLS:
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    def finished(number: int) -> None:
        sys.setprofile(None)
        os.write(pipe, bytes([number]))
        sys.setprofile(look)

    sys.setprofile(look)
    work(folder, finished)
    sys.setprofile(None)


def _forked(folder: Path, instant: int, work: Work = _filled) -> tuple[bool, set[int]]:
    """Return whether the child was killed, and the numbers of the runs that it reported as finished."""
    here, there = os.pipe()
    child = os.fork()
    if child == 0:
        _killed_at(folder, instant, there, work)
        os._exit(0)
    os.close(there)
    with os.fdopen(here, "rb") as pipe:
        finished = set(pipe.read())
    _pid, status = os.waitpid(child, 0)
    assert status in (0, signal.SIGKILL)
    return status != 0, finished


def _every_instant() -> int:
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None  # where nothing waits for a disk
    with tempfile.TemporaryDirectory(dir=memory) as scratch:
        return _killed_at_each(Path(scratch))


def _killed_at_each(scratch: Path) -> int:
    fill(scratch / "whole").close()
    whole = content(scratch / "whole")
    for instant in range(1, 1000):
        folder = scratch / str(instant)
        killed, finished = _forked(folder, instant)
        if killed and (folder / "sweep.json").exists():
            assert finished <= set(load_rows(folder)["number"]), f"instant {instant}"
        dataset = begun(folder)
        assert all(map(dataset.holds, finished)), f"instant {instant}: a finished run is lost"
        dataset.close()
        fill(folder).close()
        assert content(folder) == whole, f"instant {instant}"
        if not killed:
            return instant
    raise AssertionError("it never came to an end")


@pytest.mark.thorough
def test_a_kill_at_any_instant_loses_nothing_and_the_bytes_are_the_same() -> None:
    """Brute force: before every call that touches the disk a process is really killed."""
    assert isolated(_every_instant) > 80


#: a suite whose last part has room for the run of one more seed, and the same with it
SUITE = replace(PLAN, design="suite", spec={"suite": "s", "seeds": COUNT})
GROWN = replace(SUITE, spec={"suite": "s", "seeds": COUNT + 1}, cells=COUNT + 1)


def _changed(folder: Path, finished: Callable[[int], None]) -> None:
    """Add the run of another seed, and judge one in a sealed part anew."""
    anew = [{"number": 1, "passed": True, "outcome": "judged anew"}]
    dataset = Dataset(folder, GROWN, resume=True, hold=lambda _rows: anew, rows_per_part=PER_PART)
    if not dataset.holds(COUNT):
        dataset.add(cell(COUNT), result(COUNT))
        finished(COUNT)
    dataset.close()


def _killed_at_each_change(scratch: Path) -> int:
    def begun_suite(folder: Path) -> Path:
        dataset = Dataset(folder, SUITE, resume=False, rows_per_part=PER_PART)
        for number in range(COUNT):
            dataset.add(cell(number), result(number))
        dataset.close()
        return folder

    _changed(begun_suite(scratch / "whole"), lambda number: None)
    whole = content(scratch / "whole")
    assert load_rows(scratch / "whole")["outcome"][1] == "judged anew"
    for instant in range(1, 1000):
        folder = begun_suite(scratch / str(instant))
        killed, finished = _forked(folder, instant, _changed)
        assert {*range(COUNT), *finished} <= set(load_rows(folder)["number"]), f"instant {instant}"
        _changed(folder, lambda number: None)
        assert content(folder) == whole, f"instant {instant}"
        if not killed:
            return instant
    raise AssertionError("it never came to an end")


def _every_instant_of_a_change() -> int:
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(dir=memory) as scratch:
        return _killed_at_each_change(Path(scratch))


@pytest.mark.thorough
def test_a_kill_while_runs_are_added_or_judged_anew_loses_nothing() -> None:
    assert isolated(_every_instant_of_a_change) > 40


def _interrupted_at(dataset: Dataset, instant: int) -> bool:
    """Finish every run, and be interrupted at one instant: before or after a call that touches the disk."""
    left = instant

    def look(_frame: object, event: str, called: object) -> None:
        nonlocal left
        if event in ("c_call", "c_return") and called in SYSTEM_CALLS:
            left -= 1
            if left == 0:
                signal.raise_signal(signal.SIGINT)

    try:
        sys.setprofile(look)
        for number in ORDER:
            dataset.add(cell(number), result(number))
    except KeyboardInterrupt:
        return True
    finally:
        sys.setprofile(None)
    return False


def _interrupted_at_each(scratch: Path) -> int:
    fill(scratch / "whole").close()
    for instant in range(1, 1000):
        folder = scratch / str(instant)
        dataset = begun(folder)
        interrupted = _interrupted_at(dataset, instant)
        rows = set(load_rows(folder)["number"])
        assert (dataset.finished, set(filter(dataset.holds, range(COUNT)))) == (len(rows), rows), f"instant {instant}"
        dataset.close()
        fill(folder).close()
        assert content(folder) == content(scratch / "whole"), f"instant {instant}"
        if not interrupted:
            return instant
    raise AssertionError("it never came to an end")


@pytest.mark.slow
def test_what_counts_as_finished_is_what_the_folder_holds_whenever_it_is_interrupted(tmp_path: Path) -> None:
    assert isolated(_interrupted_at_each, tmp_path) > 80


def test_rows_come_back_in_cell_order(tmp_path: Path) -> None:
    fill(tmp_path / "a").close()
    rows = load_rows(tmp_path / "a")
    assert list(rows["number"]) == list(range(COUNT))
    assert list(rows["speed"]) == [0.1 * number for number in range(COUNT)]
    assert list(rows["seed"]) == [1 + number for number in range(COUNT)]
    assert rows["error"][3] == "crashed: SIGSEGV"
    assert rows["passed"].isna().tolist() == [number == 3 for number in range(COUNT)]
    table = pyarrow.dataset.dataset(tmp_path / "a" / "rows").to_table()
    assert table.num_rows == COUNT
    assert table.schema.names == list(PLAN.columns())
    machine = pyarrow.dataset.dataset(tmp_path / "a" / "machine").to_table()
    assert machine.schema.names == list(MACHINE)
    assert not (tmp_path / "a" / "journal.jsonl").exists()


def test_an_unfinished_sweep_can_be_read(tmp_path: Path) -> None:
    dataset = fill(tmp_path / "a", most=3)  # 2, 0, 3: the second part is sealed
    assert list(load_rows(tmp_path / "a")["number"]) == [0, 2, 3]
    assert [file.name for file in (tmp_path / "a" / "rows").glob("*")] == ["part-00001.parquet"]
    assert dataset.finished == 3
    dataset.close()
    assert (tmp_path / "a" / "journal.jsonl").read_text(encoding="utf-8").count("\n") == 1


@pytest.mark.parametrize("torn", [b"{", b'{"number":1,"key":"x"}', b"\0\0\0\0"])
def test_a_torn_last_line_is_dropped(tmp_path: Path, torn: bytes) -> None:
    fill(tmp_path / "a", most=2).close()
    with (tmp_path / "a" / "journal.jsonl").open("ab") as journal:
        journal.write(torn)
    dataset = begun(tmp_path / "a")
    assert (dataset.finished, dataset.holds(1)) == (2, False)
    dataset.close()
    fill(tmp_path / "a").close()
    fill(tmp_path / "whole").close()
    assert content(tmp_path / "a") == content(tmp_path / "whole")


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    fill(tmp_path / "a", most=2).close()
    journal = tmp_path / "a" / "journal.jsonl"
    journal.write_bytes(b"what\n" + journal.read_bytes())
    with pytest.raises(ConfigError, match=r"journal\.jsonl: line 1 is no finished run"):
        begun(tmp_path / "a")


def test_no_run_counts_twice(tmp_path: Path) -> None:
    dataset = fill(tmp_path / "a", most=3)
    for number in (0, 2):  # in the journal, in a part
        with pytest.raises(ValueError, match="finished already"):
            dataset.add(cell(number), result(number))
    dataset.close()


def test_one_sweep_at_a_time(tmp_path: Path) -> None:
    dataset = fill(tmp_path / "a", most=2)
    with pytest.raises(ConfigError, match="another process is driving"):
        begun(tmp_path / "a")
    dataset.close()
    begun(tmp_path / "a").close()


OTHERS: dict[str, dict[str, Any]] = {
    "its parameters differs": {"spec": PLAN.spec | {"parameters": {"speed": [1.0]}}},
    "its seeds differs": {"spec": PLAN.spec | {"seeds": 2}},
    "scenario s has changed": {"table": {"title": "u"}},
    "file of network has changed": {"files_sha256": {"network": ["1"]}},
    "mixed versions: its rows are of libsumo 2, got 3": {"versions": {"vve-sumo": "1", "libsumo": "3"}},
    "its columns or its number of runs differ": {"cells": 6},
}


@pytest.mark.parametrize("why", OTHERS)
def test_the_folder_of_another_sweep_is_refused(tmp_path: Path, why: str) -> None:
    fill(tmp_path / "a", most=2).close()
    before = content(tmp_path / "a")
    with pytest.raises(ConfigError, match=why) as found:
        begun(tmp_path / "a", **OTHERS[why])
    assert "\n" not in str(found.value)
    assert content(tmp_path / "a") == before


def test_a_title_and_what_is_kept_may_change(tmp_path: Path) -> None:
    fill(tmp_path / "a", most=2).close()
    begun(tmp_path / "a", spec=PLAN.spec | {"title": "x", "keep": "all"}, working="/elsewhere").close()


def test_going_on_has_to_be_asked_for(tmp_path: Path) -> None:
    fill(tmp_path / "a", most=2).close()
    with pytest.raises(ConfigError, match="--resume continues"):
        Dataset(tmp_path / "a", PLAN, resume=False)


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("x", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"something else \(thesis\.tex\)"):
        begun(tmp_path)
    with pytest.raises(ConfigError, match="is a file"):
        begun(tmp_path / "thesis.tex")
    assert list(content(tmp_path)) == ["thesis.tex"]


def test_another_layout_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sweep.json").write_text(json.dumps({"version": 0}), encoding="utf-8")
    with pytest.raises(ConfigError, match="another vve-sumo wrote it"):
        SweepPlan.of(tmp_path)
    (tmp_path / "sweep.json").write_text("[", encoding="utf-8")
    with pytest.raises(ConfigError, match="not what a sweep writes"):
        SweepPlan.of(tmp_path)
    with pytest.raises(ConfigError, match="not a sweep's folder"):
        load_rows(tmp_path / "absent")


def test_versions_that_came_or_went_are_mixed(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="scipy none, got 1"):
        refuse_mixed(tmp_path, PLAN.versions, PLAN.versions | {"scipy": "1"})


def _until_full(folder: Path) -> str:
    """Fill a folder whose files cannot grow beyond a limit; say what stopped it."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    dataset = begun(folder)
    dataset.add(cell(0), result(0))
    room = (folder / "journal.jsonl").stat().st_size + 40
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))
    try:
        dataset.add(cell(1), result(1))
    except SimulationError as error:
        assert dataset.finished == 1
        assert not dataset.holds(1)
        return str(error)
    return "nothing"


@pytest.mark.thorough
def test_a_full_disk_is_one_line_and_the_sweep_goes_on_later(tmp_path: Path) -> None:
    said = isolated(_until_full, tmp_path / "a")
    assert "cannot be written" in said
    assert "--resume" in said
    assert "\n" not in said
    assert list(load_rows(tmp_path / "a")["number"]) == [0]
    fill(tmp_path / "a").close()
    fill(tmp_path / "whole").close()
    assert content(tmp_path / "a") == content(tmp_path / "whole")


def test_a_deleted_part_that_a_crash_of_the_machine_brings_back_hides_no_newer_row(tmp_path: Path) -> None:
    """As where the journal was on the disk before the deletion of the part."""
    dataset = Dataset(tmp_path, SUITE, resume=False, rows_per_part=4)
    for number in range(COUNT):
        dataset.add(cell(number), result(number))
    dataset.close()
    last = [tmp_path / place / f"part-{COUNT // 4:05d}.parquet" for place in ("rows", "machine")]
    deleted = [part.read_bytes() for part in last]
    bigger = replace(SUITE, spec={"suite": "s", "seeds": COUNT + 2}, cells=COUNT + 2)
    anew = [{"number": COUNT - 1, "passed": True, "outcome": "judged anew"}]
    dataset = Dataset(tmp_path, bigger, resume=True, hold=lambda _rows: anew, rows_per_part=4)
    dataset.add(cell(COUNT), result(COUNT))
    dataset.close()
    assert not any(part.exists() for part in last)
    for part, data in zip(last, deleted, strict=True):
        part.write_bytes(data)

    seen: list[str] = []

    def look(rows: Iterator[Row]) -> list[Row]:
        seen.extend(row["outcome"] for row in rows)
        return []

    dataset = Dataset(tmp_path, bigger, resume=True, hold=look, rows_per_part=4)
    assert (dataset.finished, seen[COUNT - 1]) == (COUNT + 1, "judged anew")
    dataset.close()
    rows = load_rows(tmp_path)
    assert rows["number"].tolist() == list(range(COUNT + 1))
    assert rows["outcome"][COUNT - 1] == "judged anew"


def test_what_a_design_refuses_of_finished_runs_leaves_the_folder_as_it_was(tmp_path: Path) -> None:
    dataset = Dataset(tmp_path, SUITE, resume=False, rows_per_part=PER_PART)
    dataset.add(cell(0), result(0))
    dataset.close()
    before = content(tmp_path)

    def refuse(rows: Iterator[Row]) -> list[Row]:
        raise ConfigError(f"{len(list(rows))} row")

    with pytest.raises(ConfigError, match=r"^1 row$"):
        Dataset(tmp_path, GROWN, resume=True, hold=refuse, rows_per_part=PER_PART)
    assert content(tmp_path) == before
    begun_again = Dataset(tmp_path, SUITE, resume=True, rows_per_part=PER_PART)  # the folder is not locked
    begun_again.close()


def test_a_reader_that_comes_while_rows_move_back_into_the_journal_misses_none(tmp_path: Path) -> None:
    fill(tmp_path).close()
    held = sweep_folder.journal

    def moved(folder: Path) -> list[Row]:
        """Return the journal of before; then, once, the first part's rows go into it and the part is deleted."""
        noted = held(folder)
        part = folder / "rows" / "part-00000.parquet"
        if part.exists():
            rows = [row | {"wall_s": 0.0} for row in pq.read_table(part).to_pylist()]
            (folder / "journal.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
            part.unlink()
        return noted

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweep_folder, "journal", moved)
        assert SweepSnapshot.of(tmp_path).finished == COUNT
