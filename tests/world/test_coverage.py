"""Covered parts of a band against shapely, an independent geometry engine."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon, box

from vve_sumo.geometry import Box
from vve_sumo.world.coverage import RoadStrip, covered

reals = st.floats(-8.0, 8.0)
angles = st.floats(-math.pi, math.pi)
sizes = st.floats(0.2, 8.0)
rectangles = st.builds(Box, reals, reals, angles, sizes, sizes)


@given(rectangles, reals, reals, angles, st.floats(0.5, 20.0), st.floats(0.5, 4.0))
def test_covered_part_of_a_band_agrees_with_shapely(shape, x, y, angle, length, half_width):
    band = RoadStrip(x, y, math.cos(angle), math.sin(angle), length, half_width)
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
