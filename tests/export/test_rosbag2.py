"""Bags of rosbag2 as the package `rosbags` opens them, by the definitions in the file, against the record's numbers."""

from __future__ import annotations

import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from mcap.reader import make_reader

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Writer

from tests.analysis.made import PERIOD, put_scans
from tests.export.made import (
    ACTORS,
    ESTIMATE_OFF,
    HEADING,
    OF_DRIVE,
    SHIFT,
    SPEED,
    TICKS,
    TURN,
    UNIX_EPOCH,
    X,
    Y,
    away,
    box_at,
    record,
)
from vve_sumo.analysis import Run
from vve_sumo.bridges.ros2.bag_poses import write_csv
from vve_sumo.errors import ConfigError
from vve_sumo.export.write import export
from vve_sumo.pose.recording import fixes
from vve_sumo.wire.ros2.messages import LATCHED, TOPICS
from vve_sumo.wire.ros2.types import store

DETECTIONS = [
    {"tick": 0, "range_m": 20.5, "azimuth_rad": 0.1, "range_rate_mps": -8.0, "mode": 0, "actor": "parked"},
    {"tick": 0, "range_m": 7.25, "azimuth_rad": -0.4, "range_rate_mps": 1.5, "mode": 1, "actor": "walker"},
    {"tick": 145, "range_m": 60.0, "azimuth_rad": 0.0, "range_rate_mps": -2.0, "mode": 0, "actor": "lorry.7"},
]
Read = dict[str, list[tuple[int, Any]]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = record(tmp_path_factory.mktemp("bag") / "mine", {"outcome": "timeout"})
    put_scans(folder, range(0, 150, 5), DETECTIONS)
    return Run(folder)


@pytest.fixture(scope="module")
def file(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    (written,) = export(run, "rosbag2", tmp_path_factory.mktemp("out"))
    return written


@pytest.fixture(scope="module")
def read(file: Path) -> Read:
    """All messages by topic, each with its tick."""
    found: Read = defaultdict(list)
    with AnyReader([file]) as reader:
        for connection, at, data in reader.messages():
            tick = round((at / 1e9 - UNIX_EPOCH) / PERIOD)
            found[connection.topic].append((tick, reader.deserialize(data, connection.msgtype)))
    return found


def _of_ticks(read: Read, topic: str) -> list[Any]:
    assert [tick for tick, _ in read[topic]] == list(range(TICKS)), topic
    return [message for _, message in read[topic]]


def test_topics_types_and_qualities_are_those_of_the_bridge(file: Path) -> None:
    with file.open("rb") as source:
        summary = make_reader(source).get_summary()
    assert summary is not None
    got = {channel.topic: summary.schemas[channel.schema_id] for channel in summary.channels.values()}
    assert {topic: schema.name for topic, schema in got.items()} == dict(TOPICS)
    assert {schema.encoding for schema in got.values()} == {"ros2msg"}
    for channel in summary.channels.values():
        wanted = "transient_local" if channel.topic in LATCHED else "volatile"
        assert f"durability: {wanted}" in channel.metadata["offered_qos_profiles"]
        assert channel.message_encoding == "cdr"


def test_odometry_is_the_estimate_of_every_tick(read: Read) -> None:
    for tick, got in enumerate(_of_ticks(read, "/odom")):
        place, turn = got.pose.pose.position, got.pose.pose.orientation
        assert (place.x, place.y) == (X[tick] + ESTIMATE_OFF[0], Y[tick] + ESTIMATE_OFF[1])
        heading = 2.0 * math.atan2(turn.z, turn.w)
        assert math.remainder(heading - HEADING[tick] - ESTIMATE_OFF[2], math.tau) == pytest.approx(0.0, abs=1e-12)


def test_transforms_say_the_same(read: Read) -> None:
    for moved, odometry in zip(_of_ticks(read, "/tf"), _of_ticks(read, "/odom"), strict=True):
        (one,) = moved.transforms
        assert one.transform.translation.x == odometry.pose.pose.position.x
        assert one.transform.rotation == odometry.pose.pose.orientation


def test_the_clock_is_unix_time(read: Read) -> None:
    for tick, got in enumerate(_of_ticks(read, "/clock")):
        assert got.clock.sec + 1e-9 * got.clock.nanosec == pytest.approx(UNIX_EPOCH + tick * PERIOD, abs=1e-6)


def test_the_fix_is_the_receivers_place_in_the_lot(read: Read) -> None:
    to_lot = pyproj.Proj(OF_DRIVE["lot_projection"])
    for tick, got in enumerate(_of_ticks(read, "/fix")):
        x, y = to_lot(got.longitude, got.latitude)
        heading = HEADING[tick] + ESTIMATE_OFF[2]
        # From the lot to the road: turned, then moved; the receiver is 0.9 m ahead and 0.25 m right of the axle.
        road = np.array([[math.cos(TURN), -math.sin(TURN)], [math.sin(TURN), math.cos(TURN)]]) @ (x, y) + SHIFT
        ahead = np.array([math.cos(heading), math.sin(heading)])
        axle = road - 0.9 * ahead + 0.25 * np.array([-ahead[1], ahead[0]])
        assert axle == pytest.approx([X[tick] + ESTIMATE_OFF[0], Y[tick] + ESTIMATE_OFF[1]], abs=1e-6)
        assert got.status.status == 0


def test_scans_and_bodies_are_the_records(read: Read) -> None:
    clouds = dict(read["/radar/points"])
    assert list(clouds) == list(range(0, 150, 5))
    for tick, got in clouds.items():
        points = np.frombuffer(got.data.tobytes(), "<f4").reshape(-1, 6)
        wanted = [(r["range_m"], r["azimuth_rad"], r["range_rate_mps"]) for r in DETECTIONS if r["tick"] == tick]
        assert points[:, 3:].tolist() == np.array(wanted).reshape(-1, 3).astype("<f4").tolist()
    for tick, got in enumerate(_of_ticks(read, "/bodies")):
        boxes = {one.ns: one for one in got.markers[1:]}
        assert boxes.keys() == {name for name in ACTORS if not away(name, tick)}
        for name, one in boxes.items():
            row = box_at(name, tick)
            assert (one.pose.position.x, one.pose.position.y) == (row["x_m"], row["y_m"])
            assert (one.scale.x, one.scale.y, one.scale.z) == (row["length_m"], row["width_m"], row["height_m"])


def test_the_bag_comes_in_again_as_a_pose_recording(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "bag.csv"
    done = write_csv(file, out, {})
    assert (done.rows, done.left_out) == (TICKS, 0)
    to_lot = pyproj.Proj(OF_DRIVE["lot_projection"])
    for tick, fix in enumerate(fixes(out)):
        x, y = to_lot(math.degrees(fix.longitude), math.degrees(fix.latitude))
        assert math.isfinite(x + y)
        grid = fix.heading - HEADING[tick] - ESTIMATE_OFF[2] + TURN
        assert math.remainder(grid, math.tau) == pytest.approx(0.0, abs=1e-4)  # the convergence in the lot is small
        assert fix.velocity_north == fix.velocity_east == 0.0  # speed_mps of the record that was written by hand


def test_a_folder_with_sqlite_and_without_odometry_comes_in_by_its_places(read: Read, tmp_path: Path) -> None:
    folder, out = tmp_path / "bag", tmp_path / "bag.csv"
    with Writer(folder, version=9) as writer:
        for topic in ("/fix", "/imu"):
            kind = TOPICS[topic]
            connection = writer.add_connection(topic, kind, typestore=store())
            for tick, message in read[topic]:
                writer.write(connection, tick + 1, store().serialize_cdr(message, kind))
    done = write_csv(folder, out, {})
    assert (done.rows, done.left_out) == (TICKS - 1, 1)  # the first has none before it
    for fix in fixes(out):
        # The receiver is 0.25 m outside of the axle's circle of 40 m.
        assert math.hypot(fix.velocity_north, fix.velocity_east) == pytest.approx(SPEED * 40.25 / 40.0, abs=0.02)


def test_a_bag_that_is_none_or_lacks_a_topic_is_one_line(file: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(file.read_bytes()[:500])
    for bag, chosen, words in (
        (tmp_path / "none.mcap", {}, "no such bag"),
        (torn, {}, "is no bag that can be read"),
        (tmp_path, {}, "no such bag"),
        (file, {"fix": "/gps"}, "no topic /gps of sensor_msgs/msg/NavSatFix; there are /fix"),
    ):
        with pytest.raises(ConfigError, match=words) as error:
            write_csv(bag, tmp_path / "out.csv", chosen)
        assert "\n" not in str(error.value)
    assert not (tmp_path / "out.csv").exists()
