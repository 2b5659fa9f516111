"""The recorder: real processes that are killed, stopped and cut off from their disk."""

from __future__ import annotations

import dataclasses
import json
import os
import resource
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.live.patience import until
from tests.record.declared import RESOLVED
from tests.record.test_record import actors, row
from vve_sumo.bus import read_log
from vve_sumo.live.channel import pair
from vve_sumo.live.recorder_client import MAX_BACKLOG, MAX_ROWS, RecorderClient
from vve_sumo.live.spawn import start
from vve_sumo.live.summary import summarise
from vve_sumo.record.hashes import hash_parts, whole
from vve_sumo.record.reader import read_pose_chunks, read_table
from vve_sumo.record.rows import GatewayRow, LatencyRow
from vve_sumo.record.writer import LiveRecord, RecordWriter
from vve_sumo.values import CommandedPath, Frame

KINDS = {"int": 0, "float": 0.5, "bool": False, "str": "", "bytes": b"\x00\xff"}
COLUMNS = (np.array([9.0]), np.array([0.1]), np.array([-2.0]), np.array([1], np.int8), ("car0",))


def plain(kind: type, **changes: object):
    """Return a row of plain values."""
    return kind(**({f.name: KINDS[str(f.type)] for f in dataclasses.fields(kind)} | changes))


def say_tick(tap: RecorderClient | LiveRecord | RecordWriter, tick: int, boxes: int = 3) -> None:
    """Say what a drive says of a tick."""
    tap.received_pose(0.02 * tick, bytes([tick % 256] * 72))
    tap.sensed(tick, "radar", 0.02 * tick, COLUMNS)
    tap.snapshot(tick, actors(boxes))
    if tick % 2:
        tap.commanded(tick, CommandedPath((0.1 * tick, 9.0), (0.0, 0.5), (8.0, 7.0)))
    tap.ticked(row(tick))


def say_step(tap: RecorderClient | LiveRecord, step: int, **changes: object) -> None:
    """Say what a gateway says of a step."""
    tap.saw_frames(0.02 * step, "can0", [Frame(0x061, bytes([step % 256] * 8))])
    tap.saw_frames(0.02 * step + 0.001, "can0", [Frame(0x060, bytes([step % 256] * 8))])
    tap.stepped(plain(GatewayRow, step=step, time_s=0.02 * step, frames_received=1, frames_sent=1, **changes))


@dataclasses.dataclass
class Desk:
    """A recorder and the two taps that it listens to."""

    folder: Path

    def __post_init__(self) -> None:
        self.to_drive, drive = pair()
        self.to_gateway, gateway = pair()
        self.drive, self.gateway = RecorderClient(self.to_drive), RecorderClient(self.to_gateway)
        config = {
            "folder": str(self.folder),
            "resolved": {"a": 1} | RESOLVED,
            "epoch": 1000.0,
            "provenance": "{}",
            "log": None,
        }
        self.process = start("recorder", config, {"drive": drive, "gateway": gateway}, own_session=True)
        until(lambda: (self.folder / "latency.arrows").exists())

    def hang_up(self) -> dict[str, object]:
        """Let both taps go, and return the summary."""
        self.to_drive.close()
        self.to_gateway.close()
        assert self.process.wait(30.0) == 0
        return json.loads((self.folder / "summary.json").read_text(encoding="utf-8"))


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    desk = Desk(tmp_path / "r")
    yield desk
    desk.process.kill()
    desk.process.wait()


@pytest.mark.thorough
def test_what_two_processes_say_becomes_one_record(desk: Desk, tmp_path: Path) -> None:
    by_hand = LiveRecord(tmp_path / "by_hand", {"a": 1} | RESOLVED, 1000.0)
    for number in range(60):
        for to, other in ((desk.drive, desk.gateway), (by_hand, by_hand)):
            say_tick(to, number)
            to.timed(plain(LatencyRow, tick=number, received_s=0.0, framed_s=0.001 * number, missed=0))
            say_step(other, number, reasons="")
        desk.drive.flush()
        desk.gateway.flush()
    desk.drive.ended({"outcome": "stopped", "reasons": ["stop_asked"]})
    desk.drive.finish(10.0)
    summary = desk.hang_up()
    parts = by_hand.close()
    assert summary["record_parts_sha256"] == parts
    assert summary["record_sha256"] == whole(parts)
    assert "gateway" in parts
    assert "latency" not in parts
    assert (summary["outcome"], summary["reasons"], summary["record_broken"]) == ("stopped", ["stop_asked"], [])
    assert summary["ticks"] == summary["gateway_steps"] == 60
    gateway = read_table(desk.folder, "gateway")
    assert gateway["setpoint"].to_pylist() == [b"\x00\xff"] * 60
    assert [frame.id for _, _, frame in read_log(desk.folder / "can.log")] == [0x061, 0x060] * 60
    assert not list(desk.folder.glob("*.arrows"))
    assert desk.drive.failure == desk.gateway.failure == ""


@pytest.mark.thorough
def test_a_reading_of_many_rows_goes_in_several_datagrams_and_is_one_in_the_record(desk: Desk, tmp_path: Path) -> None:
    """A turn of a lidar is longer than a datagram may be."""
    rows = 2 * MAX_ROWS + 1
    many = (
        tuple(np.resize(np.asarray(column), rows) for column in COLUMNS[:-1]),
        tuple(f"body {n}" for n in range(rows)),
    )
    columns = (*many[0], many[1])
    by_hand = LiveRecord(tmp_path / "by_hand", {"a": 1} | RESOLVED, 1000.0)
    for number in range(12):
        for to in (desk.drive, by_hand):
            to.sensed(number, "radar", 0.02 * number, columns if number % 5 == 0 else COLUMNS)
            to.snapshot(number, actors(3))
            to.ticked(row(number))
        desk.drive.flush()
        time.sleep(0.02)
    desk.drive.ended({"outcome": "stopped", "reasons": []})
    desk.drive.finish(10.0)
    summary = desk.hang_up()
    assert summary["record_parts_sha256"] == by_hand.close()
    readings = read_table(desk.folder, "readings")["rows"].to_pylist()
    assert readings[:6] == [rows, *[len(COLUMNS[0])] * 4, rows]
    assert read_table(desk.folder, "sensor_radar").num_rows == sum(readings)


def test_the_lockstep_parts_hash_as_in_lockstep(tmp_path: Path) -> None:
    live, lockstep = (
        LiveRecord(tmp_path / "live", {"a": 1} | RESOLVED, 0.0),
        RecordWriter(tmp_path / "lockstep", {"a": 1} | RESOLVED, 0.0),
    )
    for tick in range(25):
        for record in (live, lockstep):
            say_tick(record, tick)
    parts = live.close()
    assert {name: parts[name] for name in parts if name != "gateway"} == lockstep.close()


@pytest.mark.thorough(witnesses=4)
@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(GatewayRow)])
def test_the_hash_covers_every_column_of_the_gateway(field: str, tmp_path: Path) -> None:
    other = {"int": 7, "float": 0.25, "bool": True, "str": "x", "bytes": b"\xff"}
    kind = next(str(f.type) for f in dataclasses.fields(GatewayRow) if f.name == field)
    hashes = []
    for name, changes in (("plain", {}), ("changed", {field: other[kind]})):
        record = LiveRecord(tmp_path / name, RESOLVED, 0.0)
        record.stepped(plain(GatewayRow, **changes))
        hashes.append(whole(record.close()))
    assert hashes[0] != hashes[1]


@pytest.mark.thorough
def test_what_no_message_can_hold_is_a_reason_and_no_exception(desk: Desk) -> None:
    desk.drive.sensed(1, "radar", 0.5, ([1j],))
    desk.drive.flush()
    assert desk.drive.failure == "record_failed"
    desk.hang_up()


@pytest.mark.thorough
def test_bytes_that_are_no_batch_are_told_and_stand_in_the_summary(desk: Desk) -> None:
    assert desk.to_drive.send(b"no batch")
    until(lambda: (desk.gateway.flush(), desk.gateway.failure)[1] == "record_failed")
    say_step(desk.gateway, 0)
    desk.gateway.flush()
    summary = desk.hang_up()
    assert summary["record_broken"] == ["messages"]
    assert summary["gateway_steps"] == 1, "what comes well is written all the same"


def test_a_drive_that_never_said_how_it_ended_was_lost(desk: Desk) -> None:
    say_tick(desk.drive, 0)
    desk.drive.flush()
    desk.to_drive.close()
    for step in range(20):
        say_step(desk.gateway, step, reasons="drive_gone+setpoint_expired", state="stopping")
        desk.gateway.flush()
    summary = desk.hang_up()
    assert summary["outcome"] == "broken"
    assert summary["reasons"] == ["drive_lost", "drive_gone", "setpoint_expired"]
    assert summary["gateway_steps"] == 20


def test_no_signal_but_kill_ends_it_before_its_time(desk: Desk) -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        for _ in range(20):
            os.kill(desk.process.pid, number)
    say_step(desk.gateway, 0)
    desk.gateway.flush()
    assert desk.hang_up()["gateway_steps"] == 1


@pytest.mark.live
def test_a_killed_recorder_has_lost_at_most_a_fifth_of_a_second(desk: Desk) -> None:
    said = _say_for(desk, 1.5)
    os.kill(desk.process.pid, signal.SIGKILL)
    killed = time.monotonic()
    desk.process.wait()
    due = sum(1 for moment in said if moment < killed - 0.2)
    assert due > 40
    ticks = read_table(desk.folder, "ticks")["tick"].to_pylist()
    assert ticks == list(range(len(ticks)))
    assert len(ticks) >= due
    assert len(read_pose_chunks(desk.folder / "pose.bin")) >= due
    steps = read_table(desk.folder, "gateway").num_rows
    frames = list(read_log(desk.folder / "can.log"))
    assert due <= steps <= len(frames) // 2
    assert summarise(desk.folder, None)["record_parts_sha256"] == hash_parts(desk.folder)
    desk.drive.flush()
    assert desk.drive.failure == "record_lost"


def _say_for(desk: Desk, duration: float) -> list[float]:
    """Say ticks and steps every 20 ms; when each was said."""
    said: list[float] = []
    begun = time.monotonic()
    while time.monotonic() < begun + duration:
        say_tick(desk.drive, len(said))
        say_step(desk.gateway, len(said))
        desk.drive.flush()
        desk.gateway.flush()
        said.append(time.monotonic())
        time.sleep(0.02)
    return said


def test_a_stopped_recorder_is_found_full_and_keeps_nobody(desk: Desk) -> None:
    os.kill(desk.process.pid, signal.SIGSTOP)
    flushes, slowest = 0, 0.0
    while not desk.drive.failure:
        say_tick(desk.drive, flushes, boxes=200)
        begun = time.monotonic()
        desk.drive.flush()
        slowest = max(slowest, time.monotonic() - begun)
        flushes += 1
        assert flushes < 5000, "no end to what the queue takes"
    assert desk.drive.failure == "record_full"
    assert flushes > MAX_BACKLOG
    assert slowest < 0.5, "a queue that is full is found full at once"
    os.kill(desk.process.pid, signal.SIGCONT)
    desk.drive.finish(20.0)
    desk.hang_up()
    ticks = read_table(desk.folder, "ticks")["tick"].to_pylist()
    assert ticks == list(range(len(ticks))), "what was accepted has no holes"
    assert len(ticks) >= flushes - 1


@pytest.mark.thorough
def test_a_recorder_that_is_slow_for_a_moment_is_forgiven(desk: Desk) -> None:
    os.kill(desk.process.pid, signal.SIGSTOP)
    for tick in range(MAX_BACKLOG // 2):
        say_tick(desk.drive, tick, boxes=1000)
        desk.drive.flush()
    os.kill(desk.process.pid, signal.SIGCONT)
    desk.drive.finish(20.0)
    assert desk.drive.failure == ""
    assert desk.hang_up()["ticks"] == MAX_BACKLOG // 2


@pytest.mark.thorough
def test_a_full_disk_is_told_to_both_and_what_can_be_written_still_is(desk: Desk) -> None:
    for tick in range(20):
        say_tick(desk.drive, tick)
        say_step(desk.gateway, tick)
    desk.drive.flush()
    desk.gateway.flush()
    until(lambda: (desk.folder / "can.log").stat().st_size > 0)
    limit = (desk.folder / "actors.arrows").stat().st_size + 30_000
    resource.prlimit(desk.process.pid, resource.RLIMIT_FSIZE, (limit, limit))

    def both_know() -> bool:
        say_tick(desk.drive, 20, boxes=500)
        desk.drive.flush()
        desk.gateway.flush()
        return bool(desk.drive.failure and desk.gateway.failure)

    until(both_know)
    assert (desk.drive.failure, desk.gateway.failure) == ("record_failed", "record_failed")
    say_step(desk.gateway, 20, reasons="record_failed")
    desk.gateway.flush()
    desk.drive.ended({"outcome": "fault", "reasons": ["record_failed"]})
    desk.drive.finish(10.0)
    summary = desk.hang_up()
    assert summary["outcome"] == "fault"
    assert "actors" in summary["record_broken"]
    assert read_table(desk.folder, "gateway")["reasons"][-1].as_py() == "record_failed"
    assert read_table(desk.folder, "actors")["tick"].to_pylist()[:60] == [tick for tick in range(20) for _ in range(3)]
    assert summary["record_parts_sha256"] == hash_parts(desk.folder)


@pytest.mark.parametrize("name", ["pose.bin", "can.log", "ticks", "gateway", "latency"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.99])
def test_every_reader_takes_a_torn_record(name: str, share: float, tmp_path: Path) -> None:
    record = LiveRecord(tmp_path / "r", RESOLVED, 0.0)
    for number in range(30):
        say_tick(record, number)
        say_step(record, number)
        record.timed(plain(LatencyRow, tick=number))
        record.flush()
    file = tmp_path / "r" / (name if "." in name else f"{name}.arrows")
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    folder = tmp_path / "r"
    counts = {
        "pose.bin": len(read_pose_chunks(folder / "pose.bin")),
        "can.log": len(list(read_log(folder / "can.log"))) / 2,
        **{table: read_table(folder, table).num_rows for table in ("ticks", "gateway", "latency")},
    }
    torn = counts.pop(name)
    assert set(counts.values()) == {30}
    assert share * 30 - 8 <= torn < 30
    assert (torn == 0) is (share == 0.0)
    assert summarise(folder, None)["outcome"] == "broken"


def test_nothing_at_all_has_a_summary_too(tmp_path: Path) -> None:
    assert summarise(tmp_path, None) == {
        "outcome": "broken", "reasons": ["drive_lost"], "ticks": 0, "gateway_steps": 0, "latency": {}
    }  # fmt: skip
