"""The bank of speeds against Bayes' rule written out, and what is foreseen by it against geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from controllers.bank import LANE_CHANGERS, WALKERS, Bank
from controllers.crossing import probability_in, probability_of_cutting_in

#: who never changes his speed and goes exactly straight: then Bayes' rule has a closed form
FIXED = WALKERS._replace(sets_out=0.0, stops=0.0, changes=0.0, drift=0.0, sways=0.0)


def seen(bank: Bank, speed: float, times: int, sigma: float, seed: int = 1, place: float = -3.0) -> np.ndarray:
    """Show the bank one who goes at a speed [m/s] by scans 50 ms apart; return what was measured after the first."""
    noise = np.random.default_rng(seed).normal(0.0, sigma, times)
    measured = place + speed * 0.05 * np.arange(1, times + 1) + noise
    for value in measured:
        bank.predict(0.05)
        bank.update(float(value), sigma * sigma)
    return measured


def test_without_changes_it_is_bayes_rule():
    """Evidence of every speed: the measurements are jointly normal, for they share the doubt of the first place."""
    bank, sigma, first, n = Bank(-3.0, 0.2, FIXED), 0.3, 0.2, 25
    before = bank.probability.copy()
    measured = seen(bank, 1.2, n, sigma)
    covariance = first * np.ones((n, n)) + sigma**2 * np.eye(n)
    times = 0.05 * np.arange(1, n + 1)
    errors = measured[:, None] - (-3.0 + np.outer(times, bank.speeds))
    log = -0.5 * np.einsum("ik,ij,jk->k", errors, np.linalg.inv(covariance), errors)
    after = before * np.exp(log - log.max())
    after /= after.sum()
    assert bank.probability == pytest.approx(after, abs=1e-6)
    best = int(after.argmax())
    weight = 1.0 / (1.0 / first + n / sigma**2)  # least squares of the place at the end, at that speed
    start = -3.0 + weight * (errors[:, best] / sigma**2).sum()
    assert bank.place[best] == pytest.approx(start + bank.speeds[best] * times[-1])
    assert bank.variance[best] == pytest.approx(weight)


@settings(deadline=None, max_examples=30)
@given(
    st.sampled_from([WALKERS, LANE_CHANGERS]),
    st.lists(st.tuples(st.floats(0.01, 1.0), st.floats(-8.0, 8.0)), min_size=1, max_size=20),
)
def test_it_stays_a_distribution(habits, scans):
    bank = Bank(0.0, 0.3, habits)
    for dt, value in scans:
        bank.predict(dt)
        assert bank.probability.sum() == pytest.approx(1.0, abs=1e-9)
        bank.update(value, 0.1)
        assert bank.probability.sum() == pytest.approx(1.0)
        assert (bank.probability > 0.0).all()
        assert (bank.variance > 0.0).all()


@pytest.mark.parametrize("seed", range(3))
def test_who_sets_out_is_told_from_who_stands(seed):
    """At 35 m: 0.3 m of noise. After a second of standing, one of walking at 5 km/h is enough, and so back."""
    bank = Bank(-3.0, 0.09, WALKERS)
    still = int(np.flatnonzero(bank.speeds == 0.0)[0])
    seen(bank, 0.0, 20, 0.3, seed)
    assert bank.probability[still] > 0.7
    seen(bank, 1.4, 20, 0.3, seed + 10)
    assert bank.probability[still] < 0.3
    assert bank.probability @ bank.speeds == pytest.approx(1.4, abs=0.5)
    seen(bank, 0.0, 20, 0.3, seed + 20, place=-3.0 + 1.4)
    assert bank.probability[still] > 0.5


def test_the_spread_is_that_of_the_mixture():
    bank = Bank(-3.0, 0.2, WALKERS)
    seen(bank, 1.0, 8, 0.3)
    random = np.random.default_rng(0)
    which = random.choice(bank.speeds.size, 200_000, p=bank.probability)
    drawn = random.normal(bank.place[which], np.sqrt(bank.variance[which]))
    assert bank.spread() == (pytest.approx(drawn.mean(), abs=0.01), pytest.approx(drawn.var(), rel=0.02))


def surely(place: float, speed: float, habits=WALKERS) -> Bank:
    """A bank that doubts neither a place nor the speed nearest to the one given."""
    bank = Bank(place, 1e-12, habits)
    bank.probability = np.where(np.arange(bank.speeds.size) == np.abs(bank.speeds - speed).argmin(), 1.0, 0.0)
    return bank


@settings(deadline=None, max_examples=50)
@given(st.floats(-6.0, -1.3), st.sampled_from([0.5, 1.0, 1.5, 2.5]), st.floats(0.1, 1.5), st.sampled_from([-1.0, 1.0]))
def test_the_probability_of_a_walker_is_nearly_geometry(place, pace, arrival, side):
    """Beyond three standard deviations of how a walker changes his pace, it is sure; the body is half a metre."""
    sigma = (arrival + 0.2) * math.sqrt(0.15**2 + 0.05 * (arrival + 0.2) / 3.0)
    bank, ahead = surely(side * place, side * pace), place + pace * arrival
    late = ahead + 0.2 * pace
    assume(min(abs(late + 0.9), abs(ahead - 0.9 - 0.5)) > 3.0 * sigma)
    wanted = 1.0 if late > -0.9 and ahead - 0.5 < 0.9 else 0.0
    assert probability_in(bank, 0.9, 0.9, arrival, arrival + 0.2) == pytest.approx(wanted, abs=2e-3)
    comes = 1.0 if late > -0.9 else 0.0
    assert probability_in(bank, 0.9, 0.9, 0.0, arrival + 0.2) == pytest.approx(comes, abs=2e-3)


def test_who_stands_beside_the_band_is_not_in_it():
    assert probability_in(surely(-1.5, 0.0), 0.9, 0.9, 2.0, 2.2) < 0.1
    assert probability_in(surely(-0.5, 0.0), 0.9, 0.9, 1.0, 1.2) > 0.9


def test_the_front_corner_of_a_car_that_comes_over_is_first_in_the_band():
    """1.2 m beside the band, 1.2 m/s across: its rear corner takes a second, its front is 4 m of way further."""
    bank = surely(2.4, -1.2, LANE_CHANGERS)
    assert probability_of_cutting_in(bank, 1.2, 1.2, 1.3, 50.0) > 0.8
    assert probability_of_cutting_in(bank, 1.2, 1.2, 0.6, 50.0) < 0.1
    assert probability_of_cutting_in(bank, 1.2, 1.2, 0.6, 10.0) == pytest.approx(0.5, abs=1e-6)
    assert probability_of_cutting_in(surely(2.4, 1.2, LANE_CHANGERS), 1.2, 1.2, 1.3, 10.0) == 0.0  # it goes away
    assert probability_of_cutting_in(surely(2.4, 0.0, LANE_CHANGERS), 1.2, 1.2, 1.3, 10.0) == 0.0
