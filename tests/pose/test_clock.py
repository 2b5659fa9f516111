"""The pose clock: arrivals as bad as networks make them, against the truth that made them."""

from __future__ import annotations

import itertools
import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.pose.clock import AgeKind, PoseClock

EPOCH = 1_300_000_000.0
DELAY = 0.012


def arrivals(
    *,
    seed: int,
    seconds: float = 20.0,
    period: float = 0.01,
    drift: float = 0.0,
    jitter: float = 0.0,
    bursts: float = 0.0,
    start: float = 37.5,
) -> list[tuple[float, float, float]]:
    """Rows of arrival on the drive's clock, GNSS time, and the truth: the drive time at which the fix was made.

    Delays are `DELAY` and an exponential jitter; in bursts the network holds all for up to `bursts` seconds, then lets
    go at once. Rows are in the order of arrival, so late ones come out of order.
    """
    chance = random.Random(seed)
    rows, held = [], 0.0
    for k in range(round(seconds / period)):
        made = k * period
        truth = start + made * (1.0 + drift)
        arrival = truth + DELAY + (chance.expovariate(1.0 / jitter) if jitter else 0.0)
        if bursts and truth > held and chance.random() < 0.2:
            held = truth + chance.uniform(0.0, bursts)
        rows.append((max(arrival, held + DELAY if truth < held else arrival), EPOCH + made, truth))
    return sorted(rows)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    drift=st.floats(-50e-6, 50e-6),
    bursts=st.sampled_from([0.0, 0.048]),
    rate=st.sampled_from([(0.004, 0.005), (0.01, 0.0), (0.01, 0.0002), (0.01, 0.005), (0.05, 0.002)]),
)
def test_within_a_millisecond_of_the_truth_after_5_s_and_time_never_goes_back(seed, drift, bursts, rate):
    """Worst seen over many seeds: 0.6 ms. Rare fixes with much jitter find the least delay less often, and err more."""
    period, jitter = rate
    clock, newest, mapped = PoseClock(EPOCH, DELAY), -math.inf, []
    for received, time, truth in arrivals(seed=seed, drift=drift, jitter=jitter, bursts=bursts, period=period):
        made = clock.step(received, time)
        if time - EPOCH > 5.0:
            assert abs(made - truth) < 1e-3
        if time > newest:
            newest = time
            mapped.append(made)
    assert all(before < after for before, after in itertools.pairwise(mapped))


@pytest.mark.parametrize("drift", [-50e-6, 50e-6])
def test_drift_is_followed_for_minutes(drift):
    clock = PoseClock(EPOCH, DELAY)
    for received, time, truth in arrivals(seed=1, seconds=200.0, period=0.1, drift=drift):
        assert clock.step(received, time) == pytest.approx(truth, abs=1e-4)


def test_later_steps_are_smooth_even_where_the_start_was_congested():
    """For 3 s everything is 30 ms late; from then on the truth is approached without a jump."""
    rows = [(EPOCH + k * 0.01, k * 0.01 + DELAY + (0.03 if k < 300 else 0.0)) for k in range(1500)]
    clock = PoseClock(EPOCH, DELAY)
    mapped = [clock.step(received, time) for time, received in rows]
    steps = [after - before for before, after in itertools.pairwise(mapped)]
    assert min(steps[201:]) > 0.0098
    assert max(steps) < 0.0101
    assert mapped[299] == pytest.approx(2.99 + 0.03, abs=1e-3)
    assert mapped[-1] == pytest.approx(14.99, abs=1e-3)


def test_one_arrival_that_is_too_early_to_be_true_moves_next_to_nothing():
    clock = PoseClock(EPOCH, DELAY)
    for k in range(1000):
        made = clock.step(k * 0.01 + DELAY - (0.05 if k == 500 else 0.0), EPOCH + k * 0.01)
        assert made == pytest.approx(k * 0.01, abs=2e-4)


def test_a_network_that_turns_slow_shows_as_age_and_is_not_learnt_away():
    clock = PoseClock(EPOCH, DELAY)
    for k in range(1000):
        clock.step(k * 0.01 + DELAY, EPOCH + k * 0.01)
    for k in range(1000, 1200):
        received = k * 0.01 + DELAY + 0.2
        age = received - clock.step(received, EPOCH + k * 0.01)
        assert age == pytest.approx(DELAY + 0.2, abs=3e-4)


def test_an_undeclared_constant_delay_cannot_be_seen():
    """Why ages are labelled: 20 ms more than declared, and the clock is 20 ms off for ever."""
    clock = PoseClock(EPOCH, 0.0)
    for k in range(1000):
        made = clock.step(k * 0.01 + 0.02, EPOCH + k * 0.01)
    assert made == pytest.approx(9.99 + 0.02)
    assert clock.report().age is AgeKind.DECLARED


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.5])
def test_a_shared_clock_is_believed_whatever_the_arrivals(delay):
    clock = PoseClock(EPOCH, DELAY, absolute=True)
    assert [clock.step(k * 0.01 + delay, EPOCH + k * 0.01) for k in range(100)] == [
        EPOCH + k * 0.01 - EPOCH for k in range(100)
    ]
    report = clock.report()
    assert (report.age, report.offset) == (AgeKind.ABSOLUTE, 0.0)
    assert report.jitter_p99 == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("drift", [-50e-6, 0.0, 20e-6])
def test_the_report_finds_offset_drift_and_spread(drift):
    clock = PoseClock(EPOCH, DELAY)
    rows = arrivals(seed=7, seconds=70.0, drift=drift, jitter=0.002)
    slow = [(received + (0.2 if 30 < time - EPOCH < 36 else 0.0), time) for received, time, _ in rows]
    for received, time in sorted(slow):
        clock.step(received, time)
    report = clock.report()
    newest = rows[-1][1] - EPOCH
    assert report.offset == pytest.approx(37.5 + newest * drift, abs=1e-3)
    assert report.drift_ppm == pytest.approx(drift * 1e6, abs=8.0)
    assert report.jitter_p50 == pytest.approx(0.002 * math.log(2), rel=0.2)
    assert report.jitter_p99 == pytest.approx(0.002 * math.log(100), rel=0.3)


def test_a_young_clock_says_what_it_does_not_know():
    report = PoseClock(EPOCH, DELAY).report()
    assert all(math.isnan(value) for value in (report.offset, report.drift_ppm, report.jitter_p50, report.jitter_p99))


@given(st.lists(st.tuples(st.floats(), st.floats()), max_size=50))
def test_no_arrival_whatever_raises_and_what_is_not_finite_stays_so(rows):
    clock = PoseClock(EPOCH, DELAY)
    for received, time in rows:
        before = clock.report()
        made = clock.step(received, time)
        assert math.isfinite(made) or str(clock.report()) == str(before)


def test_what_is_not_finite_teaches_nothing():
    clock = PoseClock(EPOCH, DELAY)
    for k in range(100):
        clock.step(k * 0.01 + DELAY, EPOCH + k * 0.01)
        assert math.isnan(clock.step(math.nan, EPOCH + k * 0.01 + 0.001))
        assert math.isnan(clock.step(k * 0.01, math.nan))
        assert math.isnan(clock.step(k * 0.01, math.inf))
    assert clock.report().offset == pytest.approx(0.0, abs=1e-6)


# What lies, and what really changed.


def steady(
    seconds: float, *, start: float = 0.0, moved: float = 0.0, period: float = 0.01
) -> list[tuple[float, float]]:
    """Arrivals and GNSS times of a stream whose receiver's clock was moved by `moved` [s]."""
    return [(start + k * period + DELAY, EPOCH + start + k * period + moved) for k in range(round(seconds / period))]


@pytest.mark.parametrize("ahead", [0.06, 0.5, 12.0, 3600.0, 1e9])
def test_one_fix_from_the_future_is_set_aside_and_moves_nothing(ahead):
    clock = PoseClock(EPOCH, DELAY)
    for received, time in steady(10.0):
        clock.step(received, time)
    before = clock.report()
    assert math.isnan(clock.step(10.004, EPOCH + 10.0 + ahead))
    assert clock.report() == before
    for received, time in steady(60.0, start=10.0):
        assert clock.step(received, time) == pytest.approx(time - EPOCH, abs=1e-6)


@pytest.mark.thorough
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), share=st.floats(0.0, 0.3), jitter=st.sampled_from([0.0, 0.002, 0.005]))
def test_lies_among_the_truth_move_the_clock_by_less_than_a_millisecond(seed, share, jitter):
    """Lies by anything from 0.2 s to a year, up to three in ten, against the same arrivals without them."""
    chance, clock, alone = random.Random(seed), PoseClock(EPOCH, DELAY), PoseClock(EPOCH, DELAY)
    for received, time, _truth in arrivals(seed=seed, jitter=jitter):
        if time - EPOCH > 2.0 and chance.random() < share:
            lie = time + 10.0 ** chance.uniform(math.log10(0.2), 7.5)
            assert math.isnan(clock.step(received - 1e-4, lie + 1e-4))
        assert clock.step(received, time) == pytest.approx(alone.step(received, time), abs=1e-3)


@pytest.mark.parametrize("moved", [0.1, 1.0, 60.0, 1e6])
def test_a_receiver_whose_clock_was_set_forth_is_believed_after_half_a_second_and_a_gap(moved):
    clock = PoseClock(EPOCH, DELAY)
    for received, time in steady(10.0):
        clock.step(received, time)
    made = [clock.step(received, time) for received, time in steady(10.0, start=10.0, moved=moved)]
    known = next(k for k, one in enumerate(made) if not math.isnan(one))
    assert known == pytest.approx(50, abs=1)
    assert made[known:] == pytest.approx([10.0 + 0.01 * k for k in range(known, 1000)], abs=1e-6)


def test_two_streams_that_contradict_each_other_are_not_both_believed():
    """One second apart, turn by turn, for a minute: the first one keeps the clock."""
    clock = PoseClock(EPOCH, DELAY)
    for received, time in steady(5.0):
        clock.step(received, time)
    for received, time in steady(60.0, start=5.0):
        assert clock.step(received, time) == pytest.approx(time - EPOCH, abs=1e-6)
        assert math.isnan(clock.step(received + 0.005, time + 1.0))
