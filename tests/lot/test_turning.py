"""What setpoints may still do to the wheel, against the gateway's own limiter driven at its bounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import vehicles
from vve_sumo.lot.turning import Turning
from vve_sumo.vehicle.limits import Limiter, Limits

VEHICLE = vehicles.FUSION.vehicle
TURNING = Turning.of(VEHICLE, Limits().comfort.lateral_jerk, 0.13)


@settings(deadline=None)
@given(st.floats(0.0, 15.0), st.floats(-0.1, 0.1), st.sampled_from((1.0, -1.0)))
def test_no_setpoint_turns_the_wheel_farther_before_the_stop(speed: float, steering: float, sign: float) -> None:
    limiter = Limiter(VEHICLE, Limits(), VEHICLE.steering_limit)
    limiter.reset(0.0, steering)
    for _ in range(13):
        limiter.step(0.0, sign, speed, emergency=False, elapsed=0.01)
    low, high = TURNING.until_stop(speed, steering, (steering, steering))
    assert low - 1e-9 <= limiter.steering <= high + 1e-9


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
    assert heading == pytest.approx(np.tan(angle) / 2.85 * (speed + 0.5) * until, rel=0.02)
