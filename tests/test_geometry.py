"""Boxes against shapely, an independent geometry engine: corners, overlap, separation, and sweeps through time."""

from __future__ import annotations

import math
import random as chances

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon

from tests.metrics.tables import CAR
from vve_sumo.geometry import (
    Box,
    Boxes,
    behind_bumper,
    distance,
    overlap,
    separation,
    time_to_collision_2d,
    vehicle_boxes,
)

PAIRS = 1000
HORIZON, STEP = 10.0, 0.05  #: of the sweep [s]


def some(random: np.random.Generator, count: int) -> Boxes:
    place, turned = random.uniform(-30.0, 30.0, (2, count)), random.uniform(-math.pi, math.pi, count)
    # Every fifth stands, and every third is turned by quarters: the cases in which a rate is zero.
    turned = np.where(np.arange(count) % 3 == 0, np.round(turned / (math.pi / 2)) * (math.pi / 2), turned)
    speed = np.where(np.arange(count) % 5 == 0, 0.0, random.uniform(-5.0, 20.0, count))
    return Boxes(*place, turned, random.uniform(0.5, 8.0, count), random.uniform(0.5, 2.5, count), speed)


def aimed(random: np.random.Generator, one: Boxes, other: Boxes) -> Boxes:
    """`one` moved to where it comes close to `other` at some time soon."""
    time, miss = random.uniform(0.0, 8.0, len(one.x)), random.normal(0.0, 3.0, (2, len(one.x)))
    x = other.x + time * (other.speed * np.cos(other.heading) - one.speed * np.cos(one.heading)) + miss[0]
    y = other.y + time * (other.speed * np.sin(other.heading) - one.speed * np.sin(one.heading)) + miss[1]
    return one._replace(x=x, y=y)


def bodies(boxes: Boxes, time: np.ndarray) -> np.ndarray:
    """Polygons of boxes at these times."""
    cos, sin = np.cos(boxes.heading), np.sin(boxes.heading)
    x, y = boxes.x + boxes.speed * cos * time, boxes.y + boxes.speed * sin * time
    corners = []
    for forward, left in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        u, v = 0.5 * forward * boxes.length, 0.5 * left * boxes.width
        corners.append(np.stack((x + u * cos - v * sin, y + u * sin + v * cos), axis=-1))
    return shapely.polygons(np.stack(corners, axis=-2))


def swept(one: Boxes, other: Boxes) -> np.ndarray:
    """First touch found in steps of time, refined by bisection; inf for none."""
    count = len(one.x)
    first = np.full(count, np.inf)
    for time in np.arange(0.0, HORIZON, STEP):
        rows = np.flatnonzero(np.isinf(first))
        touch = shapely.intersects(bodies(one.select(rows), time), bodies(other.select(rows), time))
        first[rows[touch]] = time
    rows = np.flatnonzero(np.isfinite(first) & (first > 0.0))
    low, high = first[rows] - STEP, first[rows]
    mine, theirs = one.select(rows), other.select(rows)
    for _ in range(40):
        middle = 0.5 * (low + high)
        touch = shapely.intersects(bodies(mine, middle), bodies(theirs, middle))
        low, high = np.where(touch, low, middle), np.where(touch, middle, high)
    first[rows] = high
    return first


@pytest.mark.thorough
def test_a_thousand_pairs_touch_when_a_sweep_through_time_says_so() -> None:
    random = np.random.default_rng(7)
    one, other = some(random, PAIRS), some(random, PAIRS)
    one = aimed(random, one, other)
    found, expected = time_to_collision_2d(one, other), swept(one, other)
    same = np.isclose(found, expected, rtol=0.0, atol=1e-8) | (np.isinf(expected) & (found > HORIZON - STEP))
    # What is left brushes each other for less than a step: it touches when it is said to, and did not before.
    brushes = np.flatnonzero(~same)
    assert len(brushes) < 0.02 * PAIRS
    mine, theirs, at = one.select(brushes), other.select(brushes), found[brushes]
    assert (found[brushes] < expected[brushes]).all()
    assert (shapely.distance(bodies(mine, at), bodies(theirs, at)) < 1e-9).all()
    assert (shapely.distance(bodies(mine, at - 1e-3), bodies(theirs, at - 1e-3)) > 0.0).all()
    assert np.count_nonzero(np.isfinite(expected) & (expected > 0.0)) > 400
    assert np.count_nonzero(expected == 0.0) > 20
    assert np.count_nonzero(np.isinf(expected)) > 100


def test_boxes_head_on_and_parallel() -> None:
    one = Boxes(*map(np.float64, (0, 0, 0, 4, 2, 10)))
    others = np.array(
        [[24, 0, math.pi, 4, 2, 10], [24, 2.1, math.pi, 4, 2, 10], [2, 1, 1, 4, 2, 0], [-24, 0, 0, 4, 2, 0]]
    )
    found = time_to_collision_2d(one, Boxes(*others.T))
    np.testing.assert_allclose(found, [1.0, math.inf, 0.0, math.inf], rtol=1e-12)
    np.testing.assert_allclose(time_to_collision_2d(Boxes(*others.T), one), found, rtol=1e-12)


def test_overlap_never_and_not_a_number() -> None:
    at = np.array([0.0, 2.0, 10.0, -10.0, 10.0, math.nan])
    speed = np.array([0.0, 3.0, 0.0, 0.0, 5.0, 0.0])
    zero, side = np.zeros(6), np.array([0.0, 1.9, 0.0, 0.0, 0.0, 0.0])
    other = Boxes(at, side, zero, zero + 4.0, zero + 2.0, speed)
    ego = Boxes(np.zeros(()), np.zeros(()), np.zeros(()), np.array(4.0), np.array(2.0), np.array(5.0))
    found = time_to_collision_2d(ego, other)
    np.testing.assert_allclose(found, [0.0, 0.0, 1.2, math.inf, math.inf, math.nan], atol=1e-12)
    for field in range(6):
        broken = Boxes(*(zero + math.nan if number == field else zero + 1.0 for number in range(6)))
        assert np.isnan(time_to_collision_2d(ego, broken)).all()
        assert np.isnan(time_to_collision_2d(broken, ego)).all()


def test_separation_is_positive_where_shapely_sees_room() -> None:
    random = np.random.default_rng(9)
    one, other = some(random, 500), some(random, 500)
    one = one._replace(x=other.x + random.normal(0.0, 4.0, 500), y=other.y + random.normal(0.0, 4.0, 500))
    apart, room = separation(one, other), shapely.distance(bodies(one, np.zeros(500)), bodies(other, np.zeros(500)))
    assert ((apart > 0.0) == (room > 0.0)).all()
    assert (apart <= room + 1e-9)[apart > 0.0].all()


def test_distance_is_the_one_that_shapely_measures() -> None:
    random = np.random.default_rng(10)
    one, other = some(random, 500), some(random, 500)
    one = one._replace(x=other.x + random.normal(0.0, 6.0, 500), y=other.y + random.normal(0.0, 6.0, 500))
    measured = shapely.distance(bodies(one, np.zeros(500)), bodies(other, np.zeros(500)))
    assert 20 < (measured == 0.0).sum() < 480
    np.testing.assert_allclose(distance(one, other), measured, atol=1e-9)


reals = st.floats(-8.0, 8.0)
angles = st.floats(-math.pi, math.pi)
sizes = st.floats(0.2, 8.0)
boxes = st.builds(Box, reals, reals, angles, sizes, sizes)


def polygon(shape: Box) -> Polygon:
    half_length, half_width = shape.length / 2, shape.width / 2
    cos, sin = math.cos(shape.heading), math.sin(shape.heading)
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return Polygon(
        [
            (
                shape.x + a * half_length * cos - b * half_width * sin,
                shape.y + a * half_length * sin + b * half_width * cos,
            )
            for a, b in signs
        ]
    )


def test_overlap_agrees_with_shapely_on_a_thousand_pairs():
    chance = chances.Random(7)
    hits = 0
    for _ in range(1000):
        first, second = (
            Box(chance.uniform(-5, 5), chance.uniform(-5, 5), chance.uniform(-7, 7), chance.uniform(0.3, 8), 1.9)
            for _ in range(2)
        )
        expected = polygon(first).intersection(polygon(second)).area > 1e-9
        hits += expected
        assert overlap(first, second) == expected
    assert 200 < hits < 800


@given(boxes, boxes)
def test_overlap_is_symmetric(first: Box, second: Box):
    assert overlap(first, second) == overlap(second, first)


@given(boxes)
def test_corners_are_those_of_the_polygon(shape: Box):
    assert Polygon(shape.corners()).symmetric_difference(polygon(shape)).area == pytest.approx(0.0, abs=1e-9)


def test_a_body_lies_behind_its_bumper():
    body = behind_bumper(10.0, 5.0, math.pi / 2, 4.0, 2.0)
    assert (body.x, body.y) == pytest.approx((10.0, 3.0))
    assert polygon(body).bounds == pytest.approx((9.0, 1.0, 11.0, 5.0))


def test_a_stretched_box_keeps_its_rear():
    assert polygon(Box(0.0, 0.0, 0.0, 4.0, 2.0).stretched(6.0)).bounds == pytest.approx((-2.0, -1.0, 8.0, 1.0))


def test_boxes_that_touch_do_not_overlap():
    assert not overlap(Box(0.0, 0.0, 0.0, 4.0, 2.0), Box(4.0, 0.0, 0.0, 4.0, 2.0))
    assert overlap(Box(0.0, 0.0, 0.0, 4.0, 2.0), Box(3.99, 0.0, 0.0, 4.0, 2.0))


def test_arrays_and_single_boxes_agree_on_corners_and_overlap() -> None:
    random = np.random.default_rng(10)
    one, other = some(random, 300), some(random, 300)
    one = one._replace(x=other.x + random.normal(0.0, 4.0, 300), y=other.y + random.normal(0.0, 4.0, 300))
    single = [[Box(*map(float, row)) for row in zip(*boxes[:5], strict=True)] for boxes in (one, other)]
    corners = np.moveaxis(np.array(one.corners()), 0, -1)
    np.testing.assert_allclose(corners, np.array([box.corners() for box in single[0]]).swapaxes(0, 1), atol=1e-12)
    apart = separation(one, other)
    assert (np.abs(apart) > 1e-9).all()
    assert [overlap(*pair) for pair in zip(*single, strict=True)] == (apart < 0.0).tolist()


def test_a_vehicle_lies_around_its_rear_axle() -> None:
    x, heading = np.array([10.0, 10.0]), np.array([0.0, math.pi / 2])
    boxes = vehicle_boxes(x, np.array([5.0, 5.0]), heading, np.array([3.0, 4.0]), CAR)
    bounds = shapely.bounds(bodies(boxes, np.zeros(2)))
    front, rear, half = CAR.rear_axle_to_bumper, CAR.rear_overhang, 0.5 * CAR.width
    expected = [
        [10.0 - rear, 5.0 - half, 10.0 + front, 5.0 + half],
        [10.0 - half, 5.0 - rear, 10.0 + half, 5.0 + front],
    ]
    np.testing.assert_allclose(bounds, expected, atol=1e-12)
