"""String stability against python-control: a linear follower's frequency response and H-infinity norm."""

from __future__ import annotations

import math
from itertools import pairwise

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.metrics.string_stability import amplification, speed_amplification, time_gap_error, time_shares


def follower(gap_gain: float, speed_gain: float, headway: float) -> control.TransferFunction:
    """Leader's to follower's speed of a = kg (gap - h v) + kv (w - v)."""
    return control.tf([speed_gain, gap_gain], [1.0, speed_gain + gap_gain * headway, gap_gain])


#: one that amplifies around 0.5 rad/s, and one that does not anywhere
UNSTABLE, STABLE = follower(0.4, 0.1, 0.6), follower(0.2, 0.6, 2.0)


def answered(system: control.TransferFunction, time: np.ndarray, leader: np.ndarray) -> np.ndarray:
    answer: np.ndarray = control.forced_response(system, time, leader).outputs
    return answer


def peak(system: control.TransferFunction) -> float:
    """H-infinity norm: the greatest gain over all frequencies."""
    return float(control.frequency_response(system, np.geomspace(1e-3, 1e2, 3000)).magnitude.max())


@pytest.mark.parametrize("system", [UNSTABLE, STABLE])
@pytest.mark.parametrize("frequency", [0.1, 0.5, 1.5])
def test_a_sine_is_amplified_as_the_frequency_response_says(system: control.TransferFunction, frequency: float) -> None:
    time = np.arange(0.0, 60.0 * math.tau / frequency, 0.02)
    leader = np.sin(frequency * time)
    settled = time > 30.0 * math.tau / frequency
    gain = float(control.frequency_response(system, [frequency]).magnitude[0])
    found = amplification(leader[settled], answered(system, time, leader)[settled])
    assert found.l2 == pytest.approx(gain, rel=2e-3)
    assert found.linf == pytest.approx(gain, rel=2e-3)
    speeds = speed_amplification(15.0 + leader[settled], 15.0 + answered(system, time, leader)[settled])
    assert speeds.l2 == pytest.approx(gain, rel=1e-2)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000))
def test_no_disturbance_grows_beyond_the_h_infinity_norm(seed: int) -> None:
    """A pulse of noise at first and rest after, so that all of its answer is seen."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 200.0, 0.05)
    leader = np.where(time < 60.0, np.repeat(random.normal(size=200), 20), 0.0)
    for system in (UNSTABLE, STABLE):
        norm = peak(system)
        assert amplification(leader, answered(system, time, leader)).l2 <= norm * 1.001
    assert peak(STABLE) == pytest.approx(1.0, abs=1e-3)
    assert peak(UNSTABLE) > 1.3


def test_head_to_tail_is_the_product_along_a_chain() -> None:
    time = np.arange(0.0, 1200.0, 0.02)
    speeds = [np.sin(0.5 * time)]
    for _ in range(3):
        speeds.append(answered(UNSTABLE, time, speeds[-1]))
    kept = [speed[time > 600.0] for speed in speeds]
    each = [amplification(one, other).l2 for one, other in pairwise(kept)]
    assert amplification(kept[0], kept[-1]).l2 == pytest.approx(math.prod(each), rel=1e-9)
    assert amplification(kept[0], kept[-1]).l2 > 2.0


def test_a_steady_leader_has_no_disturbance_to_pass_on() -> None:
    steady = np.full(100, 12.0)
    assert all(math.isnan(value) for value in speed_amplification(steady, steady + 1.0))
    assert all(math.isnan(value) for value in speed_amplification(np.zeros(0), np.zeros(0)))
    assert all(math.isnan(value) for value in amplification(np.zeros(5), np.ones(5)))


def test_a_dip_counts_from_the_undisturbed_speed() -> None:
    """The leader loses 5 m/s for a tenth of the time, the follower 7.5 m/s: half as much again in both senses."""
    leader, behind = np.full(1000, 20.0), np.full(1000, 20.0)
    leader[100:200], behind[120:220] = 15.0, 12.5
    assert speed_amplification(leader, behind) == pytest.approx((1.5, 1.5))


def test_time_shares_add_up_whatever_the_ticks() -> None:
    time = np.array([0.0, 1.0, 3.0, 3.5, 5.0])
    values = np.array([0.5, 1.5, math.nan, 2.0, 0.1])
    assert time_shares(time, values, [0.0, 1.0, 2.0, 3.0]) == pytest.approx([1.0 / 4.5, 2.0 / 4.5, 1.5 / 4.5])
    assert np.isnan(time_shares(time[:1], values[:1], [0.0, 1.0])).all()


def test_the_error_of_the_time_gap_is_that_of_a_policy_of_standstill_and_headway() -> None:
    speed = np.array([5.0, 10.0, 20.0])
    gap = 4.0 + (1.5 + np.array([0.1, -0.2, 0.4])) * speed
    found = time_gap_error(gap, speed, 1.5, 4.0)
    assert found.mean == pytest.approx(0.1)
    assert found.rms == pytest.approx(math.sqrt((0.01 + 0.04 + 0.16) / 3.0))
    assert math.isnan(time_gap_error(gap[:0], speed[:0], 1.5).rms)
