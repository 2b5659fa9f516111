"""What a real radar's tracks say of latency and of errors that hold on: a minute of a Denso radar (comma2k19, MIT)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from tests.sensors.denso import Track, read_tracks, remover, rows, windows
from tests.sensors.scenes import FUSION, actors, car, rear_axle
from vve_sumo.sensors.radar import Radar, RadarConfig
from vve_sumo.sensors.radar_settings import RadarSettings
from vve_sumo.values import Floats

LAGS = np.arange(-0.1, 0.3, 0.005)


@pytest.fixture(scope="module")
def tracks(shared_data: Path) -> list[Track]:
    return read_tracks(shared_data)


@pytest.fixture(scope="module")
def speed(shared_data: Path) -> CubicSpline:
    """Return the ego's own speed [m/s] over time."""
    poses = np.array(
        [
            (row["t"], np.hypot(row["ve"], row["vn"]))
            for row in rows(shared_data / "drives/comma2k19/tidy_pose_20hz.csv")
        ]
    )
    return CubicSpline(*poses.T)


@pytest.mark.parametrize(("count", "degree"), [(30, 2), (30, 3), (40, 2), (40, 3)])
def test_the_default_latency_is_that_of_real_range_rates(
    tracks: list[Track], speed: CubicSpline, count: int, degree: int
) -> None:
    """Every target's range rate holds the ego's own speed, late: least squares over the lag.

    What the targets do themselves is smooth in these 1.5 to 2 s and taken out as a polynomial; so is what is slow in
    the ego's speed. The four windows give 0.07 to 0.10 s, each with a standard error of 0.015 to 0.03 s (jackknife over
    stretches of 3 s): the poses are dated by another clock's estimate, and nothing finer can be told.
    """
    cut = list(windows(tracks, count))
    free = remover(count, degree)
    times, wanted = np.array([one.time for one in cut]), np.array([one.rate for one in cut]) @ free
    keep = wanted.std(axis=1) < 0.3  # a reflection that jumps to another part of the target says nothing of time
    assert keep.sum() > 300
    left = [float(np.sum((wanted[keep] + speed(times[keep] - lag) @ free) ** 2)) for lag in LAGS]
    lag = LAGS[int(np.argmin(left))]
    assert lag == pytest.approx(RadarConfig().latency, abs=0.035)
    assert RadarSettings().latency_s == RadarConfig().latency


def test_range_and_range_rate_are_late_by_much_the_same(tracks: list[Track]) -> None:
    """A range rate that is late by L against its range integrates to the range minus L times itself.

    Least squares over whole tracks of 2 s and more, a cubic left free in each: 0.02 s, standard error 0.006 s
    (jackknife over tracks). That is less than half a scan: one latency stands for both.
    """
    product = square = 0.0
    for time, ahead, _aside, rate in tracks:
        if len(time) < 40:
            continue
        way = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))))
        free = remover(len(time), 3)
        late, pace = free @ (ahead - way), free @ rate
        product, square = product + late @ pace, square + pace @ pace
    assert product / square == pytest.approx(0.02, abs=0.025)


def residual_correlation(series: list[Floats], count: int = 11) -> float:
    """Return the correlation, from one report to the next, of what the middle of a local quadratic leaves over."""
    weights = remover(count, 2)[count // 2]
    left = [np.convolve(one, weights[::-1], "valid") for one in series if len(one) >= 60]
    return float(sum(one[1:] @ one[:-1] for one in left) / sum(one @ one for one in left))


def declared_from(measured: float, count: int = 11) -> float:
    """Return the first-order correlation of errors of which a local quadratic leaves over what was measured."""
    weights = remover(count, 2)[count // 2]
    apart = np.abs(np.subtract.outer(np.arange(count + 1), np.arange(count + 1)))
    first, second = np.append(weights, 0.0), np.append(0.0, weights)

    def left(correlation: float) -> float:
        spread = correlation**apart
        return float(first @ spread @ second / (first @ spread @ first))

    return float(brentq(lambda correlation: left(correlation) - measured, 0.0, 0.75))


@pytest.mark.thorough
def test_errors_of_real_range_rates_are_correlated_by_0_4_to_0_5(tracks: list[Track]) -> None:
    """And what finds it there finds it in our own noise, where it is declared."""
    assert declared_from(residual_correlation([track.rate for track in tracks])) == pytest.approx(0.45, abs=0.08)
    for declared in (0.0, 0.45):
        config = RadarConfig(latency=0.0, noise_correlation=declared, detection_probability=1.0)
        sensor, street = Radar(config, FUSION, np.random.default_rng(5)), actors([car(40.0, 0.0)])
        found = [sensor.step(index * 0.05, rear_axle(), street) for index in range(10_000)]
        ours = np.array([scan.detections.range_rate[0] for scan in found if scan])
        measured = residual_correlation([ours])
        assert declared_from(max(measured, -0.27)) == pytest.approx(declared, abs=0.06)
