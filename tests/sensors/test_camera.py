"""The camera's list: what is in it, where, and how wrong; numbers, status, lanes, false objects and latency."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.sensors.scenes import BUMPER, FUSION, actors, car, rear_axle
from vve_sumo.body_kinds import number_of
from vve_sumo.sensors.camera import Camera, CameraConfig, CameraFrame, Status
from vve_sumo.sensors.street import Building, Lanes, LaneStrip, walls_of
from vve_sumo.values import Actors

PERIOD = 0.02
CONFIG = CameraConfig()
IDEAL = CONFIG.ideal()
NO_WALLS = walls_of(())
NO_LANES = Lanes(())
#: a street of two lanes of 3.2 m along +x, and a crossing one
STREET = Lanes(
    [
        LaneStrip(np.array([-50.0, 200.0]), np.array([0.0, 0.0]), 3.2),
        LaneStrip(np.array([200.0, -50.0]), np.array([3.2, 3.2]), 3.2),
        LaneStrip(np.array([5.0, 5.0]), np.array([-50.0, 50.0]), 3.0),
    ]
)


def watched(
    config: CameraConfig, scene: Actors, seconds: float = 1.0, *, seed: int = 1, speed: float = 0.0,
    lanes: Lanes = NO_LANES, walls: object = NO_WALLS,
) -> list[tuple[float, CameraFrame]]:  # fmt: skip
    """The lists of a standing ego, whatever its speed, each with the time at which it came out."""
    camera, found = Camera(config, FUSION, np.random.default_rng(seed), walls, lanes), []  # type: ignore[arg-type]
    for tick in range(round(seconds / PERIOD) + 1):
        frame = camera.step(tick * PERIOD, rear_axle(speed=speed), scene)
        camera.prepare()
        if frame is not None:
            found.append((tick * PERIOD, frame))
    return found


def last(config: CameraConfig, scene: Actors, **more: object) -> CameraFrame:
    return watched(config, scene, **more)[-1][1]  # type: ignore[arg-type]


# --- where ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("heading", "near"), [(0.0, 2.25), (math.pi, 2.25), (0.5 * math.pi, 0.9)])
def test_a_place_is_that_of_the_near_side_from_the_front_bumper(heading: float, near: float) -> None:
    objects = last(IDEAL, actors([car(40.0, 2.0, heading)])).objects
    assert objects.x.tolist() == pytest.approx([40.0 - near - BUMPER])
    assert objects.y.tolist() == pytest.approx([2.0])
    assert (objects.width.tolist(), objects.length.tolist()) == ([1.8], [4.5])


def test_a_turned_car_s_near_side_lies_nearer_on_its_own_axis() -> None:
    objects = last(IDEAL, actors([car(40.0, 0.0, 0.3)])).objects
    assert objects.x.tolist() == pytest.approx([40.0 - 2.25 * math.cos(0.3) - BUMPER])
    assert objects.y.tolist() == pytest.approx([-2.25 * math.sin(0.3)])


def test_who_stands_alone_shows_all_of_itself_also_from_above() -> None:
    """The cabin stands on the rest of a car: from above the roof of the lower part lies over the cabin's foot."""
    high = replace(IDEAL, z=2.4)
    for far in (8.0, 15.0, 40.0):
        frame = last(high, actors([car(far + BUMPER, 1.0, 0.3)]))
        assert list(frame.visible) == [1.0], far


def test_a_car_beside_the_camera_is_not_listed_though_its_front_is_in_the_picture() -> None:
    """Its near side is beside the camera: no picture shows where that meets the road."""
    beside = actors([(3.6, -2.0, 0.0, 0.0, 6.0, 1.8, 10.0)])
    assert len(last(replace(IDEAL, min_visible=0.0, min_rows=1.0), beside).objects.x) == 0
    ahead = actors([(8.6, -2.0, 0.0, 0.0, 6.0, 1.8, 10.0)])
    assert last(replace(IDEAL, min_visible=0.0, min_rows=1.0), ahead).objects.x.tolist() == pytest.approx(
        [5.6 - BUMPER]
    )


def test_a_speed_is_relative_and_opening() -> None:
    scene = actors([car(30.0, 0.0, 0.0, 8.0), car(50.0, -4.0, math.pi, 5.0)])
    assert last(IDEAL, scene, speed=10.0).objects.relative_speed.tolist() == pytest.approx([-2.0, -15.0])


@pytest.mark.thorough
def test_the_error_of_the_range_grows_with_its_square() -> None:
    """A pixel is x^2 / (f h): 0.53 m at 30 m from the camera, 2.1 m at 60 m."""
    config = replace(CONFIG, noise_correlation=0.0, miss_rate=0.0, latency=0.0)
    for distance in (30.0, 60.0):
        scene = actors([car(distance + 2.25 + config.x, 0.0)])
        lists = [frame.objects for _, frame in watched(config, scene, 60.0)]
        x = np.array([objects.x[0] for objects in lists]) - (distance + config.x - BUMPER)
        sigma = distance**2 / (config.view.focal * config.z)
        assert x.std() == pytest.approx(sigma, rel=0.1)
        assert abs(x.mean()) < 0.15 * sigma
        bearing = np.array([objects.y[0] / (objects.x[0] + BUMPER - config.x) for objects in lists])
        assert bearing.std() == pytest.approx(1.0 / config.view.focal, rel=0.1)
        speed = np.array([objects.relative_speed[0] for objects in lists])
        assert speed.std() == pytest.approx(sigma, rel=0.1)


@pytest.mark.thorough
def test_errors_hold_on_from_picture_to_picture() -> None:
    frames = [
        frame.objects.x[0] for _, frame in watched(replace(CONFIG, miss_rate=0.0), actors([car(50.0, 0.0)]), 120.0)
    ]
    x = np.array(frames) - np.mean(frames)
    assert float((x[1:] * x[:-1]).mean() / (x * x).mean()) == pytest.approx(0.9, abs=0.05)


# --- what is listed ---------------------------------------------------------------------------------------------------


def test_people_are_listed_later_than_cars() -> None:
    """16 rows of a car of 1.5 m are 123 m; 32 rows of a person of 1.7 m are 69 m."""
    for kind, size, farthest in (("car", 1.5, 123.0), ("pedestrian", 1.7, 69.7)):
        rows = [(farthest + away + IDEAL.x, 0.0, 0.0, 0.0, 0.1, 1.0, 10.0) for away in (-6.0, 6.0)]
        near, far = (actors([row], kind=kind) for row in rows)
        assert near.height[0] == size
        assert len(last(IDEAL, near).objects.x) == 1
        assert len(last(IDEAL, far).objects.x) == 0


def test_what_is_hidden_is_not_listed_and_what_is_hidden_by_half_is() -> None:
    hidden = actors([car(20.0, 0.0), car(30.0, 0.0)], ["near", "far"])
    assert last(IDEAL, hidden).names == ("near",)
    half = actors([car(20.0, 1.2), car(30.0, 0.0)], ["near", "far"])
    frame = last(IDEAL, half)
    assert frame.names == ("near", "far")
    assert frame.visible[0] == 1.0
    assert 0.4 < frame.visible[1] < 0.9


def test_a_child_behind_a_parked_car_is_not_listed_and_a_tall_man_is_seen_over_it() -> None:
    """From 1.3 m a car of 1.5 m hides what is behind it to 1.5 m and more."""
    parked = car(20.0, 0.0)
    behind = (24.0, 0.3, 0.0, 0.0, 0.4, 0.5, 0.5)
    scene = actors([parked, behind], ["parked", "behind"])
    small = replace(scene, kind=np.array([0, number_of("child")], np.int8), height=np.array([1.5, 1.2]))
    assert last(IDEAL, small).names == ("parked",)
    tall = replace(scene, kind=np.array([0, number_of("pedestrian")], np.int8), height=np.array([1.0, 1.9]))
    assert last(IDEAL, tall).names == ("parked", "behind")


def test_a_wall_hides() -> None:
    wall = walls_of([Building(((15.0, -3.0), (15.0, 3.0), (16.0, 3.0), (16.0, -3.0)), 3.0)])
    assert last(IDEAL, actors([car(30.0, 0.0)]), walls=wall).names == ()


@pytest.mark.thorough
def test_misses_come_as_often_as_declared() -> None:
    config = replace(CONFIG, miss_rate=0.2)
    frames = [frame for _, frame in watched(config, actors([car(30.0, 0.0)]), 120.0)]
    assert np.mean([len(frame.names) == 0 for frame in frames]) == pytest.approx(0.2, abs=0.04)


@pytest.mark.thorough
def test_false_objects_come_as_often_as_declared_and_nobody_is_behind_them() -> None:
    config = replace(CONFIG, false_objects=0.5)
    frames = [frame for _, frame in watched(config, actors([]), 120.0)]
    count = sum(len(frame.names) for frame in frames)
    assert count / len(frames) == pytest.approx(0.5, abs=0.06)
    assert {name for frame in frames for name in frame.names} == {""}
    x, y = (np.concatenate([getattr(frame.objects, axis) for frame in frames]) for axis in ("x", "y"))
    assert (np.abs(y) <= x * math.tan(config.view.half_angle) + 1e-9).all()


def test_false_objects_share_no_number_with_what_is_there() -> None:
    many = [car(20.0 + 2.0 * (row % 10), 3.0 * (row // 10) - 10.0) for row in range(70)]
    config = replace(IDEAL, false_objects=5.0, min_visible=0.0, min_rows=1.0)
    objects = last(config, actors(many)).objects
    assert 63 in objects.number
    assert {0.0} == {
        speed for number, speed in zip(objects.number, objects.relative_speed, strict=True) if number == 63
    }
    real = [name for name in last(config, actors(many)).names if name]
    assert len(real) == len(set(real))


# --- numbers, status, lanes -------------------------------------------------------------------------------------------


def test_a_number_stays_while_an_object_is_followed_and_is_given_anew_later() -> None:
    camera = Camera(IDEAL, FUSION, np.random.default_rng(1), NO_WALLS, NO_LANES)
    numbers: dict[float, list[int]] = {}
    for tick in range(150):
        time = tick * PERIOD
        here = [("a", car(20.0, -3.0))] if time < 1.0 or time >= 2.0 else []
        here.append(("b", car(40.0, 3.0)))
        scene = actors([body for _, body in here], [name for name, _ in here])
        frame = camera.step(time, rear_axle(), scene)
        camera.prepare()
        if frame is not None:
            numbers[round(time, 2)] = frame.objects.number.tolist()
    assert {tuple(found) for time, found in numbers.items() if time < 0.9} == {(0, 1)}
    assert {tuple(found) for time, found in numbers.items() if 1.2 < time < 1.9} == {(1,)}
    (again,) = {tuple(found) for time, found in numbers.items() if time > 2.2}
    assert again[1] == 1
    assert again[0] not in (0, 1), "a number that was given back is not the next one to be given"


def test_status_says_how_an_object_moves_and_whether_it_ever_did() -> None:
    camera = Camera(IDEAL, FUSION, np.random.default_rng(1), NO_WALLS, NO_LANES)
    seen = []
    for tick in range(150):
        speed = 6.0 if 1.0 <= tick * PERIOD < 2.0 else 0.0
        scene = actors([car(20.0, -3.0, 0.0, speed), car(40.0, 3.0, math.pi, speed)])
        frame = camera.step(tick * PERIOD, rear_axle(), scene)
        camera.prepare()
        if frame is not None:
            seen.append(tuple(frame.objects.status.tolist()))
    standing, moving, stopped = dict.fromkeys(seen)
    assert standing == (Status.STANDING, Status.STANDING)
    assert moving == (Status.MOVING, Status.ONCOMING)
    assert stopped == (Status.STOPPED, Status.STOPPED)


@pytest.mark.parametrize(
    ("y", "heading", "borders"),
    [
        (0.0, 0.0, (1.6, 1.6)),
        (0.4, 0.0, (1.2, 2.0)),
        (3.0, math.pi, (1.4, 1.8)),
        (0.3, 0.3, None),
        (30.0, 0.0, None),
        (3.0, 0.0, None),
    ],
)
def test_the_lane_is_the_one_that_leads_where_the_car_looks(
    y: float, heading: float, borders: tuple[float, float] | None
) -> None:
    camera = Camera(IDEAL, FUSION, np.random.default_rng(1), NO_WALLS, STREET)
    # The camera, not the rear axle, is at the place.
    x, y_axle = 20.0 - IDEAL.x * math.cos(heading), y - IDEAL.x * math.sin(heading)
    camera.step(0.0, rear_axle(x, y_axle, heading), actors([]))
    camera.prepare()
    camera.step(0.02, rear_axle(x, y_axle, heading), actors([]))
    seen = camera.output
    if heading == 0.3:
        assert (seen.lane_left, seen.lane_right) == pytest.approx((1.3, 1.9))
    elif borders is None:
        assert (seen.lane_known, seen.lane_left, seen.lane_right) == (False, 0.0, 0.0)
    else:
        assert seen.lane_known
        assert (seen.lane_left, seen.lane_right) == pytest.approx(borders)


# --- time -------------------------------------------------------------------------------------------------------------


def test_a_list_comes_out_after_its_latency_and_is_dated_when_the_picture_was_taken() -> None:
    for came, frame in watched(CONFIG, actors([car(30.0, 0.0)]), 2.0):
        assert CONFIG.latency - 1e-9 <= came - frame.objects.time < CONFIG.latency + PERIOD
    times = np.array([frame.objects.time for _, frame in watched(CONFIG, actors([]), 10.0)])
    assert len(times) == pytest.approx(15.0 * 9.9, abs=2)
    assert set(np.round(np.diff(times), 2).tolist()) == {0.06, 0.08}


def test_the_same_seed_sees_the_same_and_another_does_not() -> None:
    one, two, other = (last(CONFIG, actors([car(30.0, 0.0)]), seed=seed).objects.x.tolist() for seed in (1, 1, 2))
    assert one == two != other


def test_another_actor_changes_no_error() -> None:
    alone = last(CONFIG, actors([car(30.0, 0.0)], ["a"])).objects.x[0]
    both = last(CONFIG, actors([car(30.0, 0.0), car(50.0, 6.0)], ["a", "b"])).objects.x[0]
    assert alone == both
