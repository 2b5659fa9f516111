"""The fallback path: a car that follows it by odometry ends near its path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests import vehicles
from vve_sumo.lot.fallback import (
    LATERAL_ACCELERATION,
    MIN_RETURN_DISTANCE,
    RETURN_TIME,
    deferred_fallback_path,
    fallback_path,
)
from vve_sumo.path import ReferencePath
from vve_sumo.values import DeferredFallbackPath, FallbackPath, Point, Pose, resolve_fallback_path
from vve_sumo.vehicle.fallback import well_formed

VEHICLE = vehicles.FUSION.vehicle
_ANGLE = np.linspace(0.0, math.pi / 2.0, 24)
ROUND_A_CORNER = ReferencePath.from_points(
    np.concatenate((np.arange(0.0, 60.0), 60.0 + 15.0 * np.sin(_ANGLE), np.full(60, 75.0))),
    np.concatenate((np.zeros(60), 15.0 - 15.0 * np.cos(_ANGLE), np.arange(16.0, 76.0))),
)
# A bend of the same radius, with transitions of 8 m.
_SPACING = 0.25
_BEND = np.interp(np.arange(0.0, 180.0, _SPACING), [60.0, 68.0, 76.0, 84.0], [0.0, 1.0 / 15.0, 1.0 / 15.0, 0.0])
_HEADING = np.cumsum(_BEND) * _SPACING
ROUND_A_BEND = ReferencePath.from_points(
    np.cumsum(np.cos(_HEADING))[::4] * _SPACING, np.cumsum(np.sin(_HEADING))[::4] * _SPACING
)
CIRCLE = ReferencePath.from_points(30.0 * np.cos(np.linspace(0.0, 5.0, 160)), 30.0 * np.sin(np.linspace(0.0, 5.0, 160)))


def beside(path: ReferencePath, s: float, d: float, turned: float, speed: float) -> Pose:
    at = path.at(s)
    x, y = at.x - d * math.sin(at.heading), at.y + d * math.cos(at.heading)
    return Pose(0.0, Point.REAR_AXLE, x, y, at.heading + turned, speed, 0.0, 0.0, 0.0, 0.0)


def steering_for(bend: float, speed: float) -> float:
    return math.atan(bend * (VEHICLE.wheelbase + VEHICLE.understeer_gradient * speed * speed))


def followed(start: Pose, profile: FallbackPath, distance: float) -> list[tuple[float, float, float]]:
    """x, y and heading along the way, each centimetre."""
    x, y, heading, step, ways = start.x, start.y, start.heading, 0.01, []
    knots = np.arange(len(profile.curvature)) * profile.spacing
    for s in np.arange(0.5 * step, distance, step):
        bend = float(np.interp(s, knots, profile.curvature))
        x, y = x + step * math.cos(heading + 0.5 * bend * step), y + step * math.sin(heading + 0.5 * bend * step)
        heading += bend * step
        ways.append((x, y, heading))
    return ways


SMALL_DEVIATIONS = {
    "s": st.floats(0.0, 90.0),
    "d": st.floats(-0.3, 0.3),
    "turned": st.floats(-0.05, 0.05),
    "speed": st.floats(0.5, 6.0),
    "wheel": st.floats(-0.02, 0.02),
}


def followed_to_rest(
    path: ReferencePath, s: float, d: float, turned: float, speed: float, wheel: float
) -> tuple[float, list[tuple[float, float, float]]]:
    """Distance that the car takes to stop, and where it goes along its fallback path."""
    steering = steering_for(path.at(s).curvature, speed) + wheel
    way = fallback_path(beside(path, s, d, turned, speed), steering, path, s, VEHICLE)
    assert way is not None
    rest = 0.2 * speed + speed**2 / 4.8
    return rest, followed(beside(path, s, d, turned, speed), way, rest)


@settings(max_examples=80, deadline=None)
@given(**SMALL_DEVIATIONS)
@example(s=59.0, d=0.0, turned=-0.03125, speed=6.0, wheel=0.0)
@example(s=82.6, d=0.3, turned=0.05, speed=6.0, wheel=0.0)
def test_following_it_round_a_corner_without_transitions_stays_in_the_lane(
    s: float, d: float, turned: float, speed: float, wheel: float
) -> None:
    _rest, ways = followed_to_rest(ROUND_A_CORNER, s, d, turned, speed, wheel)
    deviations = [abs(ROUND_A_CORNER.project(x, y, s).d) for x, y, _heading in ways[:: max(len(ways) // 20, 1)]]
    assert max(deviations, default=0.0) < 0.75


@settings(max_examples=80, deadline=None)
@given(**SMALL_DEVIATIONS)
def test_where_the_lateral_jerk_allows_the_bend_the_deviation_falls_as_its_closed_form(
    s: float, d: float, turned: float, speed: float, wheel: float
) -> None:
    rest, ways = followed_to_rest(ROUND_A_BEND, s, d, turned, speed, wheel)
    x, y, heading = ways[-1]
    at = ROUND_A_BEND.project(x, y, s + rest)
    length = max(RETURN_TIME * speed, MIN_RETURN_DISTANCE)
    closed_form = (d + (turned + d / length) * rest) * math.exp(-rest / length)
    assert at.d == pytest.approx(closed_form, abs=0.08)
    assert abs(math.remainder(heading - at.heading, math.tau)) < 0.07


@pytest.mark.parametrize("speed", [0.0, 0.3, 5.0, 11.0, 16.0])
def test_it_is_short_in_knots_and_longer_than_any_stop(speed: float) -> None:
    straight = ReferencePath.from_points([0.0, 300.0], [0.0, 0.0])
    way = fallback_path(beside(straight, 10.0, 0.2, 0.0, speed), 0.0, straight, 10.0, VEHICLE)
    assert way is not None
    assert len(way.curvature) <= 32
    slowest_stop = 0.2 * speed + speed**2 / (2.0 * (2.4 - 0.5))
    assert way.spacing * (len(way.curvature) - 1) > slowest_stop


def test_it_may_be_asked_for_at_a_length() -> None:
    way = fallback_path(beside(CIRCLE, 10.0, 0.0, 0.0, 5.0), 0.0, CIRCLE, 10.0, VEHICLE, 62.0)
    assert way is not None
    assert way.spacing * (len(way.curvature) - 1) == pytest.approx(62.0)


def test_on_the_path_it_is_the_path() -> None:
    way = fallback_path(beside(CIRCLE, 10.0, 0.0, 0.0, 8.0), steering_for(1.0 / 30.0, 8.0), CIRCLE, 10.0, VEHICLE)
    assert way is not None
    assert way.curvature == pytest.approx([1.0 / 30.0] * len(way.curvature), abs=5e-4)


@given(wheel=st.floats(-0.5, 0.5), speed=st.floats(1.0, 16.0))
def test_it_begins_with_the_wheels_as_they_are(wheel: float, speed: float) -> None:
    way = fallback_path(beside(CIRCLE, 10.0, 0.0, 0.0, speed), wheel, CIRCLE, 10.0, VEHICLE)
    if way is not None:
        assert way.curvature[0] == pytest.approx(
            math.tan(wheel) / (VEHICLE.wheelbase + VEHICLE.understeer_gradient * speed**2)
        )


def test_it_asks_for_no_more_than_tyres_and_comfort_give() -> None:
    way = fallback_path(beside(CIRCLE, 10.0, 1.5, 0.3, 8.0), 0.0, CIRCLE, 10.0, VEHICLE)
    assert way is not None
    squares = [max(64.0 - 3.0 * way.spacing * i, 0.25) for i in range(len(way.curvature))]
    for knot, square in list(zip(way.curvature, squares, strict=True))[1:]:
        assert abs(knot) * square <= LATERAL_ACCELERATION + 3.0 * way.spacing * abs(knot) + 1e-9


@pytest.mark.parametrize("field", ["x", "y", "heading", "speed"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("distance", [None, 10.0])
def test_there_is_none_from_nowhere(field: str, bad: float, distance: float | None) -> None:
    start = replace(beside(CIRCLE, 10.0, 0.0, 0.0, 5.0), **{field: bad})
    assert fallback_path(start, 0.0, CIRCLE, 10.0, VEHICLE, distance) is None


@pytest.mark.parametrize(
    ("d", "turned", "steering", "s"),
    [(6.0, 0.0, 0.0, 10.0), (0.0, 1.5, 0.0, 10.0), (0.0, 0.0, math.nan, 10.0), (0.0, 0.0, 0.0, math.nan)],
)
def test_there_is_none_from_far_off(d: float, turned: float, steering: float, s: float) -> None:
    assert fallback_path(beside(CIRCLE, 10.0, d, turned, 5.0), steering, CIRCLE, s, VEHICLE) is None


@settings(max_examples=300, deadline=None)
@given(
    numbers=st.tuples(*[st.floats(-1e6, 1e6) | st.floats()] * 4),
    steering=st.floats(-0.6, 0.6) | st.floats(),
    s=st.floats(-10.0, 200.0) | st.floats(),
)
def test_a_deferred_path_is_the_one_that_is_computed_at_once_and_always_well_formed(
    numbers: tuple[float, float, float, float], steering: float, s: float
) -> None:
    x, y, heading, speed = numbers
    pose = Pose(0.0, Point.REAR_AXLE, x, y, heading, speed, 0.0, 0.0, 0.0, 0.0)
    at_once = fallback_path(pose, steering, CIRCLE, s, VEHICLE)
    assert resolve_fallback_path(deferred_fallback_path(pose, steering, CIRCLE, s, VEHICLE)) == at_once
    assert at_once is None or well_formed(at_once)


def test_a_deferred_path_is_computed_once_and_not_before_it_is_needed() -> None:
    asked: list[str] = []

    def compute() -> FallbackPath:
        asked.append("now")
        return FallbackPath(1.0, (0.1,))

    deferred = DeferredFallbackPath(compute)
    assert asked == []
    assert deferred.path() == FallbackPath(1.0, (0.1,)) == deferred.path()
    assert asked == ["now"]
