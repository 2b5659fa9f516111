"""Time to collision of boxes in arrays against a sweep through time with shapely, and against the scalar one."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from vve_sumo import laws
from vve_sumo.metrics.boxes import Boxes, separation, time_to_collision_of_boxes

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
        touch = shapely.intersects(bodies(one.taken(rows), time), bodies(other.taken(rows), time))
        first[rows[touch]] = time
    rows = np.flatnonzero(np.isfinite(first) & (first > 0.0))
    low, high = first[rows] - STEP, first[rows]
    mine, theirs = one.taken(rows), other.taken(rows)
    for _ in range(40):
        middle = 0.5 * (low + high)
        touch = shapely.intersects(bodies(mine, middle), bodies(theirs, middle))
        low, high = np.where(touch, low, middle), np.where(touch, middle, high)
    first[rows] = high
    return first


def test_a_thousand_pairs_touch_when_a_sweep_through_time_says_so() -> None:
    random = np.random.default_rng(7)
    one, other = some(random, PAIRS), some(random, PAIRS)
    one = aimed(random, one, other)
    found, expected = time_to_collision_of_boxes(one, other), swept(one, other)
    same = np.isclose(found, expected, rtol=0.0, atol=1e-8) | (np.isinf(expected) & (found > HORIZON - STEP))
    # What is left brushes each other for less than a step: it touches when it is said to, and did not before.
    brushes = np.flatnonzero(~same)
    assert len(brushes) < 0.02 * PAIRS
    mine, theirs, at = one.taken(brushes), other.taken(brushes), found[brushes]
    assert (found[brushes] < expected[brushes]).all()
    assert (shapely.distance(bodies(mine, at), bodies(theirs, at)) < 1e-9).all()
    assert (shapely.distance(bodies(mine, at - 1e-3), bodies(theirs, at - 1e-3)) > 0.0).all()
    assert np.count_nonzero(np.isfinite(expected) & (expected > 0.0)) > 400
    assert np.count_nonzero(expected == 0.0) > 20
    assert np.count_nonzero(np.isinf(expected)) > 100


def test_it_is_the_scalar_law_pair_by_pair() -> None:
    random = np.random.default_rng(8)
    one, other = some(random, 300), some(random, 300)
    one = aimed(random, one, other)
    found = time_to_collision_of_boxes(one, other)
    for row in range(300):
        mine, theirs = (
            laws.Box(*box[:5], box[5] * math.cos(box[2]), box[5] * math.sin(box[2]))
            for box in ([float(column[row]) for column in boxes] for boxes in (one, other))
        )
        expected = laws.time_to_collision_of_boxes(mine, theirs)
        assert found[row] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_overlap_never_and_not_a_number() -> None:
    at = np.array([0.0, 2.0, 10.0, -10.0, 10.0, math.nan])
    speed = np.array([0.0, 3.0, 0.0, 0.0, 5.0, 0.0])
    zero, side = np.zeros(6), np.array([0.0, 1.9, 0.0, 0.0, 0.0, 0.0])
    other = Boxes(at, side, zero, zero + 4.0, zero + 2.0, speed)
    ego = Boxes(np.zeros(()), np.zeros(()), np.zeros(()), np.array(4.0), np.array(2.0), np.array(5.0))
    found = time_to_collision_of_boxes(ego, other)
    np.testing.assert_allclose(found, [0.0, 0.0, 1.2, math.inf, math.inf, math.nan], atol=1e-12)
    for field in range(6):
        broken = Boxes(*(zero + math.nan if number == field else zero + 1.0 for number in range(6)))
        assert np.isnan(time_to_collision_of_boxes(ego, broken)).all()
        assert np.isnan(time_to_collision_of_boxes(broken, ego)).all()


def test_separation_is_positive_where_shapely_sees_room() -> None:
    random = np.random.default_rng(9)
    one, other = some(random, 500), some(random, 500)
    one = one._replace(x=other.x + random.normal(0.0, 4.0, 500), y=other.y + random.normal(0.0, 4.0, 500))
    apart, room = separation(one, other), shapely.distance(bodies(one, np.zeros(500)), bodies(other, np.zeros(500)))
    assert ((apart > 0.0) == (room > 0.0)).all()
    assert (apart <= room + 1e-9)[apart > 0.0].all()
