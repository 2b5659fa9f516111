"""What setpoints may still do to the wheel, against the gateway's own limiter driven at its bounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import vehicles
from vve_sumo.lot.turning import Turning
from vve_sumo.vehicle.limits import COMFORT, Limiter, Limits

VEHICLE = vehicles.FUSION.vehicle
TURNING = Turning.of(VEHICLE, COMFORT.lateral_jerk, 0.13, COMFORT.acceleration)


@settings(deadline=None)
@given(st.floats(0.0, 15.0), st.floats(-0.1, 0.1), st.sampled_from((1.0, -1.0)))
def test_no_setpoint_turns_the_wheel_farther_before_the_stop(speed: float, steering: float, sign: float) -> None:
    limiter = Limiter(VEHICLE, Limits(), VEHICLE.steering_limit)
    limiter.reset(0.0, steering)
    for _ in range(13):
        limiter.step(0.0, sign, speed, emergency=False, elapsed=0.01)
    low, high = TURNING.until_stop(speed, steering, (steering, steering))
    assert low - 1e-9 <= limiter.steering <= high + 1e-9


@given(speed=st.floats(0.0, 40.0), jerk=st.floats(0.5, 50.0))
def test_the_wheel_turns_as_fast_as_the_limiter_lets_it(speed: float, jerk: float) -> None:
    rate = Limiter(VEHICLE, Limits(), VEHICLE.steering_limit).steering_rate_bound(speed, jerk)
    _, high = Turning.of(VEHICLE, jerk, 0.13, COMFORT.acceleration).until_stop(speed, 0.0, (0.0, 0.0))
    assert high == pytest.approx(min(0.13 * rate, VEHICLE.steering_limit))


def test_what_was_asked_for_counts_as_far_as_the_wheel_lags_behind() -> None:
    calm = TURNING.at_once(8.0, 0.0, (0.0, 0.0))
    asked = TURNING.at_once(8.0, 0.0, (0.0, 0.5))
    assert asked[0] == calm[0]
    assert asked[1] - calm[1] == pytest.approx(5.0 * 2.85 / 64.0 * TURNING.answer_time)


def test_led_astray_turns_the_heading_by_the_integral_of_the_wheel() -> None:
    """A trapezoid: up at the limiter's rate, held until the steering answers the stop, and back."""
    spacing, speed = 0.5, 8.0
    left = TURNING.led_astray(np.zeros(60), spacing, speed, 0.0, (0.0, 0.0))[1]
    angle, until = TURNING.until_stop(speed, 0.0, (0.0, 0.0))[1], TURNING.lifetime + TURNING.answer_time
    heading = spacing * (left.sum() - 0.5 * (left[0] + left[-1]))
    fast = speed + COMFORT.acceleration * until
    assert heading == pytest.approx(np.tan(angle) / 2.85 * fast * until, rel=0.02)


@settings(deadline=None, max_examples=50)
@given(speed=st.floats(0.5, 15.0), acceleration=st.floats(0.5, 5.0), side=st.sampled_from((0, 1)))
def test_a_car_that_speeds_up_all_the_while_turns_no_farther(speed: float, acceleration: float, side: int) -> None:
    """An integration of its own, without brakes: the wheel turns away at the limiter's rate, waits, and turns back."""
    turning, spacing = Turning.of(VEHICLE, COMFORT.lateral_jerk, 0.13, acceleration), 0.2
    ways = turning.led_astray(np.zeros(400), spacing, speed, 0.0, (0.0, 0.0))
    angle = turning.until_stop(speed, 0.0, (0.0, 0.0))[side]
    until = turning.lifetime + turning.answer_time
    rise = abs(angle) / Limiter(VEHICLE, Limits(), 1.0).steering_rate_bound(speed, COMFORT.lateral_jerk)
    t = np.linspace(0.0, until + rise, 4001)
    bend = np.interp(t, [0.0, rise, until, until + rise], np.array([0.0, 1.0, 1.0, 0.0]) * np.tan(angle) / 2.85)
    turned = abs(np.trapezoid(bend * (speed + acceleration * t), t))
    heading = abs(spacing * (ways[side].sum() - 0.5 * (ways[side][0] + ways[side][-1])))
    assert heading >= turned * (1.0 - 5e-3)
