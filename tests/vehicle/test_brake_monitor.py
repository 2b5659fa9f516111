"""Brakes that give too little and engines that push too much, on a car without drag or creep: sums done by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests import vehicles
from tests.vehicle.car import FUSION
from vve_sumo.vehicle import brake_monitor
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.brake_monitor import BrakeMonitor, HoldMonitor
from vve_sumo.vehicle.calibration import Calibration

STEP = 0.02  # [s]
#: 550 N m are 1 m/s2. Nothing else acts on the car unless a test says so.
BARE = replace(vehicles.FUSION.calibration, rolling_resistance=0.0, drag_area=0.0, creep_force=0.0)
BRAKE = Pedals(1100.0, 0.0)  # a sound car brakes with 2 m/s2, the weakest one that passes with 1.5
COAST = Pedals(0.0, 0.0)
THROTTLE = Pedals(0.0, 0.3)


class Drive:
    """A car that gains what a test says, and what is said of it."""

    def __init__(
        self, calibration: Calibration = BARE, delay: float = 0.0, lag: float = 0.0, speed: float = 10.0
    ) -> None:
        self.response = BrakeMonitor(replace(FUSION, brake_delay=delay, brake_lag=lag), calibration)
        self.wheels = self.gnss = speed
        self.step(COAST)

    def step(self, commanded: Pedals, gain: float = 0.0, gnss: float | None = None, grade: float = 0.0) -> list[str]:
        """One step at `gain` [m/s2]; the receiver's own gain where it is another."""
        self.wheels += gain * STEP
        self.gnss += (gain if gnss is None else gnss) * STEP
        return self.response.step(STEP, commanded, self.wheels, self.gnss, grade)

    def until(self, commanded: Pedals, gain: float, gnss: float | None = None, grade: float = 0.0) -> tuple[float, str]:
        """After which time something is said, and what; infinite for nothing in 10 s."""
        for number in range(500):
            codes = self.step(commanded, gain, gnss, grade)
            if codes:
                return (number + 1) * STEP, *codes
        return math.inf, ""

    def run(self, duration: float, commanded: Pedals, gain: float) -> None:
        for _ in range(round(duration / STEP)):
            assert self.step(commanded, gain) == []


@pytest.mark.parametrize(
    ("gain", "found"), [(-2.0, math.inf), (-1.26, math.inf), (-1.0, 1.0), (0.0, 0.2), (1.0, 0.25 / 2.25)]
)
def test_brakes_that_give_less_than_three_quarters_are_found_by_the_speed_that_is_too_much(gain, found):
    """1100 N m: 1.5 m/s2 at least, less a margin of 0.25; a quarter of a metre per second too much is a fault."""
    after, *code = Drive(speed=100.0).until(BRAKE, gain)
    assert after == pytest.approx(found, abs=1.01 * STEP)
    assert code == ([""] if found == math.inf else ["brake_not_following"])


@pytest.mark.parametrize(("gain", "found"), [(0.0, math.inf), (0.24, math.inf), (0.5, 1.0), (1.0, 0.25 / 0.75)])
def test_a_car_that_gains_speed_on_its_own_is_found(gain, found):
    after, *code = Drive().until(COAST, gain)
    assert after == pytest.approx(found, abs=1.01 * STEP)
    assert code == ([""] if found == math.inf else ["drive_not_following"])


@pytest.mark.parametrize("grade", [-0.1, 0.1])
def test_a_declared_grade_is_no_fault_and_hides_none(grade):
    pull = -9.80665 * math.sin(grade)
    assert Drive(speed=100.0).until(BRAKE, -1.26 + pull, grade=grade) == (math.inf, "")
    assert Drive().until(BRAKE, pull, grade=grade)[0] == pytest.approx(0.2, abs=1.01 * STEP)


def test_drag_brakes_and_creep_pushes_half_as_much_again():
    """169 N of drag are 0.1 m/s2; 338 N of creep are at 1 m/s half of it, and half as much again 0.15 m/s2."""
    drag = replace(BARE, rolling_resistance=0.1 / 9.80665)
    assert Drive(drag).until(COAST, 0.4)[0] == pytest.approx(0.25 / (0.4 - 0.25 + 0.1), abs=1.01 * STEP)
    creep = replace(BARE, creep_force=338.0)
    drive = Drive(creep, speed=1.0)
    for number in range(200):
        drive.wheels = 1.0 + 0.0001 * number
        excess = (0.005 - 0.25 - 0.15) * STEP * number
        assert drive.response.step(STEP, COAST, drive.wheels, drive.wheels, 0.0) == []
        assert excess <= 0.0
    push = drive.response._most(1.0, 0.0, 0.0)
    assert push == pytest.approx(0.15 + 0.25, abs=1e-9)


def test_brakes_answer_after_their_delay_and_with_their_lag():
    """Until the delay is over the car may roll; then the torque comes with 1 - (lag / (lag + step))^n."""
    delay, lag = 0.1, 0.06
    excess, torque, expected = 0.0, 0.0, math.inf
    for number in range(100):
        if number >= round(delay / STEP):
            torque += (1100.0 - torque) * STEP / (lag + STEP)
        excess = max(excess + (0.75 * torque / 550.0 - 0.25) * STEP, 0.0)
        if excess > 0.25:
            expected = (number + 1) * STEP
            break
    assert 0.3 < expected < 0.5
    after, code = Drive(delay=delay + 1e-9, lag=lag).until(BRAKE, 0.0)
    assert (after, code) == (pytest.approx(expected, abs=1.01 * STEP), "brake_not_following")


def test_the_torque_that_is_there_follows_what_was_told_a_delay_ago():
    drive = Drive(delay=0.1 - 1e-9, lag=0.06)
    for number, torque in enumerate((0.0, 0.0, 0.0, 0.0, 0.0, 275.0, 481.25)):
        drive.step(BRAKE, -2.0)
        assert drive.response._torque == pytest.approx(torque), number


def test_brakes_that_are_let_go_are_told_from_an_engine_once_their_torque_has_gone():
    drive = Drive(delay=0.0)
    drive.run(0.5, BRAKE, -2.0)
    assert drive.until(COAST, 1.0)[1] == "drive_not_following"


@pytest.mark.parametrize("gain", [-3.0, 0.0, 3.0])
def test_with_the_throttle_open_nothing_is_too_much(gain):
    assert Drive(speed=100.0).until(THROTTLE, gain) == (math.inf, "")


@pytest.mark.parametrize("silent", ["", "wheels", "gnss"])
@pytest.mark.parametrize(("before", "pressed"), [(2.0, 1.0), (2.0, 0.1), (-1.0, 1.0), (0.0, 1.0)])
def test_an_engine_may_push_on_for_a_while_and_no_longer(before, pressed, silent):
    """One and a half times the measured gain and 0.3 m/s2, falling with one and a half times the drive's lag."""
    steps = round(pressed / STEP)
    measured = before * (1.0 - (0.1 / (0.1 + STEP)) ** steps)
    push, excess, number = 1.5 * max(measured, 0.0) + 0.3, 0.0, 0
    while excess <= 0.25:
        push *= 0.375 / (0.375 + STEP)
        excess = max(excess + (2.0 - 0.25 - push) * STEP, 0.0)
        number += 1
    drive = Drive(speed=20.0)
    if silent:
        setattr(drive, silent, math.nan)
    drive.run(pressed, THROTTLE, before)
    assert drive.until(COAST, 2.0) == (pytest.approx(number * STEP, abs=0.5 * STEP), "drive_not_following")


def test_the_measured_gain_is_that_of_the_time_in_which_it_came():
    """Wheels that are heard at every third step, and no receiver."""
    drive = Drive(speed=20.0)
    for number in range(150):
        drive.wheels += 2.0 * STEP
        drive.response.step(STEP, THROTTLE, math.nan if number % 3 else drive.wheels, math.nan, 0.0)
    assert drive.response._acceleration == pytest.approx(2.0, rel=0.01)


def test_an_engine_that_fades_with_its_lag_is_left_alone():
    drive = Drive()
    drive.run(1.0, THROTTLE, 2.0)
    for number in range(500):
        assert drive.step(COAST, 2.0 * math.exp(-number * STEP / 0.25)) == []


def test_the_throttle_forgives_what_was_too_much_before():
    drive = Drive()
    drive.run(0.32, COAST, 1.0)
    assert drive.step(THROTTLE, 0.0) == []
    drive.run(3.0, COAST, 0.0)
    assert drive.until(COAST, 1.0)[0] == pytest.approx(0.25 / 0.75, abs=1.01 * STEP)


def test_braking_better_than_needed_earns_nothing():
    drive = Drive(speed=100.0)
    drive.run(5.0, BRAKE, -2.0)
    assert drive.until(BRAKE, 0.0)[0] == pytest.approx(0.2, abs=1.01 * STEP)


# Two witnesses.


def test_a_receiver_that_sees_the_car_brake_denies_what_the_wheels_say():
    assert Drive().until(BRAKE, 0.0, gnss=-2.0) == (math.inf, "")


def test_a_receiver_that_sees_less_of_it_confirms_by_a_tenth():
    """At -1 m/s2 the receiver's excess grows by 0.25 m/s2: 0.1 m/s after 0.4 s, twice as late as the wheels' own."""
    assert Drive().until(BRAKE, 0.0, gnss=-1.0)[0] == pytest.approx(0.4, abs=1.01 * STEP)


def test_a_receiver_that_is_silent_denies_nothing():
    drive = Drive()
    drive.gnss = math.nan
    assert drive.until(BRAKE, 0.0)[0] == pytest.approx(0.2, abs=1.01 * STEP)


def test_a_receiver_that_comes_back_begins_to_count_then():
    drive = Drive()
    drive.gnss = math.nan
    drive.run(0.1, BRAKE, 0.0)
    drive.gnss = 10.0
    assert drive.until(BRAKE, 0.0)[0] == pytest.approx(0.1, abs=1.01 * STEP)


def test_without_wheels_the_receiver_decides():
    """A quarter of a metre per second too much after 0.2 s."""
    drive = Drive()
    drive.wheels = math.nan
    drive.step(BRAKE)
    drive.run(0.18, BRAKE, 0.0)
    assert drive.until(BRAKE, 0.0)[0] == pytest.approx(0.02, abs=1.01 * STEP)


@pytest.mark.parametrize("wheels", [math.nan, math.inf])
@pytest.mark.parametrize("receiver", [False, True])
@pytest.mark.parametrize("steps", [1, 2, 5])
@pytest.mark.parametrize("commanded", [BRAKE, COAST])
def test_wheels_that_fail_every_other_time_hide_nothing(wheels, receiver, steps, commanded):
    """As in `wheel_speed_invalid` that flaps while brakes fail or an engine pushes by itself."""
    drive = Drive()
    gain = 0.0 if commanded is BRAKE else 1.5
    for number in range(60):
        drive.wheels += gain * STEP
        drive.gnss += gain * STEP
        said = wheels if number // steps % 2 else drive.wheels
        if drive.response.step(STEP, commanded, said, drive.gnss if receiver else math.nan, 0.0):
            break
    assert number * STEP <= 0.2 + 2 * steps * STEP


@pytest.mark.parametrize("steps", [1, 2, 5, 10])
@pytest.mark.parametrize("receiver", [False, True])
def test_wheels_that_fail_every_other_time_accuse_no_brakes_that_give_just_enough(steps, receiver):
    drive = Drive(speed=50.0)
    for number in range(500):
        drive.wheels -= 1.26 * STEP
        drive.gnss -= 1.26 * STEP
        said = math.nan if number // steps % 2 else drive.wheels
        assert drive.response.step(STEP, BRAKE, said, drive.gnss if receiver else math.nan, 0.0) == []


def test_a_car_that_came_to_rest_unseen_is_not_too_fast():
    """Within 1.2 s sound brakes take more than 3 m/s: what is left is the receiver's noise."""
    drive = Drive(speed=3.0)
    drive.run(0.2, BRAKE, -1.5)
    for _ in range(120):
        assert drive.response.step(STEP, BRAKE, math.nan, math.nan, 0.0) == []
    for _ in range(5):
        assert drive.response.step(STEP, BRAKE, 0.12, 0.12, 0.0) == []


@pytest.mark.parametrize("silent", [1, 5])
def test_what_neither_wheels_nor_receiver_saw_is_seen_afterwards(silent):
    """1.25 m/s2 too much for as long as both are silent."""
    drive = Drive()
    drive.run(0.06, BRAKE, 0.0)
    for _ in range(silent):
        assert drive.response.step(STEP, BRAKE, math.nan, math.nan, 0.0) == []
    assert drive.until(BRAKE, 0.0)[0] == pytest.approx(0.2 - 0.06 - silent * STEP, abs=1.01 * STEP)


@pytest.mark.parametrize("speed", [0.2, 10.0])
@pytest.mark.parametrize("silent", ["wheels", "gnss"])
def test_one_of_two_speeds_is_enough_from_the_first_step(silent, speed):
    drive = Drive(speed=speed)
    drive.response = BrakeMonitor(replace(FUSION, brake_delay=0.0, brake_lag=0.0), BARE)
    setattr(drive, silent, math.nan)
    assert drive.until(BRAKE, 0.0)[0] == pytest.approx(0.2 + STEP, abs=1.01 * STEP)


# Others brake.


@pytest.mark.parametrize(("gain", "found"), [(0.4995, []), (0.5005, ["brake_not_following"])])
@pytest.mark.parametrize("commanded", [BRAKE, COAST])
def test_a_car_that_others_brake_may_only_not_gain_speed(commanded, gain, found):
    """In a second by 0.25 m/s2 and a quarter of a metre per second; how hard it is braked is not known."""
    subject = BrakeMonitor(replace(FUSION, brake_delay=0.0, brake_lag=0.0), BARE)
    for _ in range(9):
        assert subject.step(1.0, commanded, 10.0, 10.0, 0.0, others_brake=True) == []
    assert subject.step(1.0, commanded, 10.0 + gain, 10.0 + gain, 0.0, others_brake=True) == found


# What is not judged.


@pytest.mark.parametrize(("speed", "judged"), [(0.1, False), (0.11, True)])
def test_a_car_that_hardly_rolls_is_not_judged(speed, judged):
    assert (Drive(speed=speed).until(BRAKE, 0.0)[0] < math.inf) is judged


@pytest.mark.parametrize("elapsed", [0.0, -0.02])
def test_a_step_without_time_begins_anew(elapsed):
    drive = Drive()
    drive.run(0.18, BRAKE, 0.0)
    assert drive.response.step(elapsed, BRAKE, 10.0, 10.0, 0.0) == []
    assert drive.until(BRAKE, 0.0)[0] == pytest.approx(0.2 + STEP, abs=1.01 * STEP)


def test_reset_forgets_everything():
    drive = Drive()
    drive.run(0.5, THROTTLE, 2.0)
    drive.run(0.1, BRAKE, 0.0)
    fresh = Drive()
    drive.response.reset()
    fresh.response.reset()
    assert {k: v for k, v in vars(drive.response).items() if k != "_calibration"} == {
        k: v for k, v in vars(fresh.response).items() if k != "_calibration"
    }
    drive.wheels = drive.gnss = 10.0
    drive.step(COAST)
    assert drive.until(COAST, 1.0)[0] == pytest.approx(0.25 / 0.75, abs=1.01 * STEP)


def test_the_first_command_waits_for_the_delay_like_any_other():
    subject = BrakeMonitor(replace(FUSION, brake_delay=0.1, brake_lag=0.0), BARE)
    subject.step(STEP, BRAKE, 10.0, 10.0, 0.0)
    assert subject._torque == 0.0


def test_half_a_newton_metre_is_braking():
    assert Drive().until(Pedals(0.5, 0.0), 1.0)[1] == "brake_not_following"


def test_what_is_allowed_without_bound_leaves_no_excess():
    assert brake_monitor.cusum_step(0.2, -math.inf) == 0.0
    assert brake_monitor.cusum_step(0.2, math.nan) == 0.2


# A car that stands, held by its brakes.


def rolls(*steps: tuple[float, bool, bool, float, float], monitor: HoldMonitor | None = None) -> list[bool]:
    """Whether a car rolls off at each of several steps: time [s], held, stands, by a wheel and by receiver [m/s]."""
    monitor = monitor or HoldMonitor()
    return [monitor.step(*step) for step in steps]


STANDS = (0.0, True, True, 0.0, 0.0)


@pytest.mark.parametrize(("speed", "found"), [(0.08, False), (0.0801, True), (5.0, True)])
def test_a_held_car_whose_wheel_turns_for_a_tenth_of_a_second_rolls(speed, found):
    steps = ((when, True, False, speed, 0.0) for when in (1.0, 1.09, 1.1))
    assert rolls(STANDS, *steps) == [False, False, False, found]


@pytest.mark.parametrize(("speed", "found"), [(0.1, False), (0.1001, True), (5.0, True)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_held_car_that_the_receiver_sees_move_for_three_tenths_rolls(speed, sign, found):
    steps = ((when, True, False, 0.0, sign * speed) for when in (1.0, 1.29, 1.3))
    assert rolls(STANDS, *steps) == [False, False, False, found]


def test_speeds_that_are_not_known_are_no_motion():
    assert rolls(STANDS, *((0.1 * step, True, False, math.nan, math.nan) for step in range(10))) == [False] * 11


@pytest.mark.parametrize(
    "before",
    [
        (0.0, True, False, 0.0, 0.0),  # it did not stand
        (0.0, False, True, 0.0, 0.0),  # it stood without being held
    ],
)
def test_only_a_car_that_stood_while_it_was_held_can_roll_off(before):
    assert rolls(before, *((when, True, False, 0.5, 0.5) for when in (1.0, 2.0, 3.0))) == [False] * 4


def test_a_car_that_is_let_go_may_roll():
    let_go = (0.5, False, True, 0.0, 0.0)
    assert rolls(STANDS, let_go, *((when, True, False, 0.5, 0.5) for when in (1.0, 2.0, 3.0))) == [False] * 5
    assert rolls(STANDS, *((when, False, False, 0.5, 0.5) for when in (1.0, 2.0, 3.0))) == [False] * 4


@pytest.mark.parametrize(("wheel", "gnss", "least"), [(0.5, 0.0, 0.1), (0.0, 0.5, 0.3)])
def test_what_was_before_a_reset_holds_no_car(wheel, gnss, least):
    monitor = HoldMonitor()
    rolls(STANDS, (1.0, True, True, wheel, gnss), monitor=monitor)
    monitor.reset()
    again = [(1.0 + when, True, True, wheel, gnss) for when in (0.05, least, 0.05 + least)]
    assert rolls(*again, monitor=monitor) == [False, False, True], "the time counts from then on"
    monitor.reset()
    assert rolls(*((when, True, False, 0.5, 0.5) for when in (2.0, 3.0)), monitor=monitor) == [False, False]
