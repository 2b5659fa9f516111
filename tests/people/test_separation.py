"""The distance from the car's ground: against another library's geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from tests.people.persons import FENCE
from vve_sumo.people.separation import distance_to_fence, separation

COORDINATES = st.floats(-300.0, 300.0)


@st.composite
def outlines(draw: st.DrawFn) -> tuple[tuple[float, float], ...]:
    """Star-shaped outlines: most are not convex, none crosses itself."""
    radii = draw(st.lists(st.floats(5.0, 100.0), min_size=3, max_size=12))
    x, y = draw(COORDINATES), draw(COORDINATES)
    turns = np.arange(len(radii)) * (2.0 * math.pi / len(radii))
    if draw(st.booleans()):
        turns = turns[::-1]
    return tuple((x + r * math.cos(a), y + r * math.sin(a)) for r, a in zip(radii, turns, strict=True))


@given(outlines(), COORDINATES, COORDINATES)
def test_it_is_shapelys(fence: tuple[tuple[float, float], ...], x: float, y: float) -> None:
    expected = shapely.distance(shapely.Polygon(fence), shapely.Point(x, y))
    assert distance_to_fence(x, y, fence) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("x", "y", "distance"),
    [(0.0, 0.0, 60.0), (57.0, -54.0, 5.0), (60.0, 0.0, 0.0), (100.0, 10.0, 0.0), (260.0, 50.0, 100.0)],
)
def test_by_hand(x: float, y: float, distance: float) -> None:
    assert distance_to_fence(x, y, FENCE) == pytest.approx(distance)
    assert distance_to_fence(x, y, FENCE[::-1]) == pytest.approx(distance)
    assert separation(x, y, 12.0, FENCE) == pytest.approx(distance - 12.0)


def test_what_is_no_place_has_no_distance_and_what_is_no_ground_is_far() -> None:
    assert math.isnan(distance_to_fence(math.nan, 0.0, FENCE))
    assert math.isnan(separation(0.0, 0.0, math.nan, FENCE))
    assert distance_to_fence(0.0, 0.0, ()) == math.inf
