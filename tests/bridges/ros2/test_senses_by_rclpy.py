"""What further sensors measured, as real nodes of rclpy in another process hear it: the record's rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.bridges.ros2.clouds_of_record import (
    OBJECTS,
    STATIONS,
    Cloud,
    points_of,
    recorded,
    same_rows,
    same_scans,
    same_turns,
)
from tests.bridges.ros2.heard import SENSES, heard
from vve_sumo.analysis import Run

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")


def _read(cloud: dict[str, Any]) -> Cloud:
    fields = [(field["name"], field["datatype"], field["offset"]) for field in cloud["fields"]]
    points, header = points_of(fields, cloud["point_step"], bytes.fromhex(cloud["data"])), cloud["header"]
    assert (cloud["height"], cloud["width"], cloud["is_bigendian"]) == (1, len(points), False)
    at = int(header["stamp"]["sec"]) * 1_000_000_000 + int(header["stamp"]["nanosec"])
    return at, header["frame_id"], points


Sensed = tuple[Run, dict[str, list[Cloud]]]


@pytest.fixture(scope="module")
def sensed(tmp_path_factory: pytest.TempPathFactory) -> Sensed:
    """The record of a short drive, and the clouds that a node heard."""
    run, messages = heard(tmp_path_factory)
    return run, {topic: [_read(cloud) for cloud in messages[topic]] for topic in SENSES}


def _each_once(clouds: list[Cloud], run: Run, sensor: str) -> None:
    """Each reading came once, in order, in the sensor's frame; the first ones are of before the first valid tick."""
    stamps, readings = [at for at, _, _ in clouds], recorded(run, sensor)
    assert stamps
    assert [at for at in readings if at >= stamps[0]][: len(stamps)] == stamps
    assert len(stamps) > 0.9 * len(readings)
    assert {frame for _, frame, _ in clouds} == {sensor}


def test_every_turn_of_the_lidar_is_the_recorded_one(sensed: Sensed) -> None:
    run, clouds = sensed
    _each_once(clouds["/roof/points"], run, "roof")
    same_turns(clouds["/roof/points"], run, "roof")
    for _, _, points in clouds["/roof/points"]:
        assert -0.1 <= points["time"].min() < points["time"].max() <= 0.0
        assert (np.diff(points["time"]) >= 0.0).all()


def test_every_list_of_the_camera_is_the_recorded_one(sensed: Sensed) -> None:
    run, clouds = sensed
    _each_once(clouds["/front/objects"], run, "front")
    same_rows(clouds["/front/objects"], run, "front", OBJECTS)


def test_every_scan_of_a_second_radar_is_the_recorded_one(sensed: Sensed) -> None:
    run, clouds = sensed
    _each_once(clouds["/second/points"], run, "second")
    same_scans(clouds["/second/points"], run, "second")


def test_every_message_of_v2x_that_was_received_is_among_the_stations(sensed: Sensed) -> None:
    run, clouds = sensed
    came, received = recorded(run, "obu", "station", "message", *STATIONS.values()), 0
    for at, frame, points in clouds["/obu/stations"]:
        assert frame == "obu"
        of_now = came.get(at, {"station": np.zeros(0)})
        for row, station in enumerate(of_now["station"].tolist()):
            (point,) = points[points["number"] == station]
            assert point["message"] == of_now["message"][row]
            for name, column in STATIONS.items():
                assert point[name] == np.float32(of_now[column][row]), name
            received += 1
    assert received > 5
