"""Measurements as clouds and detections, read by what their own fields say, against the values they are made of."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vve_sumo.body_kinds import TYPICAL, number_of
from vve_sumo.sensors.camera import no_objects
from vve_sumo.values import CameraObjects, PointCloud, Stations, StopLines

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
from vve_sumo.wire.ros2 import clouds
from vve_sumo.wire.vlp16 import turn_of

AT = 1_767_225_600_020_000_000
FORMATS = {1: "i1", 2: "u1", 4: "<u2", 6: "<u4", 7: "<f4", 8: "<f8"}
LISTED = dataclasses.replace(
    no_objects(0.0), number=np.array([7, 9]), kind=np.array([number_of("van"), number_of("child")], np.int8),
    status=np.array([3, 1], np.int8), x=np.array([20.0, 31.5]), y=np.array([-1.5, 2.25]),
    relative_speed=np.array([-8.0, -11.0]), width=np.array([2.0, 0.35]), length=np.array([5.9, 0.5]),
)  # fmt: skip


def _read(cloud: Any) -> NDArray[Any]:
    layout = np.dtype({"names": [field.name for field in cloud.fields], "itemsize": cloud.point_step,
                       "formats": [FORMATS[field.datatype] for field in cloud.fields],
                       "offsets": [field.offset for field in cloud.fields]})  # fmt: skip
    points = np.frombuffer(cloud.data.tobytes(), layout)
    assert (cloud.height, cloud.width, cloud.row_step) == (1, len(points), len(points) * cloud.point_step)
    return points


def test_a_turn_is_the_points_of_its_rays_that_came_back() -> None:
    generator = np.random.default_rng(1)
    far = np.round(generator.uniform(0.5, 100.0, (20, 3)) / 0.002) * 0.002
    far[generator.random(far.shape) < 0.3] = 0.0
    cloud = PointCloud(
        0.1, np.radians(np.linspace(180.0, -160.0, 20)), np.array([0.0, -1e-3, -2e-3]), np.radians([-15.0, 0.0, 15.0]),
        np.linspace(-19e-4, 0.0, 20), far, generator.integers(0, 100, far.shape).astype(np.int8),
    )  # fmt: skip
    points = _read(clouds.lidar_cloud(AT, turn_of(cloud), "roof"))
    got = np.stack([points[axis] for axis in "xyz"], axis=1)
    assert np.abs(got - cloud.points()).max() < 0.01 * math.pi / 180.0 * 100.0  # azimuths are in steps of 0.01 degrees
    firing, channel = np.nonzero(far)
    assert points["ring"].tolist() == channel.tolist()
    assert points["intensity"].tolist() == cloud.reflectivity[firing, channel].tolist()
    assert points["time"] == pytest.approx(cloud.time_offset[firing], abs=1e-9)


def _stations() -> Stations:
    columns: dict[str, Any] = {name: np.array([0.25, -3.5]) for name in Stations.__slots__}
    fixed = {"time": 1.0, "number": np.array([4_000_000_000, 2]), "message": np.array([2, 16], np.int8),
             "kind": np.array([0, 6], np.int8), "objects": None, "events": None}  # fmt: skip
    return Stations(**(columns | fixed))


def _stop_lines() -> StopLines:
    columns: dict[str, Any] = {name: np.array([0.25, -3.5]) for name in StopLines.__slots__}
    fixed = {"time": 1.0, "intersection": np.array([1, 70_000]), "group": np.array([3, 0]),
             "phase": np.array([3, 6], np.int8)}  # fmt: skip
    return StopLines(**(columns | fixed))


@pytest.mark.parametrize("table", [LISTED, _stations(), _stop_lines()], ids=lambda table: type(table).__name__)
def test_a_table_is_a_cloud_with_a_field_for_each_column(table: CameraObjects | Stations | StopLines) -> None:
    cloud = clouds.table_cloud(AT, table, "front")
    points = _read(cloud)
    assert cloud.header.frame_id == "front"
    assert points.dtype.names is not None
    assert points.dtype.names[:3] == ("x", "y", "z")
    # Where on the earth a station is its own fix says; what others report of others has tables of its own.
    left_out = {"time", "latitude", "longitude", "true_heading", "objects", "events"}
    left_out |= {"lane_known", "lane_left", "lane_right"}
    assert {*points.dtype.names} == {*table.__slots__} - left_out | {"z"}
    for name in set(points.dtype.names) - {"z"}:
        assert points[name].tolist() == getattr(table, name).astype(points[name].dtype).tolist(), name


def test_detections_are_boxes_behind_the_near_sides() -> None:
    van, child = clouds.detections(AT, LISTED, "front").detections
    assert (van.results[0].hypothesis.class_id, van.results[0].hypothesis.score, van.id) == ("van", 1.0, "7")
    assert (van.bbox.size.x, van.bbox.size.y, van.bbox.size.z) == (5.9, 2.0, TYPICAL["van"].height)
    assert van.bbox.center.position.x - 0.5 * van.bbox.size.x == pytest.approx(20.0)
    assert van.bbox.center.position.y == -1.5
    assert van.bbox.center.position.z - 0.5 * van.bbox.size.z == pytest.approx(0.0)
    assert (child.results[0].hypothesis.class_id, child.results[0].pose.pose) == ("child", child.bbox.center)
