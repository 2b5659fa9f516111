"""The calibration: its numbers against each other and against a standard car's coast-down."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import vehicles
from vve_sumo.errors import ConfigError

FUSION = vehicles.FUSION.calibration


def test_the_measured_brake_plateau_is_reproduced():
    """Public recordings of one Fusion: 3017 N m gave 5.49 m/s2."""
    assert FUSION.brake_force(3017.0) / FUSION.mass == pytest.approx(5.49, abs=0.01)
    assert FUSION.brake_force(FUSION.brake_torque_limit) / FUSION.mass == pytest.approx(5.9, abs=0.05)


@given(st.floats(0.0, 1.0), st.floats(0.0, 60.0))
def test_throttle_and_force_are_inverse(throttle, speed):
    assert FUSION.throttle(FUSION.drive_force(throttle, speed), speed) == pytest.approx(throttle, abs=1e-12)


@given(st.floats(0.0, 3250.0))
def test_brake_torque_and_force_are_inverse(torque):
    assert FUSION.brake_torque(FUSION.brake_force(torque)) == pytest.approx(torque, abs=1e-9)


@given(st.floats(-1e5, 1e5), st.floats(-5.0, 60.0))
def test_pedals_never_leave_their_travel(force, speed):
    assert 0.0 <= FUSION.throttle(force, speed) <= 1.0
    assert 0.0 <= FUSION.brake_torque(force) <= FUSION.brake_torque_limit


def test_full_throttle_is_constant_force_then_constant_power():
    corner = 120_000.0 / 6500.0
    assert FUSION.full_throttle_force(0.0) == FUSION.full_throttle_force(corner * 0.999) == 6500.0
    assert FUSION.full_throttle_force(40.0) * 40.0 == pytest.approx(120_000.0)
    assert FUSION.full_throttle_force(corner * 1.001) == pytest.approx(6500.0, rel=2e-3)


def test_creep_fades_linearly_and_pushes_a_car_rolling_backwards_no_harder():
    assert [FUSION.creep(speed) for speed in (-3.0, 0.0, 1.0, 2.0, 10.0)] == [600.0, 600.0, 300.0, 0.0, 0.0]


def test_drag_at_highway_speed():
    """30 m/s: 0.012 * 1690 * 9.80665 = 198.9 N rolling and 0.372 * 900 = 334.8 N of air."""
    assert FUSION.drag(30.0) == pytest.approx(533.7, abs=0.1)


@pytest.mark.parametrize("name", ["mass", "brake_gain", "brake_torque_limit", "drive_force_limit", "drive_power_limit"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_an_impossible_car_is_refused_by_name(name, value):
    with pytest.raises(ConfigError, match=f"calibration: {name} must be"):
        replace(FUSION, **{name: value})
