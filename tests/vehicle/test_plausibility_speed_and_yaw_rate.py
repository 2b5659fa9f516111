"""Receiver and car compared at one moment: speed, yaw rate and steering report, just inside and outside the limits."""

from __future__ import annotations

import math

import pytest

from tests.vehicle.car import CALIBRATION, FUSION
from tests.vehicle.steady_circle import STEP, UNDERSTEER, Drive
from vve_sumo.vehicle.plausibility import CarMotion, Plausibility


@pytest.mark.parametrize("heading", [0.0, 1.0, 3.1, -2.0])
@pytest.mark.parametrize("yaw_rate", [0.0, 0.3, -0.3])
@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_a_steady_circle_is_plausible(speed, yaw_rate, heading):
    Drive(speed, yaw_rate, heading).run(15.0)


# Speeds: 0.30 m/s and twice two percent of the wheels' speed, at 10 m/s 0.70 m/s.


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("speed", "allowed"), [(10.0, 0.7), (-10.0, 0.7), (1.0, 0.34)])
def test_a_speed_that_differs_for_half_a_second(speed, allowed, sign):
    assert Drive(speed).until(receiver={"speed": sign * (allowed - 0.001)}) == (math.inf, [])
    after, reasons = Drive(speed).until(receiver={"speed": sign * (allowed + 0.001)})
    assert (after, reasons) == (pytest.approx(0.5), ["speed_mismatch"])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_speed_that_differs_by_three_times_as_much_for_a_tenth(sign):
    assert Drive().until(receiver={"speed": sign * 2.099})[0] == pytest.approx(0.5)
    assert Drive().until(receiver={"speed": sign * 2.101}) == (pytest.approx(0.1), ["speed_mismatch"])


def test_while_the_car_accelerates_the_speeds_may_be_three_tenths_of_a_second_apart():
    """2 m/s2: 0.6 m/s more, once the measured acceleration has settled; the wheels are held against what they say."""
    for more, last in ((-0.01, []), (0.01, ["speed_mismatch"])):
        drive = Drive(5.0)
        for number in range(100):
            drive.speed += 2.0 * STEP
            off = 0.3 + 0.04 * drive.speed + 0.6 + more if number >= 50 else 0.0
            reasons = drive.step(receiver={"speed": off})
            if reasons:
                break
        assert reasons == last


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_yaw_rate_that_differs_for_half_a_second(sign):
    assert Drive().until(receiver={"yaw_rate": sign * 0.099}, car={"yaw_rate": 0.0}) == (math.inf, [])
    drive = Drive()
    after, reasons = drive.until(receiver={"yaw_rate": sign * 0.101})
    assert (after, reasons) == (pytest.approx(0.5), ["yaw_rate_mismatch"])


@pytest.mark.parametrize("name", ["speed", "yaw_rate"])
def test_what_the_receiver_does_not_know_agrees_with_nothing(name):
    drive = Drive()
    assert f"{name}_mismatch" in [code for _ in range(50) for code in drive.step(receiver={name: math.nan})]


@pytest.mark.parametrize("name", ["speed", "yaw_rate"])
def test_a_break_begins_anew(name):
    drive = Drive()
    for _ in range(3):
        drive.run(0.48, receiver={name: 0.95 if name == "speed" else 0.12})
        drive.step(silent=True)
    for _ in range(3):
        drive.run(0.08, receiver={"speed": 5.0})
        drive.step(silent=True)


# The steering report against the gyroscope: 0.06 rad/s and a fifth of what the angle should give.


@pytest.mark.parametrize("speed", [3.0, 12.0])
@pytest.mark.parametrize("steering", [0.0, 0.05, -0.05])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_steering_report_against_the_gyroscope(speed, steering, sign):
    """Single-track model on a steady circle (Rajamani, Vehicle Dynamics and Control, 3.3)."""
    circle = speed * math.tan(steering) / (2.85 + UNDERSTEER * speed * speed)
    allowed = 0.06 + 0.2 * abs(circle)
    for off, found in ((allowed - 0.001, False), (allowed + 0.001, True)):
        subject = Plausibility(FUSION, CALIBRATION)
        car = CarMotion(speed, circle + sign * off, steering, (1.0,), math.nan, False)
        said = [subject.step(k * STEP, STEP, car, None, False) for k in range(30)]
        assert (said[24], said[25]) == ([], ["steering_mismatch"] if found else [])


def test_silent_wheels_or_gyroscope_disagree_with_nothing():
    for name in ("speed", "yaw_rate"):
        Drive().run(1.0, car={name: math.nan})


def test_a_speed_that_nobody_knows_is_a_gross_difference():
    drive = Drive()
    said = [drive.step(receiver={"speed": math.nan}) for _ in range(10)]
    assert ["speed_mismatch" in reasons for reasons in said] == [False] * 5 + [True] * 5
    assert said[0] == ["position_mismatch"], "and allows no delay"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_receiver_that_is_late_is_no_lie(sign):
    """2 m/s2 for two seconds with poses 0.25 s old: half a metre beside the wheels' two seconds, and no reason."""
    for delay, found in ((0.25, False), (1.0, True)):
        drive, past, seen = Drive(8.0, settling=0.0), [], set()
        for tick in range(250):
            drive.speed += sign * 2.0 * STEP if tick >= 150 else 0.0
            driven = drive.speed * STEP
            x, y = drive.x + driven * math.cos(drive.heading), drive.y + driven * math.sin(drive.heading)
            past.append((x, y, drive.speed))
            old_x, old_y, old_speed = past[max(tick - round(delay / STEP), 0)]
            late = {"x": old_x - x, "y": old_y - y, "speed": old_speed - drive.speed}
            seen |= set(drive.step(receiver=late, silent=tick < 100))
        assert bool(seen & {"speed_mismatch", "position_mismatch"}) is found


def test_a_car_that_is_met_at_speed_has_not_accelerated():
    drive = Drive(settling=0.0, learnt=False)
    assert drive.until(receiver={"speed": 0.71}) == (pytest.approx(0.5), ["speed_mismatch"])


def test_the_acceleration_is_measured_with_a_lag_of_a_tenth_of_a_second():
    drive = Drive(5.0)
    drive.speed += 2.0 * STEP
    drive.step()
    assert drive.subject._acceleration == pytest.approx(2.0 * STEP / (0.1 + STEP))


def test_the_receivers_acceleration_is_measured_with_the_same_lag():
    """Two steps at 2 m/s2, each of which closes the same share of what is left."""
    drive, share = Drive(5.0), STEP / (0.1 + STEP)
    for expected in (2.0 * share, 2.0 * (1.0 - (1.0 - share) ** 2)):
        drive.speed += 2.0 * STEP
        drive.step()
        assert drive.subject._gnss_acceleration == pytest.approx(expected)


def test_wheels_that_accelerate_alone_allow_themselves_no_delay():
    """Wheels at 5 + 2 t m/s, a receiver at 5: after 0.26 s they are 0.3 m/s and twice two percent apart."""
    drive = Drive(5.0)
    for number in range(60):
        wheels = 2.0 * STEP * number
        if "speed_mismatch" in drive.step(car={"speed": wheels}):
            break
    assert number * STEP == pytest.approx(0.26 + 0.5, abs=1.5 * STEP)


def test_a_wrong_steering_report_is_named_beside_whatever_the_receiver_says():
    assert Drive().until(car={"steering": 0.1})[1] == ["steering_mismatch"]


def test_the_bias_is_taken_off_before_the_steering_is_compared():
    """Learnt 0.02 rad/s; 0.05 rad/s on top of it are allowed, to either side."""
    for more, found in ((0.05, False), (-0.05, False), (0.07, True), (-0.07, True)):
        drive = Drive(learnt=False, settling=0.0)
        drive.stand(2.0, yaw_rate=0.02)
        assert (drive.until(silent=True, car={"yaw_rate": 0.02 + more})[1] != []) is found


def test_a_car_that_stands_does_not_turn_whatever_the_gyroscope_says():
    drive = Drive(0.0, settling=0.0)
    drive.run(3.0, car={"yaw_rate": 0.055, "stands": True})
