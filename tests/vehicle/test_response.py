"""Brakes that give too little and engines that give too much, against Newton's law with the calibrated car."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.vehicle.car import FUSION
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.response import Response

STEP = 0.02  # [s]
TORQUE = 1100.0  # [N m]
#: A car without creep and drag, whose brakes answer at once: torque over mass is all there is.
CALIBRATION = Calibration()
QUICK = replace(FUSION, brake_delay=0.0, brake_lag=1e-9)


def gain(
    response: Response,
    pedals: Pedals,
    acceleration: float,
    speed: float = 10.0,
    grade: float = 0.0,
    satellite: bool = True,
) -> float:
    """After which time a car that gains speed so is reported [s]; infinite for never in 20 s."""
    now = 0.0
    while now < 20.0:
        codes = response.step(STEP, pedals, speed, speed if satellite else math.nan, grade)
        if codes:
            return now
        speed, now = speed + acceleration * STEP, now + STEP
        speed = min(max(speed, 9.0), 11.0) if acceleration == 0.0 else speed
    return math.inf


def sound(torque: float, speed: float = 10.0, share: float = 1.0, grade: float = 0.0) -> float:
    """What the calibrated car gains with brakes that give so much of the torque [m/s2]."""
    force = CALIBRATION.creep(speed) - CALIBRATION.drag(speed) - share * CALIBRATION.brake_force(torque)
    return force / CALIBRATION.mass - 9.80665 * math.sin(grade)


@pytest.mark.parametrize("grade", [0.0, -0.1, 0.1])
def test_a_sound_car_and_one_with_four_fifths_of_its_brakes_are_left_alone(grade):
    """A margin of 0.25 m/s2 is more than a fifth of 1100 N m at 1690 kg lacks, less a quarter of it."""
    for share in (1.0, 0.8):
        assert (
            gain(
                Response(QUICK, CALIBRATION), Pedals(TORQUE, 0.0), sound(TORQUE, share=share, grade=grade), 30.0, grade
            )
            == math.inf
        )


def test_brakes_that_give_nothing_are_found_in_a_moment():
    """1100 N m at three quarters are 1.5 m/s2 that are missing, less 0.25: a quarter of a metre per second in 0.2 s."""
    response = Response(QUICK, CALIBRATION)
    lacking = 0.75 * CALIBRATION.brake_force(TORQUE) / CALIBRATION.mass - 0.25
    found = gain(response, Pedals(TORQUE, 0.0), sound(0.0), 10.0)
    assert found == pytest.approx(0.25 / lacking, abs=3.0 * STEP)
