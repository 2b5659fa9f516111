"""Dead times, lags and limits against their step responses."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.plant.actuators import DeadTime, Lagged, Steering, share_of_step

STEP = 0.005


@given(st.integers(0, 40), st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=100))
def test_dead_time_is_a_pure_shift(steps: int, values: list[float]) -> None:
    line = DeadTime(steps * STEP, STEP, -7.0)
    assert [line.step(value) for value in values] == ([-7.0] * steps + values)[: len(values)]


@pytest.mark.parametrize(("delay", "lag"), [(0.0, 0.02), (0.025, 0.015), (0.03, 0.1)])
def test_step_response_is_the_exponential_after_the_dead_time(delay: float, lag: float) -> None:
    actuator = Lagged(delay, lag, STEP)
    for step in range(1, 200):
        since = step * STEP - delay
        expected = 3000.0 * -math.expm1(-since / lag) if since > 1e-9 else 0.0
        assert actuator.step(3000.0) == pytest.approx(expected, abs=1e-6)


def test_no_lag_follows_at_once() -> None:
    assert share_of_step(0.0, STEP) == 1.0
    assert Lagged(0.0, 0.0, STEP).step(0.7) == 0.7


def test_steering_keeps_to_rate_and_angle() -> None:
    steering = Steering(0.04, 0.08, rate_limit=8.0, angle_limit=2.0, duration=STEP)
    last, fastest = 0.0, 0.0
    for _ in range(400):
        angle = steering.step(5.0, rolling=True)
        fastest, last = max(fastest, (angle - last) / STEP), angle
    assert fastest == pytest.approx(8.0)
    assert angle == pytest.approx(2.0, abs=1e-6)


@pytest.mark.plain
def test_a_released_wheel_returns_only_while_rolling() -> None:
    steering = Steering(0.0, 0.0, rate_limit=1000.0, angle_limit=8.0, duration=STEP)
    steering.step(1.0, rolling=True)
    for _ in range(100):
        steering.step(math.nan, rolling=False)
    assert steering.angle == 1.0
    for _ in range(100):
        steering.step(math.nan, rolling=True)
    assert steering.angle == pytest.approx(math.exp(-0.5 / Steering.RETURN_LAG), rel=1e-9)
