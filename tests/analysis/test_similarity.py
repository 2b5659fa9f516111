"""Likeness of signals against closed forms, numpy and scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal, stats

from vve_sumo.analysis.similarity import pearson, shift_of, theil_u

STEP = 0.02
TIME = np.arange(0.0, 40.0, STEP)


def sine(late: float) -> np.ndarray:
    return 3.0 + 2.0 * np.sin(2.0 * np.pi * 0.15 * (TIME - late)) + np.sin(2.0 * np.pi * 0.04 * (TIME - late))


@given(late=st.floats(-1.8, 1.8))
@settings(max_examples=25, deadline=None)
def test_a_shifted_sine_gives_its_shift_to_a_millisecond(late: float) -> None:
    """Positive where the second is later, also between two samples."""
    assert shift_of(sine(0.0), sine(late), STEP, 2.0) == pytest.approx(late, abs=1e-3)
    assert pearson(sine(late), 5.0 * sine(late) - 2.0) == pytest.approx(1.0, abs=1e-12)


def test_the_shift_of_noise_is_that_of_scipys_correlation() -> None:
    noise = np.random.default_rng(1).standard_normal(1200)
    one, other = noise[100:1100], noise[63:1063]
    peak = signal.correlation_lags(1000, 1000)[np.argmax(signal.correlate(other, one))]
    assert peak == 37
    assert shift_of(one, other, 1.0, 100.0) == pytest.approx(37.0, abs=0.2)


def test_no_shift_is_given_where_none_fits_best() -> None:
    assert math.isnan(shift_of(sine(0.0), sine(1.0), STEP, 0.5))
    assert math.isnan(shift_of(sine(0.0), np.full_like(TIME, 3.0), STEP, 2.0))
    assert math.isnan(shift_of(sine(0.0)[:3], sine(0.0)[:3], STEP, 2.0))
    assert math.isnan(shift_of(*np.random.default_rng(5).standard_normal((2, 500)), 1.0, 50.0))


def test_points_that_nobody_knows_take_no_part_in_the_shift() -> None:
    one, other = sine(0.0), sine(0.31)
    one[200:260], other[900:1000] = math.nan, math.nan
    assert shift_of(one, other, STEP, 2.0) == pytest.approx(0.31, abs=1e-3)


def test_pearson_is_scipys_and_nothing_of_a_flat_signal() -> None:
    one, other = np.random.default_rng(2).standard_normal((2, 500)) + 100.0
    assert pearson(one, other) == pytest.approx(stats.pearsonr(one, other).statistic, abs=1e-12)
    assert math.isnan(pearson(one, np.full(500, 7.3)))
    assert math.isnan(pearson(one[:1], other[:1]))


@pytest.mark.parametrize("scale", [-3.0, -1.0, 0.0, 0.5, 1.0, 4.0])
def test_theils_coefficient_of_a_scaled_signal(scale: float) -> None:
    """RMS of (c - 1) x over (1 + |c|) RMS of x."""
    one = np.random.default_rng(3).standard_normal(400)
    assert theil_u(one, scale * one) == pytest.approx(abs(scale - 1.0) / (1.0 + abs(scale)), abs=1e-12)
    assert theil_u(scale * one, one) == pytest.approx(theil_u(one, scale * one), abs=1e-12)


def test_theils_coefficient_of_nothing() -> None:
    assert theil_u(np.zeros(5), np.zeros(5)) == 0.0
    assert math.isnan(theil_u(np.zeros(0), np.zeros(0)))
