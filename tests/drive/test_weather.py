"""What the weather does to the simulated vehicle: full braking against the closed form of a sliding block."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests import vehicles
from tests.drive.street import altered
from tests.plant.test_car import EPOCH, LOT, ride
from vve_sumo.drive.lockstep import car_parameters
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.plant.car import Car, CarParameters
from vve_sumo.rig.car_parameters import DRY


def braking(parameters: CarParameters) -> tuple[float, float]:
    """Return the mean speed [m/s] and deceleration [m/s2] of a full braking from speed, its onset left out."""
    car = Car(parameters, (0.0, 0.0, 0.0), LOT, EPOCH, np.random.SeedSequence(1))
    for command, start, seconds in (((1500.0, 0.0, 0.0), 0.0, 1.0), ((0.0, 0.35, 0.0), 1.0, 8.0)):
        for _ in ride(car, seconds, lambda _, now=command: now, start):
            pass
    full = parameters.vehicle.brake_torque_limit, 0.0, 0.0
    for _ in ride(car, 1.0, lambda _: full, 9.0):
        pass
    first = car.truth().speed
    for _ in ride(car, 0.5, lambda _: full, 10.0):
        pass
    last = car.truth().speed
    assert last > 2.0
    return 0.5 * (first + last), (first - last) / 0.5


@pytest.mark.parametrize("friction", [0.3, 0.1])
def test_full_braking_is_what_friction_lets_through(friction: float) -> None:
    """mu g, and what rolls and drags: c_r g + rho C_d A v^2 / (2 m)."""
    parameters = car_parameters(altered({"weather": {"friction": friction}, "ego.car.noise": False}))
    speed, deceleration = braking(parameters)
    calibration, mass = parameters.calibration, parameters.vehicle.mass
    drag = 0.5 * 1.2 * calibration.drag_area * speed * speed / mass
    expected = (friction + calibration.rolling_resistance) * GRAVITY + drag
    assert deceleration == pytest.approx(expected, rel=0.02)


def test_on_a_dry_road_the_car_is_the_one_it_was() -> None:
    plain = altered({"ego.car": {}})
    assert car_parameters(plain) == vehicles.parameters(imperfections=vehicles.FUSION.measured)
    assert math.isclose(plain.scenario.weather.friction, DRY)
