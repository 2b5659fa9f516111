"""When a car is believed to stand: evidence step by step, with the times worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from vve_sumo.vehicle.standstill import Standstill

STEP = 0.015625  # [s], a binary fraction
BRAKING = 4.0  # commanded [m/s2]
#: Wheels are believed where their fall to zero is what 12 m/s2 and their resolution explain in a step [m/s].
BELIEVED = 12.0 * STEP + 0.04
#: From 0.30 m/s the receiver's mean, with a lag of 0.1 s, comes from a reading of 0.03 below 0.05 m/s: 0.1 ln(27 / 2).
FORGOTTEN = 0.26


class Weighed:
    """A standstill and its clock."""

    def __init__(self) -> None:
        self.subject, self.now = Standstill(), 0.0

    def step(self, wheels: float | None, gnss: float | None, braking: float | None = BRAKING) -> tuple[bool, ...]:
        """Certain, at rest, moves."""
        self.now += STEP
        self.subject.step(self.now, STEP, wheels, gnss, braking)
        return self.subject.certain, self.subject.at_rest, self.subject.moves

    def until(self, flag: str, *evidence: float | None) -> float:
        """How long the evidence takes to raise the flag [s]."""
        begun = self.now
        while not getattr(self.subject, flag):
            self.step(*evidence)
            assert self.now < begun + 120.0, "never"
        return self.now - begun


def moving(speed: float) -> Weighed:
    weighed = Weighed()
    assert weighed.step(speed, speed) == (False, False, True)
    return weighed


def test_it_knows_nothing_at_first():
    subject = Standstill()
    assert (subject.certain, subject.settled, subject.at_rest, subject.moves, subject.contradicted) == (False,) * 5
    assert (subject.may_move, subject.fell_too_fast) == (False, False)


@pytest.mark.parametrize(("last", "may_move"), [((2.0, None), True), ((None, 2.0), True), ((0.0, 0.0), False)])
def test_a_car_that_is_not_heard_may_still_do_what_it_did(last, may_move):
    weighed = Weighed()
    weighed.step(*last)
    for _ in range(100):
        assert weighed.step(None, None)[2] is False
        assert weighed.subject.may_move is may_move
    while weighed.step(0.0, 0.0)[2]:
        assert weighed.now < 100 * STEP + 2.0 * FORGOTTEN
    assert not weighed.subject.may_move, "until it is heard again"


def test_wheels_that_read_zero_every_other_time_do_not_say_that_the_car_stands():
    weighed = moving(8.0)
    for _ in range(200):
        weighed.step(0.0, None, braking=None)
        assert weighed.subject.may_move
        weighed.step(8.0, None, braking=None)
        assert weighed.subject.may_move
    # A car that really stands is known to after the time that the hardest braking takes.
    begun = weighed.now
    while weighed.subject.may_move:
        weighed.step(0.0, None, braking=None)
    assert weighed.now - begun == pytest.approx(8.0 / 12.0, abs=2 * STEP)


def test_wheels_that_turned_a_moment_ago_count_for_longer_than_a_receiver_that_says_rest():
    """Which may be frozen; after 3 s without a wheel that turns it is believed."""
    weighed = Weighed()
    weighed.step(0.0, 0.0)
    for _ in range(500):
        weighed.step(0.5, 0.0, braking=None)
        assert weighed.subject.may_move
        weighed.step(None, 0.0, braking=None)
        assert weighed.subject.may_move
    begun = weighed.now
    while weighed.subject.may_move:
        weighed.step(None, 0.0, braking=None)
    assert weighed.now - begun == pytest.approx(3.0, abs=2 * STEP)


def test_only_wheels_that_turned_count_for_longer():
    weighed = moving(8.0)
    while weighed.now < 4.0:
        weighed.step(0.0, None, 0.0)
        assert weighed.subject.may_move, "zeros that are not believed"
    begun = weighed.now
    while weighed.subject.may_move:
        weighed.step(None, 0.0, 0.0)
    assert weighed.now - begun <= FORGOTTEN


def test_a_receiver_alone_is_believed_when_it_says_rest():
    weighed = Weighed()
    weighed.step(None, 2.0)
    begun = weighed.now
    while weighed.subject.may_move:
        weighed.step(None, 0.0)
    assert weighed.now - begun <= FORGOTTEN


def test_wheels_that_turned_before_they_stood_do_not_count():
    weighed = moving(0.1)
    weighed.until("certain", 0.0, None)
    weighed.step(None, 0.0)
    assert not weighed.subject.may_move


@pytest.mark.parametrize("gnss", [0.0, None])
def test_a_car_that_was_driven_off_unseen_does_not_stand_before_its_brakes_could_have_stopped_it(gnss):
    """Wheels that read zero and a receiver that froze at rest: 2 m/s2 for a second is a car of 2 m/s."""
    weighed = Weighed()
    weighed.until("certain", 0.0, gnss, 0.0)
    begun = weighed.now
    while weighed.subject.certain:
        weighed.step(0.0, gnss, -2.0)
    assert weighed.now - begun == pytest.approx(0.5 / 2.0, abs=2 * STEP)
    while weighed.now < begun + 1.0:
        assert weighed.step(0.0, gnss, -2.0) == (False, False, False)
    # Half of the commanded braking of 4 m/s2, down to what a car gains before it is seen to move.
    assert weighed.until("certain", 0.0, gnss) == pytest.approx((2.0 - 0.5) / 2.0, abs=3 * STEP)


def test_a_car_that_is_seen_to_move_off_stands_as_soon_as_it_is_seen_to_stand():
    weighed = Weighed()
    for _ in range(64):
        weighed.step(0.0, 0.0, -2.0)
    weighed.step(0.06, 0.0, -2.0)
    assert weighed.until("certain", 0.0, 0.0) <= FORGOTTEN


def test_a_request_that_leaves_the_car_held_says_nothing_and_a_foot_may_brake_hard():
    weighed = Weighed()
    for _ in range(2000):
        weighed.step(0.0, 0.0, -0.1)
    assert weighed.subject.certain
    for _ in range(128):
        weighed.step(0.0, 0.0, -2.0)  # 4 m/s
    assert weighed.until("certain", 0.0, 0.0, None) == pytest.approx((4.0 - 0.5) / 12.0, abs=3 * STEP)


def test_a_car_that_is_let_go_coasts():
    weighed = Weighed()
    for _ in range(64):
        weighed.step(0.0, 0.0, -2.0)  # 2 m/s
    assert weighed.until("certain", 0.0, 0.0, 0.0) == pytest.approx((2.0 - 0.5) / 0.1, rel=0.02)


@pytest.mark.parametrize(
    ("wheels", "gnss", "fell"),
    [
        (8.0 - 12.0 * STEP - 0.05, None, True),
        (8.0 - 12.0 * STEP, None, False),
        (7.69, 8.0, True),
        (7.71, 8.0, False),
        (None, 8.0, False),
        (None, None, False),
    ],
)
def test_wheels_fall_no_faster_than_a_car_can_brake(wheels, gnss, fell):
    weighed = moving(8.0)
    weighed.step(wheels, gnss)
    assert weighed.subject.fell_too_fast is fell


@pytest.mark.parametrize(("gnss", "fell"), [(8.0, False), (8.29, False), (8.31, True), (None, True)])
def test_wheels_that_come_down_from_a_wrong_speed_are_believed_with_the_receiver(gnss, fell):
    weighed = moving(8.0)
    weighed.step(30.0, gnss, 0.0)
    for _ in range(100):
        weighed.step(8.0, gnss, 0.0)
        assert weighed.subject.fell_too_fast is fell


@pytest.mark.parametrize("braking", [0.0, -2.0])
def test_a_car_that_nobody_brakes_does_not_stand_because_its_wheels_read_zero(braking):
    weighed = moving(8.0)
    for _ in range(20_000):
        weighed.step(0.0, None, braking)
    assert (weighed.subject.certain, weighed.subject.may_move) == (False, True)
    assert weighed.until("certain", 0.0, 0.0, 0.0) <= 8.0 / 12.0 + FORGOTTEN, "the receiver says that it stands"


@pytest.mark.parametrize(
    ("wheels", "gnss", "certain", "moves"),
    [
        (0.0, 0.0, True, False),
        (0.049, 0.299, True, False),
        (0.05, 0.0, False, True),
        (0.0, 0.30, False, True),
        (0.0, None, True, False),
        (None, 0.0, False, False),
        (None, None, False, False),
        (None, 0.30, False, True),
        (0.05, None, False, True),
    ],
)
def test_a_car_that_has_not_moved_stands_when_wheels_say_so_and_nobody_against_it(wheels, gnss, certain, moves):
    """Wheels below 0.05 m/s; the receiver below 0.30 m/s, ten sigma of its velocity, or silent."""
    assert Weighed().step(wheels, gnss) == (certain, False, moves)


def test_standing_for_three_tenths_of_a_second_is_rest():
    weighed = Weighed()
    assert weighed.until("at_rest", 0.0, 0.0) == pytest.approx(0.3 + STEP, abs=2.0 * STEP)
    assert weighed.step(0.1, 0.0) == (False, False, True), "and it ends at once"


def test_a_car_that_is_told_to_drive_off_has_not_settled():
    weighed = Weighed()
    weighed.until("settled", 0.0, 0.0)
    weighed.step(0.0, 0.0, -0.5)
    assert weighed.subject.certain
    assert not weighed.subject.settled
    assert weighed.until("settled", 0.0, 0.0) >= 0.3


@pytest.mark.parametrize("braking", [0.0, 0.5])
def test_a_car_that_is_told_to_roll_or_to_brake_a_little_settles(braking):
    assert Weighed().until("settled", 0.0, 0.0, braking) == pytest.approx(0.3 + STEP, abs=2.0 * STEP)


def test_a_car_that_no_receiver_sees_is_not_at_rest_while_its_wheels_turn():
    weighed = moving(5.0)
    for _ in range(300):
        assert weighed.step(5.0, None) == (False, False, True)


def test_the_receivers_mean_goes_half_way_to_what_it_reads_in_a_tenth_of_a_second():
    subject = Standstill()
    subject.step(0.1, 0.1, None, 0.2, BRAKING)
    assert subject.gnss_mean == pytest.approx(0.1)
    subject.step(0.4, 0.3, None, -0.1, BRAKING)
    assert subject.gnss_mean == pytest.approx(-0.05), "and three quarters in three"


@pytest.mark.parametrize("speed", [0.3, -0.3, 5.0, -5.0])
def test_a_speed_above_rest_is_at_once_the_mean(speed):
    weighed = Weighed()
    weighed.step(None, speed)
    assert weighed.subject.gnss_mean == (0.3 if speed > 0.0 else -0.3)


def test_the_receiver_alone_is_believed_after_three_seconds_and_for_rest_only():
    weighed = moving(5.0)
    assert weighed.until("at_rest", None, 0.03) == pytest.approx(3.0 + FORGOTTEN, abs=3.0 * STEP)
    assert not weighed.subject.certain
    assert weighed.subject.contradicted
    assert weighed.step(None, 0.3) == (False, False, True)
    assert not weighed.subject.contradicted


def test_certain_and_at_rest_is_no_contradiction():
    weighed = Weighed()
    weighed.until("at_rest", 0.0, 0.0)
    assert not weighed.subject.contradicted


def test_wheels_that_fall_as_a_car_can_brake_are_believed_at_once():
    """12 m/s2 and 0.04 m/s of resolution; from 3 m/s."""
    weighed, speed = moving(3.0), 3.0
    while speed > 0.0:
        speed = max(speed - 12.0 * STEP - 0.019, 0.0)
        certain, _, _ = weighed.step(speed, None)
    assert certain


def test_wheels_that_say_zero_too_soon_wait_for_a_car_with_half_its_brakes():
    """5 m/s at half of 4 m/s2 take 2.5 s, less what is believed at once."""
    assert moving(5.0).until("certain", 0.0, None) == pytest.approx((5.0 - BELIEVED) / 2.0, abs=2.0 * STEP)


def test_a_car_that_is_told_next_to_nothing_rolls_out():
    """At 0.3 m/s2 at least, even where the command is to brake with 0.2."""
    assert moving(5.0).until("certain", 0.0, None, 0.2) == pytest.approx((5.0 - BELIEVED) / 0.3, abs=2.0 * STEP)


def test_wheels_at_the_bound_of_what_a_car_can_brake():
    """To the last bit: 1.25 m/s less 12 m/s2 in a step and 0.04 m/s."""
    for wheels, believed in ((1.25 - 12.0 * STEP - 0.04, True), (1.25 - 12.0 * STEP - 0.041, False)):
        weighed = moving(1.25)
        weighed.step(wheels, None)
        possible = wheels if believed else 1.25 - 2.0 * STEP
        assert weighed.until("certain", 0.0, None) == pytest.approx((possible - BELIEVED) / 2.0, abs=2.0 * STEP)


def test_where_the_receiver_confirms_or_a_driver_may_brake_the_hardest_braking_counts():
    assert moving(5.0).until("certain", 0.0, 0.03) == pytest.approx((5.0 - BELIEVED) / 12.0, abs=2.0 * STEP)
    assert moving(5.0).until("certain", 0.0, None, None) == pytest.approx((5.0 - BELIEVED) / 12.0, abs=2.0 * STEP)


@pytest.mark.parametrize("gnss", [0.3, -0.3, 5.0, -5.0])
def test_a_receiver_that_sees_the_car_move_confirms_no_sudden_zero(gnss):
    """A second of it counts at half of 4 m/s2, like one without a receiver."""
    weighed = moving(5.0)
    for _ in range(64):
        weighed.step(0.0, gnss)
    assert weighed.until("certain", 0.0, None) == pytest.approx((5.0 - BELIEVED) / 2.0 - 1.0, abs=2.0 * STEP)


def test_a_car_that_creeps_by_the_receiver_alone_does_not_stand():
    """Wheels of zero, and 0.1 m/s by the receiver, which a single fix may say at rest as well."""
    for speed in (0.1, -0.1):
        weighed = Weighed()
        weighed.until("at_rest", 0.0, 0.0)
        for _ in range(300):
            flags = weighed.step(0.0, speed)
        assert flags == (False, False, True)


def test_a_receiver_s_noise_at_rest_averages_out():
    weighed, chance = Weighed(), np.random.default_rng(1)
    weighed.until("at_rest", 0.0, 0.0)
    assert {weighed.step(0.0, float(noise)) for noise in chance.normal(0.0, 0.025, 50_000)} == {(True, True, False)}


def test_a_receiver_that_sees_the_car_move_is_never_outvoted():
    weighed = moving(5.0)
    for _ in range(2000):
        assert weighed.step(0.0, 5.0) == (False, False, True)


def test_silent_wheels_keep_their_last_speed_in_mind():
    """Silent for a second at half of 4 m/s2, then zero: the rest of 5 m/s takes as long as if they had said zero."""
    weighed = moving(5.0)
    for _ in range(64):
        weighed.step(None, None)
    assert weighed.until("certain", 0.0, None) == pytest.approx((5.0 - BELIEVED) / 2.0 - 1.0, abs=2.0 * STEP)


def test_wheels_that_turn_again_are_believed_again():
    weighed = moving(5.0)
    weighed.step(0.0, None)
    weighed.step(4.9, None)
    assert weighed.until("certain", 0.0, None) == pytest.approx((4.9 - BELIEVED) / 2.0, abs=2.0 * STEP)


# --- speed that was commanded and that nothing has shown ------------------------------------------------------------


def commanded(*requests: tuple[float | None, float]) -> Weighed:
    """A car that stands by all reports, and to which decelerations [m/s2] were commanded, each for a time [s]."""
    weighed = Weighed()
    for _ in range(200):
        weighed.step(0.0, 0.0, 0.0)
    for braking, seconds in requests:
        for _ in range(round(seconds / STEP)):
            weighed.step(0.0, 0.0, braking)
    return weighed


def test_half_a_metre_per_second_that_nothing_has_shown_is_no_standstill():
    assert commanded((-1.0, 0.5 - STEP)).subject.certain
    assert not commanded((-1.0, 0.5)).subject.certain


def test_a_receiver_alone_does_not_say_rest_while_that_speed_may_be_there():
    weighed = commanded((-1.0, 1.0))
    for _ in range(round(10.0 / STEP)):
        assert not weighed.step(None, 0.0, -1.0)[1]
    assert weighed.until("at_rest", None, 0.0, None) > 0.0


@pytest.mark.parametrize(
    ("braking", "loses"),
    [(0.2, 0.3), (0.5, 0.3), (1.0, 0.5), (4.0, 2.0), (0.0, 0.1), (None, 12.0)],
    ids=["hardly", "gently", "more", "hard", "not", "maybe by a driver"],
)
def test_it_is_braked_off_as_slowly_as_a_weak_car_would(braking: float | None, loses: float):
    """A share of a half of what is commanded, 0.3 m/s2 at least; by itself a car loses 0.1 m/s2, by a driver 12."""
    # 0.5 m/s more than what is believed, less a step.
    weighed = commanded((-1.0, 1.0))
    assert weighed.until("certain", 0.0, 0.0, braking) == pytest.approx(0.5 / loses, abs=1.01 * STEP)


@pytest.mark.parametrize("braking", [None, 4.0, 0.0])
def test_long_braking_before_does_not_count_against_a_later_command(braking: float | None):
    assert not commanded((braking, 30.0), (-1.0, 0.5)).subject.certain
