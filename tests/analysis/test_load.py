"""A folder is loaded as what it holds; one that holds anything else is one line; a killed drive is read to its end."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.conftest import REPOSITORY
from tests.killed import killed_at
from tests.record.declared import TABLES
from tests.sweep.test_dataset import PLAN, begun, cell, fill, result
from vve_sumo.analysis import Run, Sweep, load
from vve_sumo.errors import ConfigError
from vve_sumo.record.layout import SCHEMAS
from vve_sumo.record.reader import read_table


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The record of `vve-sumo drive`, killed when some seconds of it were on the disk."""
    folder = tmp_path_factory.mktemp("killed") / "record"
    drive = [sys.executable, "-m", "vve_sumo.cli", "drive", "cut_in", "--out", str(folder), "--quiet"]
    killed_at(drive, folder / "sensor_radar.arrows", 30_000)
    return folder


def run_of(folder: Path) -> Run:
    run = load(folder)
    assert isinstance(run, Run)
    return run


@pytest.mark.thorough
def test_a_killed_drive_is_read_to_its_last_tick(killed: Path) -> None:
    run = run_of(killed)
    assert not run.complete
    assert list(run.ticks["tick"]) == list(range(len(run.ticks)))
    assert len(run.ticks) >= read_table(killed, "ticks").num_rows - 10
    assert len(run.lead.gap) == len(run.motion.x) == len(run.ticks)
    assert run.ticks.attrs["units"]["speed_mps"] == "m/s"
    with pytest.raises(ConfigError, match="no table 'nix' in a record; there are ticks"):
        run.table("nix")


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("table", "share"), [("ticks", 0.6), ("actors", 0.5), ("sensor_radar", 0.7), ("readings", 0.8), ("actors", 0.93)]
)
def test_tables_that_end_at_different_ticks_are_cut_to_the_last_whole_one(
    killed: Path, table: str, share: float, tmp_path: Path
) -> None:
    """Brute force: the last tick up to which every table still holds the rows that it held before it was torn."""
    shutil.copytree(killed, tmp_path / "torn")
    torn = tmp_path / "torn" / f"{table}.arrows"
    os.truncate(torn, int(share * torn.stat().st_size))
    before, after = (Counter(rows_of(folder)) for folder in (killed, tmp_path / "torn"))
    last = min(tick for _name, tick in before - after) - 1
    run = run_of(tmp_path / "torn")
    assert 0 < max(run.ticks["tick"]) == last < max(run_of(killed).ticks["tick"])
    assert max(run.actors["tick"]) <= last
    assert max(run.detections["tick"]) <= last


def rows_of(folder: Path) -> list[tuple[str, int]]:
    return [(name, tick) for name in TABLES for tick in read_table(folder, name)["tick"].to_pylist()]


def recorded(killed: Path, folder: Path) -> Path:
    """A record whose tables were finished."""
    shutil.copytree(killed, folder)
    for name in TABLES:
        table = read_table(folder, name)
        (folder / f"{name}.arrows").unlink()
        pq.write_table(table, folder / f"{name}.parquet")
    return folder


def swept(folder: Path) -> Path:
    fill(folder).close()
    return folder


def truncated(name: str) -> Callable[[Path], None]:
    return lambda folder: os.truncate(folder / name, (folder / name).stat().st_size // 2)


def without(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def holding(name: str, content: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_text(content, encoding="utf-8") and None


def changed(name: str, **keys: object) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        reported = json.loads((folder / name).read_text(encoding="utf-8"))
        (folder / name).write_text(json.dumps(reported | keys), encoding="utf-8")

    return change


def foreign(name: str) -> Callable[[Path], None]:
    return lambda folder: pq.write_table(pa.table({"tick": [1], "a": [2]}), folder / name)


def emptied(name: str) -> Callable[[Path], None]:
    return lambda folder: pq.write_table(SCHEMAS["ticks"].empty_table(), folder / name)


RECORDS: list[tuple[Callable[[Path], None], str]] = [
    (truncated("scenario.json"), r"scenario\.json: not what a drive writes"),
    (holding("scenario.json", "[]"), r"scenario\.json: not what a drive writes"),
    (
        changed("scenario.json", layout=1),
        r"scenario\.json: layout 1 of a record, expected 7 or 8 or 9 or 10: another vve-sumo",
    ),
    (holding("summary.json", "{}"), r"summary\.json: not what a drive writes"),
    (holding("summary.json", "{"), r"summary\.json: not what a drive writes"),
    (truncated("ticks.parquet"), r"ticks\.parquet: cannot be read"),
    (foreign("ticks.parquet"), "table ticks has no column time_s: another vve-sumo wrote it"),
    (emptied("ticks.parquet"), "holds no tick"),
    (without("ticks.parquet"), r"no ticks\.parquet and no ticks\.arrows"),
    (truncated("actors.parquet"), r"actors\.parquet: cannot be read"),
    (without("scenario.json"), r"tables without their scenario\.json"),
]


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(("harm", "said"), RECORDS)
def test_a_record_that_is_none_is_one_line(
    killed: Path, tmp_path: Path, harm: Callable[[Path], None], said: str
) -> None:
    folder = recorded(killed, tmp_path / "record")
    assert len(run_of(folder).ticks) > 0
    harm(folder)
    refused(folder, said)


def of_another_sweep(folder: Path) -> None:
    shutil.copy(folder / "rows" / "part-00000.parquet", folder / "rows" / "part-00009.parquet")


def with_a_gap(folder: Path) -> None:
    file = folder / "rows" / "part-00001.parquet"
    table = pq.read_table(file)
    pq.write_table(pa.concat_tables([table.slice(0, 1), table.slice(0, 1)]), file)


def wider(folder: Path) -> None:
    file = folder / "rows" / "part-00001.parquet"
    table = pq.read_table(file)
    pq.write_table(table.append_column("more", pa.array([1] * table.num_rows)), file)


SWEEPS: list[tuple[Callable[[Path], None], str]] = [
    (truncated("sweep.json"), r"sweep\.json: not what a sweep writes"),
    (holding("sweep.json", "[]"), r"sweep\.json: not what a sweep writes"),
    (holding("sweep.json", '{"version": 4}'), r"sweep\.json: not what a sweep writes: expected a dict as its spec"),
    (changed("sweep.json", parameters={"speed": "complex"}), r"sweep\.json: not what a sweep writes: got speed: compl"),
    (
        changed("sweep.json", version=1),
        r"layout 1 of a dataset, expected 4: another vve-sumo wrote it, version 1; a",
    ),
    (truncated("rows/part-00001.parquet"), r"part-00001\.parquet: cannot be read"),
    (foreign("rows/part-00001.parquet"), r"part-00001\.parquet: its columns .* from number on"),
    (wider, r"part-00001\.parquet: its columns .* from more on"),
    (of_another_sweep, r"part-00009\.parquet: holds run 0, as part-00000\.parquet does"),
    (with_a_gap, r"part-00001\.parquet: its runs do not follow each other"),
    (holding("journal.jsonl", "x\n"), r"journal\.jsonl: line 1 is no finished run"),
    (holding("journal.jsonl", '{"number": 9, "key": 5}\n'), r"journal\.jsonl: cannot be read"),
]


@pytest.mark.thorough(witnesses=5)
@pytest.mark.parametrize(("harm", "said"), SWEEPS)
def test_a_dataset_that_is_none_is_one_line(tmp_path: Path, harm: Callable[[Path], None], said: str) -> None:
    folder = swept(tmp_path / "sweep")
    assert isinstance(load(folder), Sweep)
    harm(folder)
    refused(folder, said)


def test_the_record_of_a_run_is_in_its_dataset(killed: Path, tmp_path: Path) -> None:
    sweep = load(swept(tmp_path / "sweep"))
    assert isinstance(sweep, Sweep)
    shutil.copytree(killed, tmp_path / "sweep" / "records" / cell(2).key)
    assert list(sweep.run(cell(2).key).ticks["tick"]) == list(run_of(killed).ticks["tick"])


def test_a_dataset_without_a_finished_run_is_one_line(tmp_path: Path) -> None:
    begun(tmp_path / "sweep").close()
    refused(tmp_path / "sweep", "no run of this sweep is finished; vve-sumo sweep … --resume goes on")
    dataset = begun(tmp_path / "sweep")
    dataset.add(cell(4), result(4))
    assert load(tmp_path / "sweep").finished == 1
    assert PLAN.cells == load(tmp_path / "sweep").planned
    dataset.close()


def test_whatever_else_a_folder_holds_is_said_and_what_to_load_instead(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", r"an empty folder; expected a drive's record")
    refused(tmp_path / "absent", r"not there; expected a drive's record")
    (tmp_path / "a.txt").write_text("x", encoding="utf-8")
    refused(tmp_path / "a.txt", "a file; expected a drive's record")
    refused(REPOSITORY / "docs", r"neither a record nor a dataset; expected a drive's record")
    folder = swept(tmp_path / "sweep")
    refused(tmp_path, rf"neither a record nor a dataset; it holds others, such as {folder}$")
    refused(folder / "rows", rf"a part of a sweep; load its folder, {folder}$")
    refused(folder / "rows" / "part-00000.parquet", rf"a part of a sweep; load its folder, {folder}$")
    record = tmp_path / "suite" / "records" / "row"
    record.mkdir(parents=True)
    (tmp_path / "suite" / "journal.jsonl").write_text("{}\n", encoding="utf-8")
    earlier = "the layout that a suite of an earlier vve-sumo left"
    refused(tmp_path / "suite", rf"{earlier}; its tables can be read as they are; .*in another folder$")
    (record / "scenario.json").write_text("{}", encoding="utf-8")
    refused(tmp_path / "suite", rf"{earlier}.*; it holds others, such as {record}$")
    refused(record / "scenario.json", rf"a part of a record; load its folder, {record}$")


def refused(folder: Path, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        open_all(folder)
    assert "\n" not in str(caught.value)


def open_all(folder: Path) -> None:
    """Load a folder and read its tables, which is when what is wrong with one of them shows."""
    held = load(folder)
    if isinstance(held, Sweep):
        held.rows()
    else:
        _ = held.actors, held.detections
