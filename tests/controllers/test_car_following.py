"""Car-following laws against their closed forms, and the controllers made of them behind a car of constant speed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from tests.conftest import REPOSITORY
from tests.controllers.street import FUSION, Flaws, Obstacle, drive
from vve_sumo import controller
from vve_sumo.controllers import ConstantTimeGap, IntelligentDriver
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath

ROAD = ReferencePath.from_points([0.0, 1000.0], [0.0, 0.0])
CONTROLLERS = REPOSITORY / "controllers"
DESIRED = 11.0


def steady_gap(name: str, tuning: dict[str, float], lead_speed: float) -> tuple[float, float]:
    """Return the gap [m] and the speed [m/s] that a controller settles on behind a car of constant speed."""
    made = controller.load(name, FUSION, tuning, [CONTROLLERS])
    lead = Obstacle(60.0, speed=lambda _time: lead_speed)
    done = drive(made, ROAD, DESIRED, [lead], 90.0, flaws=Flaws(steering_zero=0.0, misalignment=0.0), start_speed=8.0)
    settled = done.time > 80.0
    assert not done.emergency.any()
    assert np.abs(done.d).max() < 0.2
    return float(done.gap[settled].mean()), float(done.speed[settled].mean())


@given(st.floats(0.0, 10.9))
def test_in_equilibrium_neither_law_accelerates(speed: float) -> None:
    acc, idm = ConstantTimeGap(4.0, 1.2, 0.3, 0.5), IntelligentDriver()
    assert acc.acceleration(speed, DESIRED, 4.0 + 1.2 * speed, speed) == pytest.approx(0.0, abs=1e-9)
    gap = (2.0 + 1.6 * speed) / math.sqrt(1.0 - (speed / DESIRED) ** 4)
    assert idm.acceleration(speed, DESIRED, gap, speed) == pytest.approx(0.0, abs=1e-9)
    assert idm.equilibrium_gap(speed, DESIRED) == pytest.approx(gap)


def test_the_limits_of_the_intelligent_driver_are_the_papers() -> None:
    idm = IntelligentDriver()
    assert idm.acceleration(0.0, DESIRED, math.inf, 0.0) == 0.73  # from rest on a free road
    assert idm.acceleration(DESIRED, DESIRED, math.inf, 0.0) == 0.0
    # Far faster than the car ahead, with the gap that comfortable braking takes: what the gap
    # adds to the free road tends to -b.
    speed = 1e4
    braking = idm.acceleration(speed, 1e9, speed**2 / (2.0 * 1.67), 0.0)
    assert braking - 0.73 == pytest.approx(-1.67, rel=0.01)
    assert math.isfinite(idm.acceleration(5.0, DESIRED, -3.0, 0.0))


def test_a_gap_error_of_the_constant_time_gap_dies_out_as_its_linear_system_says() -> None:
    law, step = ConstantTimeGap(5.0, 1.5, 0.23, 0.6), 0.001
    gap, speed, lead = 40.0, 10.0, 8.0
    for _ in range(4000):
        acceleration = law.acceleration(speed, DESIRED, gap, lead)
        gap += (lead - speed) * step - 0.5 * acceleration * step**2
        speed += acceleration * step
    system = np.array([[0.0, -1.0], [law.gap_gain, -law.gap_gain * law.time_gap - law.speed_gain]])
    steady = np.array([5.0 + 1.5 * lead, lead])
    there = steady + expm(4.0 * system) @ (np.array([40.0, 10.0]) - steady)
    assert (gap, speed) == pytest.approx(tuple(there), rel=1e-3)


def amplification(law: ConstantTimeGap) -> float:
    """Return the greatest gain from the leader's speed to the follower's over the frequency."""
    s = 1j * np.geomspace(1e-4, 1e2, 4000)
    return float(
        np.abs(
            (law.speed_gain * s + law.gap_gain)
            / (s * s + (law.speed_gain + law.gap_gain * law.time_gap) * s + law.gap_gain)
        ).max()
    )


@given(st.floats(0.5, 3.0), st.floats(0.05, 2.0), st.floats(0.0, 3.0))
def test_the_stated_condition_of_string_stability_is_that_of_the_transfer_function(
    time_gap: float, gap_gain: float, speed_gain: float
) -> None:
    law, margin = (
        ConstantTimeGap(5.0, time_gap, gap_gain, speed_gain),
        speed_gain * time_gap + gap_gain * time_gap**2 / 2,
    )
    if abs(margin - 1.0) > 0.02:
        assert (amplification(law) <= 1.0 + 1e-9) == (margin > 1.0)


@pytest.mark.thorough
@pytest.mark.parametrize("lead_speed", [4.0, 8.0])
def test_the_controllers_settle_on_the_gap_of_their_law(lead_speed: float) -> None:
    gap, speed = steady_gap("acc", {"time_headway_s": 1.8, "gap_m": 3.0}, lead_speed)
    assert speed == pytest.approx(lead_speed, abs=0.05)
    assert gap == pytest.approx(3.0 + 1.8 * speed, abs=0.3)
    gap, speed = steady_gap("idm", {"acceleration_m_s2": 1.5}, lead_speed)
    assert speed == pytest.approx(lead_speed, abs=0.1)
    assert gap == pytest.approx((2.0 + 1.6 * speed) / math.sqrt(1.0 - (speed / DESIRED) ** 4), abs=0.4)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["acc", "idm"])
def test_they_stop_behind_a_standing_car_and_drive_on_alone(name: str) -> None:
    made = controller.load(name, FUSION, {}, [CONTROLLERS])
    done = drive(made, ROAD, DESIRED, [Obstacle(150.0)], 90.0, flaws=Flaws(steering_zero=0.0), start_speed=8.0)
    assert done.speed[-1] == 0.0
    assert {"acc": 5.0, "idm": 2.0}[name] == pytest.approx(done.gap[-1], abs=0.9)
    free = drive(controller.load(name, FUSION, {}, [CONTROLLERS]), ROAD, DESIRED, [], 40.0, start_speed=8.0)
    assert free.speed[-1] > 10.0


@pytest.mark.parametrize("name", ["acc", "idm"])
def test_a_wrong_tuning_is_one_line(name: str) -> None:
    with pytest.raises(ConfigError, match=f"controller {name}: tuning key 'comfort' is unknown"):
        controller.load(name, FUSION, {"comfort": True}, [CONTROLLERS])
    with pytest.raises(ConfigError, match="must be 0 to 5, got 9"):
        controller.load(name, FUSION, {"time_headway_s": 9.0}, [CONTROLLERS])
