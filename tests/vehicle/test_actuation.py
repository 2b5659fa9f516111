"""Actuation in the loop with a car that is heavier, lighter, weaker or steeper than believed."""

from __future__ import annotations

import itertools
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicle.car import CALIBRATION, FUSION, GRAVITY, PERIOD, Car
from vve_sumo.vehicle.actuation import Actuation
from vve_sumo.vehicle.interface import Gear

CARS = list(itertools.product((0.85, 1.0, 1.15), (0.9, 1.0, 1.1), (-0.03, 0.0, 0.03)))


class Loop:
    """The car under the pedals, without any gateway; the grade is known or not."""

    def __init__(self, car: Car, grade_known: bool = True):
        self.car = car
        self.grade = car.grade if grade_known else 0.0
        self.car.gear, self.car.enabled, self.car._throttle_wish = Gear.DRIVE, True, 0.0
        self.actuation = Actuation(CALIBRATION, FUSION.brake_delay, FUSION.brake_lag)
        self.pedals = []

    def run(self, duration: float, wish):
        """Speeds at the ends of the periods; `wish` is a number or a function of the speed."""
        speeds = []
        for _ in range(round(duration / PERIOD)):
            measured = round(self.car.speed / FUSION.wheel_radius, 2) * FUSION.wheel_radius
            self.step(wish(self.car.speed) if callable(wish) else wish, measured)
            speeds.append(self.car.speed)
        return speeds

    def step(self, wish: float, measured: float) -> None:
        pedals = self.actuation.step(wish, measured, self.grade, PERIOD)
        self.pedals.append(pedals)
        self.car._brake_pipe.append(pedals.brake_torque)
        self.car._throttle_wish = pedals.throttle
        self.car.advance(PERIOD)


def slope(speeds, first, last):
    """Mean acceleration between two times [s]."""
    return (speeds[round(last / PERIOD)] - speeds[round(first / PERIOD)]) / (last - first)


@pytest.mark.parametrize("grade_known", [True, False])
@pytest.mark.parametrize(("mass", "gain", "grade"), CARS)
def test_wished_deceleration_is_there_after_a_second(mass, gain, grade, grade_known):
    loop = Loop(Car(mass=mass * 1690.0, brake_gain=gain, grade=grade, speed=14.0), grade_known)
    loop.actuation._holding = False
    loop.run(2.0, 0.0)
    loop.car.speed = 14.0
    speeds = loop.run(3.5, -2.5)
    for first in (1.0, 1.5, 2.0, 2.5):
        assert slope(speeds, first, first + 0.5) == pytest.approx(-2.5, abs=0.15)


@pytest.mark.thorough(witnesses=4)
@pytest.mark.parametrize(("mass", "gain", "grade"), CARS)
def test_the_car_stands_for_a_minute_and_drives_off_again(mass, gain, grade):
    loop = Loop(Car(mass=mass * 1690.0, brake_gain=gain, grade=grade, speed=5.0), grade_known=False)
    loop.actuation._holding = False
    stop = loop.run(5.0, -0.9)
    stop += loop.run(3.0, lambda speed: -0.9 if speed > 0.0 else 0.0)
    assert stop[-1] == 0.0
    assert set(loop.run(60.0, 0.0)) == {0.0}
    # Enough for a tenth of grade and the creep of a car 15 % heavier whose brakes give 10 % less.
    assert loop.pedals[-1].brake_torque * 0.9 * 1690.0 / 550.0 > 1.15 * 1690.0 * GRAVITY * 0.10 + 600.0
    speeds = loop.run(4.0, 1.0)
    assert min(speeds) > -0.06
    assert slope(speeds, 2.0, 3.9) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("grade", [-0.10, 0.10])
def test_a_tenth_of_grade_is_held_although_nobody_knows_of_it(grade):
    loop = Loop(Car(mass=1.15 * 1690.0, brake_gain=0.9, grade=grade), grade_known=False)
    loop.car._brake_pipe = [1500.0] * 2
    loop.car._torque = loop.actuation._torque = 1500.0
    assert set(loop.run(60.0, 0.0)) == {0.0}
    # Enough for a tenth of grade and the creep of a car 15 % heavier whose brakes give 10 % less.
    assert loop.pedals[-1].brake_torque * 0.9 * 1690.0 / 550.0 > 1.15 * 1690.0 * GRAVITY * 0.10 + 600.0


def test_a_steeper_slope_than_built_for_takes_all_the_brakes_there_are_and_keeps_them():
    loop = Loop(Car(mass=1.15 * 1690.0, brake_gain=0.9, grade=-0.20))
    speeds = loop.run(20.0, 0.0)
    assert loop.pedals[-1].brake_torque == 3250.0
    assert set(speeds[-round(15.0 / PERIOD) :]) == {0.0}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("wish", [-0.5, -0.35, -0.2, -0.1, 0.0, 0.1, 0.3])
def test_constant_wishes_do_not_make_the_pedals_take_turns(wish):
    for mass, gain, grade in CARS:
        loop = Loop(Car(mass=mass * 1690.0, brake_gain=gain, grade=grade, speed=12.0), grade_known=False)
        loop.actuation._holding = False
        loop.run(8.0, wish)
        used = [("throttle" if p.throttle > 0 else "brake") for p in loop.pedals if p.throttle or p.brake_torque]
        changes = sum(a != b for a, b in itertools.pairwise(used))
        assert changes <= 1, (mass, gain, grade)


def test_noise_does_not_make_the_pedals_take_turns_where_coasting_is_all_it_takes():
    """Rolling and air resistance are the wished deceleration, so the wanted force is noise around zero."""
    loop, noise = Loop(Car(speed=14.0)), random.Random(1)
    loop.actuation._holding = False
    believed = CALIBRATION
    for _ in range(round(20.0 / PERIOD)):
        speed = loop.car.speed
        loop.step(-believed.drag(speed) / 1690.0, speed + noise.gauss(0.0, 0.005))
    used = [("throttle" if p.throttle > 0 else "brake") for p in loop.pedals if p.throttle or p.brake_torque]
    assert sum(a != b for a, b in itertools.pairwise(used)) <= 1


def test_a_car_that_rolls_back_is_stopped_before_it_drives_off():
    loop = Loop(Car(speed=-0.8, grade=0.05))
    speeds = loop.run(3.0, 1.0)
    at_rest = next(i for i, speed in enumerate(speeds) if speed > -0.1)
    assert {pedals.throttle for pedals in loop.pedals[:at_rest]} == {0.0}
    assert speeds[-1] > 1.0


def test_a_speed_keeper_settles_without_changing_pedals():
    loop = Loop(Car(speed=10.0))
    loop.actuation._holding = False
    speeds = loop.run(20.0, lambda speed: 0.5 * (8.0 - speed))
    assert speeds[-1] == pytest.approx(8.0, abs=0.05)
    late = loop.pedals[-round(5.0 / PERIOD) :]
    assert len({p.throttle > 0 for p in late}) == 1


def test_a_saturated_pedal_winds_nothing_up():
    """A second of asking for twice what the brakes have must not be paid back by braking on."""
    loop = Loop(Car(speed=25.0, brake_lag=FUSION.brake_lag))
    loop.actuation._holding = False
    loop.run(1.5, -9.0)
    assert loop.pedals[-1].brake_torque == 3250.0
    speeds = loop.run(2.0, -1.0)
    assert slope(speeds, 0.3, 0.8) == pytest.approx(-1.0, abs=0.05)


@given(
    st.lists(
        st.tuples(st.floats(-9.0, 2.0), st.floats(-1.0, 30.0), st.floats(-1.6, 1.6), st.booleans()),
        min_size=1,
        max_size=60,
    )
)
def test_never_both_pedals_and_never_beyond_their_travel(steps):
    actuation = Actuation(CALIBRATION, FUSION.brake_delay, FUSION.brake_lag)
    for acceleration, speed, grade, brakes_only in steps:
        brake, throttle, _asked = actuation.step(acceleration, speed, grade, PERIOD, brakes_only=brakes_only)
        assert 0.0 <= brake <= 3250.0
        assert 0.0 <= throttle <= 1.0
        assert brake == 0.0 or throttle == 0.0
        assert throttle == 0.0 or not brakes_only


@pytest.mark.parametrize("steps", [1, 2, 10, 40])
@pytest.mark.parametrize("way", ["unknown", "wrong"])
def test_a_speed_that_fails_now_and_then_makes_the_car_brake_no_other_than_was_asked(steps, way):
    """Zero that is not believed, or no speed at all, every other few steps; a car 15 % heavier than declared."""
    loop = Loop(Car(speed=25.0, brake_lag=FUSION.brake_lag, mass=1.15 * 1690.0))
    actuation, speeds = loop.actuation, []
    actuation._holding = False
    for number in range(400):
        if number // steps % 2 == 0:
            pedals = actuation.step(-2.0, loop.car.speed, 0.0, PERIOD, brakes_only=True)
        elif way == "wrong":
            pedals = actuation.step(-2.0, 0.0, 0.0, PERIOD, brakes_only=True, believed=False)
        else:
            pedals = actuation.without_speed(2.0, 0.0)
            actuation.lose_speed()
        loop.car._brake_pipe.append(pedals.brake_torque)
        loop.car.advance(PERIOD)
        speeds.append(loop.car.speed)
    assert slope(speeds, 2.0, 6.0) == pytest.approx(-2.0, abs=0.35)


def test_a_stop_whose_speed_fell_at_once_and_is_doubted_from_then_on_brakes_as_asked():
    """Wheel speeds that were a tenth too large become right: a car that seems to brake hard must not brake less."""
    loop = Loop(Car(speed=12.0, brake_lag=FUSION.brake_lag))
    actuation, speeds = loop.actuation, []
    actuation._holding = False
    for number in range(200):
        scale, believed = (1.1, True) if number < 40 else (1.0, number < 45)
        pedals = actuation.step(
            -2.4, scale * loop.car.speed, 0.0, PERIOD, brakes_only=True, believed=believed
        )  # fmt: skip
        loop.car._brake_pipe.append(pedals.brake_torque)
        loop.car.advance(PERIOD)
        speeds.append(loop.car.speed)
    assert slope(speeds, 1.5, 3.5) == pytest.approx(-2.4, abs=0.2)


def test_one_wrong_report_of_zero_neither_holds_nor_corrects():
    actuation = Actuation(CALIBRATION, FUSION.brake_delay, FUSION.brake_lag)
    actuation._holding = False
    before = [actuation.step(-2.0, 8.0 - 0.04 * number, 0.0, PERIOD) for number in range(50)][-1]
    wrong = actuation.step(-2.0, 0.0, 0.0, PERIOD, believed=False)
    assert wrong.brake_torque == pytest.approx(before.brake_torque, abs=10.0)
    assert actuation.step(-2.0, 5.92, 0.0, PERIOD).brake_torque == pytest.approx(before.brake_torque, abs=10.0)


@pytest.mark.parametrize("believed", [False, True])
def test_a_speed_of_nan_reaches_no_pedal(believed):
    actuation = Actuation(CALIBRATION, FUSION.brake_delay, FUSION.brake_lag)
    actuation._holding = False
    for speed, trusted in ((8.0, True), (math.nan, True), (0.0, believed), (math.nan, False), (7.8, True)):
        pedals = actuation.step(-2.0, speed, 0.0, PERIOD, believed=trusted)
        assert all(map(math.isfinite, pedals)), speed


@pytest.mark.parametrize("deceleration", [2.4, 4.0])
def test_without_a_speed_the_brakes_still_give_what_is_asked_against_full_creep(deceleration):
    actuation = Actuation(CALIBRATION, FUSION.brake_delay, FUSION.brake_lag)
    brake, throttle, _asked = actuation.without_speed(deceleration, grade=0.05)
    assert actuation.without_speed(deceleration, grade=0.0).brake_torque == brake, "no help of a slope is relied on"
    steeper = actuation.without_speed(deceleration, grade=-0.05).brake_torque - brake
    assert steeper / 550.0 == pytest.approx(GRAVITY * math.sin(0.05))
    assert throttle == 0.0
    assert (brake * 1690.0 / 550.0 - 600.0) / 1690.0 == pytest.approx(deceleration)
    assert brake / 550.0 > GRAVITY * 0.03
