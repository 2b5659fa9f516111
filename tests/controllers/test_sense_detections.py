"""Detections of a lidar's points and a camera's objects, against the bodies that were looked at (shapely)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import Point as Place
from shapely.geometry import Polygon

from controllers.camera_detections import CameraDetections
from controllers.lidar_detections import LidarDetections
from tests.controllers.bench import ROAD
from tests.sensors.scenes import BUMPER, FUSION, Row, actors, car, rear_axle
from tests.sensors.test_camera import IDEAL as IDEAL_CAMERA
from tests.sensors.test_camera import last
from tests.sensors.test_lidar import IDEAL, driven, pose_at
from vve_sumo.geometry import Box
from vve_sumo.values import Detections, Observation, Pose, SensorOutput

SPAN = 0.2 + 0.02  #: drive time in which two turns come out [s]


def observed(sensor: str, output: SensorOutput, pose: Pose, time: float) -> Observation:
    return Observation(0, time, replace(pose, time=time), ROAD, 10.0, {sensor: output}, 0.0)


def by_lidar(rows: Sequence[Row], kind: str = "car", *, speed: float = 0.0, yaw_rate: float = 0.0) -> Detections:
    """What a controller makes of the last of the turns of a drive that sees standing bodies."""
    scene = actors(rows, kind=kind)
    turns = driven(IDEAL, SPAN, speed=speed, yaw_rate=yaw_rate, scene=scene)
    sense, found = LidarDetections(FUSION, "roof", IDEAL.x, IDEAL.z), None
    for time, turn in turns:
        for tick in range(round((time - 0.1) / 0.02), round(time / 0.02) + 1):
            found = sense.scan(observed("roof", turn.cloud, pose_at(0.02 * tick, speed, yaw_rate), 0.02 * tick))
    assert found is not None
    assert found.time == turns[-1][1].cloud.time
    return found


def places(found: Detections, pose: Pose) -> np.ndarray:
    """Where detections are in the scene."""
    bearing = pose.heading + found.azimuth
    x = pose.x + BUMPER * math.cos(pose.heading) + found.range * np.cos(bearing)
    y = pose.y + BUMPER * math.sin(pose.heading) + found.range * np.sin(bearing)
    return np.stack((x, y), axis=-1)


def bodies(rows: Sequence[Row]) -> list[Polygon]:
    return [Polygon(Box(x, y, heading, length, width).corners()) for x, y, heading, _, length, width, _ in rows]


@pytest.mark.parametrize("seed", range(30))
def test_each_body_is_one_detection_at_its_nearest_point(seed: int) -> None:
    """Bodies in directions of their own, so that none hides another, each wherever it points to."""
    chance = np.random.default_rng(seed)
    rows = []
    for bearing in np.arange(-0.6, 0.61, 0.3) + chance.uniform(-0.05, 0.05, 5):
        far = chance.uniform(12.0, 30.0)
        x, y = BUMPER + far * math.cos(bearing), far * math.sin(bearing)
        rows.append((x, y, chance.uniform(-3.1, 3.1), 0.0, 2.0, 0.8, 10.0))
    found = by_lidar(rows)
    seen = places(found, rear_axle())
    front = Place(BUMPER, 0.0)
    for body in bodies(rows):
        near = [one for one in seen if body.distance(Place(*one)) < 0.05]
        assert len(near) == 1
        # A ray meets a body each 0.2 degrees: nearly at its nearest point.
        assert body.distance(front) <= front.distance(Place(*near[0])) + 1e-6
        assert front.distance(Place(*near[0])) == pytest.approx(body.distance(front), abs=0.25)
    assert len(seen) == len(rows)


@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.0, 0.0), (12.0, 0.0), (8.0, 0.4), (5.0, -0.6)])
def test_the_car_s_motion_during_a_turn_is_taken_out(speed: float, yaw_rate: float) -> None:
    """At 12 m/s the car goes on by half a metre from the ray ahead to the turn's end."""
    rows = [car(26.0, -2.0), car(22.0, 5.0, 1.0)]
    found = by_lidar(rows, speed=speed, yaw_rate=yaw_rate)
    seen = places(found, pose_at(found.time, speed, yaw_rate))
    off = [min(body.boundary.distance(Place(*one)) for body in bodies(rows)) for one in seen]
    assert len(seen) == 2
    assert max(off) < 0.05


def test_a_long_flank_seen_at_a_grazing_angle_is_one_thing() -> None:
    bus = (30.0, -3.0, 0.0, 0.0, 18.0, 2.5, 10.0)
    found = by_lidar([bus], "bus")
    assert found.range.tolist() == pytest.approx([math.hypot(21.0 - BUMPER, 1.75)], abs=0.1)


def test_a_child_between_two_parked_cars_is_a_thing_of_its_own() -> None:
    child = (18.0, -1.3, math.pi / 2.0, 0.0, 0.5, 0.35, 0.5)
    rows = [car(14.7, -2.8), car(21.3, -2.8), child]
    seen = places(by_lidar(rows), rear_axle())
    assert sum(bodies([child])[0].distance(Place(*one)) < 0.05 for one in seen) == 1
    assert len(seen) == 3


def test_the_road_and_what_the_car_passes_below_are_no_things() -> None:
    assert len(by_lidar([]).range) == 0


def test_a_lidar_knows_no_speed() -> None:
    found = by_lidar([car(20.0, 0.0)], speed=10.0)
    assert np.isnan(found.range_rate).all()


def test_a_camera_s_object_is_detected_at_the_edge_that_is_next_to_the_car_s_axis() -> None:
    rows = [car(30.0, 4.0), car(40.0, -3.0), car(50.0, 0.3)]
    objects = last(IDEAL_CAMERA, actors(rows), speed=10.0).objects
    sense = CameraDetections("front", IDEAL_CAMERA.view.focal, IDEAL_CAMERA.z)
    found = sense.scan(observed("front", objects, rear_axle(speed=10.0), 1.0))
    seen = sorted(places(found, rear_axle()).tolist())
    assert np.array(seen) == pytest.approx(np.array([[27.75, 3.1], [37.75, -2.1], [47.75, 0.0]]), abs=1e-6)
    # All of them stand: they come nearer by the car's speed along the line of sight.
    assert found.range_rate.tolist() == pytest.approx((-10.0 * np.cos(found.azimuth)).tolist())


def test_a_camera_knows_a_distance_as_its_pixels_tell_it() -> None:
    """Errors that are alike from picture to picture count as larger ones that are not."""
    view = IDEAL_CAMERA.view
    sense = CameraDetections("front", view.focal, IDEAL_CAMERA.z)
    alike = math.sqrt(1.9 / 0.1)
    assert sense.noise.growth * 30.0**2 == pytest.approx(alike * 30.0**2 / (view.focal * IDEAL_CAMERA.z))


@pytest.mark.parametrize(
    ("sense", "kind"),
    [(LidarDetections(FUSION, "roof", 1.4, 1.9), "lidar"), (CameraDetections("roof", 1312.0, 1.3), "camera")],
    ids=["lidar", "camera"],
)
def test_a_sensor_that_is_not_there_is_named(sense: LidarDetections | CameraDetections, kind: str) -> None:
    empty = Observation(0, 0.0, rear_axle(), ROAD, 10.0, {}, 0.0)
    with pytest.raises(TypeError, match=f"no sensor 'roof' of kind {kind}: name it by the tuning key sensor"):
        sense.scan(empty)
