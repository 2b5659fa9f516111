"""Deviation and heading error on a straight line and a circle, where they can be read off."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.metrics.tracking import track, wrapped
from vve_sumo.path import ReferencePath


def test_left_of_a_straight_path_is_positive_and_so_is_a_heading_to_the_left() -> None:
    """A path to the south-west, so that the headings lie to both sides of ±pi."""
    along = np.linspace(0.0, 100.0, 40)
    path = ReferencePath.from_points(-along, -1e-3 * along)
    heading = -math.pi + math.atan(1e-3)
    s, d = np.array([20.0, 50.0, 80.0]), np.array([0.3, -0.7, 0.0])
    x = s * math.cos(heading) - d * math.sin(heading)
    y = s * math.sin(heading) + d * math.cos(heading)
    error = np.array([0.01, -0.02, 3.0])
    turns = np.array([0.0, 2.0, -1.0]) * 2.0 * math.pi
    found = track(path, x, y, heading + error + turns, s + 1.0)
    np.testing.assert_allclose(found.lateral_deviation, d, atol=1e-9)
    np.testing.assert_allclose(found.heading_error, error, atol=1e-9)


def test_inside_a_left_turn_is_left_and_the_frame_turns_with_the_path() -> None:
    angles = np.linspace(0.0, math.pi, 200)
    path = ReferencePath.from_points(40.0 * np.sin(angles), 40.0 - 40.0 * np.cos(angles))
    at, d, error = np.linspace(0.3, 2.8, 30), 0.4, 0.05
    x, y = (40.0 - d) * np.sin(at), 40.0 - (40.0 - d) * np.cos(at)
    found = track(path, x, y, at + error, 40.0 * at)
    np.testing.assert_allclose(found.lateral_deviation, d, atol=1e-3)
    np.testing.assert_allclose(found.heading_error, error, atol=1e-3)


def test_a_pose_that_nobody_knows_has_no_deviation() -> None:
    path = ReferencePath.from_points([0.0, 50.0, 100.0], [0.0, 0.0, 0.0])
    one, nan = np.array([10.0, 10.0, math.nan]), np.array([math.nan, 0.0, 0.0])
    found = track(path, one, nan, np.array([0.0, math.nan, 0.0]), np.array([10.0, 10.0, 10.0]))
    np.testing.assert_equal(found.lateral_deviation, [math.nan, 0.0, math.nan])
    assert np.isnan(found.heading_error).all()


@given(st.floats(-50.0, 50.0))
def test_wrapped_angles_keep_their_direction(angle: float) -> None:
    found = float(wrapped(np.array(angle)))
    assert -math.pi <= found <= math.pi
    assert math.isclose(math.cos(found), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(found), math.sin(angle), abs_tol=1e-9)
