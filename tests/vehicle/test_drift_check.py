"""What one value of each cause explains of the way by the receiver: by brute force, and to the millimetre by hand."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from vve_sumo.vehicle.drift import DriftCheck, DriftSample, FeasibleSet, unseen_drift


@pytest.mark.thorough
@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**31), st.integers(1, 12))
def test_what_is_left_to_explain_is_what_a_linear_programme_finds(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    feasible, rows, bounds = FeasibleSet(1.0, 2.0), [], []
    for _ in range(count):
        p, q, difference = random.uniform(-3.0, 3.0, 3)
        allowed = random.uniform(0.1, 3.0)
        rows += [(p, q, -1.0), (-p, -q, -1.0)]
        bounds += [difference + allowed, allowed - difference]
        # The least slack with which every difference is explained; close calls are left to rounding.
        answer = linprog((0, 0, 1), A_ub=rows, b_ub=bounds, bounds=[(-1, 1), (-2, 2), (None, None)])
        assert answer.fun is not None
        slack = float(answer.fun)
        explained = feasible.explain(difference, p, q, allowed)
        if abs(slack) > 1e-9:
            assert explained is (slack < 0.0)
        if not explained:
            break


class CutAlways(FeasibleSet):
    """Cuts at both sides of every band, also where nothing is taken away."""

    __slots__ = ()

    def explain(self, difference: float, p: float, q: float, allowed: float) -> bool:
        for sign in (1.0, -1.0):
            beyond = [sign * (a * p + b * q - difference) - allowed for a, b in self._corners]
            if min(beyond) > 0.0:
                return False
            self._cut(beyond)
        return True


@given(st.integers(0, 2**31), st.floats(0.2, 30.0))
def test_cuts_that_are_left_out_would_take_nothing_away(seed: int, growth: float) -> None:
    random = np.random.default_rng(seed)
    quick, full = FeasibleSet(0.004, 1.0), CutAlways(0.004, 1.0)
    for n in range(30):
        p, q = growth * n, random.uniform(-0.3, 0.3)
        difference = 0.001 * p + 0.3 * q + random.uniform(-0.1, 0.1)
        assert quick.explain(difference, p, q, 0.1) is full.explain(difference, p, q, 0.1)
        assert quick._corners == full._corners


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", DriftSample._fields)
def test_a_sample_that_is_not_finite_is_not_explained(field: str, bad: float) -> None:
    check = DriftCheck(0.0075, 0.02)
    assert check.explain(DriftSample(0.0, 0.0, 0.0, 5.0, 5.0, 0.0))
    assert check.explain(DriftSample(0.5, 0.0, 0.0, 5.0, 5.0, 0.5)._replace(**{field: bad})) is False
    assert check.explain(DriftSample(9.0, 9.0, 0.0, 5.0, 5.0, 0.5)), "and the way begins anew"


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("rate", [0.02, 0.05, 0.1, 0.3])
def test_no_drift_after_the_first_hundred_metres_grows_beyond_what_is_said(rate: float, side: int, sign: float) -> None:
    """At 8 m/s, a misaligned receiver and wheels that are half their tolerance wrong; the drift begins at 100 m."""
    check = DriftCheck(0.0075, 0.02)
    for tick in range(1200):
        way = 0.8 * tick
        off = sign * rate * max(way - 100.0, 0.0) / 8.0
        moved = (way + off, 0.0035 * way) if side == 0 else (way, 0.0035 * way + off)
        if not check.explain(DriftSample(*moved, 0.0, 8.0, 7.92, 0.99 * way)):
            break
        assert abs(off) <= unseen_drift(way)


# The set of what explains the differences so far.


@pytest.mark.parametrize("difference", [2.0, -2.0])
def test_what_is_just_explained_is_explained_again(difference: float) -> None:
    """Of |a| <= 1 and |b| <= 2 only a = 1 explains it, or a = -1, and that is then known."""
    feasible = FeasibleSet(1.0, 2.0)
    assert feasible.explain(difference, 1.0, 0.0, 1.0) is True
    assert feasible.explain(difference, 1.0, 0.0, 1.0) is True
    assert feasible.explain(0.5 * difference, 1.0, 0.0, 0.0) is True
    assert feasible.explain(0.49 * difference, 1.0, 0.0, 0.0) is False


def test_what_is_cut_through_two_corners_keeps_both() -> None:
    """Of |a| <= 1 and |b| <= 1 those with a + b <= 0: (1, -1) and (-1, 1) still explain, (1, 1) does not."""
    for p, q, kept in ((1.0, -1.0, True), (-1.0, 1.0, True), (1.0, 1.0, False)):
        feasible = FeasibleSet(1.0, 1.0)
        assert feasible.explain(-2.0, 1.0, 1.0, 2.0) is True
        assert feasible.explain(3.0, p, q, 1.0) is kept


# A way, sample by sample.

SLIP = 0.01  # [rad s2/m]
TOLERANCE = 0.02
NEAR = 1e-6  # [m]


class Moved(NamedTuple):
    """From one sample to the next: seen by the receiver along and across the mean heading [m], turned by [rad]."""

    ahead: float
    left: float = 0.0
    turn: float = 0.0
    own: float | None = None  #: by the wheels [m]; None: as far as the receiver says
    speed: float = 8.0  #: by the receiver, at the end [m/s]
    wheel_speed: float = 8.0  #: by the wheels, at the end [m/s]


class Way:
    """Where the moves lead from somewhere, headed nearly west, so that a turn to the left passes pi."""

    def __init__(self, check: DriftCheck | None = None, speed: float = 8.0, wheel_speed: float = 8.0) -> None:
        self.check = check or DriftCheck(SLIP, TOLERANCE)
        self.sample = DriftSample(30.0, -20.0, 3.1, speed, wheel_speed, 50.0)
        assert self.check.explain(self.sample) is True

    def move(self, moved: Moved) -> bool:
        x, y, heading, _, _, own = self.sample
        middle = heading + 0.5 * moved.turn
        x += moved.ahead * math.cos(middle) - moved.left * math.sin(middle)
        y += moved.ahead * math.sin(middle) + moved.left * math.cos(middle)
        heading = (heading + moved.turn + math.pi) % math.tau - math.pi
        own += moved.ahead if moved.own is None else moved.own
        self.sample = DriftSample(x, y, heading, moved.speed, moved.wheel_speed, own)
        return self.check.explain(self.sample)


def bounds(least: float, most: float) -> list[tuple[float, bool]]:
    return [(least - NEAR, False), (least + NEAR, True), (most - NEAR, True), (most + NEAR, False)]


@pytest.mark.parametrize(("left", "explained"), bounds(-0.62, 0.62))
def test_across_a_straight_way_noise_and_half_a_per_cent_are_explained(left: float, explained: bool) -> None:
    """After 100 m: 0.12 m of noise, 0.1 m that changes, and 0.4 m by a misaligned receiver."""
    assert Way().move(Moved(100.0, left)) is explained
    way = Way()
    assert way.move(Moved(50.0, 0.4 * left)) is True
    assert way.move(Moved(50.0, 0.6 * left)) is explained, "it is the sum that counts"


@pytest.mark.parametrize(("differs", "explained"), bounds(-2.22, 2.22))
def test_along_a_straight_way_noise_and_the_wheels_scale_are_explained(differs: float, explained: bool) -> None:
    """After 100 m: 0.22 m as across, and 2 m by wheels that are a fiftieth wrong."""
    assert Way().move(Moved(100.0, own=100.0 - differs)) is explained
    way = Way()
    assert way.move(Moved(50.0, own=50.0 - 0.4 * differs)) is True
    assert way.move(Moved(50.0, own=50.0 - 0.6 * differs)) is explained


@pytest.mark.parametrize(("differs", "explained"), bounds(-2.82, 2.82))
@pytest.mark.parametrize(("speed", "wheel_speed"), [(12.0, 8.0), (6.0, 6.0)])
def test_a_late_receiver_is_explained(differs: float, explained: bool, speed: float, wheel_speed: float) -> None:
    """From a mean of 8 m/s to one of 10 or of 6, by as much as 0.3 s: 0.6 m."""
    way = Way(speed=6.0, wheel_speed=10.0)
    assert way.move(Moved(100.0, own=100.0 - differs, speed=speed, wheel_speed=wheel_speed)) is explained


@pytest.mark.parametrize("turn", [0.1, -0.1])
@pytest.mark.parametrize(("outwards", "explained"), bounds(-0.18, 0.308))
def test_a_rear_axle_that_slips_twice_as_much_or_not_at_all_is_explained(
    turn: float, outwards: float, explained: bool
) -> None:
    """10 m and 0.1 rad at a mean of 8 m/s slip by 0.064 m, and 0.12 + 0.01 + 0.01 + 0.04 m are explained anyway."""
    way = Way(speed=6.0)
    assert way.move(Moved(10.0, -math.copysign(1.0, turn) * outwards, turn, speed=10.0)) is explained


@pytest.mark.parametrize("turn", [0.1, -0.1])
@pytest.mark.parametrize(("outwards", "explained"), bounds(-0.24, 0.496))
def test_the_slip_of_two_bends_adds_up(turn: float, outwards: float, explained: bool) -> None:
    """Twice that bend: 0.128 m of slip, and 0.12 + 0.02 + 0.02 + 0.08 m beside."""
    way, half = Way(), -0.5 * math.copysign(1.0, turn) * outwards
    assert way.move(Moved(10.0, half, turn)) is True
    assert way.move(Moved(10.0, half, turn)) is explained


@pytest.mark.parametrize(("left", "explained"), bounds(-0.32, 0.32))
def test_to_and_fro_the_way_counts_and_the_turns_do_not(left: float, explained: bool) -> None:
    """100 m and back: 200 m are driven, which may change 0.2 m, and nothing is ahead or turned."""
    way = Way(speed=0.0)
    assert way.move(Moved(100.0, 0.0, 0.5, speed=0.0)) is True
    assert way.move(Moved(-100.0, left, -0.5, speed=0.0)) is explained


@pytest.mark.parametrize("anew", ["reset", "unexplained"])
@pytest.mark.parametrize(("left", "explained"), bounds(-0.62, 0.62))
def test_a_way_that_begins_anew_knows_nothing_of_the_one_before(left: float, explained: bool, anew: str) -> None:
    way = Way(speed=2.0, wheel_speed=2.0)
    assert way.move(Moved(50.0, 0.3, 0.2, own=50.1, speed=2.0)) is True
    if anew == "reset":
        way.check.reset()
    else:
        assert way.move(Moved(0.0, 5.0)) is False
    way = Way(way.check)
    assert way.move(Moved(100.0, left)) is explained
    way = Way(way.check) if not explained else way
    assert way.move(Moved(0.0, 9.0)) is False


def test_no_more_than_this_is_unseen() -> None:
    """0.12 and 0.04 m of noise, and for every 100 m as much again and two times 0.1 m."""
    assert [unseen_drift(way) for way in (0.0, 100.0, 250.0)] == pytest.approx([0.16, 0.52, 1.06])
