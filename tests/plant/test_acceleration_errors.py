"""Errors of the accelerometers against their own parameters and against recordings of a Fusion's bus."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import savgol_filter

from tests import vehicles
from vve_sumo.plant.acceleration_errors import AccelerationErrors
from vve_sumo.values import Floats
from vve_sumo.vehicle.interface import Accelerations

PERIOD = 0.01
MEASURED = vehicles.FUSION.measured
WINDOW = 51  #: reports of 10 ms, of the parabola that stands for the car's own motion
STEADY = ("car_50km", "car_60km", "lkast_activated")
SIGNALS = {"longitudinal": "ax_raw_mps2", "lateral": "ay_raw_mps2"}


def simulated(seconds: float, seed: int = 1, size: float = 1.0) -> Floats:
    """Longitudinal and lateral acceleration (n, 2) of a car that runs straight on at a constant speed [m/s2]."""
    errors = AccelerationErrors(MEASURED, size, PERIOD, np.random.SeedSequence(seed))
    said = [errors.measured(Accelerations(0.0, 0.0, 9.81)) for _ in range(round(seconds / PERIOD))]
    return np.array([(one.longitudinal, one.lateral) for one in said])


def noise_and_correlation(signal: Floats) -> tuple[float, float]:
    """Standard deviation about a running parabola, and its correlation from report to report."""
    rest = (signal - savgol_filter(signal, WINDOW, 2))[WINDOW // 2 : -(WINDOW // 2)]
    return float(rest.std()), float(np.corrcoef(rest[1:], rest[:-1])[0, 1])


def recorded(folder: Path, name: str) -> dict[str, Floats]:
    with (folder / "drives" / "ford_fusion" / f"tidy_{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {column: np.array([float(row[column]) for row in rows]) for column in rows[0]}


def test_noise_has_its_size_and_its_memory() -> None:
    accelerations = simulated(600.0)
    longitudinal, lateral = (accelerations - accelerations.mean(axis=0)).T
    assert longitudinal.std() == pytest.approx(MEASURED.longitudinal_acceleration_noise, rel=0.03)
    assert lateral.std() == pytest.approx(MEASURED.lateral_acceleration_noise, rel=0.03)
    kept = np.corrcoef(lateral[6:], lateral[:-6])[0, 1]
    assert kept == pytest.approx(math.exp(-0.06 / MEASURED.acceleration_correlation), abs=0.02)
    assert abs(np.corrcoef(longitudinal, lateral)[0, 1]) < 0.03


@pytest.mark.thorough
def test_offsets_are_drawn_once_for_a_drive() -> None:
    drives = np.array([simulated(6.0, seed).reshape(2, -1, 2).mean(axis=1) for seed in range(200)])
    assert abs(drives[:, 0] - drives[:, 1]).max() < 0.15, "the same in both halves of a drive"
    sigmas = MEASURED.longitudinal_acceleration_bias, MEASURED.lateral_acceleration_bias
    assert drives[:, 0].std(axis=0) == pytest.approx(sigmas, rel=0.15)


def test_a_car_without_noise_measures_the_truth() -> None:
    assert not simulated(1.0, size=0.0).any()


@pytest.mark.parametrize("number", [0, 1], ids=SIGNALS)
def test_simulated_noise_is_as_large_and_as_lasting_as_recorded(shared_data: Path, number: int) -> None:
    """Between the least and the most of three steady recordings, a tenth more room for six seconds each."""
    column = list(SIGNALS.values())[number]
    theirs = [noise_and_correlation(recorded(shared_data, name)[column]) for name in STEADY]
    ours = noise_and_correlation(simulated(100.0)[:, number])
    for mine, real in zip(ours, zip(*theirs, strict=True), strict=True):
        assert 0.9 * min(real) < mine < 1.1 * max(real)


def test_recorded_offsets_are_such_as_are_drawn(shared_data: Path) -> None:
    """Root mean squares of four recordings within a factor of two of what is drawn: of four no more can be asked."""
    along, across = [], []
    for name in (*STEADY, "collision_assist_activated"):
        log = recorded(shared_data, name)
        rear = 0.5 * vehicles.FUSION.vehicle.wheel_radius * (log["wheel_rl_radps"] + log["wheel_rr_radps"])
        gained = (rear[-20:].mean() - rear[:20].mean()) / (log["t"][-20:].mean() - log["t"][:20].mean())
        along.append(log["ax_raw_mps2"].mean() - gained)
        across.append(log["ay_raw_mps2"].mean() - (log["v_over_ground_kmh"] / 3.6 * log["yaw_rate_radps"]).mean())
    for found, sigma in (
        (along, MEASURED.longitudinal_acceleration_bias),
        (across, MEASURED.lateral_acceleration_bias),
    ):
        assert 0.5 < np.sqrt(np.mean(np.square(found))) / sigma < 2.0
