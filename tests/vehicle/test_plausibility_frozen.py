"""Wheel speeds, gyroscope and steering report that do not change although the car's motion does."""

from __future__ import annotations

import math

import pytest

from tests.setpoints import setpoint as complete
from tests.vehicle.steady_circle import STEP, Drive
from vve_sumo.vehicle.plausibility import CarMotion


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("change", "found"), [(0.199, False), (0.201, True)])
def test_wheels_that_do_not_change_while_the_receivers_speed_does(change, found, sign):
    drive = Drive()
    drive.run(1.0, car={"wheels": (5.0,)})
    after, reasons = drive.until(car={"wheels": (5.0,)}, receiver={"speed": sign * change})
    assert (after, reasons) == ((pytest.approx(0.5), ["wheel_speeds_frozen"]) if found else (math.inf, []))


def test_wheels_that_changed_once_are_measured_from_there():
    drive = Drive()
    drive.run(0.5, car={"wheels": (5.0,)})
    drive.run(0.4, car={"wheels": (5.0,)}, receiver={"speed": 0.25})
    assert drive.until(car={"wheels": (6.0,)}, receiver={"speed": 0.25}) == (math.inf, [])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("change", "found"), [(0.039, False), (0.041, True)])
def test_a_gyroscope_that_does_not_change_while_the_receiver_sees_a_turn(change, found, sign):
    drive = Drive()
    drive.run(0.2, still=True)
    after, reasons = drive.until(receiver={"yaw_rate": sign * change}, still=True)
    assert (after, reasons) == ((pytest.approx(0.5), ["yaw_rate_frozen"]) if found else (math.inf, []))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("change", "found"), [(0.029, False), (0.031, True)])
def test_a_steering_report_that_does_not_change_while_it_is_told_to(change, found, sign):
    drive = Drive()
    found_frozen(drive, 0.0, 0.001)  # it moved once since its first step
    assert not any(found_frozen(drive, 0.0) for _ in range(50))
    seen = [found_frozen(drive, sign * change) for _ in range(60)]
    assert seen.index(True) == 25 if found else not any(seen)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("left", "found"), [(0.199, False), (0.201, True)])
def test_wheels_whose_speed_the_receiver_comes_to_are_not_frozen(left, found, sign):
    """Fixes that are late: a speed that was 0.3 m/s off when the wheels last changed is `left` off for good."""
    for side in (1.0, -1.0):  # on which side of the wheels' it ends
        drive = Drive()
        drive.run(0.2, receiver={"speed": sign * 0.3})
        drive.run(0.02, car={"wheels": (5.0,)}, receiver={"speed": sign * 0.3})
        after, reasons = drive.until(car={"wheels": (5.0,)}, receiver={"speed": side * left})
        changed = abs(side * left - sign * 0.3) > 0.2
        expected = (pytest.approx(0.5), ["wheel_speeds_frozen"]) if found and changed else (math.inf, [])
        assert (after, reasons) == expected, side


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("left", "found"), [(0.039, False), (0.041, True)])
def test_a_gyroscope_whose_yaw_rate_the_receiver_comes_to_is_not_frozen(left, found, sign):
    drive = Drive()
    drive.run(0.2, receiver={"yaw_rate": sign * 0.09})
    drive.run(0.2, receiver={"yaw_rate": sign * 0.09}, still=True)
    after, reasons = drive.until(receiver={"yaw_rate": sign * left}, still=True)
    assert (after, reasons) == ((pytest.approx(0.5), ["yaw_rate_frozen"]) if found else (math.inf, []))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("change", "found"), [(0.039, False), (0.041, True)])
def test_the_bias_of_a_frozen_gyroscope_neither_hides_it_nor_betrays_it(change, found, sign):
    drive = Drive(learnt=False, settling=0.0)
    drive.stand(2.0, yaw_rate=0.02)
    drive.run(1.0, car={"yaw_rate": 0.02})
    drive.run(0.2, car={"yaw_rate": 0.02}, still=True)
    _, reasons = drive.until(car={"yaw_rate": 0.02}, receiver={"yaw_rate": sign * change}, still=True)
    assert reasons == (["yaw_rate_frozen"] if found else [])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("left", "found"), [(0.029, False), (0.031, True)])
def test_a_steering_report_to_which_the_command_comes_back_is_not_frozen(left, found, sign):
    """The report, 0, last changed as the command was 0.08 rad off."""
    drive = Drive()
    found_frozen(drive, sign * 0.08, 0.001)
    assert not any(found_frozen(drive, sign * 0.08) for _ in range(10))
    seen = [found_frozen(drive, sign * left) for _ in range(60)]
    assert seen.index(True) == 25 if found else not any(seen)


def test_what_was_told_before_a_silence_is_not_compared_with_what_is_told_after_it():
    drive = Drive()
    found_frozen(drive, 0.0, 0.001)
    assert not any(found_frozen(drive, angle) for angle in [0.0] * 50 + [math.nan] + [0.05] * 60)


def found_frozen(drive: Drive, angle: float, reported: float = 0.0) -> bool:
    drive._tick()
    motion = CarMotion(10.0, 0.0, reported, (float(drive.ticks),), angle, False)
    drive.x += 10.0 * STEP * math.cos(drive.heading)
    drive.y += 10.0 * STEP * math.sin(drive.heading)
    setpoint = complete(0.0, 0.0, time=drive.now, x=drive.x, y=drive.y, heading=drive.heading, speed=10.0, yaw_rate=0.0)
    return "steering_report_frozen" in drive.subject.step(drive.now, STEP, motion, setpoint, True)
