"""OSI messages, read back by the official classes and traces; places and speeds against plain geometry."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pyproj
import pytest

from tests.vehicles import FUSION as MODEL
from vve_sumo.body_kinds import number_of
from vve_sumo.frames import MapFrame, move_point
from vve_sumo.values import Actors, Detections, Point, Pose

pytest.importorskip("osi3", reason="needs the extra osi")
from vve_sumo.wire.osi import FIRST_ACTOR, HOST, Encoder

FUSION = MODEL.vehicle
TIME = 1_400_000_000.02
POSE = Pose(2.0, Point.REAR_AXLE, 120.0, -40.0, 2.1, 9.0, 0.2, 0.3, -1.0, 0.0)
ACTORS = Actors(
    2.0,
    ("parked_car", "walker"),
    np.array([140.0, 130.0]),
    np.array([-20.0, -30.0]),
    np.array([1.0, -2.0]),
    np.array([0.0, 1.4]),
    np.array([4.5, 0.5]),
    np.array([1.8, 0.5]),
    np.array([10.0, 0.5]),
    np.array([0.0, 0.1]),
    np.array([1.5, 1.7]),
    np.array([number_of("car"), number_of("pedestrian")], np.int8),
)
SCAN = Detections(
    1.91, np.array([22.3, 40.1]), np.array([0.05, -0.2]), np.array([-9.0, 3.0]), np.array([0, 1], np.int8)
)


def _encoder() -> Encoder:
    return Encoder(FUSION, "+proj=utm +zone=17")


def test_the_ego_lies_where_the_pose_puts_its_box() -> None:
    view = _encoder().sensor_view(TIME, POSE, ACTORS)
    ego = next(each for each in view.global_ground_truth.moving_object if each.id.value == HOST)
    centre = move_point(POSE, FUSION.length / 2.0 - FUSION.rear_overhang, 0.0, Point.CENTRE)
    assert (ego.base.position.x, ego.base.position.y) == pytest.approx((centre.x, centre.y))
    cos, sin = math.cos(centre.heading), math.sin(centre.heading)
    along = ego.base.velocity.x * cos + ego.base.velocity.y * sin
    across = -ego.base.velocity.x * sin + ego.base.velocity.y * cos
    assert (along, across) == pytest.approx((centre.speed, centre.lateral_speed))
    rear = ego.vehicle_attributes.bbcenter_to_rear
    assert ego.base.position.x + rear.x * cos - rear.y * sin == pytest.approx(POSE.x)
    assert ego.base.position.y + rear.x * sin + rear.y * cos == pytest.approx(POSE.y)
    assert (ego.base.dimension.length, ego.base.dimension.width) == (FUSION.length, FUSION.width)


def test_actors_as_they_are_and_keep_their_identifiers() -> None:
    encoder = _encoder()
    truth = encoder.sensor_view(TIME, POSE, ACTORS).global_ground_truth
    _, parked, walker = truth.moving_object
    assert [each.id.value for each in (parked, walker)] == [FIRST_ACTOR, FIRST_ACTOR + 1]
    assert parked.type == parked.TYPE_VEHICLE
    assert walker.type == walker.TYPE_PEDESTRIAN
    assert (walker.base.position.x, walker.base.position.y) == (130.0, -30.0)
    assert walker.base.orientation.yaw == -2.0
    assert math.hypot(walker.base.velocity.x, walker.base.velocity.y) == pytest.approx(math.hypot(1.4, 0.1))
    later = Actors(2.02, ("walker",), *(getattr(ACTORS, column.name)[1:] for column in fields(Actors)[2:]))
    (_, again) = encoder.sensor_view(TIME + 0.02, POSE, later).global_ground_truth.moving_object
    assert again.id.value == FIRST_ACTOR + 1


def test_detections_lie_in_the_frame_of_the_front_bumper() -> None:
    data = _encoder().sensor_data(TIME, SCAN, 0.09)
    (radar,) = data.feature_data.radar_sensor
    assert radar.header.mounting_position.position.x == FUSION.rear_axle_to_bumper
    assert radar.header.data_qualifier == radar.header.DATA_QUALIFIER_AVAILABLE
    assert radar.header.number_of_valid_detections == 2
    stamp = radar.header.measurement_time
    assert stamp.seconds + stamp.nanos / 1e9 == pytest.approx(TIME - 0.09, abs=1e-6)
    read = [(each.position.distance, each.position.azimuth, each.radial_velocity) for each in radar.detection]
    assert read == list(zip(SCAN.range.tolist(), SCAN.azimuth.tolist(), SCAN.range_rate.tolist(), strict=True))


def test_an_invalid_message_has_no_detection() -> None:
    encoder = _encoder()
    (radar,) = encoder.sensor_data(TIME, SCAN, 0.09, valid=False).feature_data.radar_sensor
    assert radar.header.data_qualifier == radar.header.DATA_QUALIFIER_NOT_AVAILABLE
    assert not radar.detection
    (after,) = encoder.sensor_data(TIME, SCAN, 0.09).feature_data.radar_sensor
    assert after.header.cycle_counter == radar.header.cycle_counter + 1


def test_a_trace_is_read_back_by_the_official_reader(tmp_path: Path) -> None:
    from osi_utilities import ReadStatus, SingleTraceReader, SingleTraceWriter

    encoder, file = _encoder(), tmp_path / "20260101T000000Z_sd_3.8.0_1.0.0_2_trace.osi"
    messages = [encoder.sensor_data(TIME + 0.05 * n, SCAN, 0.09) for n in range(2)]
    writer = SingleTraceWriter()
    assert writer.open(file)
    for message in messages:
        writer.write_message(message)
    writer.close()
    reader = SingleTraceReader()
    assert reader.open(file)
    read = []
    while (result := reader.read_message()) is not None and getattr(result, "status", ReadStatus.OK) == ReadStatus.OK:
        read.append(result.message)
    assert [each.SerializeToString() for each in read] == [each.SerializeToString() for each in messages]


def test_the_maps_places_lead_back_to_latitude_and_longitude_by_the_messages_own_projection():
    """As OSI defines `proj_frame_offset`: added to the coordinates, before the inverse of `proj_string`, by pyproj."""
    frame = MapFrame("+proj=utm +zone=17 +ellps=WGS84 +datum=WGS84 +units=m +no_defs", (1312.11, 1525.97))
    truth = Encoder(FUSION, frame.projection, frame.offset).sensor_view(TIME, POSE, ACTORS).global_ground_truth
    shift, ego = truth.proj_frame_offset.position, truth.moving_object[0].base.position
    longitude, latitude = pyproj.Proj(truth.proj_string)(ego.x + shift.x, ego.y + shift.y, inverse=True)
    expected = frame.to_geodetic(ego.x, ego.y)
    assert (math.radians(latitude), math.radians(longitude)) == pytest.approx(expected, abs=1e-12)
