"""Occlusion against brute force, shapely and small scenes with round answers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point, Polygon

from tests.exhaustive import with_slow
from tests.sensors import reference
from tests.sensors.reference import Box
from vve_sumo.sensors import visibility
from vve_sumo.sensors.visibility import Sector, Sight, nearest_visible

MODES = ((174.0, math.radians(10.0)), (60.0, math.radians(45.0)))
WIDE = ((1e4, math.radians(89.0)),)


def sights(boxes: Sequence[Box], modes: Sequence[tuple[float, float]] = MODES) -> dict[int, Sight]:
    placed = [
        visibility.AntennaBox(x, y, math.cos(heading), math.sin(heading), 0.5 * length, 0.5 * width)
        for x, y, heading, length, width in boxes
    ]
    found = nearest_visible(placed, [Sector(far, math.tan(half)) for far, half in modes])
    assert [sight.box for sight in found] == sorted(sight.box for sight in found)
    return {sight.box: sight for sight in found}


def polygon(box: Box) -> Polygon:
    return Polygon(reference.corners(box))


def random_boxes(rng: np.random.Generator, count: int, *, apart: bool) -> list[Box]:
    """Cars, lorries and posts around the antenna, which is in none of them; not overlapping where `apart` is asked."""
    boxes: list[Box] = []
    shapes: list[Polygon] = [Point(0.0, 0.0).buffer(0.05)]
    while len(boxes) < count:
        distance, bearing = 190.0 * rng.random() ** 2, rng.uniform(-1.2, 1.2)
        length = rng.choice([0.3, 4.5, 12.0]) * rng.uniform(0.8, 1.2)
        box = Box(
            distance * math.cos(bearing),
            distance * math.sin(bearing),
            rng.uniform(-math.pi, math.pi),
            length,
            min(length, rng.uniform(1.5, 2.6)),
        )
        shape = polygon(box)
        if not any(shape.intersects(other) for other in (shapes if apart else shapes[:1])):
            boxes.append(box)
            shapes.append(shape)
    return boxes


def assert_as_brute_force(boxes: Sequence[Box], modes: Sequence[tuple[float, float]] = MODES) -> None:
    expected = reference.seen(boxes, modes)
    found = sights(boxes, modes)
    assert set(found) == set(expected)
    for row, sight in found.items():
        assert math.hypot(sight.x, sight.y) == pytest.approx(expected[row].range, abs=1e-9)
        assert math.atan2(sight.y, sight.x) == pytest.approx(expected[row].azimuth, abs=1e-9)
        assert sight.sector == expected[row].mode


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("seed", with_slow(range(10), lambda seed: seed < 2))
def test_equals_brute_force_on_a_thousand_scenes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(100):
        assert_as_brute_force(random_boxes(rng, int(rng.integers(2, 13)), apart=True))


@pytest.mark.parametrize("seed", range(4))
def test_equals_brute_force_where_boxes_overlap(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    for _ in range(50):
        boxes = random_boxes(rng, int(rng.integers(2, 9)), apart=False)
        near = [box._replace(x=box.x * 0.3 + 6.0, y=box.y * 0.3) for box in boxes]
        clear = [box for box in near if polygon(box).distance(Point(0.0, 0.0)) > 0.05]
        assert_as_brute_force(clear)


@pytest.mark.parametrize("seed", range(5))
def test_alone_the_distance_is_shapelys(seed: int) -> None:
    for box in random_boxes(np.random.default_rng(200 + seed), 60, apart=False):
        ahead = polygon(box).intersection(Polygon([(0.0, 0.0), (1e3, 1e3), (1e3, -1e3)]))
        found = sights([box], [(1e3, math.radians(45.0))])
        assert (0 in found) == (ahead.area > 0.0)
        if found:
            assert math.hypot(found[0].x, found[0].y) == pytest.approx(ahead.distance(Point(0.0, 0.0)), abs=1e-9)


def test_a_car_straight_behind_another_is_not_seen() -> None:
    assert set(sights([Box(30.0, 0.0, 0.0, 4.5, 1.8), Box(20.0, 0.0, 0.0, 4.5, 1.8)])) == {1}


def test_a_half_hidden_car_is_seen_at_its_nearest_visible_point() -> None:
    """The hider's left corner at (10, 1) casts its shadow to y = 2 at the face of the car behind at x = 20."""
    found = sights([Box(11.0, 0.0, 0.0, 2.0, 2.0), Box(22.0, 1.5, 0.0, 4.0, 3.0)])
    assert (found[1].x, found[1].y) == (pytest.approx(20.0), pytest.approx(2.0))


def test_a_car_between_two_others_is_seen_through_the_gap() -> None:
    boxes = [Box(10.5, 2.0, 0.0, 1.0, 2.0), Box(10.5, -2.0, 0.0, 1.0, 2.0), Box(40.0, 0.0, 0.0, 4.0, 1.8)]
    assert (sights(boxes)[2].x, sights(boxes)[2].y) == (38.0, 0.0)


def test_boxes_that_touch_let_nothing_through() -> None:
    """A wall of plates, edge to edge, at many angles; rounding alone sets them apart."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        heading = rng.uniform(-0.5, 0.5)
        cos, sin, piece = math.cos(heading), math.sin(heading), rng.uniform(0.2, 0.5)
        wall = [Box(10.0 - y * piece * sin, y * piece * cos, heading, 0.0, piece) for y in range(-12, 13)]
        assert len(wall) not in sights([*wall, Box(40.0, 0.1, 0.0, 4.0, 2.0)])


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("seed", range(3))
def test_equals_brute_force_where_walls_run_through_each_other(seed: int) -> None:
    """Long thin boxes that cross several times between one corner and the next."""
    rng = np.random.default_rng(300 + seed)
    for _ in range(60):
        walls = [
            Box(rng.uniform(5.0, 40.0), rng.uniform(-25.0, 25.0), rng.uniform(-math.pi, math.pi), 80.0, 0.3)
            for _ in range(8)
        ]
        assert_as_brute_force([wall for wall in walls if polygon(wall).distance(Point(0.0, 0.0)) > 3.0])


def test_where_boxes_overlap_the_nearer_surface_hides_the_other() -> None:
    """A lorry across the road with a car stuck half into its side: the car shows, and so does the rest of the lorry."""
    found = sights([Box(20.0, 0.0, 0.5 * math.pi, 12.0, 2.5), Box(18.0, 1.0, 0.0, 4.5, 1.8)])
    assert (found[1].x, found[1].y) == (pytest.approx(15.75), pytest.approx(0.1))
    assert (found[0].x, found[0].y) == (pytest.approx(18.75), pytest.approx(0.0))


def test_a_box_inside_another_is_not_seen() -> None:
    assert set(sights([Box(20.0, 0.0, 0.0, 2.0, 1.0), Box(20.0, 0.0, 0.3, 12.0, 2.5)])) == {1}


@pytest.mark.parametrize("x", [0.0, 2.0, 2.25])
def test_an_antenna_in_or_at_a_box_sees_that_box_alone_at_no_distance(x: float) -> None:
    found = sights([Box(20.0, 0.0, 0.0, 4.5, 1.8), Box(x, 0.3, 0.0, 4.5, 1.8)])
    assert found == {1: Sight(1, 0.0, 0.0, 0)}


@pytest.mark.parametrize(
    ("box", "mode"),
    [
        (Box(150.0, 0.0, 0.0, 4.0, 1.8), 0),
        (Box(30.0, 0.0, 0.0, 4.0, 1.8), 0),
        (Box(30.0, 15.0, 0.0, 4.0, 1.8), 1),
        (Box(177.0, 0.0, 0.0, 4.0, 1.8), None),
        (Box(60.0, 40.0, 0.0, 4.0, 1.8), None),
        (Box(5.0, 12.0, 0.0, 4.0, 1.8), None),
        (Box(-20.0, 0.0, 0.0, 4.0, 1.8), None),
    ],
)
def test_field_of_view(box: Box, mode: int | None) -> None:
    assert [sight.sector for sight in sights([box]).values()] == ([] if mode is None else [mode])


def test_a_lorry_alongside_that_reaches_behind_is_seen_in_its_front_part() -> None:
    """Its side lies on y = -2; the edge of the 45 deg field of view meets it at x = 2."""
    found = sights([Box(0.0, -3.25, 0.0, 20.0, 2.5)])
    assert (found[0].x, found[0].y) == (pytest.approx(2.0), pytest.approx(-2.0))


coordinate = st.floats(-60.0, 60.0, allow_subnormal=False)
sizes = st.floats(0.0, 15.0, allow_subnormal=False)
any_box = st.builds(Box, coordinate, coordinate, st.floats(-4.0, 4.0), sizes, sizes)


@pytest.mark.thorough
@settings(max_examples=300, deadline=None)
@given(st.lists(any_box, max_size=8))
def test_a_seen_point_lies_on_its_box_and_in_view(boxes: list[Box]) -> None:
    for row, sight in sights(boxes).items():
        far, half = MODES[sight.sector]
        assert math.hypot(sight.x, sight.y) <= far + 1e-9
        assert abs(math.atan2(sight.y, sight.x)) <= half + 1e-9
        box = boxes[row]
        cos, sin = math.cos(box.heading), math.sin(box.heading)
        dx, dy = sight.x - box.x, sight.y - box.y
        assert abs(dx * cos + dy * sin) <= 0.5 * box.length + 1e-6
        assert abs(dy * cos - dx * sin) <= 0.5 * box.width + 1e-6


@settings(max_examples=100, deadline=None)
@given(st.lists(any_box, min_size=1, max_size=6))
def test_more_boxes_never_bring_a_box_nearer(boxes: list[Box]) -> None:
    without, with_all = sights(boxes[:-1]), sights(boxes)
    touched = any(math.hypot(sight.x, sight.y) == 0.0 for sight in with_all.values())
    for row, sight in with_all.items():
        if row < len(boxes) - 1 and not touched:
            assert math.hypot(sight.x, sight.y) >= math.hypot(without[row].x, without[row].y) - 1e-6
