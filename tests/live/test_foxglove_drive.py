"""A live drive watched by a viewer of topics: what it got is what the record holds."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.live.command_line import begun, own_rig
from tests.live.foxglove_client import Got, Viewer
from tests.live.records import SHORTER
from tests.live.test_foxglove import heading_of
from vve_sumo.record.reader import read_table

pytestmark = [pytest.mark.live, pytest.mark.thorough]

TOPICS = ("/ego/pose_estimated", "/scene", "/signals", "/states", "/sensor_radar", "/gateway/log")
#: of the record's ticks, those that signals repeat
NUMBERS = (
    "time_s", "x_m", "y_m", "heading_rad", "speed_mps", "s_m", "acceleration_setpoint_mps2", "steering_setpoint_rad",
    "granted_acceleration_mps2", "steering_rad", "brake_torque_nm",
)  # fmt: skip


def address_of(console: subprocess.Popen[str]) -> str:
    """Return what the console says that viewers connect to."""
    assert console.stderr is not None
    for line in console.stderr:
        if found := re.search(r"foxglove: (ws://127\.0\.0\.1:\d+/[\w-]+/foxglove)", line):
            return found[1]
    raise AssertionError("the drive ended before it said where its topics are")


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, list[Got]]]:
    """The record of a drive, and what a viewer got of it."""
    folder = tmp_path_factory.mktemp("foxglove")
    scenario = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    for old, new in SHORTER.items():
        scenario = scenario.replace(old, new)
    (folder / "short.toml").write_text(scenario, encoding="utf-8")
    rig = own_rig(folder)
    console = begun("drive", "short.toml", "--rig", str(rig), "--foxglove", "--out", "record", cwd=folder)
    got: dict[str, list[Got]] = {topic: [] for topic in TOPICS}
    try:
        viewer = Viewer(address_of(console), buffer=1 << 20)
        viewer.subscribe(*TOPICS)
        for one in viewer.rest():
            got[one.topic].append(one)
        console.communicate(timeout=120.0)
    finally:
        if console.poll() is None:
            console.kill()
            console.communicate()
    return folder / "record", got


def test_signals_and_states_are_the_ticks_of_the_record(watched: tuple[Path, dict[str, list[Got]]]) -> None:
    record, got = watched
    ticks = {row["tick"]: row for row in read_table(record, "ticks").to_pylist()}
    assert len(got["/signals"]) > 300
    named = {one.time: one for one in got["/states"]}
    for signals, states in [(one, named[one.time]) for one in got["/signals"] if one.time in named]:
        row = ticks[signals.content["tick"]]
        for name in NUMBERS:
            value = signals.content.get(name)
            assert value == (row[name] if row[name] == row[name] else None), name
        for name in ("state", "reasons", "faults", "note", "pose_reasons"):
            assert states.content[name] == row[name], name
    assert {one.content["state"] for one in got["/states"]} >= {"engaged", "stopped"}


def ticks_by_time(got: dict[str, list[Got]]) -> dict[int, int]:
    return {one.time: one.content["tick"] for one in got["/signals"]}


def known(got: dict[str, list[Got]], topic: str) -> list[Got]:
    """Return a topic's messages whose tick is known: on a busy machine some signals are left out."""
    found = [one for one in got[topic] if one.time in ticks_by_time(got)]
    assert found
    return found


def test_poses_and_bodies_are_those_of_the_record(watched: tuple[Path, dict[str, list[Got]]]) -> None:
    record, got = watched
    numbers = ticks_by_time(got)
    ticks = {row["tick"]: row for row in read_table(record, "ticks").to_pylist()}
    for one in known(got, "/ego/pose_estimated"):
        row, pose = ticks[numbers[one.time]], one.content.pose
        assert (pose.position.x, pose.position.y) == (row["x_m"], row["y_m"])
        assert heading_of(pose.orientation) == pytest.approx(row["heading_rad"], abs=1e-9)
    actors: dict[int, dict[str, tuple[float, float]]] = {}
    for row in read_table(record, "actors").to_pylist():
        actors.setdefault(row["tick"], {})[row["actor"]] = row["x_m"], row["y_m"]
    for one in known(got, "/scene"):
        places = {body.id: body.cubes[0].pose.position for body in one.content.entities if body.id != "ego"}
        assert {name: (at.x, at.y) for name, at in places.items()} == actors.get(numbers[one.time], {})
    assert any(len(one.content.entities) > 1 for one in got["/scene"])


def test_scans_and_changes_of_state_are_those_of_the_record(watched: tuple[Path, dict[str, list[Got]]]) -> None:
    record, got = watched
    numbers = ticks_by_time(got)
    rows: dict[int, int] = {}
    for row in read_table(record, "sensor_radar").to_pylist():
        rows[row["tick"]] = rows.get(row["tick"], 0) + 1
    assert got["/sensor_radar"]
    for one in known(got, "/sensor_radar"):
        assert len(one.content.data) == one.content.point_stride * rows.get(numbers[one.time], 0)
    changes = [one.content.message.partition(":")[0] for one in got["/gateway/log"]]
    assert changes[-1] == got["/states"][-1].content["state"]
    assert "engaged" in changes


def test_the_viewer_of_these_tests_reads_the_server_of_foxgloves_own_sdk() -> None:
    sdk = pytest.importorskip("foxglove")
    context = sdk.Context()
    channel = sdk.Channel("/made", schema={"type": "object"}, context=context)
    server = sdk.start_server(host="127.0.0.1", port=0, context=context)
    try:
        viewer = Viewer(f"ws://127.0.0.1:{server.port}/", "foxglove.sdk.v1")
        viewer.subscribe("/made")
        for _ in range(200):
            channel.log({"value": 3}, log_time=1_700_000_000_000_000_000)
        assert viewer.next() == Got("/made", 1_700_000_000_000_000_000, {"value": 3})
        viewer.close()
    finally:
        server.stop()
