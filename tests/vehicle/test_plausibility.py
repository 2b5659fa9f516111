"""Receiver and car compared: each disagreement alone, just inside and just outside of what is allowed, by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.setpoints import setpoint as complete
from tests.vehicle.car import CALIBRATION, FUSION, Rig
from vve_sumo.vehicle import drift, plausibility
from vve_sumo.vehicle.plausibility import CarMotion, Plausibility

STEP = 0.02  # [s]
TOLERANCE = 0.02  # of the wheels' scale, the calibration's
#: Lateral speed of the rear axle over speed squared and yaw rate: its slip angle over the lateral acceleration, which
#: is its share of the mass over its cornering stiffness [s2/m].
SLIP = 1690.0 * 1.27 / (2.85 * 100_740.0)
UNDERSTEER = 1690.0 / 2.85 * (1.58 / 120_000.0 - 1.27 / 100_740.0)


class Drive:
    """A car on a steady circle, its receiver, and what a test adds to either."""

    def __init__(
        self,
        speed: float = 10.0,
        yaw_rate: float = 0.0,
        heading: float = 0.7,
        learnt: bool = True,
        settling: float = 3.0,
    ) -> None:
        self.subject = Plausibility(FUSION, replace(CALIBRATION, wheel_speed_tolerance=TOLERANCE))
        self.speed, self.yaw_rate, self.heading = speed, yaw_rate, heading
        self.x, self.y = 100.0, -50.0
        self.now, self.ticks = 0.0, 0
        if learnt:
            self.stand(0.5)
        self.run(settling)

    def stand(self, duration: float, yaw_rate: float = 0.0) -> None:
        for _ in range(round(duration / STEP)):
            self._tick()
            self.subject.step(self.now, STEP, CarMotion(0.0, yaw_rate, 0.0, (0.0,), math.nan, True), None, False)

    def step(self, car: dict | None = None, receiver: dict | None = None, **how: float) -> list[str]:
        """Drive for a step; `car` and `receiver` are added to what either says, or stand in its place."""
        self._tick()
        turn = self.yaw_rate * STEP
        middle, driven = self.heading + 0.5 * turn, self.speed * STEP
        across = -SLIP * self.speed**2 * self.yaw_rate * STEP
        self.x += driven * math.cos(middle) - across * math.sin(middle)
        self.y += driven * math.sin(middle) + across * math.cos(middle)
        self.heading += turn
        said = {
            "speed": self.speed,
            "yaw_rate": self.yaw_rate + (0.0 if how.get("still") else 1e-9 * self.ticks),  # no gyroscope is still
            "steering": self.angle(),
            "wheels": (float(self.ticks),),
            "commanded_steering": math.nan,
            "stands": False,
        }
        motion = CarMotion(
            **{**said, **{k: v if k in ("wheels", "stands") else said[k] + v for k, v in (car or {}).items()}}
        )
        setpoint = None
        if not how.get("silent"):
            values = {"x": self.x, "y": self.y, "heading": self.heading, "speed": self.speed, "yaw_rate": self.yaw_rate}
            for name, more in (receiver or {}).items():
                values[name] += more
            setpoint = complete(0.0, 0.0, time=self.now, **values)
        return self.subject.step(self.now, how.get("elapsed", STEP), motion, setpoint, how.get("fresh", True))

    def angle(self) -> float:
        """Road-wheel angle that drives the circle [rad]."""
        curvature = self.yaw_rate / max(self.speed, 1e-9)
        return math.atan(2.85 * curvature * (1.0 + UNDERSTEER * self.speed**2 / 2.85))

    def _tick(self) -> None:
        self.ticks += 1
        self.now = self.ticks * STEP

    def run(self, duration: float, **what: object) -> None:
        for _ in range(round(duration / STEP)):
            assert self.step(**what) == []

    def until(self, within: float = 0.9, **what: object) -> tuple[float, list[str]]:
        """After which time something is said, and what; infinite for nothing within that time."""
        for number in range(round(within / STEP)):
            reasons = self.step(**what)
            if reasons:
                return number * STEP, reasons
        return math.inf, []

    def ahead(self, metres: float) -> dict[str, float]:
        return {"x": metres * math.cos(self.heading), "y": metres * math.sin(self.heading)}

    def left(self, metres: float) -> dict[str, float]:
        return {"x": -metres * math.sin(self.heading), "y": metres * math.cos(self.heading)}


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


# What stays the same to the last bit.


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
    told(drive, 0.0, 0.001)  # it moved once since it is told anything
    assert not any(told(drive, 0.0) for _ in range(50))
    seen = [told(drive, sign * change) for _ in range(60)]
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
    told(drive, sign * 0.08, 0.001)
    assert not any(told(drive, sign * 0.08) for _ in range(10))
    seen = [told(drive, sign * left) for _ in range(60)]
    assert seen.index(True) == 25 if found else not any(seen)


def test_what_was_told_before_a_silence_is_not_compared_with_what_is_told_after_it():
    drive = Drive()
    told(drive, 0.0, 0.001)
    assert not any(told(drive, angle) for angle in [0.0] * 50 + [math.nan] + [0.05] * 60)


def told(drive: Drive, angle: float, reported: float = 0.0) -> bool:
    drive._tick()
    motion = CarMotion(10.0, 0.0, reported, (float(drive.ticks),), angle, False)
    drive.x += 10.0 * STEP * math.cos(drive.heading)
    drive.y += 10.0 * STEP * math.sin(drive.heading)
    setpoint = complete(0.0, 0.0, time=drive.now, x=drive.x, y=drive.y, heading=drive.heading, speed=10.0, yaw_rate=0.0)
    return "steering_report_frozen" in drive.subject.step(drive.now, STEP, motion, setpoint, True)


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


# Dead reckoning.


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
        assert drive.subject._satellite_acceleration == pytest.approx(expected)


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
