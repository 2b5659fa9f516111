"""Rectangles against shapely, an independent geometry engine."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon, box

from vve_sumo.world.footprint import Band, Rectangle, behind_bumper, covered, overlap

reals = st.floats(-8.0, 8.0)
angles = st.floats(-math.pi, math.pi)
sizes = st.floats(0.2, 8.0)
rectangles = st.builds(Rectangle, reals, reals, angles, sizes, sizes)


def polygon(shape: Rectangle) -> Polygon:
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
    chance = random.Random(7)
    hits = 0
    for _ in range(1000):
        first, second = (
            Rectangle(chance.uniform(-5, 5), chance.uniform(-5, 5), chance.uniform(-7, 7), chance.uniform(0.3, 8), 1.9)
            for _ in range(2)
        )
        expected = polygon(first).intersection(polygon(second)).area > 1e-9
        hits += expected
        assert overlap(first, second) == expected
    assert 200 < hits < 800


@given(rectangles, rectangles)
def test_overlap_is_symmetric(first: Rectangle, second: Rectangle):
    assert overlap(first, second) == overlap(second, first)


@given(rectangles)
def test_corners_are_those_of_the_polygon(shape: Rectangle):
    assert Polygon(shape.corners()).symmetric_difference(polygon(shape)).area == pytest.approx(0.0, abs=1e-9)


@given(rectangles, reals, reals, angles, st.floats(0.5, 20.0), st.floats(0.5, 4.0))
def test_covered_part_of_a_band_agrees_with_shapely(shape, x, y, angle, length, half_width):
    band = Band(x, y, math.cos(angle), math.sin(angle), length, half_width)
    local = Polygon(
        [
            ((px - x) * band.cos + (py - y) * band.sin, (py - y) * band.cos - (px - x) * band.sin)
            for px, py in shape.corners()
        ]
    )
    expected = local.intersection(box(0.0, -half_width, length, half_width))
    part = covered(shape.corners(), band)
    if part is None:
        assert expected.area < 1e-9
    else:
        assert part == pytest.approx((expected.bounds[0], expected.bounds[2]), abs=1e-6)


def test_a_body_lies_behind_its_bumper():
    body = behind_bumper(10.0, 5.0, math.pi / 2, 4.0, 2.0)
    assert (body.x, body.y) == pytest.approx((10.0, 3.0))
    assert polygon(body).bounds == pytest.approx((9.0, 1.0, 11.0, 5.0))


def test_a_stretched_box_keeps_its_rear():
    assert polygon(Rectangle(0.0, 0.0, 0.0, 4.0, 2.0).stretched(6.0)).bounds == pytest.approx((-2.0, -1.0, 8.0, 1.0))


def test_boxes_that_touch_do_not_overlap():
    assert not overlap(Rectangle(0.0, 0.0, 0.0, 4.0, 2.0), Rectangle(4.0, 0.0, 0.0, 4.0, 2.0))
    assert overlap(Rectangle(0.0, 0.0, 0.0, 4.0, 2.0), Rectangle(3.99, 0.0, 0.0, 4.0, 2.0))
