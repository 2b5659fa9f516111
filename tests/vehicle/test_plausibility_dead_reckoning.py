"""Receiver and car compared over the way driven: heading and position, just inside and outside the limits."""

from __future__ import annotations

import math

import pytest

from tests.setpoints import setpoint as complete
from tests.vehicle.car import CALIBRATION, FUSION, Rig
from tests.vehicle.steady_circle import SLIP, STEP, Drive
from vve_sumo.vehicle import drift, plausibility
from vve_sumo.vehicle.plausibility import CarMotion, Plausibility


def test_a_bias_is_learnt_at_standstill_and_taken_off():
    """0.02 rad/s for ten seconds would be 0.2 rad; without it the heading keeps within 0.03 rad."""
    drive = Drive(learnt=False, settling=0.0)
    drive.stand(2.0, yaw_rate=0.02)
    drive.run(12.0, car={"yaw_rate": 0.02})


def test_what_turns_faster_at_standstill_is_no_bias():
    for rate, learnt in ((0.049, True), (-0.049, True), (0.051, False), (-0.051, False), (math.nan, False)):
        drive = Drive(learnt=False, settling=0.0)
        drive.stand(2.0, yaw_rate=rate)
        assert drive.subject._bias == pytest.approx(rate if learnt else 0.0)


def test_a_bias_is_the_mean_of_ten_seconds():
    """A plain mean at first; later a new value counts by its share of ten seconds."""
    drive = Drive(learnt=False, settling=0.0)
    drive.stand(1.0, yaw_rate=0.01)
    drive.stand(1.0, yaw_rate=0.03)
    assert drive.subject._bias == pytest.approx(0.02)
    drive.stand(30.0, yaw_rate=0.02)
    drive.stand(STEP, yaw_rate=0.04)
    assert drive.subject._bias == pytest.approx(0.02 + 0.02 * STEP / 10.0, rel=1e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("learnt", "allowed"), [(True, 0.031), (False, 0.042)])
def test_a_heading_that_steps(learnt, allowed, sign):
    """0.03 rad, and in a second what the gyroscope's bias may be."""
    for off, found in ((allowed - 0.0015, False), (allowed + 0.0005, True)):
        drive = Drive(learnt=learnt)
        drive.run(2.0)
        _, reasons = drive.until(receiver={"heading": sign * off}, within=0.25)
        assert reasons == (["heading_mismatch"] if found else [])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_heading_that_steps_in_a_bend(sign):
    """At 0.5 rad/s the gyroscope's scale, two percent of half a radian, comes on top."""
    for off, found in ((0.0385, False), (0.0415, True)):
        drive = Drive(yaw_rate=0.5)
        drive.run(2.0)
        _, reasons = drive.until(receiver={"heading": sign * off})
        assert ("heading_mismatch" in reasons) is found


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("side", "allowed"), [("left", 0.235), ("ahead", 0.355)])
def test_a_position_that_steps(side, allowed, sign):
    """Over 10 m in a second: 0.15 m, 0.8 or 2 percent of the way, and half a milliradian."""
    for off, found in ((allowed - 0.03, False), (allowed + 0.005, True)):
        drive = Drive()
        drive.run(2.0)
        _, reasons = drive.until(receiver=getattr(drive, side)(sign * off))
        assert reasons == (["position_mismatch"] if found else [])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("side", ["left", "ahead"])
def test_a_position_that_steps_after_a_turn(side, sign):
    """0.6 rad in a second: ahead and left are mixed, and 0.335 and 0.455 m are 0.565 m as the crow flies."""
    across, along = 0.15 + (0.008 + 0.5 * 0.013) * 10.0, 0.15 + (0.02 + 0.5 * 0.013) * 10.0
    allowed = math.hypot(across, along)
    for off, found in ((allowed - 0.05, False), (allowed + 0.02, True)):
        drive = Drive(yaw_rate=0.6)
        drive.run(2.0)
        then = drive.heading - 0.6
        turned = Drive(heading=then)
        _, reasons = drive.until(receiver=getattr(turned, side)(sign * off))
        assert ("position_mismatch" in reasons) is found


def test_a_position_that_creeps_is_found_by_the_long_windows():
    """0.15 m/s to the left: 0.15 m in a second, 0.45 m in three against 0.4 m that are allowed there."""
    drive, off = Drive(), 0.0
    for _ in range(round(6.0 / STEP)):
        off += 0.15 * STEP
        reasons = drive.step(receiver=drive.left(off))
        if reasons:
            break
    assert reasons == ["position_mismatch"]
    assert off == pytest.approx(0.45, abs=0.05)


@pytest.mark.parametrize(
    "how", [{"silent": True}, {"car": {"speed": math.nan}}, {"car": {"yaw_rate": math.nan}}, {"elapsed": 0.0}]
)
def test_where_either_side_is_silent_the_windows_begin_anew(how):
    drive = Drive()
    drive.run(2.0)
    drive.step(receiver=drive.left(5.0), **how)
    drive.run(1.0, receiver=drive.left(5.0))


def test_a_pose_that_is_not_fresh_is_not_compared_again():
    drive = Drive()
    drive.run(2.0)
    drive.run(1.0, receiver=drive.left(5.0), fresh=False)


def test_a_pose_is_compared_at_its_own_time():
    """One that is 80 ms old lies 0.8 m behind at 10 m/s, and that is where dead reckoning was."""
    drive = Drive(yaw_rate=0.3)
    poses = []
    for _ in range(400):
        drive._tick()
        drive.heading += 0.3 * STEP
        drive.x += 10.0 * STEP * math.cos(drive.heading)
        drive.y += 10.0 * STEP * math.sin(drive.heading)
        poses.append((drive.now, drive.x, drive.y, drive.heading))
        then, x, y, heading = poses[-5] if len(poses) >= 5 else poses[0]
        car = CarMotion(10.0, 0.3, drive.angle(), (float(drive.ticks),), math.nan, False)
        setpoint = complete(0.0, 0.0, time=then, x=x, y=y, heading=heading, speed=10.0, yaw_rate=0.3)
        place = drive.subject._place(drive.now, car, setpoint)
        if len(poses) > 5:
            assert drive.subject._heading - place.own_heading == pytest.approx(0.3 * 0.08)
            moved = math.dist((drive.subject._x, drive.subject._y), (place.own_x, place.own_y))
            assert moved == pytest.approx(0.8)
            toward = math.atan2(drive.subject._y - place.own_y, drive.subject._x - place.own_x)
            assert math.remainder(toward - drive.subject._heading, math.tau) == pytest.approx(0.0, abs=1e-9)
        drive.subject.step(drive.now, STEP, car, setpoint, True)


def test_dead_reckoning_drives_chords():
    """A circle's chord points half of the turn off its tangent; the rear axle slips outwards by a constant angle."""
    subject = Plausibility(FUSION, CALIBRATION)
    for tick in range(101):
        subject.step(tick * STEP, STEP, CarMotion(10.0, 0.5, 0.1, (1.0,), math.nan, False), None, False)
    chord = math.atan2(subject._y, subject._x)
    assert subject._heading == pytest.approx(0.5 * 100 * STEP)
    assert chord == pytest.approx(0.5 * subject._heading - math.atan(SLIP * 10.0 * 0.5), abs=1e-6)


@pytest.mark.parametrize("ticks", range(6))
def test_after_a_silence_the_first_pose_is_kept(ticks):
    drive = Drive()
    drive.run(ticks * STEP)
    drive.step(silent=True)
    drive.step()
    drive.step()
    assert drive.until(receiver=drive.left(1.0)) == (pytest.approx(0.0, abs=3 * STEP), ["position_mismatch"])


def test_a_heading_is_the_same_after_a_whole_turn():
    drive = Drive(yaw_rate=0.3)
    drive.run(0.5, receiver={"heading": -math.tau})


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("turned", "left", "ahead"),
    [
        (0.4, 7.35, 8.55),  # ten seconds at 0.012 rad/s, and 0.008: 0.128 rad of which half counts over 100 m
        (0.48, 7.43, 8.63),
        (0.5, 7.45, 8.65),
        (0.6, math.hypot(7.55, 8.75), math.hypot(7.55, 8.75)),  # after half a radian the two are one
    ],
)
def test_what_a_hundred_metres_in_ten_seconds_may_be_off(turned, left, ahead, sign):
    subject = Plausibility(FUSION, CALIBRATION)
    then = plausibility._Place(0.0, 5.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 10.0)
    for more, found in ((-0.01, []), (0.01, ["position_mismatch"])):
        for x, y in ((0.0, sign * (left + more)), (sign * (ahead + more), 0.0)):
            now = plausibility._Place(10.0, 105.0 + x, 6.0 + y, 0.0, 100.0, 0.0, 0.0, 100.0, turned, 10.0)
            assert subject._compared(then, now) == found


def test_headings_that_are_finite_and_infinitely_far_apart_are_a_mismatch():
    """1.7e308 less -1.7e308 is infinite, and an infinite angle has no remainder."""
    rig = Rig()
    rig.cruise(5.0)
    for tick in range(60):
        status = rig.step(0.0, heading=1.7e308 if tick < 20 else -1.7e308)
    assert status.reasons[0] == "heading_mismatch"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_drift_too_slow_for_every_window_is_found_by_the_whole_way(sign):
    """0.05 m/s to one side from 100 m on, at 10 m/s: half of what ten seconds may be off."""
    drive, off, codes = Drive(settling=10.0), 0.0, []
    while not codes:
        off += sign * 0.05 * STEP
        codes = drive.step(receiver={"x": -off * math.sin(drive.heading), "y": off * math.cos(drive.heading)})
        assert abs(off) < drift.unseen_drift(10.0 * drive.now), "larger than said"
    assert codes == ["position_mismatch"]
    assert abs(off) > 0.5


def test_an_old_pose_is_compared_with_the_way_until_its_own_time():
    """A pose of 0.2 s ago lies behind by as much as the car then drove, at 5 m/s and at 25 m/s alike."""
    drive, driven, speed, past = Drive(speed=5.0, heading=0.0), 0.0, 5.0, []
    for tick in range(2600):
        drive._tick()
        speed = min(25.0, speed + (4.0 * STEP if tick > 2000 else 0.0))
        driven += speed * STEP
        past.append((driven, speed))
        then, slower = past[max(len(past) - 11, 0)]
        age = STEP * min(len(past) - 1, 10)
        car = CarMotion(speed, 0.0, 1e-9 * tick, (float(tick),), math.nan, False)
        receiver = complete(0.0, 0.0, time=drive.now - age, x=then, y=0.0, heading=0.0, speed=slower, yaw_rate=0.0)
        # What came before is another drive, and is forgotten.
        fresh = tick > 0
        assert drive.subject.step(drive.now, STEP, car, receiver if fresh else None, fresh) == []


def test_a_jump_that_every_comparison_sees_is_said_once():
    drive = Drive()
    codes = [drive.step(receiver={"x": 5.0}) for _ in range(10)]
    assert {code.count("position_mismatch") for code in codes} == {1}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_heading_that_creeps_is_found_by_the_longest_window(sign):
    """4.5 mrad/s at a crawl: in ten seconds 0.03 rad and 1 mrad/s are allowed, so it is found after 0.04 / 0.0045 s."""
    drive = Drive(speed=0.5)
    begun, codes = drive.now, []
    while not codes:
        codes = drive.step(receiver={"heading": sign * 0.0045 * (drive.now + STEP - begun)})
        assert drive.now < begun + 12.0, "never"
    assert codes == ["heading_mismatch"]
    assert drive.now - begun == pytest.approx(0.04 / 0.0045, abs=0.1)
