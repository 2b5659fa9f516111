"""A foot shows in speed that is missing: how much, beside which pedals, and what the car has taught; by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.vehicle.bare import BARE, CAR
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.slowing_monitor import SlowingMonitor

#: The brakes of `CAR` let go with 0.15 + 0.1 + 0.05 = 0.3 s, and its engine pushes with 1.5 * 0.2 + 0.1 = 0.4 s.
COAST = Pedals(0.0, 0.0)
GENTLE = Pedals(500.0, 0.0)
HARD = Pedals(2000.0, 0.0)
PUSH = Pedals(0.0, 0.2)
#: Of sin 1 m/s2 of gravity along the road [rad].
UPHILL = math.asin(1.0 / 9.80665)
NEAR = 0.001  # [m/s]


class Drive:
    """A car that gains what a test says, and whether a foot is seen."""

    def __init__(
        self, commanded: Pedals = COAST, calibration: Calibration = BARE, speed: float = 20.0, settled: bool = True
    ) -> None:
        self.monitor = SlowingMonitor(CAR, calibration)
        self.wheels = self.gnss = speed
        if settled:  # for so long that brakes and engine give what is commanded
            assert self.monitor.step(1e12, commanded, speed, speed, 0.0) is False

    def step(
        self,
        gain: float,
        commanded: Pedals = COAST,
        elapsed: float = 1.0,
        grade: float = 0.0,
        gnss: float | None = None,
    ) -> bool:
        """A step in which the wheels gain so many m/s, and the receiver's speed as many unless it is told another."""
        self.wheels += gain
        self.gnss += gain if gnss is None else gnss
        return self.monitor.step(elapsed, commanded, self.wheels, self.gnss, grade)


ROLLING = {"rolling_resistance": 0.4 / 9.80665}  # 0.4 m/s2
CREEP = {"creep_force": 1000.0}  # 0.5 m/s2 at 2 m/s, half of the speed where it ends
WEAK = {"drive_power_limit": 40_000.0}  # 2000 N at 20 m/s, a fifth of the force at standstill


@pytest.mark.parametrize(
    ("car", "commanded", "grade", "speed", "least"),
    [
        # Any car: half of the push, 1.35 of the brakes, 1.5 of the drag, 0.35 m/s2 of margin; 0.30 m/s are left.
        ({}, COAST, 0.0, 20.0, -0.35 - 0.30),
        ({}, GENTLE, 0.0, 20.0, -1.35 - 0.35 - 0.30),
        ({}, Pedals(0.0, 0.04), 0.0, 20.0, 0.5 * 0.4 - 0.35 - 0.30),
        ({}, COAST, UPHILL, 20.0, -1.0 - 0.35 - 0.30),
        (ROLLING, COAST, 0.0, 20.0, -1.5 * 0.4 - 0.35 - 0.30),
        ({}, COAST, 0.0, 0.5, -0.35 - 0.30),
        # This car: what is modelled, 0.35 m/s2 and 0.15 of what the pedals ask for as a margin; 0.70 m/s are left.
        ({}, HARD, 0.0, 20.0, -4.0 - 0.35 - 0.15 * 4.0 - 0.70),
        ({}, PUSH, 0.0, 20.0, 2.0 - 0.35 - 0.15 * 2.0 - 0.70),
        ({}, PUSH, UPHILL, 20.0, 2.0 - 1.0 - 0.35 - 0.15 * 2.0 - 0.70),
        (ROLLING, PUSH, 0.0, 20.0, 2.0 - 0.4 - 0.35 - 0.15 * 2.0 - 0.70),
        (CREEP, COAST, 0.0, 2.0, 0.5 - 0.35 - 0.70),
        (WEAK, Pedals(0.0, 1.0), 0.0, 20.0, 2.0 - 0.35 - 0.15 * 2.0 - 0.70),
    ],
)
def test_the_least_that_a_sound_car_gains_in_a_second(
    car: dict[str, float], commanded: Pedals, grade: float, speed: float, least: float
) -> None:
    """Speed at the second's end; a millimetre per second less is a foot."""
    for gain, foot in ((least + NEAR, False), (least - NEAR, True)):
        drive = Drive(commanded, replace(BARE, **car), speed - gain)
        assert drive.step(gain, commanded, grade=grade) is foot


def test_what_is_missing_adds_up_and_what_is_too_much_earns_nothing() -> None:
    """Coasting, half a second at -0.6 m/s2 is 0.125 m/s too much; pushed, one of 0.8 m/s2 is 0.275 m/s."""
    drive = Drive()
    assert [drive.step(-0.30, elapsed=0.5) for _ in range(3)] == [False, False, True]
    drive = Drive()
    drive.step(2.0)
    assert [drive.step(-0.30, elapsed=0.5) for _ in range(3)] == [False, False, True]
    drive = Drive(PUSH)
    drive.step(2.9, PUSH)  # which also teaches 0.9 / 16 of a m/s2: 0.028 m/s more are expected in half a second
    assert [drive.step(0.40, PUSH, elapsed=0.5) for _ in range(3)] == [False, False, True]


def test_a_car_must_be_faster_than_one_metre_per_second_to_be_compared_with_itself() -> None:
    for speed, foot in ((1.0, False), (1.001, True)):
        drive = Drive(PUSH, speed=speed - 0.5)
        assert drive.step(0.5, PUSH) is foot, (
            "half a metre per second less than 1.35, which is modelled less the margin"
        )


def test_a_slow_car_forgets_what_it_missed_beside_itself() -> None:
    drive = Drive(PUSH, speed=2.0)
    assert drive.step(0.75, PUSH) is False, "0.6 m/s are missing, of 0.7"
    drive.wheels = drive.gnss = 0.5
    drive.monitor.step(100.0, PUSH, 0.5, 0.5, 1.0)  # so steep that nothing is missing
    drive.wheels = drive.gnss = 1.5
    drive.monitor.step(0.5, PUSH, 1.5, 1.5, 0.0)
    assert drive.step(0.75, PUSH) is False
    assert drive.step(0.75, PUSH) is True


# What this car has taught.


@pytest.mark.parametrize(("seconds", "share"), [(15.0, 0.5), (5.0, 0.25), (45.0, 0.75)])
@pytest.mark.parametrize("off", [-0.3, 0.3])
def test_a_car_that_is_off_its_model_is_compared_with_what_it_did(off: float, seconds: float, share: float) -> None:
    """Of what it is off for so many seconds, t / (15 s + t) is learnt; pushed, it is 0.65 m/s in a second else."""
    least = 0.65 + off * share
    for gain, foot in ((least + NEAR, False), (least - NEAR, True)):
        drive = Drive(PUSH)
        assert drive.step((2.0 + off) * seconds, PUSH, elapsed=seconds) is False
        assert drive.step(gain, PUSH) is foot


def test_what_is_learnt_twice_is_learnt_better() -> None:
    """Half of 0.3 m/s2, then half of the rest."""
    for gain, foot in ((0.65 - 0.225 + NEAR, False), (0.65 - 0.225 - NEAR, True)):
        drive = Drive(PUSH)
        for _ in range(2):
            assert drive.step(1.7 * 15.0, PUSH, elapsed=15.0) is False
        assert drive.step(gain, PUSH) is foot


@pytest.mark.parametrize(("speed", "learns"), [(1.0, False), (1.001, True)])
def test_at_one_metre_per_second_nothing_is_learnt(speed: float, learns: bool) -> None:
    """1.7 m/s2 for 15 s, 0.3 less than modelled, up to this speed; then 0.1 m/s less than expected in a second."""
    drive = Drive(PUSH, speed=speed - 25.5)
    assert drive.step(25.5, PUSH, elapsed=15.0) is False
    for drive.wheels in (math.nan, 20.0):  # the sums begin anew
        assert drive.step(0.0, PUSH) is False
    drive.gnss = math.nan
    assert drive.step(0.55, PUSH) is not learns


# Brakes that let go and an engine that is not yet there.


def test_a_released_brake_goes_on_braking_for_a_while() -> None:
    """1000 N m, and half of them after 0.3 s: 1 m/s2, of which 1.35 and 0.35 are no foot; then a quarter."""
    pressed = Pedals(1000.0, 0.0)
    for gain, foot in ((-1.70 * 0.3 - 0.30 + NEAR, False), (-1.70 * 0.3 - 0.30 - NEAR, True)):
        assert Drive(pressed).step(gain, COAST, elapsed=0.3) is foot
    for gain, foot in ((-1.025 * 0.3 - 0.30 + NEAR, False), (-1.025 * 0.3 - 0.30 - NEAR, True)):
        drive = Drive(pressed)
        drive.step(0.0, COAST, elapsed=0.3)
        assert drive.step(gain, COAST, elapsed=0.3) is foot


def test_a_brake_may_grip_at_once() -> None:
    for gain, foot in ((-2.0 + NEAR, False), (-2.0 - NEAR, True)):
        assert Drive(COAST).step(gain, GENTLE) is foot


def test_the_brakes_may_hold_a_car_at_first() -> None:
    """With all their 3000 N m, a quarter of which is there after two times 0.3 s: 1.5 m/s2."""
    allowed = (1.35 * 1.5 + 0.35) * 0.3
    for gain, foot in ((-allowed - 0.30 + NEAR, False), (-allowed - 0.30 - NEAR, True)):
        drive = Drive(settled=False)
        assert drive.step(0.0, elapsed=0.3) is False
        assert drive.step(gain, elapsed=0.3) is foot


def test_an_engine_may_take_a_while_to_push() -> None:
    """A fifth of the throttle, a tenth after 0.4 s: 1 m/s2, of which half is expected, less 0.35; then 0.15."""
    for gain, foot in ((0.15 * 0.4 - 0.30 + NEAR, False), (0.15 * 0.4 - 0.30 - NEAR, True)):
        assert Drive(COAST).step(gain, PUSH, elapsed=0.4) is foot
    # 1.5 m/s2: this car gives 1.5 - 0.35 - 0.15 * 1.5, and any car 0.75 - 0.35.
    least = 0.40 * 0.4 - 0.30
    for gain, foot in ((least + NEAR, False), (least - NEAR, True)):
        drive = Drive(COAST)
        drive.step(0.4, PUSH, elapsed=0.4)
        assert drive.step(gain, PUSH, elapsed=0.4) is foot


def test_an_engine_need_not_push_once_the_throttle_is_closed() -> None:
    for gain, foot in ((-0.65 + NEAR, False), (-0.65 - NEAR, True)):
        assert Drive(PUSH).step(gain, COAST) is foot


# Two witnesses.


@pytest.mark.parametrize(
    ("commanded", "wheels", "gnss", "foot"),
    [
        # any car: 0.35 m/s2 are allowed
        (COAST, -0.66, -0.45 + NEAR, False),
        (COAST, -0.66, -0.45 - NEAR, True),
        (COAST, -0.66, math.nan, True),
        (COAST, -0.64, -5.0, False),
        (COAST, -0.64, math.nan, False),
        # this car: 1.35 m/s2 are expected, and of any car no more than 0.65
        (PUSH, 0.60, 1.25 + NEAR, False),
        (PUSH, 0.60, 1.25 - NEAR, True),
        (PUSH, 0.60, math.nan, True),
        (PUSH, 0.70, -5.0, False),
        (PUSH, 0.70, math.nan, False),
    ],
)
def test_the_receiver_must_see_a_tenth_of_it_where_it_is_known(
    commanded: Pedals, wheels: float, gnss: float, foot: bool
) -> None:
    assert Drive(commanded).step(wheels, commanded, gnss=gnss) is foot


def test_what_the_receiver_sees_adds_up_too() -> None:
    """0.06 m/s missing by the receiver each second, and 0.4 m/s by the wheels."""
    drive = Drive()
    assert [drive.step(-0.75, gnss=-0.41) for _ in range(2)] == [False, True]
    drive = Drive(PUSH)  # 1.35 m/s are expected in the first second and 1.2625 in the next: a sixteenth is learnt
    assert [drive.step(0.60, PUSH, gnss=seen) for seen in (1.26, 1.24)] == [False, True]


@pytest.mark.parametrize(("elapsed", "foot"), [(0.0257, False), (0.0258, True)])
def test_wheels_that_fall_faster_than_any_car_brakes_count_as_that(elapsed: float, foot: bool) -> None:
    """12 m/s2, which is 11.65 beyond the margin: 0.30 m/s are missing after 25.75 ms."""
    drive = Drive()
    assert drive.step(-20.0, elapsed=elapsed, gnss=math.nan) is foot


# Steps that tell nothing.


@pytest.mark.parametrize("commanded", [COAST, PUSH])
def test_a_step_of_no_length_begins_the_sums_anew_and_moves_no_pedal(commanded: Pedals) -> None:
    drive = Drive(commanded)
    lost = -0.55 if commanded is COAST else 0.85
    assert drive.step(lost, commanded) is False
    assert drive.step(0.0, HARD, elapsed=0.0) is False
    assert drive.step(0.0, COAST, elapsed=0.0) is False
    assert [drive.step(lost, commanded) for _ in range(2)] == [False, True]


def test_wheels_that_are_unknown_for_a_step_begin_the_sums_anew_and_unteach_nothing() -> None:
    """The receiver is silent too, so that the wheels decide."""
    for commanded, lost in ((COAST, -0.55), (PUSH, 0.85)):
        drive = Drive(commanded)
        drive.gnss = math.nan
        assert drive.step(lost, commanded) is False
        speed, drive.wheels = drive.wheels, math.nan
        assert drive.step(0.0, commanded) is False
        drive.wheels = speed
        assert drive.step(0.0, commanded) is False
        assert [drive.step(lost, commanded) for _ in range(2)] == [False, True]
        drive.wheels = math.nan
        assert drive.step(0.0, commanded) is False


def test_what_was_before_a_reset_does_not_count() -> None:
    drive = Drive(PUSH)
    drive.step(1.7 * 15.0, PUSH, elapsed=15.0)
    drive.step(0.6, PUSH)
    drive.monitor.reset()
    assert drive.step(-10.0, PUSH, elapsed=1e12) is False, "with what speed it came is not known"
    for gain, foot in ((0.65 + NEAR, False), (0.65 - NEAR, True)):
        drive.monitor.reset()
        drive.step(0.0, PUSH, elapsed=1e12)
        assert drive.step(gain, PUSH) is foot, "nothing is learnt"
    # Its brakes may hold it, and its engine may not push yet: in 1.2 s a fifth of 3000 N m, 3/4 of the throttle.
    least = (1.5 - 1.2 - 0.35 - 0.15 * 2.7) * 1.2 - 0.70
    for gain, foot in ((least + NEAR, False), (least - NEAR, True)):
        drive.monitor.reset()
        drive.step(0.0, PUSH, elapsed=1e-12)
        assert drive.step(gain, PUSH, elapsed=1.2) is foot
