"""The Fusion's numbers against real recordings of a Fusion's bus (repository autti/veloz, branch 20170214)."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests import vehicles
from vve_sumo.errors import ConfigError
from vve_sumo.plant.actuators import Lagged
from vve_sumo.plant.car import STEP, chassis
from vve_sumo.plant.dynamics import Dynamics
from vve_sumo.rig.car_parameters import perturbed
from vve_sumo.scenario.schema import CarDifferences
from vve_sumo.vehicle.model import IDEAL

RECORDING = "drives/ford_fusion/tidy_collision_assist_activated.csv"
Log = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def braking(shared_data: Path) -> Log:
    """Floored pedal, its release, a collision warning, then braking from 20 to 13 m/s at up to 5.9 m/s2."""
    with (shared_data / RECORDING).open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def replay(log: Log, torque: str, start: float = 2.0, brake_gain_factor: float = 1.0, lag: bool = False) -> float:
    """RMS error of speed [m/s] when the recorded accelerator pedal and brake torque drive the plant from `start` on."""
    body = vehicles.parameters(brake_gain_factor=brake_gain_factor)
    calibration, vehicle = body.calibration, body.vehicle
    speed = log["v_over_ground_kmh"] / 3.6
    engine = Lagged(body.throttle_delay, calibration.drive_lag, STEP)
    # The recording's torque request is inside the car: the kit's share of the dead time is left out.
    brakes = Lagged(0.015, vehicle.brake_lag, STEP) if lag else Lagged(0.0, 0.0, STEP)
    motion = Dynamics(chassis(body), (0.0, 0.0, 0.0), speed=float(np.interp(start, log["t"], speed)))
    for _ in range(400):
        engine.step(float(np.interp(start, log["t"], log["accel_pedal_pct"])) / 100.0)
    errors = []
    for now in np.arange(start, log["t"][-1] - STEP, STEP):
        throttle = engine.step(float(np.interp(now, log["t"], log["accel_pedal_pct"])) / 100.0)
        held = calibration.brake_force(brakes.step(float(np.interp(now, log["t"], log[torque])))) * brake_gain_factor
        motion.advance(STEP, 0.0, calibration.drive_force(throttle, motion.speed), held)
        errors.append(motion.speed - float(np.interp(now + STEP, log["t"], speed)))
    return float(np.sqrt(np.mean(np.square(errors))))


def test_recorded_hard_braking_is_reproduced(braking: Log) -> None:
    """Speed within 0.15 m/s rms over 2.1 s in which it goes from 19 up to 20 and down to 13 m/s."""
    assert replay(braking, "brk_tq_act_Nm") < 0.15


def test_recorded_request_through_the_actuator_is_reproduced(braking: Log) -> None:
    assert replay(braking, "brk_tq_req_arb_Nm", lag=True) < 0.15


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_the_replay_would_notice_brakes_that_are_a_fifth_off(braking: Log, factor: float) -> None:
    assert replay(braking, "brk_tq_act_Nm", brake_gain_factor=factor) > 0.30


def test_actuator_turns_the_recorded_request_into_the_recorded_torque(braking: Log) -> None:
    """Within 90 N m rms, three per cent of the peak: both are sampled at 50 Hz and nothing is known in between."""
    times = braking["t"]
    changed = np.flatnonzero(np.diff(braking["brk_tq_act_Nm"])) + 1
    actuator = Lagged(0.015, vehicles.parameters().vehicle.brake_lag, STEP)
    grid = np.arange(2.40, 4.12, STEP)
    asked_changed = np.r_[0, np.flatnonzero(np.diff(braking["brk_tq_req_arb_Nm"])) + 1]
    asked = np.interp(grid, times[asked_changed], braking["brk_tq_req_arb_Nm"][asked_changed])
    given = np.array([actuator.step(float(torque)) for torque in asked])
    inside = changed[(times[changed] > 2.45) & (times[changed] < 4.1)]
    error = np.interp(times[inside], grid + STEP, given) - braking["brk_tq_act_Nm"][inside]
    assert np.sqrt(np.mean(error**2)) < 90.0


def test_full_braking_reaches_the_declared_deceleration() -> None:
    vehicle, calibration = vehicles.parameters().vehicle, vehicles.parameters().calibration
    force = calibration.brake_force(vehicle.brake_torque_limit)
    assert force / vehicle.mass == pytest.approx(vehicle.deceleration_limit, abs=0.05)
    assert vehicle.understeer_gradient == pytest.approx(3.3e-4, rel=0.02)


def test_the_measured_brake_gain_is_that_of_the_recorded_plateau(braking: Log) -> None:
    """Torque over the deceleration that is left once the assumed drag is taken out; the calibration has it in."""
    plateau = (braking["t"] > 3.2) & (braking["t"] < 3.95)
    times, speed = braking["t"][plateau], braking["v_over_ground_kmh"][plateau] / 3.6
    calibration = vehicles.FUSION.calibration
    braked = -np.polyfit(times, speed, 1)[0] - calibration.drag(speed.mean()) / calibration.mass
    gain = braking["brk_tq_act_Nm"][plateau].mean() / braked
    assert vehicles.FUSION.measured.brake_gain_factor == pytest.approx(calibration.brake_gain / gain, abs=0.005)


def test_the_fidelity_of_a_file_decides_on_the_imperfections() -> None:
    assert perturbed(vehicles.FUSION, CarDifferences()).imperfections == vehicles.FUSION.measured
    assert perturbed(vehicles.FUSION, CarDifferences(fidelity="ideal")).imperfections == IDEAL
    assert perturbed(vehicles.FUSION, CarDifferences(fidelity="measured")).imperfections == vehicles.FUSION.measured
    bare = replace(vehicles.FUSION, measured=IDEAL)
    assert perturbed(bare, CarDifferences()).imperfections == IDEAL
    with pytest.raises(ConfigError, match=r"^fidelity: expected 'ideal'.* ford_fusion, .* got 'measured'$"):
        perturbed(bare, CarDifferences(fidelity="measured"))
