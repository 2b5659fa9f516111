"""What further sensors measured, as real nodes of rclpy in another process hear it: the record's rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.bridges.ros2.heard import SENSES, heard
from vve_sumo.analysis import Run
from vve_sumo.export.unix_time import unix_of_drive

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
FORMATS = {1: "i1", 2: "u1", 4: "<u2", 6: "<u4", 7: "<f4", 8: "<f8"}
Cloud = tuple[int, str, NDArray[Any]]  # Unix time [ns], frame, points


def _read(cloud: dict[str, Any]) -> Cloud:
    """Read a cloud by what its own fields say."""
    fields, header = cloud["fields"], cloud["header"]
    layout = np.dtype({"names": [field["name"] for field in fields],
                       "formats": [FORMATS[field["datatype"]] for field in fields],
                       "offsets": [field["offset"] for field in fields], "itemsize": cloud["point_step"]})  # fmt: skip
    points = np.frombuffer(bytes.fromhex(cloud["data"]), layout)
    assert (cloud["height"], cloud["width"], cloud["is_bigendian"]) == (1, len(points), False)
    at = int(header["stamp"]["sec"]) * 1_000_000_000 + int(header["stamp"]["nanosec"])
    return at, header["frame_id"], points


Sensed = tuple[Run, dict[str, list[Cloud]]]


@pytest.fixture(scope="module")
def sensed(tmp_path_factory: pytest.TempPathFactory) -> Sensed:
    """The record of a short drive, and the clouds that a node heard."""
    run, messages = heard(tmp_path_factory)
    return run, {topic: [_read(cloud) for cloud in messages[topic]] for topic in SENSES}


def _recorded(run: Run, sensor: str, *columns: str) -> dict[int, dict[str, NDArray[Any]]]:
    """Return each reading's columns of the record, by the Unix time of its measurement [ns]."""
    table = run.sensed[sensor]
    whole = {name: table.rows[name].to_numpy() for name in columns}
    return {1000 * unix_of_drive(run, at): {name: column[table.of_reading(number)] for name, column in whole.items()}
            for number, at in enumerate(table.measured.tolist())}  # fmt: skip


def _same_readings(clouds: list[Cloud], recorded: dict[int, Any], name: str) -> None:
    """Each reading came once, in order, in the sensor's frame; the first ones are of before the first valid tick."""
    stamps = [at for at, _, _ in clouds]
    assert stamps
    assert [at for at in recorded if at >= stamps[0]][: len(stamps)] == stamps
    assert len(stamps) > 0.9 * len(recorded)
    assert {frame for _, frame, _ in clouds} == {name}


def test_every_turn_of_the_lidar_is_the_recorded_one(sensed: Sensed) -> None:
    run, clouds = sensed
    names = ("channel", "azimuth_rad", "elevation_rad", "range_m", "reflectivity")
    recorded = _recorded(run, "roof", *names)
    _same_readings(clouds["/roof/points"], recorded, "roof")
    for at, _, points in clouds["/roof/points"]:
        channel, azimuth, elevation, far, reflectivity = recorded[at].values()
        assert len(points) == len(far) > 5000
        level = far * np.cos(elevation)
        wanted = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), far * np.sin(elevation)], axis=1)
        got = np.stack([points[axis] for axis in "xyz"], axis=1)
        assert np.abs(got - wanted).max() < 2e-5
        assert (points["ring"] == channel).all()
        assert (points["intensity"] == reflectivity).all()
        assert -0.1 <= points["time"].min() < points["time"].max() <= 0.0
        assert (np.diff(points["time"]) >= 0.0).all()


def test_every_list_of_the_camera_is_the_recorded_one(sensed: Sensed) -> None:
    run, clouds = sensed
    columns = {"number": "number", "kind": "kind", "status": "status", "x": "x_m", "y": "y_m",
               "relative_speed": "relative_speed_mps", "width": "width_m", "length": "length_m"}  # fmt: skip
    recorded = _recorded(run, "front", *columns.values())
    _same_readings(clouds["/front/objects"], recorded, "front")
    assert sum(len(points) for _, _, points in clouds["/front/objects"]) > 10
    for at, _, points in clouds["/front/objects"]:
        for name, column in columns.items():
            assert points[name].tolist() == recorded[at][column].astype(points[name].dtype).tolist(), name


def test_every_scan_of_a_second_radar_is_the_recorded_one(sensed: Sensed) -> None:
    run, clouds = sensed
    recorded = _recorded(run, "second", "range_m", "azimuth_rad", "range_rate_mps")
    _same_readings(clouds["/second/points"], recorded, "second")
    assert sum(len(points) for _, _, points in clouds["/second/points"]) > 10
    for at, _, points in clouds["/second/points"]:
        wanted = np.stack(list(recorded[at].values()), axis=1).astype("<f4")
        got = np.stack([points[name] for name in ("range", "azimuth", "range_rate")], axis=1)
        assert got.tolist() == wanted.tolist()


def test_every_message_of_v2x_that_was_received_is_among_the_stations(sensed: Sensed) -> None:
    run, clouds = sensed
    columns = {"x": "x_m", "y": "y_m", "speed": "speed_mps", "heading": "heading_rad", "length": "length_m",
               "width": "width_m", "uncertainty": "uncertainty_m", "age": "age_s"}  # fmt: skip
    recorded = _recorded(run, "obu", "station", "message", *columns.values())
    received = 0
    for at, frame, points in clouds["/obu/stations"]:
        assert frame == "obu"
        of_now = recorded.get(at, {"station": np.zeros(0)})
        for row, station in enumerate(of_now["station"].tolist()):
            (point,) = points[points["number"] == station]
            assert point["message"] == of_now["message"][row]
            for name, column in columns.items():
                assert point[name] == np.float32(of_now[column][row]), name
            received += 1
    assert received > 5
