"""The record: what a kill leaves, what the hash covers, what other tools can read."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import re
import sys
from pathlib import Path

import can
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.drive.street import drive_once
from tests.isolated import isolated
from tests.killed import killed_at
from tests.record.declared import RESOLVED
from vve_sumo.coded_texts import CodedTexts
from vve_sumo.commanded_path import by_tick
from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import hash_parts, whole
from vve_sumo.record.reader import holds_table, read_commanded, read_pose_chunks, read_table, sensor_tables
from vve_sumo.record.rows import TickRow
from vve_sumo.record.writer import TICKS_PER_BATCH, LiveRecord, MemoryRecorder, RecordWriter
from vve_sumo.values import Actors, CommandedPath, Frame

KINDS = {"int": 0, "float": 0.5, "bool": False, "str": ""}


def row(tick: int, **changes: object) -> TickRow:
    """Return a tick's row of plain values."""
    plain = {f.name: KINDS[str(f.type)] for f in dataclasses.fields(TickRow)}
    return TickRow(**(plain | {"tick": tick, "time_s": 0.02 * tick} | changes))


def actors(count: int) -> Actors:
    """Return a table of some actors."""
    column = np.arange(float(count))
    return Actors(0.0, tuple(f"car{i}" for i in range(count)), *[column] * 9, np.arange(count).astype(np.int8))


def fill(record: MemoryRecorder, ticks: int, **changes: object) -> None:
    """Record some ticks of everything."""
    detection = np.array([9.0]), np.array([0.1]), np.array([-2.0]), np.array([1], np.int8), ("car0",)
    for tick in range(ticks):
        record.received_pose(0.02 * tick, bytes([tick % 256] * 72))
        record.saw_frames(0.02 * tick, "can0", [Frame(0x060, bytes([tick % 256] * 8))])
        record.sensed(tick, "radar", 0.02 * tick, detection)
        record.snapshot(tick, actors(3))
        record.ticked(row(tick, **changes))


def closed(folder: Path, ticks: int, **changes: object) -> str:
    """Return the hash of a record of some ticks."""
    record = RecordWriter(folder, {"a": 1} | RESOLVED, 1000.0)
    fill(record, ticks, **changes)
    parts = record.close()
    assert hash_parts(folder) == parts, "the files say what was hashed while they grew"
    return whole(parts)


def test_a_finished_record_reads_back_what_was_kept(tmp_path: Path) -> None:
    closed(tmp_path / "r", 25, note="brake", lateral_deviation_m=math.nan)
    ticks, seen, boxes = (read_table(tmp_path / "r", name) for name in ("ticks", "sensor_radar", "actors"))
    assert ticks["tick"].to_pylist() == list(range(25))
    assert set(ticks["note"].to_pylist()) == {"brake"}
    assert np.isnan(ticks["lateral_deviation_m"].to_numpy()).all()
    assert ticks.schema.field("speed_mps").metadata[b"meaning"].startswith(b"rear axle")
    assert seen["range_m"].to_pylist() == [9.0] * 25
    assert boxes.num_rows == 75
    chunks = read_pose_chunks(tmp_path / "r" / "pose.bin")
    assert chunks[7] == (0.02 * 7, bytes([7] * 72))


def test_a_record_that_is_discarded_takes_away_what_it_made_and_nothing_else(tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    record = RecordWriter(there, {"a": 1} | RESOLVED, 1000.0)
    fill(record, 25)
    record.attach("notes.txt", "of the drive")
    record.attach_table("roads", pa.table({"a": [1]}))
    for name in ("thesis.tex", "ticks.csv"):  # somebody else's, put there while the drive went on
        (there / name).write_text("the only copy", encoding="utf-8")
    (there / "figures").mkdir()
    record.discard()
    assert sorted(file.name for file in there.iterdir()) == ["figures", "thesis.tex", "ticks.csv"]
    assert (there / "thesis.tex").read_text(encoding="utf-8") == "the only copy"


def test_a_record_that_is_discarded_when_it_is_closed_takes_its_tables_away_too(tmp_path: Path) -> None:
    record = RecordWriter(tmp_path / "r", {"a": 1} | RESOLVED, 1000.0)
    fill(record, 25)
    record.close()
    record.discard()
    assert not (tmp_path / "r").exists()


def test_a_text_that_lay_there_before_the_record_is_not_deleted_with_it(tmp_path: Path) -> None:
    record = RecordWriter(tmp_path / "r", {"a": 1} | RESOLVED, 1000.0)
    (tmp_path / "r" / "notes.txt").write_text("mine", encoding="utf-8")
    record.attach("notes.txt", "of the drive")
    record.discard()
    assert [file.name for file in (tmp_path / "r").iterdir()] == ["notes.txt"]


def test_a_discarded_record_leaves_no_folder_that_it_made_but_for_what_others_put_there(tmp_path: Path) -> None:
    for other in (False, True):
        record = RecordWriter(tmp_path / "a" / "b" / "c", {"a": 1} | RESOLVED, 1000.0)
        if other:
            (tmp_path / "a" / "mine.txt").write_text("mine", encoding="utf-8")
        record.discard()
        assert (tmp_path / "a").exists() is other
        assert not (tmp_path / "a" / "b").exists()


def test_what_nobody_keeps_has_the_same_hash_and_tables(tmp_path: Path) -> None:
    kept, unkept = (
        RecordWriter(tmp_path / "r", {"a": 1} | RESOLVED, 1000.0),
        MemoryRecorder({"a": 1} | RESOLVED, 1000.0),
    )
    for record in (kept, unkept):
        fill(record, 25, note="brake", lateral_deviation_m=math.nan)
        record.sensed(25, "radar", 0.5, (*[np.zeros(0)] * 3, np.zeros(0, np.int8), ()))
    assert unkept.close() == kept.close() == hash_parts(tmp_path / "r")
    assert {*kept.tables} > {*unkept.tables} == {"ticks", "actors"}  # what the summary is computed from
    for name, table in unkept.tables.items():
        table.validate(full=True)
        assert repr(table.to_pylist()) == repr(read_table(tmp_path / "r", name).to_pylist())  # NaN is like NaN
        assert table.schema.equals(kept.tables[name].schema, check_metadata=True)


NAMES = ("", "car0", "a much longer name", "süß")


@pytest.mark.parametrize("coded", [[True] * 3, [True, False, True]], ids=["all coded", "some coded"])
def test_coded_texts_are_recorded_as_the_texts_that_they_stand_for(coded: list[bool], tmp_path: Path) -> None:
    """The same hash and the same bytes, in one batch and over several."""
    files, parts = [], []
    for name in ("plain", "coded"):
        record = RecordWriter(tmp_path / name, RESOLVED, 0.0)
        for tick in range(2 * TICKS_PER_BATCH + 3):
            codes = np.arange(tick, 3 * tick) % len(NAMES)
            texts = NAMES[tick % 2 :] + NAMES[: tick % 2]  # the same code does not always stand for the same text
            numbers = [np.linspace(0.0, 1.0, len(codes))] * 3, np.zeros(len(codes), np.int8)
            own = CodedTexts(codes.astype(np.int32), texts)
            column = own if name == "coded" and coded[tick % 3] else [texts[code] for code in codes.tolist()]
            record.sensed(tick, "radar", 0.02 * tick, (*numbers[0], numbers[1], column))
            record.ticked(row(tick))
        parts.append(record.close())
        files.append((tmp_path / name / "sensor_radar.parquet").read_bytes())
    assert parts[0] == parts[1] == hash_parts(tmp_path / "coded")
    assert files[0] == files[1]


def test_other_tools_read_the_can_log(tmp_path: Path) -> None:
    closed(tmp_path / "r", 12)
    with can.LogReader(tmp_path / "r" / "can.log") as log:
        messages = list(log)
    assert [bytes(m.data) for m in messages] == [bytes([tick] * 8) for tick in range(12)]
    assert {m.arbitration_id for m in messages} == {0x060}
    assert messages[5].timestamp == pytest.approx(1000.1, abs=1e-6)


def test_the_hash_covers_every_column_and_input(tmp_path: Path) -> None:
    plain = closed(tmp_path / "plain", 12)
    assert closed(tmp_path / "same", 12) == plain
    assert closed(tmp_path / "longer", 13) != plain
    for field in dataclasses.fields(TickRow)[1:]:
        other = {"int": 7, "float": 0.25, "bool": True, "str": "x"}[str(field.type)]
        assert closed(tmp_path / field.name, 12, **{field.name: other}) != plain, field.name


@pytest.mark.parametrize("part", ["scenario", "pose", "can", "readings", "sensor_radar", "actors"])
def test_the_hash_covers_every_part(part: str, tmp_path: Path) -> None:
    hashes = []
    for changed in (False, True):
        record = RecordWriter(
            tmp_path / f"{part}{changed}", {"a": 2 if changed and part == "scenario" else 1} | RESOLVED, 1000.0
        )
        fill(record, 12)
        if changed and part == "pose":
            record.received_pose(1.0, b"x")
        elif changed and part == "can":
            record.saw_frames(1.0, "can0", [Frame(1, b"")])
        elif changed and part == "readings":
            record.sensed(13, "radar", 0.2, (*[np.zeros(0)] * 3, np.zeros(0, np.int8), ()))
        elif changed and part == "sensor_radar":
            record.sensed(13, "radar", 0.2, (*[np.array([1.0])] * 3, np.array([0], np.int8), ("car1",)))
        elif changed and part == "actors":
            record.snapshot(13, actors(1))
        hashes.append(whole(record.close()))
    assert hashes[0] != hashes[1]


def test_an_open_record_is_readable_up_to_its_last_batch(tmp_path: Path) -> None:
    record = RecordWriter(tmp_path / "r", RESOLVED, 0.0)
    fill(record, 3 * TICKS_PER_BATCH + 4)
    ticks = read_table(tmp_path / "r", "ticks")
    assert ticks.num_rows == 3 * TICKS_PER_BATCH
    assert len(read_pose_chunks(tmp_path / "r" / "pose.bin")) == 3 * TICKS_PER_BATCH
    torn = tmp_path / "r" / "ticks.arrows"
    torn.write_bytes(torn.read_bytes()[:-100])
    assert read_table(tmp_path / "r", "ticks").num_rows == 2 * TICKS_PER_BATCH


def test_a_folder_that_is_no_record_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not a drive's record"):
        read_table(tmp_path, "ticks")


def test_an_ego_that_a_record_does_not_have_is_named_and_its_only_one_is_the_default(tmp_path: Path) -> None:
    closed(tmp_path, 15)
    for name in ("ticks", "actors", "readings", "sensor_radar"):
        assert read_table(tmp_path, name, "ego").equals(read_table(tmp_path, name))
        assert holds_table(tmp_path, name, "ego")
        for reader in (read_table, holds_table):
            with pytest.raises(ConfigError, match=re.escape(f"{tmp_path}: no ego 'other', expected 'ego'")):
                reader(tmp_path, name, "other")
    for read in (read_commanded, sensor_tables):
        assert len(read(tmp_path, "ego")) == len(read(tmp_path))
        with pytest.raises(ConfigError, match="no ego 'other'"):
            read(tmp_path, "other")


def test_not_a_number_becomes_null_in_the_summary(tmp_path: Path) -> None:
    record = RecordWriter(tmp_path / "r", RESOLVED, 0.0)
    record.close()
    record.summarise({"gap": math.nan, "inner": {"x": math.inf}, "ok": 1.5})
    written = json.loads((tmp_path / "r" / "summary.json").read_text(encoding="utf-8"))
    text = json.dumps({key: written[key] for key in ("gap", "inner", "ok")}, indent=1) + "\n"
    assert written.pop("summary_sha256") == hashlib.sha256(text.encode()).hexdigest()
    assert written == {
        "gap": None,
        "inner": {"x": None},
        "ok": 1.5,
    }


@pytest.mark.thorough
def test_a_killed_drive_leaves_all_but_its_last_moment(tmp_path: Path) -> None:
    """SIGKILL under way: every table opens, and ends within 0.2 s of drive time of the others."""
    folder = tmp_path / "record"
    always_near = {"obstacles": [{"id": "parked_car", "at_m": 150.0}]}
    code = f"from tests.drive.street import drive_once; drive_once({always_near!r}, {str(folder)!r})"
    killed_at([sys.executable, "-c", code], folder / "can.log", 400_000)
    ticks = read_table(folder, "ticks")["tick"].to_pylist()
    assert ticks == list(range(len(ticks)))
    assert len(ticks) > 100
    last_pose = read_pose_chunks(folder / "pose.bin")[-1][0]
    assert abs(last_pose - 0.02 * ticks[-1]) <= 0.2
    assert read_table(folder, "actors")["tick"].to_pylist()[-1] >= ticks[-1] - TICKS_PER_BATCH


@pytest.mark.thorough
def test_the_summary_carries_what_it_promises(tmp_path: Path) -> None:
    summary = isolated(drive_once, {"duration_s": 3.0}, str(tmp_path / "record"))
    written = json.loads((tmp_path / "record" / "summary.json").read_text(encoding="utf-8"))
    for key in (
        "outcome",
        "collision",
        "stop_gap_m",
        "min_ttc_s",
        "max_lateral_deviation_m",
        "max_deceleration_mps2",
        "duration_s",
        "ticks",
        "record_sha256",
    ):
        assert key in written
    assert written["outcome"] == "timeout"
    assert written["ticks"] == 150
    assert written["sumo_warnings"] == []
    assert written["passed"] is False
    assert written["record_sha256"] == summary["record_sha256"]
    assert not list((tmp_path / "record").glob("*.arrows"))


def test_paths_are_on_the_disk_before_the_ticks_that_they_belong_to(tmp_path: Path) -> None:
    """A drive that is killed at any write leaves no tick whose path is missing."""
    record, path = RecordWriter(tmp_path / "r", RESOLVED, 0.0), CommandedPath((1.0, 2.0), (0.0, 0.1), (5.0, 5.0))
    for tick in range(25):
        if tick >= 5:
            record.commanded(tick, path)
        record.ticked(row(tick))
    ticks, paths = record._parts["ticks"], record._parts["commanded_paths"]
    assert [*record._parts.values()].index(paths) < [*record._parts.values()].index(ticks)
    assert read_commanded(tmp_path / "r")["tick"].to_pylist() == [tick for tick in range(5, 20) for _ in path.x]
    assert read_table(tmp_path / "r", "ticks").num_rows == 20
    parts = record.close()
    assert hash_parts(tmp_path / "r") == parts
    assert by_tick(read_commanded(tmp_path / "r")) == dict.fromkeys(range(5, 25), path)


def test_a_live_record_whose_paths_cannot_be_written_goes_on(tmp_path: Path) -> None:
    path = CommandedPath((1.0, 2.0), (0.0, 0.1), (5.0, 5.0))
    (tmp_path / "commanded_paths.arrows").mkdir()  # no file can be opened there
    record = LiveRecord(tmp_path, RESOLVED, 0.0)
    for tick in range(3):
        record.commanded(tick, path)
        record.ticked(row(tick))
    assert record.broken == {"commanded_paths"}
    record.flush()
    assert read_table(tmp_path, "ticks").num_rows == 3


@pytest.mark.parametrize("column", ["tick", "x_m", "actor"])
def test_a_file_whose_damage_takes_a_value_away_has_another_hash(tmp_path: Path, column: str) -> None:
    """One changed bit of a Parquet file may say that a value is absent: no number can stand for it."""
    closed(tmp_path / "r", 3)
    whole_table, file = read_table(tmp_path / "r", "actors"), tmp_path / "r" / "actors.parquet"
    before = hash_parts(tmp_path / "r")
    values = whole_table.column(column).to_pylist()
    lacking = pa.array([None, *values[1:]], whole_table.schema.field(column).type)
    at = whole_table.schema.get_field_index(column)
    pq.write_table(whole_table.set_column(at, column, lacking), file)
    assert [name for name, digest in hash_parts(tmp_path / "r").items() if digest != before[name]] == ["actors"]
