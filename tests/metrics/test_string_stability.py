"""String stability against python-control: a linear follower's frequency response and H-infinity norm."""

from __future__ import annotations

import math
from itertools import pairwise

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.exhaustive import with_slow
from tests.metrics.tables import CAR, actors_of, drive_of, ticks_of
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.string_stability import (
    amplification,
    settled_from,
    speed_amplification,
    time_gap_error,
    time_shares,
)
from vve_sumo.path import ReferencePath


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


@pytest.mark.thorough
@pytest.mark.parametrize("system", [UNSTABLE, STABLE])
@pytest.mark.parametrize("frequency", with_slow([0.1, 0.5, 1.5], lambda frequency: frequency == 0.5))
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


@pytest.mark.thorough
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


@pytest.mark.thorough
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


HEADWAY, SWAY, SWAY_RATE = 2.0, 1.0, 0.5  #: [s], [m/s], [rad/s]


def behind_a_swaying_leader(
    approach: float, ticks: int = 8000
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return time, gap and speeds of leader and follower: `STABLE`, which begins `approach` [m/s] faster.

    The leader keeps 12 m/s for 60 s and sways then. The follower is integrated in small steps.
    """
    time = 0.02 * np.arange(ticks)
    leader = 12.0 + np.where(time > 60.0, SWAY * np.sin(SWAY_RATE * (time - 60.0)), 0.0)
    speed, gap = np.empty(ticks), np.empty(ticks)
    v, g = 12.0 + approach, HEADWAY * 12.0 + 4.0 * approach
    for tick, w in enumerate(leader.tolist()):
        speed[tick], gap[tick] = v, g
        for _ in range(10):
            v, g = v + 0.002 * (0.2 * (g - HEADWAY * v) + 0.6 * (w - v)), g + 0.002 * (w - v)
    return time, gap, leader, speed


def driven(time: np.ndarray, gap: np.ndarray, leader: np.ndarray, speed: np.ndarray) -> DriveData:
    place = 5.0 + np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    rows = [
        {"time_s": t, "true_x_m": x, "s_m": x, "true_speed_mps": v}
        for t, x, v in zip(time.tolist(), place.tolist(), speed.tolist(), strict=True)
    ]
    front = (place + CAR.rear_axle_to_bumper + gap + 2.0).tolist()
    actors = [
        {"tick": tick, "actor": "leader", "x_m": x, "speed_mps": w}
        for tick, (x, w) in enumerate(zip(front, leader.tolist(), strict=True))
    ]
    way = np.arange(0.0, place[-1] + 200.0, 20.0)
    return drive_of(ticks_of(rows), actors_of(actors), ReferencePath.from_points(way, np.zeros_like(way)))


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("approach", [0.0, 6.0])
def test_the_approach_is_no_answer_to_a_disturbance(approach: float) -> None:
    """The frequency response says by how much a swaying leader is followed, whether the ego came from far or not."""
    time, gap, leader, speed = behind_a_swaying_leader(approach)
    drive = driven(time, gap, leader, speed)
    gain = float(control.frequency_response(STABLE, [SWAY_RATE]).magnitude[0])
    assert gain < 1.0
    assert drive.speed_amplification.l2 == pytest.approx(gain, rel=0.03)
    # The first sway has a transient.
    sways = time > 60.0
    assert drive.speed_amplification.linf == pytest.approx(np.ptp(speed[sways]) / np.ptp(leader[sways]), rel=0.05)


def test_a_follower_that_never_settles_has_no_amplification() -> None:
    time, gap, leader, speed = behind_a_swaying_leader(6.0, ticks=700)
    assert settled_from(time, gap, leader, speed) == len(time)
    leader[::30] += 1.0
    drive = driven(time, gap, leader, speed)
    assert math.isnan(drive.speed_amplification.l2)
    assert not len(drive.following)


@settings(deadline=None, max_examples=30)
@given(settles=st.integers(0, 400))
def test_a_follower_is_settled_from_when_it_has_the_leaders_speed_and_keeps_it(settles: int) -> None:
    time = 0.02 * np.arange(1000)
    leader = np.full(1000, 12.0)
    speed = np.where(np.arange(1000) < settles, 13.0, 12.05)
    gap = 30.0 - np.concatenate(([0.0], np.cumsum((speed - leader)[:-1] * 0.02)))
    assert settled_from(time, gap, leader, speed) == settles
    # A gap that creeps on at 0.3 m/s is no equilibrium, and neither is the end of the record.
    assert settled_from(time, gap - 0.3 * time, leader, speed) == len(time)
    cut = slice(settles + 100)
    assert settled_from(time[cut], gap[cut], leader[cut], speed[cut]) == settles + 100


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
