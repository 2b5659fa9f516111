"""The rig's speed limit: no setpoint drives the car beyond it, and a car that is beyond it by the margin is stopped."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import vehicles
from tests.vehicle.car import CALIBRATION, FUSION, PERIOD, Rig
from tests.vehicle.whole_car import LOT, VEHICLE, WholeCar
from vve_sumo.plant.car import ActuatorFaults, Car
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.limits import SPEED_LIMIT_BRAKING, SPEED_LIMIT_MARGIN, SPEED_LIMIT_TIME, Limiter, Limits

S = ArmingState
STEEP = math.atan(0.05)


def limited_car(limit: float, grade: float = 0.0, mass_factor: float = 1.0) -> WholeCar:
    parameters = vehicles.parameters(noise=0.0, grade=grade, mass_factor=mass_factor)
    car = Car(parameters, (0.0, 0.0, 0.0), LOT, 1_447_000_000.0, np.random.SeedSequence(1))
    limits = Limits(speed=limit)
    return WholeCar(car, Gateway(VEHICLE, calibration=parameters.calibration, limits=limits))


def engaged(whole: WholeCar, grade: float) -> None:
    for _ in range(10):
        whole.step(grade=grade)
    whole.step(command=OperatorCommand.ENGAGE, grade=grade)
    while whole.step(grade=grade).reasons != ("waiting_for_go",):
        assert whole.tick < 200
    whole.step(command=OperatorCommand.GO, grade=grade)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("limit", [3.0, 12.0])
@pytest.mark.parametrize("grade", [-STEEP, 0.0, STEEP])
@pytest.mark.parametrize("mass_factor", [0.85, 1.15])
def test_a_brain_that_asks_for_more_for_ever_stays_at_the_limit(limit, grade, mass_factor):
    whole = limited_car(limit, grade, mass_factor)
    engaged(whole, grade)
    fastest = 0.0
    for _ in range(1000):
        status = whole.step(2.0, grade=grade)
        fastest = max(fastest, whole.car.truth().speed)
    assert (status.state, status.reasons) == (S.ENGAGED, ())
    assert fastest < limit + 0.1
    assert whole.car.truth().speed == pytest.approx(limit, abs=0.05)
    assert status.limited[-1] == "speed"


def test_without_a_limit_the_same_brain_is_faster():
    whole = WholeCar()
    whole.engage()
    for _ in range(500):
        status = whole.step(2.0)
    assert whole.car.truth().speed > 13.0
    assert "speed" not in status.limited


def rolling(limit: float) -> Rig:
    rig = Rig(gateway=Gateway(FUSION, CALIBRATION, limits=Limits(speed=limit), period=PERIOD))
    rig.cruise(limit - 0.5)
    return rig


@pytest.mark.parametrize("wheels", [True, False], ids=["by the wheels", "by the receiver"])
@pytest.mark.parametrize("speed", [7.1, -7.1])
def test_a_car_beyond_the_margin_is_stopped_by_either_speed_forwards_and_backwards(wheels, speed):
    rig = rolling(6.0)
    if wheels:
        rig.car.speed = speed
        status = rig.step(1.0, speed=5.5)
    else:
        status = rig.step(1.0, speed=speed)
    assert (status.state, status.throttle) == (S.STOPPING, 0.0)
    assert "speed_above_limit" in status.reasons
    rig.run(8.0)
    assert rig.car.speed == 0.0


def test_a_car_within_the_margin_is_slowed_gently_and_goes_on():
    rig = rolling(6.0)
    rig.car.speed = 6.8
    statuses = rig.run(0.3, 2.0)
    assert {status.state for status in statuses} == {S.ENGAGED}
    assert min(status.acceleration for status in statuses) >= -1.0
    rig.run(5.0, 2.0)
    assert rig.car.speed == pytest.approx(6.0, abs=0.1)


@pytest.mark.parametrize("opening", [0.15, 0.4])
def test_a_runaway_is_stopped_before_it_is_much_beyond_the_margin(opening):
    """The throttle is stuck open: whatever is found first, the car is at rest in the end."""
    whole = limited_car(6.0)
    engaged(whole, 0.0)
    for _ in range(400):
        whole.step(2.0)
    whole.car.actuator_faults = ActuatorFaults(stuck_throttle=opening)
    fastest = 0.0
    for _ in range(500):
        status = whole.step(2.0)
        fastest = max(fastest, whole.car.truth().speed)
    assert status.state is not S.ENGAGED
    assert fastest < 6.0 + SPEED_LIMIT_MARGIN + 0.5
    assert whole.car.truth().speed == 0.0


# In closed form.


def limiter(limit: float | None) -> Limiter:
    return Limiter(FUSION, Limits(speed=limit), 0.5)


SPEEDS = st.floats(0.0, 40.0)


@pytest.mark.parametrize(
    ("speed", "granted"), [(0.0, 2.0), (8.4, 2.0), (9.2, 1.0), (10.0, 0.0), (10.4, -0.5), (10.8, -1.0), (12.0, -1.0)]
)
def test_the_limit_is_approached_within_eight_tenths_of_a_second_each(speed, granted):
    """Of 2 m/s2, at a limit of 10 m/s; beyond it the car is slowed with 1 m/s2 at most."""
    assert limiter(10.0).within_speed(2.0, speed) == pytest.approx(granted)
    assert limiter(10.0).within_speed(-3.0, speed) == -3.0


@pytest.mark.parametrize(("speed", "too_fast"), [(10.99, False), (11.0, False), (11.01, True)])
def test_a_car_that_is_one_metre_per_second_faster_than_its_limit_is_too_fast(speed, too_fast):
    assert limiter(10.0).too_fast(speed) is too_fast


@given(st.floats(0.5, 40.0), SPEEDS, st.floats(-9.0, 9.0))
def test_what_is_granted_is_the_least_of_the_request_and_the_approach_to_the_limit(limit, speed, asked):
    granted = limiter(limit).within_speed(asked, speed)
    approach = (limit - speed) / SPEED_LIMIT_TIME
    assert granted == min(asked, max(approach, -SPEED_LIMIT_BRAKING))
    assert granted <= asked
    assert speed < limit or granted <= 0.0, "no push at the limit and beyond"


@given(SPEEDS, st.floats(-9.0, 9.0))
def test_where_limit_or_speed_is_not_known_nothing_is_limited(speed, asked):
    assert limiter(None).within_speed(asked, speed) == asked
    assert not limiter(None).too_fast(speed)
    assert limiter(5.0).within_speed(asked, math.nan) == asked
    assert not limiter(5.0).too_fast(math.nan)


@given(st.floats(0.5, 40.0), SPEEDS)
def test_too_fast_is_beyond_the_margin(limit, speed):
    assert limiter(limit).too_fast(speed) is (speed > limit + SPEED_LIMIT_MARGIN)


@given(st.floats(1.0, 20.0), st.floats(0.0, 1.0))
def test_a_car_that_follows_the_grant_nears_the_limit_exponentially(limit, share):
    """dv/dt = (limit - v) / T from a speed below it: v = limit - (limit - v0) exp(-t / T), never beyond."""
    subject, speed, step = limiter(limit), share * limit, 0.001
    start = speed
    for _ in range(2000):
        speed += subject.within_speed(math.inf, speed) * step
        assert speed <= limit
    assert speed == pytest.approx(limit - (limit - start) * math.exp(-2.0 / SPEED_LIMIT_TIME), abs=0.01 * limit)


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan, math.inf])
def test_a_limit_that_is_no_positive_number_is_refused(limit):
    with pytest.raises(ValueError, match="limits: speed must be a positive number"):
        Limits(speed=limit)
