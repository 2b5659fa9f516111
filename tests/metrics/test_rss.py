"""The RSS distance against Intel's own library, where it is installed; LGPL, so a test's oracle and no dependency."""

from __future__ import annotations

import itertools
import warnings
from typing import Any

import numpy as np
import pytest

from vve_sumo.metrics import following
from vve_sumo.metrics.following import Rss

with warnings.catch_warnings():
    # Its bindings register a vector type twice.
    warnings.simplefilter("ignore", RuntimeWarning)
    ad_rss = pytest.importorskip("ad_rss")

SPEEDS = (0.0, 1.0, 5.0, 13.9, 22.2, 36.1)
ASSUMED = (following.RSS, Rss(0.3, 1.0, 6.0, 9.0), Rss(2.0, 3.5, 4.0, 6.0))


def state(speed: float, assumed: Rss) -> Any:
    """A vehicle of ad-rss; whatever is left at not-a-number makes it refuse, also what the distance does not need."""
    physics, rss = ad_rss.physics, ad_rss.rss
    state = rss.core.RelativeObjectState()
    state.object_type = rss.world.ObjectType.OtherVehicle
    velocity, dynamics = state.structured_object_state.velocity, state.dynamics
    velocity.speed_lon_min = velocity.speed_lon_max = physics.Speed(speed)
    velocity.speed_lat_min = velocity.speed_lat_max = physics.Speed(0.0)
    state.structured_object_state.is_in_correct_lane = True
    state.structured_object_state.distance_to_enter_intersection = physics.Distance(0.0)
    state.structured_object_state.distance_to_leave_intersection = physics.Distance(1000.0)
    dynamics.alpha_lon.accel_max = physics.Acceleration(assumed.acceleration)
    dynamics.alpha_lon.brake_max = physics.Acceleration(-assumed.max_braking)
    dynamics.alpha_lon.brake_min = physics.Acceleration(-assumed.min_braking)
    dynamics.alpha_lon.brake_min_correct = physics.Acceleration(-assumed.min_braking)
    dynamics.alpha_lat.accel_max = physics.Acceleration(0.2)
    dynamics.alpha_lat.brake_min = physics.Acceleration(-0.8)
    dynamics.lateral_fluctuation_margin = physics.Distance(0.0)
    dynamics.response_time = physics.Duration(assumed.response)
    dynamics.max_speed_on_acceleration = physics.Speed(100.0)
    _fill_what_has_no_part_in_it(state)
    return state


def _fill_what_has_no_part_in_it(state: Any) -> None:
    physics = ad_rss.physics
    settings, placed = state.dynamics.unstructured_settings, state.unstructured_object_state
    settings.pedestrian_turning_radius = settings.vehicle_min_radius = physics.Distance(5.0)
    settings.drive_away_max_angle = physics.Angle(1.0)
    settings.vehicle_yaw_rate_change = physics.AngularAcceleration(0.3)
    settings.vehicle_trajectory_calculation_step = physics.Duration(0.2)
    placed.yaw, placed.steering_angle = physics.Angle(0.0), physics.Angle(0.0)
    placed.yaw_rate = physics.AngularVelocity(0.0)
    placed.dimension.length, placed.dimension.width = physics.Distance(4.5), physics.Distance(1.8)
    placed.center_point.x, placed.center_point.y = physics.Distance(0.0), physics.Distance(0.0)
    placed.speed_range.minimum, placed.speed_range.maximum = physics.Speed(0.0), physics.Speed(0.0)


def theirs(speed: float, leader_speed: float, assumed: Rss) -> float:
    distance = ad_rss.physics.Distance(0.0)
    rule = ad_rss.rss.structured.calculateSafeLongitudinalDistanceSameDirection
    assert rule(state(leader_speed, assumed), state(speed, assumed), distance)
    return float(str(distance))


def test_rss_distance_is_that_of_intels_library() -> None:
    """It writes four digits or so."""
    for assumed in ASSUMED:
        rows = np.array(list(itertools.product(SPEEDS, SPEEDS)))
        expected = [theirs(speed, leader, assumed) for speed, leader in rows]
        found = following.rss_distance(rows[:, 0], rows[:, 1], assumed)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=5e-4)
        assert np.count_nonzero(found) > 15
