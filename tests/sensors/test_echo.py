"""What an antenna without error measures: closed forms of rigid motion, and indifference to the map's axes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sensors import reference
from tests.sensors.scenes import BUMPER, FUSION, Row, actors, car, rear_axle
from vve_sumo.sensors.echo import Echo, Mount, antenna_at, echoes
from vve_sumo.sensors.visibility import Sector
from vve_sumo.values import Point, Pose

MODES = ((174.0, math.radians(10.0)), (60.0, math.radians(45.0)))
SECTORS = [Sector(far, math.tan(half)) for far, half in MODES]


def seen(pose: Pose, rows: Sequence[Row], mount: Mount = Mount(), across: float = 0.0) -> list[Echo]:  # noqa: B008 - frozen
    found, refused = echoes(antenna_at(pose, mount, FUSION), actors(rows, None, across), SECTORS)
    assert refused == 0
    return found


def test_a_car_dead_ahead_is_seen_at_its_rear_face_from_the_antenna() -> None:
    (echo,) = seen(rear_axle(), [car(50.0, 0.0)], Mount(x=-0.1))
    assert echo == Echo(0, pytest.approx(50.0 - 2.25 - BUMPER + 0.1), 0.0, 0.0, 0)


@pytest.mark.parametrize("y", [-6.0, -2.0, 0.0, 3.0, 8.0])
def test_a_parked_car_closes_with_the_cosine_of_its_azimuth(y: float) -> None:
    (echo,) = seen(rear_axle(speed=13.0), [car(30.0, y)])
    assert echo.range_rate == pytest.approx(-13.0 * math.cos(echo.azimuth), abs=1e-12)


def test_a_car_that_drives_along_keeps_its_distance() -> None:
    (echo,) = seen(rear_axle(speed=13.0), [car(30.0, 0.0, speed=13.0)])
    assert echo.range_rate == 0.0


def test_a_car_that_comes_closes_with_both_speeds() -> None:
    (echo,) = seen(rear_axle(speed=13.0), [car(60.0, 0.0, math.pi, 9.0)])
    assert echo.range_rate == pytest.approx(-22.0)


def test_yaw_rate_sweeps_the_antenna_sideways_by_its_lever_arm() -> None:
    """At rest but turning, the antenna moves left at yaw rate times 4.44 m: it closes on what lies to the left."""
    (echo,) = seen(rear_axle(yaw_rate=0.5), [car(20.0, 8.0)], Mount(x=0.6))
    assert echo.range_rate == pytest.approx(-0.5 * (BUMPER + 0.6) * math.sin(echo.azimuth), abs=1e-12)


def test_a_post_at_the_centre_of_a_steady_circle_neither_nears_nor_recedes() -> None:
    """The rear axle circles (0, 20) to the left; the antenna looks 70 deg left, so that the post is in view."""
    pose = rear_axle(speed=8.0, yaw_rate=8.0 / 20.0)
    (echo,) = seen(pose, [(0.0, 20.0, 0.0, 0.0, 1e-6, 1e-6, 1.0)], Mount(yaw=math.radians(70.0)))
    assert echo.range == pytest.approx(math.hypot(20.0, BUMPER - 0.1), abs=1e-5)
    assert echo.range_rate == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("mount", [Mount(), Mount(0.3, 0.6, 0.2), Mount(-1.0, -0.7, -0.3)])
def test_range_rate_is_the_derivative_of_range(mount: Mount) -> None:
    """Central difference over a curved drive past moving posts, so small that their nearest point stays the same."""
    step, speed, yaw_rate, lateral_speed = 1e-4, 12.0, 0.3, 0.4

    def post_at(time: float, heading: float, target_speed: float, across: float) -> Row:
        cos, sin = math.cos(heading), math.sin(heading)
        x, y = 25.0 + time * (target_speed * cos - across * sin), 3.0 + time * (target_speed * sin + across * cos)
        return x, y, heading, target_speed, 1e-5, 1e-5, 1.0

    def pose_at(time: float) -> Pose:
        turn = yaw_rate * time
        forward = (speed * math.sin(turn) - lateral_speed * (1.0 - math.cos(turn))) / yaw_rate
        leftward = (speed * (1.0 - math.cos(turn)) + lateral_speed * math.sin(turn)) / yaw_rate
        return rear_axle(forward, leftward, turn, speed, yaw_rate, lateral_speed)

    for target in ((0.0, 5.0, 0.0), (2.0, 7.0, 0.0), (-1.0, 0.0, 0.0), (1.5, 9.0, 1.1), (0.1, 9.0, -3.0)):
        before, now, after = (
            seen(pose_at(time), [post_at(time, *target)], mount, target[2])[0] for time in (-step, 0.0, step)
        )
        assert now.range_rate == pytest.approx((after.range - before.range) / (2.0 * step), abs=1e-4)


def test_an_actor_with_a_value_that_is_not_finite_is_left_out_and_counted() -> None:
    good = car(20.0, 0.0)
    for column in range(7):
        for bad in (math.nan, math.inf, -math.inf):
            row = (*good[:column], bad, *good[column + 1 :])
            found, refused = echoes(antenna_at(rear_axle(), Mount(), FUSION), actors([good, row]), SECTORS)
            assert ([echo.row for echo in found], refused) == ([0], 1)
    for bad in (math.nan, math.inf, -math.inf):
        assert echoes(antenna_at(rear_axle(), Mount(), FUSION), actors([good], None, bad), SECTORS) == ([], 1)


def test_inside_an_actor_the_distance_is_zero_and_the_closing_speed_the_boresights() -> None:
    (echo,) = seen(rear_axle(speed=4.0), [car(BUMPER, 0.0), car(20.0, 0.0)])
    assert echo == Echo(0, 0.0, 0.0, -4.0, 0)


def test_only_the_rear_axles_pose_is_accepted() -> None:
    pose = Pose(0.0, Point.FRONT_BUMPER, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="rear axle"):
        antenna_at(pose, Mount(), FUSION)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("seed", range(4))
def test_choosing_by_field_of_view_loses_nothing(seed: int) -> None:
    """Boxes all around the car, most of them out of view, against brute force over all of them."""
    rng = np.random.default_rng(seed)
    mount = Mount(0.2, -0.4, 0.15)
    for _ in range(40):
        pose = rear_axle(*rng.uniform(-50.0, 50.0, 2), rng.uniform(-4.0, 4.0))
        antenna = antenna_at(pose, mount, FUSION)
        rows = [
            (*rng.uniform(-150.0, 150.0, 2), rng.uniform(-4.0, 4.0), 0.0, rng.uniform(2.0, 18.0), 2.0, 1.0)
            for _ in range(12)
        ]
        cos, sin = math.cos(antenna.heading), math.sin(antenna.heading)
        boxes = [
            reference.Box(
                (x - antenna.x) * cos + (y - antenna.y) * sin,
                (y - antenna.y) * cos - (x - antenna.x) * sin,
                heading - antenna.heading,
                length,
                width,
            )
            for x, y, heading, _, length, width, _ in rows
        ]
        if any(abs(box.x) < 12.0 and abs(box.y) < 12.0 for box in boxes):
            continue
        expected = reference.seen(boxes, MODES)
        found = {echo.row: echo for echo in seen(pose, rows, mount)}
        assert found.keys() == expected.keys()
        for row, echo in found.items():
            assert (echo.range, echo.azimuth) == pytest.approx(expected[row][:2], abs=1e-9)


distance = st.floats(-100.0, 100.0)
angle = st.floats(-math.pi, math.pi)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.tuples(st.integers(8, 120), st.integers(-12, 12), angle, st.floats(-5.0, 30.0)), max_size=6),
    st.tuples(distance, distance, angle),
)
def test_turning_and_shifting_the_whole_scene_changes_nothing(
    cars: list[tuple[int, int, float, float]], move: tuple[float, float, float]
) -> None:
    dx, dy, turn = move
    cos, sin = math.cos(turn), math.sin(turn)

    def moved(x: float, y: float) -> tuple[float, float]:
        return dx + x * cos - y * sin, dy + x * sin + y * cos

    # Off the grid, so that no surfaces, lines of sight or edges of view fall together to the last bit.
    rows = [
        car(x + 0.1234 + 0.017 * row, 1.7 * y + 0.4321 + 0.013 * row, heading, speed)
        for row, (x, y, heading, speed) in enumerate(cars)
    ]
    rows_moved = [(*moved(x, y), heading + turn, *rest) for x, y, heading, *rest in rows]
    before = seen(rear_axle(0.0, 0.0, 0.0, 11.0, 0.2, 0.1), rows)
    after = seen(rear_axle(*moved(0.0, 0.0), turn, 11.0, 0.2, 0.1), rows_moved)
    assert [(echo.row, echo.mode) for echo in after] == [(echo.row, echo.mode) for echo in before]
    for one, other in zip(before, after, strict=True):
        assert other[1:4] == pytest.approx(one[1:4], abs=1e-6)
