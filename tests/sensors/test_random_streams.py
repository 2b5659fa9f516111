"""Errors that hold on from scan to scan, and false alarms, against what is declared of them."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from tests.sensors.scenes import FUSION, actors, car, rear_axle
from vve_sumo.sensors.falsealarm import RANGE_RATE_SPAN
from vve_sumo.sensors.radar import ESR_MODES, NO_ACTOR, Radar, RadarConfig, RadarScan
from vve_sumo.sensors.random_streams import CorrelatedNoise, stream

#: the flaws of a radar whose numbers are to be looked at: neither latency nor quanta, every target detected
PLAIN = replace(
    RadarConfig(),
    latency=0.0,
    range_quantum=0.0,
    range_rate_quantum=0.0,
    azimuth_quantum=0.0,
    detection_probability=1.0,
)
SEED = bytes(range(32))


def radar(config: RadarConfig) -> Radar:
    return Radar(config, FUSION, np.random.default_rng(3))


def run(config: RadarConfig, count: int, rows: int = 1) -> list[RadarScan]:
    sensor, street = radar(config), actors([car(40.0 + 8.0 * row, 4.0 * row) for row in range(rows)])
    found = [sensor.step(index * 0.05, rear_axle(), street) for index in range(count)]
    return [result for result in found if result is not None]


def columns(results: list[RadarScan]) -> np.ndarray:
    return np.array([(r.detections.range[0], r.detections.azimuth[0], r.detections.range_rate[0]) for r in results])


@pytest.mark.thorough
@pytest.mark.parametrize("declared", [0.0, 0.45, 0.9])
def test_errors_are_as_wide_as_declared_and_correlated_as_declared(declared: float) -> None:
    """20,000 scans; a correlation of rho decorrelates in (1+rho)/(1-rho) scans, which widens what is tolerated."""
    count = 20_000
    noise = columns(run(replace(PLAIN, noise_correlation=declared), count))
    noise -= columns(run(replace(PLAIN, range_sigma=0.0, azimuth_sigma=0.0, range_rate_sigma=0.0), 1))
    alone = count * (1.0 - declared) / (1.0 + declared)
    for column, sigma in zip(noise.T, (0.25, math.radians(0.5), 0.12), strict=True):
        # The antenna's place behind the bumper turns a degree of azimuth by a few thousandths.
        assert column.std() == pytest.approx(sigma, rel=5.0 / math.sqrt(2.0 * alone) + 0.005)
        assert abs(column.mean()) < 5.0 * sigma / math.sqrt(alone)
        for lag in (1, 2, 5):
            measured = np.corrcoef(column[:-lag], column[lag:])[0, 1]
            assert measured == pytest.approx(declared**lag, abs=5.0 / math.sqrt(alone))
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 5.0 / math.sqrt(alone)


@pytest.mark.parametrize(("away", "expected"), [(1, 0.8), (3, 0.512), (20, 0.8**20)])
def test_who_was_not_looked_at_for_a_while_comes_back_with_other_errors(away: int, expected: float) -> None:
    """Many actors, each looked at twice: the correlation over the pause is the declared one to its power."""
    pairs = []
    for number in range(4000):
        luck = CorrelatedNoise(stream(SEED, f"actor{number}"), 0.8, 50_000)
        pairs.append((luck.at(0)[1], luck.at(away * 50_000)[1]))
    first, second = np.array(pairs).T
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(expected, abs=5.0 / math.sqrt(4000))
    assert second.std() == pytest.approx(1.0, rel=5.0 / math.sqrt(8000))


def test_scans_that_come_40_and_60_ms_apart_correlate_by_their_time() -> None:
    luck, errors = CorrelatedNoise(stream(SEED, "one"), 0.45, 50_000), []
    for index in range(40_000):
        errors.append(luck.at(index // 2 * 100_000 + (60_000 if index % 2 else 0))[3])
    after_60, after_40 = np.array(errors).reshape(-1, 2).T, np.array(errors[1:-1]).reshape(-1, 2).T
    assert np.corrcoef(after_60)[0, 1] == pytest.approx(0.45**1.2, abs=0.03)
    assert np.corrcoef(after_40)[0, 1] == pytest.approx(0.45**0.8, abs=0.03)


def test_another_car_changes_no_correlated_error_and_no_false_alarm_on_this_one() -> None:
    config = replace(PLAIN, noise_correlation=0.45)
    alone, joined = run(config, 200), run(replace(config, false_alarms=2.0), 200, rows=3)
    for one, all_ in zip(alone, joined, strict=True):
        at = all_.actors.index("car0")
        for name in ("range", "azimuth", "range_rate"):
            assert getattr(all_.detections, name)[at] == getattr(one.detections, name)[0]
    few, many = ([seen(result) for result in run(replace(config, false_alarms=0.7), 200, rows)] for rows in (1, 3))
    assert few == many
    assert any(few)


def seen(result: RadarScan) -> list[tuple[float, float, float, int]]:
    """What has nobody behind it."""
    found = result.detections
    rows = zip(
        found.range.tolist(), found.azimuth.tolist(), found.range_rate.tolist(), found.mode.tolist(), strict=True
    )
    return [row for row, name in zip(rows, result.actors, strict=True) if name == NO_ACTOR]


@pytest.mark.parametrize("rate", [0.1, 2.5])
def test_false_alarms_are_poisson_with_the_declared_mean(rate: float) -> None:
    counts = np.array([len(result.actors) for result in run(replace(PLAIN, false_alarms=rate), 6000, rows=0)])
    assert counts.mean() == pytest.approx(rate, abs=5.0 * math.sqrt(rate / 6000))
    most = int(stats.poisson.ppf(0.999, rate))
    share = stats.poisson.pmf(np.arange(most + 1), rate)
    expected = np.append(share, 1.0 - share.sum()) * 6000
    observed = np.bincount(np.minimum(counts, most + 1), minlength=most + 2)
    assert stats.chisquare(observed[:-2], expected[:-2] * observed[:-2].sum() / expected[:-2].sum()).pvalue > 1e-4
    assert abs(np.corrcoef(counts[:-1], counts[1:])[0, 1]) < 5.0 / math.sqrt(6000)


def test_false_alarms_fill_the_field_of_view_and_lie_nowhere_else() -> None:
    """From an antenna at the bumper: half of them in each mode's field, uniform there in range, azimuth and rate."""
    config = replace(PLAIN, false_alarms=3.0, mount=replace(PLAIN.mount, x=0.0))
    ranges, azimuths, rates, modes = np.array([row for result in run(config, 4000, rows=0) for row in seen(result)]).T
    long, medium = ESR_MODES
    in_long = (ranges <= long.range_max) & (np.abs(azimuths) <= long.half_angle)
    in_medium = (ranges <= medium.range_max) & (np.abs(azimuths) <= medium.half_angle)
    assert np.all(in_long | in_medium)
    assert np.array_equal(modes == 0, in_long)
    far, aside = ranges > medium.range_max, np.abs(azimuths) > long.half_angle
    assert stats.binomtest(int(far.sum()), len(ranges), 0.5 * (1.0 - 60.0 / 174.0)).pvalue > 1e-4
    assert stats.binomtest(int(aside.sum()), len(ranges), 0.5 * (1.0 - 10.0 / 45.0)).pvalue > 1e-4
    assert stats.kstest(ranges[far], stats.uniform(60.0, 114.0).cdf).pvalue > 1e-4
    assert stats.kstest(azimuths[far], stats.uniform(-long.half_angle, 2.0 * long.half_angle).cdf).pvalue > 1e-4
    assert stats.kstest(ranges[aside], stats.uniform(0.0, 60.0).cdf).pvalue > 1e-4
    assert stats.kstest(rates, stats.uniform(-RANGE_RATE_SPAN, 2.0 * RANGE_RATE_SPAN).cdf).pvalue > 1e-4


def test_false_alarms_come_in_order_and_in_quanta_like_everything_else() -> None:
    config = replace(RadarConfig(), latency=0.0, false_alarms=4.0, mount=replace(PLAIN.mount, x=0.0))
    for result in run(config, 100, rows=3):
        found = result.detections
        assert all(first <= second for first, second in pairwise(found.range.tolist()))
        for values, quantum in ((found.range, 0.1), (found.range_rate, 0.01), (found.azimuth, math.radians(0.1))):
            assert values / quantum == pytest.approx(np.rint(values / quantum), abs=1e-6)


def test_an_ideal_radar_is_prompt_and_sees_nothing_that_is_not_there() -> None:
    worst = replace(RadarConfig(), latency=0.5, noise_correlation=0.9, false_alarms=5.0)
    assert worst.ideal() == RadarConfig().ideal()
    results = run(worst.ideal(), 50)
    assert len(results) == 50
    assert all(result.actors == ("car0",) for result in results)
