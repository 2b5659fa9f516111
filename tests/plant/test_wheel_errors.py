"""Errors of the wheel-speed sensors against their own parameters and against recordings of a Fusion's bus."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests import vehicles
from vve_sumo.plant.wheel_errors import WheelErrors
from vve_sumo.values import Floats
from vve_sumo.vehicle.interface import WheelSpeeds
from vve_sumo.vehicle.model import IDEAL, Imperfections

PERIOD = 0.01
MEASURED = vehicles.FUSION.measured
#: recordings at a steady speed, and the track that turns their yaw rate into a difference of wheel speeds
STEADY = ("car_60km", "lkast_activated")
WHEELS = ("wheel_fl_radps", "wheel_fr_radps", "wheel_rl_radps", "wheel_rr_radps")
FORMS = 12  #: degree of the polynomial that stands for the car's own change of speed


def simulated(imperfections: Imperfections, speed: float, seconds: float, seed: int = 1) -> Floats:
    """Wheel speeds (n, 4) at a constant speed of all wheels [rad/s]."""
    errors = WheelErrors(imperfections, 1.0, PERIOD, np.random.SeedSequence(seed))
    return np.array([errors.measured(WheelSpeeds(*[speed] * 4)) for _ in range(round(seconds / PERIOD))])


def recorded(folder: Path, name: str) -> tuple[Floats, Floats]:
    """Wheel speeds (n, 4) [rad/s] and yaw rate [rad/s] of a recording, 10 ms apart."""
    with (folder / "drives" / "ford_fusion" / f"tidy_{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    wheels = np.array([[float(row[wheel]) for wheel in WHEELS] for row in rows])
    return wheels, np.array([float(row["yaw_rate_radps"]) for row in rows])


def runout_and_rest(speeds: Floats) -> tuple[float, float]:
    """Amplitude once per revolution, over the mean speed, and the standard deviation of what is left [rad/s]."""
    times = np.linspace(-1.0, 1.0, len(speeds))
    trend = np.polynomial.legendre.legvander(times, FORMS)
    smooth = trend @ np.linalg.lstsq(trend, speeds, rcond=None)[0]
    angle = np.cumsum(smooth) * PERIOD
    terms = np.c_[trend, np.cos(angle), np.sin(angle)]
    found = np.linalg.lstsq(terms, speeds, rcond=None)[0]
    return math.hypot(*found[-2:]) / speeds.mean(), float((speeds - terms @ found).std())


def runouts(imperfections: Imperfections) -> list[float]:
    of = imperfections
    return [
        of.wheel_runout_front_left,
        of.wheel_runout_front_right,
        of.wheel_runout_rear_left,
        of.wheel_runout_rear_right,
    ]


@pytest.mark.parametrize("speed", [5.0, 34.0, 52.0])
def test_each_wheel_has_its_runout_in_proportion_to_the_speed(speed: float) -> None:
    finely = replace(MEASURED, wheel_quantum=0.0)
    found = [runout_and_rest(wheel)[0] for wheel in simulated(finely, speed, 40.0).T]
    sampling = MEASURED.wheel_jitter * math.sqrt(2.0 / 4000.0)
    assert found == pytest.approx(runouts(MEASURED), abs=4.0 * sampling)


def test_the_error_goes_once_round_with_the_wheel() -> None:
    """Half a revolution apart the runout's errors cancel out."""
    speed = math.pi / 0.1  # half a revolution in ten reports
    runout = replace(IDEAL, wheel_runout_front_left=0.001)
    wheel = simulated(runout, speed, 5.0)[:, 0]
    assert np.ptp(wheel) == pytest.approx(2.0 * 0.001 * speed, rel=0.06)
    assert wheel[:-10] + wheel[10:] == pytest.approx(2.0 * speed, abs=1e-9)


def test_jitter_is_independent_of_itself_and_of_the_other_wheels() -> None:
    wheels = simulated(replace(IDEAL, wheel_jitter=0.0005), 40.0, 100.0)
    errors = wheels - 40.0
    assert errors.std(axis=0) == pytest.approx(0.02, rel=0.03)
    assert abs(np.corrcoef(errors.T) - np.eye(4)).max() < 0.03
    assert abs(np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]) < 0.03


def test_the_right_wheels_turn_faster_by_their_share() -> None:
    front_left, front_right, rear_left, rear_right = simulated(MEASURED, 50.0, 100.0).mean(axis=0)
    assert front_right - front_left == pytest.approx(50.0 * MEASURED.wheel_front_right_over_left, abs=0.004)
    assert rear_right - rear_left == pytest.approx(50.0 * MEASURED.wheel_rear_right_over_left, abs=0.004)
    assert 0.5 * (front_left + front_right) == pytest.approx(50.0, abs=0.004)


def test_a_wheel_at_rest_is_measured_at_rest() -> None:
    assert not simulated(MEASURED, 0.0, 5.0).any()


def test_speeds_come_in_the_sensors_steps() -> None:
    steps = simulated(MEASURED, 33.333, 5.0) / 0.04
    assert steps == pytest.approx(np.round(steps), abs=1e-6)


def test_seeds_draw_other_angles() -> None:
    first, again, other = (simulated(MEASURED, 40.0, 1.0, seed) for seed in (1, 1, 2))
    assert (first == again).all()
    assert (first != other).any()


@pytest.mark.parametrize("name", STEADY)
def test_recorded_wheels_have_the_runout_of_the_vehicle_file(shared_data: Path, name: str) -> None:
    """Each within 3e-4 of its wheel's figure: the recordings differ among themselves by as much."""
    wheels, _ = recorded(shared_data, name)
    found = [runout_and_rest(wheel) for wheel in wheels.T]
    assert [one for one, _ in found] == pytest.approx(runouts(MEASURED), abs=3e-4)
    # The sine is no accident of a fit: for the wheel with the largest it explains most of the variance.
    without = runout_and_rest(wheels[:, 2])[1]
    amplitude = found[2][0] * wheels[:, 2].mean()
    assert 0.5 * amplitude**2 > without**2


def test_simulated_wheels_are_as_noisy_as_recorded_ones(shared_data: Path) -> None:
    """What is left without runout and trend, at the speed of the recording in which the speed was steadiest."""
    wheels, _ = recorded(shared_data, "lkast_activated")
    ours = simulated(MEASURED, float(wheels.mean()), PERIOD * len(wheels))
    left = [np.median([runout_and_rest(wheel)[1] for wheel in of.T]) for of in (wheels, ours)]
    assert left[1] == pytest.approx(left[0], rel=0.25)


@pytest.mark.parametrize("name", [*STEADY, "car_50km"])
def test_recorded_front_wheels_differ_as_the_vehicle_file_says(shared_data: Path, name: str) -> None:
    wheels, yaw_rate = recorded(shared_data, name)
    by_yaw = yaw_rate * vehicles.FUSION.simulated.track / vehicles.FUSION.vehicle.wheel_radius
    front = (wheels[:, 1] - wheels[:, 0] - by_yaw).mean() / wheels.mean()
    rear = (wheels[:, 3] - wheels[:, 2] - by_yaw).mean() / wheels.mean()
    assert 0.0003 < front < MEASURED.wheel_front_right_over_left + 0.0003
    assert rear == pytest.approx(MEASURED.wheel_rear_right_over_left, abs=0.0004)


@pytest.mark.parametrize("name", STEADY)
def test_recorded_speeds_come_in_the_steps_of_the_vehicle_file(shared_data: Path, name: str) -> None:
    steps = recorded(shared_data, name)[0] / MEASURED.wheel_quantum
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
