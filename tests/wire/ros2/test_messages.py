"""Our values in ROS 2's fields: frames of REP 103 and 105, stamps, variances; against closed forms, without ROS."""

from __future__ import annotations

import datetime
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.body_kinds import number_of
from vve_sumo.path import ReferencePath
from vve_sumo.values import Actors, Fix, FixQuality, Floats, Point, Pose

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
from vve_sumo.wire.ros2 import clouds, messages
from vve_sumo.wire.ros2.types import decode, encode, store

AT = 1_767_225_600_020_000_000  # 2026-01-01 00:00:00.02 UTC [ns]
POSE = Pose(0.0, Point.REAR_AXLE, 12.0, -7.5, 2.5, 9.25, -0.125, 0.0625, -1.5, 0.02)
angles = st.floats(-math.pi, math.pi)


def _fix(**changes: Any) -> Fix:
    given_: dict[str, Any] = {
        "time": 0.0, "time_received": 0.0, "latitude": 0.7, "longitude": -1.45, "altitude": 230.0, "heading": 1.0,
        "pitch": 0.1, "roll": -0.05, "velocity_north": 1.0, "velocity_east": 2.0, "velocity_down": 0.0,
        "yaw_rate": 0.2, "acceleration": 1.25, "locked": True, "quality": FixQuality.RTK_FIXED,
        "position_sigma": 0.02, "velocity_sigma": 0.03, "heading_sigma": 0.001,
    }  # fmt: skip
    return Fix(**(given_ | changes))


def _pose(x: float, y: float, heading: float) -> Pose:
    return Pose(0.0, Point.REAR_AXLE, x, y, heading, 0.0, 0.0, 0.0, 0.0, 0.0)


def _turned(orientation: Any, vector: tuple[float, float, float]) -> Floats:
    """Turn a vector by Hamilton's product q v q*, with quaternions as 2 by 2 complex matrices."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    basis = [np.array(m) for m in ([[1j, 0], [0, -1j]], [[0, 1], [-1, 0]], [[0, 1j], [1j, 0]])]
    q = w * np.eye(2) + x * basis[0] + y * basis[1] + z * basis[2]
    v = sum(part * each for part, each in zip(vector, basis, strict=True))
    turned = q @ v @ q.conj().T
    return np.array([turned[0, 0].imag, turned[0, 1].real, turned[0, 1].imag])


def test_a_stamp_is_unix_time_of_the_same_instant() -> None:
    # A leap second is in GNSS time; 18 of them lie between 1980 and 2026.
    instant = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
    gnss = (instant - datetime.datetime(1980, 1, 6, tzinfo=datetime.UTC)).total_seconds() + 18
    at = messages.unix_nanoseconds(gnss + 0.02)
    assert at == AT
    stamp = messages.clock(at).clock
    assert (stamp.sec, stamp.nanosec) == (int(instant.timestamp()), 20_000_000)


@given(angles)
def test_the_heading_turns_base_link_in_the_map(heading: float) -> None:
    orientation = messages.odometry(AT, _pose(0.0, 0.0, heading)).pose.pose.orientation
    assert _turned(orientation, (1, 0, 0)) == pytest.approx([math.cos(heading), math.sin(heading), 0], abs=1e-12)
    assert _turned(orientation, (0, 0, 1)) == pytest.approx([0, 0, 1], abs=1e-12)


@given(angles, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_the_imu_turns_as_the_car_does(heading: float, pitch: float, roll: float) -> None:
    imu = messages.imu(AT, _fix(heading=heading, pitch=pitch, roll=roll))
    nose, left = _turned(imu.orientation, (1, 0, 0)), _turned(imu.orientation, (0, 1, 0))
    assert nose == pytest.approx(
        [math.cos(pitch) * math.cos(heading), math.cos(pitch) * math.sin(heading), math.sin(pitch)], abs=1e-12
    )  # nose up is up
    assert left[2] == pytest.approx(math.sin(roll) * math.cos(pitch), abs=1e-12)  # right side down is left side up


def test_odometry_has_the_pose_in_odom_and_the_speeds_in_base_link() -> None:
    got = messages.odometry(AT, POSE, _fix())
    assert (got.header.frame_id, got.child_frame_id) == ("odom", "base_link")
    place, twist = got.pose.pose.position, got.twist.twist
    assert (place.x, place.y, place.z) == (12.0, -7.5, 0.0)
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == (9.25, -0.125, 0.0625)
    assert np.diag(got.pose.covariance.reshape(6, 6)) == pytest.approx([4e-4, 4e-4, 1e6, 1e6, 1e6, 1e-6])
    assert np.diag(got.twist.covariance.reshape(6, 6)) == pytest.approx([9e-4, 9e-4, 1e6, 1e6, 1e6, 0.0])
    assert not messages.odometry(AT, POSE).pose.covariance.any()
    assert not messages.odometry(AT, POSE, _fix(position_sigma=math.nan)).pose.covariance.any()


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), angles)
def test_the_frames_lead_from_the_map_to_the_front_bumper(x: float, y: float, heading: float) -> None:
    pose = _pose(x, y, heading)
    frames = [*messages.static_transforms(AT, 3.84, (0.3, 0.2)).transforms, *messages.transforms(AT, pose).transforms]
    parents = {each.child_frame_id: each for each in frames}
    assert {child: each.header.frame_id for child, each in parents.items()} == {
        "odom": "map", "base_link": "odom", "radar": "base_link", "gnss": "base_link"
    }  # fmt: skip

    def in_map(frame: str, point: tuple[float, float, float]) -> Floats:
        if frame == "map":
            return np.array(point)
        moved = parents[frame].transform
        turned = _turned(moved.rotation, point)
        at = turned + np.array([moved.translation.x, moved.translation.y, moved.translation.z])
        return in_map(parents[frame].header.frame_id, (at[0], at[1], at[2]))

    cos, sin = math.cos(heading), math.sin(heading)
    assert in_map("radar", (0, 0, 0)) == pytest.approx([x + 3.84 * cos, y + 3.84 * sin, 0], abs=1e-8)
    assert in_map("gnss", (0, 0, 0)) == pytest.approx(
        [x + 0.3 * cos - 0.2 * sin, y + 0.3 * sin + 0.2 * cos, 0], abs=1e-8
    )


def test_a_fix_is_in_degrees_with_its_variances_and_its_status() -> None:
    got = messages.nav_sat_fix(AT, _fix())
    assert (got.latitude, got.longitude) == pytest.approx((math.degrees(0.7), math.degrees(-1.45)), abs=1e-12)
    assert got.altitude == 230.0
    assert (got.status.status, got.status.service, got.position_covariance_type) == (2, 1, 1)
    assert np.diag(got.position_covariance.reshape(3, 3)) == pytest.approx([4e-4, 4e-4, 1e6])
    unknown = messages.nav_sat_fix(AT, _fix(position_sigma=math.nan))
    assert unknown.position_covariance_type == 0
    assert messages.nav_sat_fix(AT, _fix(locked=False)).status.status == -1
    assert messages.STATUS.keys() == set(FixQuality)


@given(st.lists(st.tuples(st.floats(0.5, 200.0), st.floats(-1.5, 1.5), st.floats(-60.0, 60.0)), max_size=64))
def test_a_scan_is_a_cloud_that_its_own_fields_describe(rows: list[tuple[float, float, float]]) -> None:
    columns = np.array(rows).reshape(-1, 3).T
    got = clouds.radar_cloud(AT, *columns)
    layout = np.dtype({"names": [f.name for f in got.fields], "formats": ["<f4"] * 6, "itemsize": got.point_step,
                       "offsets": [f.offset for f in got.fields]})  # fmt: skip
    points = np.frombuffer(got.data.tobytes(), layout)
    assert (got.height, got.width, got.row_step) == (1, len(rows), len(rows) * got.point_step)
    assert got.header.frame_id == "radar"
    assert all(field.datatype == 7 and field.count == 1 for field in got.fields)
    for point, (far, azimuth, rate) in zip(points, rows, strict=True):
        assert point["x"] == pytest.approx(far * math.cos(azimuth), abs=1e-4)
        assert point["y"] == pytest.approx(far * math.sin(azimuth), abs=1e-4)
        assert (point["range"], point["range_rate"]) == (np.float32(far), np.float32(rate))


def test_bodies_are_boxes_that_stand_on_the_ground() -> None:
    columns: Any = {
        "x": (1.0, 5.0), "y": (2.0, 6.0), "heading": (0.5, -0.5), "speed": (3.0, 0.0), "length": (5.9, 0.5),
        "width": (2.0, 0.35), "radar_cross_section": (10.0, 0.1), "lateral_speed": (0.0, 0.0), "height": (2.3, 1.2),
    }  # fmt: skip
    kinds = np.array([number_of("van"), number_of("child")], np.int8)
    actors = Actors(0.0, ("van", "child"), **{name: np.array(pair) for name, pair in columns.items()}, kind=kinds)
    cleared, van, child = messages.markers(AT, actors).markers
    assert cleared.action == 3  # DELETEALL
    assert (van.ns, van.text, van.type, van.action, van.header.frame_id) == ("van", "van", 1, 0, "map")
    assert (van.scale.x, van.scale.y, van.scale.z, van.pose.position.z) == (5.9, 2.0, 2.3, 1.15)
    assert (child.ns, child.pose.position.x, child.pose.position.y) == ("child", 5.0, 6.0)
    assert child.color.r != van.color.r


def test_the_path_is_a_pose_every_metre_and_its_end() -> None:
    line = ReferencePath.from_points(np.array([0.0, 3.0, 4.5]), np.array([0.0, 4.0, 6.0]))
    got = messages.path(AT, line)
    places = np.array([(each.pose.position.x, each.pose.position.y) for each in got.poses])
    steps = np.hypot(*np.diff(places, axis=0).T)
    assert steps[:-1] == pytest.approx(np.ones(len(steps) - 1), abs=1e-6)
    assert places[-1] == pytest.approx([4.5, 6.0], abs=1e-6)


def test_the_diagnostics_say_state_reasons_and_gap() -> None:
    (status,) = messages.drive_status(AT, "stopping", ("pose_stale", "off_path"), valid=False, gap=12.5).status
    values = {pair.key: pair.value for pair in status.values}
    assert (status.level, status.message) == (2, "stopping")
    assert values == {"state": "stopping", "reasons": "pose_stale+off_path", "valid": "false", "gap_m": "12.500"}
    assert messages.drive_status(AT, "engaged", (), valid=True, gap=math.nan).status[0].level == 0


def test_every_type_is_whole_in_cdr() -> None:
    made = [
        messages.clock(AT), messages.odometry(AT, POSE, _fix()), messages.transforms(AT, POSE),
        messages.nav_sat_fix(AT, _fix()), messages.imu(AT, _fix()), messages.markers(AT, Actors.none(0.0)),
        clouds.radar_cloud(AT, np.zeros(0), np.zeros(0), np.zeros(0)),
        messages.diagnostics(AT, 1, "a", {"b": "c"}),
    ]  # fmt: skip
    for message in made:
        assert encode(decode(encode(message), message.__msgtype__)) == encode(message)
    assert set(messages.TOPICS.values()) <= store().fielddefs.keys()
