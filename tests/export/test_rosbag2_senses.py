"""Further sensors in a bag of rosbag2, as the package `rosbags` reads it, against the rows of the record."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
from rosbags.highlevel import AnyReader

from tests.bridges.ros2.clouds_of_record import (
    OBJECTS,
    STATIONS,
    STOP_LINES,
    Cloud,
    points_of,
    recorded,
    same_rows,
    same_scans,
    same_turns,
)
from tests.conftest import REPOSITORY
from tests.isolated import isolated
from tests.once import once
from vve_sumo.analysis import Run
from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.export.write import export

KINDS = {"roof": "lidar", "front": "camera", "obu": "v2x", "lights": "signals", "second": "radar"}
Read = dict[str, list[tuple[int, Any]]]  # time of the bag [ns] and message, by topic


def _drive(folder: str) -> None:
    from vve_sumo.drive import run as drives

    sensors = [{"name": name, "kind": kind} for name, kind in KINDS.items()]
    values = {"sensors": sensors, "duration_s": 2.0, "ego.initial_speed_mps": 10.0, "ego.initial_s_m": 150.0,
              "actors": [{"id": "ahead", "kind": "van", "ahead_m": 25.0, "speed_mps": 10.0}],
              "controller.name": "follow_and_stop"}  # fmt: skip
    drives.run(drives.resolve_by_name("signal_street", REPOSITORY, values=values), Path(folder), REPOSITORY)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return Run(once(tmp_path_factory, "every_sense_at_signals", lambda folder: isolated(_drive, str(folder))))


@pytest.fixture(scope="module")
def read(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Read:
    (file,) = export(run, "rosbag2", tmp_path_factory.mktemp("bag"))
    found: Read = defaultdict(list)
    with AnyReader([file]) as reader:
        for connection, at, data in reader.messages():
            found[connection.topic].append((at, reader.deserialize(data, connection.msgtype)))
    return found


def _clouds(read: Read, topic: str) -> list[Cloud]:
    found = []
    for _, cloud in read[topic]:
        fields = [(field.name, field.datatype, field.offset) for field in cloud.fields]
        stamp = cloud.header.stamp
        points = points_of(fields, cloud.point_step, cloud.data.tobytes())
        found.append((stamp.sec * 1_000_000_000 + stamp.nanosec, cloud.header.frame_id, points))
    return found


TOPICS = {"roof": "points", "front": "objects", "obu": "stations", "lights": "stop_lines", "second": "points"}


@pytest.mark.parametrize("sensor", TOPICS)
def test_each_reading_is_there_once_at_the_tick_at_which_it_came_out(run: Run, read: Read, sensor: str) -> None:
    topic = f"/{sensor}/{TOPICS[sensor]}"
    assert [(at, frame) for at, frame, _ in _clouds(read, topic)] == [(at, sensor) for at in recorded(run, sensor)]
    clock = [at for at, _ in read["/clock"]]
    assert [at for at, _ in read[topic]] == [clock[tick] for tick in run.sensed[sensor].at.tolist()]


def test_turns_scans_lists_and_lines_are_the_recorded_ones(run: Run, read: Read) -> None:
    same_turns(_clouds(read, "/roof/points"), run, "roof")
    same_scans(_clouds(read, "/second/points"), run, "second")
    same_rows(_clouds(read, "/front/objects"), run, "front", OBJECTS)
    same_rows(_clouds(read, "/lights/stop_lines"), run, "lights", STOP_LINES)


def test_stations_are_the_messages_that_came_and_what_no_record_holds_is_no_number(run: Run, read: Read) -> None:
    clouds = _clouds(read, "/obu/stations")
    same_rows(clouds, run, "obu", STATIONS)
    for name in ("yaw_rate", "acceleration"):
        assert all(np.isnan(points[name]).all() for _, _, points in clouds)


def test_boxes_are_those_of_the_camera_s_list(run: Run, read: Read) -> None:
    lists = list(recorded(run, "front", *OBJECTS.values()).values())
    assert len(read["/front/detections"]) == len(lists)
    for (_, got), rows in zip(read["/front/detections"], lists, strict=True):
        assert [one.id for one in got.detections] == [str(number) for number in rows["number"]]
        for one, kind, x, length in zip(got.detections, rows["kind"], rows["x_m"], rows["length_m"], strict=True):
            assert one.results[0].hypothesis.class_id == BODY_KINDS[kind]
            assert one.bbox.center.position.x == pytest.approx(x + 0.5 * length)


def test_frames_are_where_the_sensors_are(run: Run, read: Read) -> None:
    ((_, static),) = read["/tf_static"]
    places = {one.child_frame_id: one.transform.translation for one in static.transforms}
    assert places.keys() >= KINDS.keys()
    assert (places["roof"].x, places["roof"].y, places["roof"].z) == (1.4, 0.0, 1.9)
    for name in KINDS.keys() - {"roof"}:
        assert places[name].x == run.vehicle.rear_axle_to_bumper
