"""What the plant's steps of 5 ms miss: against equations written anew and solved by scipy, and against finer steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import count

import pytest
from scipy.integrate import solve_ivp

from tests.vehicles import parameters
from vve_sumo.physical_constants import AIR_DENSITY, GRAVITY
from vve_sumo.plant.car import STEP, chassis
from vve_sumo.plant.dynamics import Dynamics

BODY = chassis(parameters())
#: what `Dynamics` states: place [m], heading [rad], speed [m/s]
PLACE, HEADING, SPEED = 3e-3, 1e-5, 3e-4
Inputs = tuple[float, float, float]  # road-wheel angle [rad], drive force [N], brake force [N]


def lane_changes(time: float, size: float, braking: float) -> Inputs:
    """Full drive force, lane changes on and off it, then brakes to rest in a bend; `braking` as a share of weight."""
    if time < 5.0:
        return size * 0.03 * math.sin(math.tau * time / 3.0), 6500.0, 0.0
    if time < 10.0:
        return size * 0.045 * math.sin(math.tau * time / 2.5), 500.0, 0.0
    return size * 0.02, 0.0, braking * BODY.mass * GRAVITY


def rates(_: float, state: Sequence[float], steering: float, drive: float, brake: float) -> list[float]:
    """A single-track car that rolls forward, by its slip angles; the state is that of the centre of mass."""
    _x, _y, heading, speed, lateral, yaw_rate = state
    a, length, weight = BODY.front_axle_to_mass, BODY.wheelbase, BODY.mass * GRAVITY
    b = length - a
    drag = BODY.rolling_resistance * weight + 0.5 * AIR_DENSITY * BODY.drag_area * speed**2
    acceleration = (drive - drag - min(brake, BODY.friction * weight)) / BODY.mass
    sides = []
    for stiffness, arm, rest, sign, steered in (
        (BODY.cornering_stiffness_front, a, weight * b / length, -1.0, steering),
        (BODY.cornering_stiffness_rear, -b, weight * a / length, 1.0, 0.0),
    ):
        load = rest + sign * BODY.mass * acceleration * BODY.mass_height / length
        slip = steered - (lateral + arm * yaw_rate) / speed
        sides.append(load * min(max(stiffness / rest * slip, -BODY.friction), BODY.friction))
    front, rear = sides
    return [
        speed * math.cos(heading) - (lateral - b * yaw_rate) * math.sin(heading),
        speed * math.sin(heading) + (lateral - b * yaw_rate) * math.cos(heading),
        yaw_rate,
        acceleration,
        (front + rear) / BODY.mass - speed * yaw_rate,
        (a * front - b * rear) / BODY.yaw_inertia,
    ]


@pytest.mark.thorough
@pytest.mark.parametrize(("size", "braking"), [(0.3, 0.5), (1.0, 0.8)])
def test_a_step_of_5_ms_misses_little_of_what_scipy_integrates(size: float, braking: float) -> None:
    """From 5 m/s, through 23 m/s and up to 8 m/s2 across, down to 4 m/s: at these speeds the tyres alone act."""
    motion, exact = Dynamics(BODY, (0.0, 0.0, 0.0), speed=5.0), [0.0, 0.0, 0.0, 5.0, 0.0, 0.0]
    for step in count():
        if motion.speed < 4.0:
            break
        inputs = lane_changes((step + 0.5) * STEP, size, braking)
        motion.advance(STEP, *inputs)
        exact = solve_ivp(rates, (0.0, STEP), exact, "RK45", args=inputs, rtol=1e-8, atol=1e-10).y[:, -1].tolist()
        x, y, heading, speed, _lateral, _yaw_rate = exact
        assert math.hypot(motion.x - x, motion.y - y) < PLACE
        assert abs(motion.heading - heading) < HEADING
        assert abs(motion.speed - speed) < SPEED
    assert motion.distance > 200.0


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(("size", "braking"), [(0.3, 0.5), (1.0, 0.8), (1.6, 0.3)])
def test_a_whole_drive_in_steps_of_5_ms_ends_where_one_in_tenths_of_them_does(size: float, braking: float) -> None:
    """From rest to rest, so through the blend with the rolling car and the stop within a step as well."""
    coarse, fine = Dynamics(BODY, (0.0, 0.0, 0.0)), Dynamics(BODY, (0.0, 0.0, 0.0))
    for step in range(round(18.0 / STEP)):
        inputs = lane_changes((step + 0.5) * STEP, size, braking)
        coarse.advance(STEP, *inputs)
        for _ in range(10):
            fine.advance(STEP / 10, *inputs)
        # The finer steps miss about a tenth of what the coarse ones do.
        assert math.hypot(coarse.x - fine.x, coarse.y - fine.y) < 0.9 * PLACE
        assert abs(coarse.heading - fine.heading) < 0.9 * HEADING
        assert abs(coarse.speed - fine.speed) < 0.9 * SPEED
    assert (coarse.speed, fine.speed) == (0.0, 0.0)
    assert coarse.distance > 150.0
