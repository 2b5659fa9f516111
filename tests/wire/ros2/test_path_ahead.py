"""The path ahead as the car sees it, and the speed along it: against circles and straight lines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.path import ReferencePath
from vve_sumo.values import Point, Pose

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
from vve_sumo.wire.ros2.path_ahead import AHEAD, LATERAL, SLOWING, STEP, PathAhead

RADIUS = 40.0
ANGLES = np.linspace(0.0, 2.5, 200)
CIRCLE = ReferencePath.from_points(RADIUS * np.sin(ANGLES), RADIUS - RADIUS * np.cos(ANGLES))  # a turn to the left
STRAIGHT = ReferencePath.from_points(np.linspace(0.0, 500.0, 51), np.zeros(51))


def _pose(x: float, y: float, heading: float) -> Pose:
    return Pose(0.0, Point.REAR_AXLE, x, y, heading, 5.0, 0.0, 0.0, 0.0, 0.0)


def _places(ahead: PathAhead, pose: Pose, s: float) -> np.ndarray:
    poses = ahead.path(0, pose, s).poses
    return np.array([(each.pose.position.x, each.pose.position.y) for each in poses])


@given(st.floats(0.0, 30.0), st.floats(-1.0, 1.0), st.floats(-0.3, 0.3))
def test_the_poses_lie_on_the_line_wherever_the_car_is(s: float, aside: float, turned: float) -> None:
    angle = s / RADIUS
    nearer = RADIUS - aside
    pose = _pose(nearer * math.sin(angle), RADIUS - nearer * math.cos(angle), angle + turned)
    places = _places(PathAhead(CIRCLE, 8.0), pose, s)
    assert len(places) == 1 + AHEAD / STEP
    middle = np.array([math.sin(turned), math.cos(turned)]) * nearer  # of the circle, as the car sees it
    assert np.hypot(*(places - middle).T) == pytest.approx(RADIUS, abs=2e-3)
    assert np.hypot(*np.diff(places, axis=0).T) == pytest.approx(2.0 * RADIUS * math.sin(0.5 * STEP / RADIUS), abs=2e-3)
    assert np.hypot(*places[0]) <= STEP + abs(aside) + 1e-6  # it begins beside the car


def test_it_ends_where_the_path_ends() -> None:
    ahead = PathAhead(STRAIGHT, 8.0)
    assert _places(ahead, _pose(490.0, 0.5, 0.0), 490.0)[-1] == pytest.approx((10.0, -0.5))
    assert _places(ahead, _pose(520.0, 0.0, 0.0), 520.0)[-1] == pytest.approx((-20.0, 0.0))


def test_the_speed_is_the_scenarios_and_in_a_bend_that_of_its_lateral_acceleration() -> None:
    straight = PathAhead(STRAIGHT, 11.0).reference(0, 250.0).twist
    assert (straight.linear.x, straight.angular.z) == pytest.approx((11.0, 0.0))
    bend = PathAhead(CIRCLE, 11.0).reference(0, 50.0).twist
    assert bend.linear.x == pytest.approx(math.sqrt(LATERAL * RADIUS), rel=2e-3)
    assert bend.angular.z == pytest.approx(bend.linear.x / RADIUS, rel=2e-3)


def test_before_a_bend_it_falls_as_a_car_slows() -> None:
    x = np.concatenate([np.linspace(-100.0, -2.0, 50), RADIUS * np.sin(ANGLES)])
    y = np.concatenate([np.zeros(50), RADIUS - RADIUS * np.cos(ANGLES)])
    ahead = PathAhead(ReferencePath.from_points(x, y), 30.0)
    squares = [ahead.reference(0, 100.0 - before).twist.linear.x ** 2 for before in (20.0, 40.0, 60.0)]
    assert np.diff(squares) == pytest.approx(2.0 * SLOWING * 20.0)
    # A spline begins to bend a little beside the place where the circle does.
    assert squares[0] == pytest.approx(LATERAL * RADIUS + 2.0 * SLOWING * 20.0, rel=0.06)
