"""Motion against closed forms and against the single-track model of commonroad-vehicle-models."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests import vehicles
from tests.vehicles import parameters
from vve_sumo.physical_constants import AIR_DENSITY, GRAVITY
from vve_sumo.plant.car import STEP, chassis
from vve_sumo.plant.dynamics import DYNAMIC_SPEED, KINEMATIC_SPEED, Dynamics, blend

FUSION = chassis(parameters())
FRICTIONLESS = replace(FUSION, rolling_resistance=0.0, drag_area=0.0)
ORIGIN = (0.0, 0.0, 0.0)


def drive(motion: Dynamics, seconds: float, steering: float = 0.0, force: float = 0.0, brake: float = 0.0) -> Dynamics:
    for _ in range(round(seconds / STEP)):
        motion.advance(STEP, steering, force, brake)
    return motion


def test_coast_down_follows_the_closed_form() -> None:
    """Constant plus square resistance: v = sqrt(a/b) tan(atan(v0 sqrt(b/a)) - t sqrt(a b))."""
    a = FUSION.rolling_resistance * GRAVITY
    b = 0.5 * AIR_DENSITY * FUSION.drag_area / FUSION.mass
    motion = drive(Dynamics(FUSION, ORIGIN, speed=25.0), 30.0)
    expected = math.sqrt(a / b) * math.tan(math.atan(25.0 * math.sqrt(b / a)) - 30.0 * math.sqrt(a * b))
    assert motion.speed == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("speed", [1.5, 2.9, 7.0, 14.0])
@pytest.mark.parametrize("brake", [2000.0, 9000.0])
def test_stopping_distance_of_constant_brake_force(speed: float, brake: float) -> None:
    motion = drive(Dynamics(FRICTIONLESS, ORIGIN, speed=speed), 15.0, brake=brake)
    assert motion.speed == 0.0
    assert motion.x == pytest.approx(speed**2 * FUSION.mass / (2.0 * brake), abs=1e-3)


@pytest.mark.parametrize("speed", [4.0, 10.0, 17.0, 25.0])
@pytest.mark.parametrize("steering", [0.01, -0.02])
def test_steady_circle_has_the_yaw_rate_of_the_understeer_gradient(speed: float, steering: float) -> None:
    motion = drive(Dynamics(FRICTIONLESS, ORIGIN, speed=speed), 8.0, steering)
    vehicle = vehicles.FUSION.vehicle
    expected = speed * steering / (vehicle.wheelbase + vehicle.understeer_gradient * speed**2)
    assert motion.yaw_rate == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("speed", [1.01, 1.3, 2.0, 3.0, 40.0])
@pytest.mark.parametrize("mass_factor", [0.5, 1.0, 2.0])
def test_the_bend_settles_at_every_speed_and_load(speed: float, mass_factor: float) -> None:
    """Stiff tyres over a small speed are where an explicit integration would chatter."""
    body = replace(chassis(parameters(mass_factor=mass_factor)), rolling_resistance=0.0, drag_area=0.0)
    motion = drive(Dynamics(body, ORIGIN, speed=speed), 20.0, 0.002)
    settled = motion.yaw_rate
    assert settled == pytest.approx(speed * 0.002 / (body.wheelbase + mass_factor * 3.3e-4 * speed**2), rel=3e-3)
    for _ in range(50):
        motion.advance(STEP, 0.002, 0.0, 0.0)
        assert motion.yaw_rate == pytest.approx(settled, rel=1e-9)


def test_below_walking_pace_the_rear_axle_runs_on_the_rolling_circle() -> None:
    steering = 0.3
    radius = FUSION.wheelbase / math.tan(steering)
    motion = drive(Dynamics(FRICTIONLESS, ORIGIN, speed=0.9), 20.0, steering)
    assert math.hypot(motion.x, motion.y - radius) == pytest.approx(radius, abs=1e-4)
    assert math.remainder(motion.heading - 0.9 * 20.0 / radius, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert motion.lateral_speed == 0.0


def side_acceleration(motion: Dynamics, before: tuple[float, float]) -> float:
    """Of the centre of mass [m/s2], from what can be seen of the motion one step apart."""
    rear = FUSION.wheelbase - FUSION.front_axle_to_mass
    change = motion.lateral_speed - before[0] + rear * (motion.yaw_rate - before[1])
    return change / STEP + motion.speed * 0.5 * (motion.yaw_rate + before[1])


@pytest.mark.parametrize("steering", [0.5, -0.2])
def test_full_lock_at_speed_is_limited_by_grip(steering: float) -> None:
    motion, largest = Dynamics(FRICTIONLESS, ORIGIN, speed=15.0), 0.0
    for _ in range(400):
        before = motion.lateral_speed, motion.yaw_rate
        motion.advance(STEP, steering, 0.0, 0.0)
        largest = max(largest, abs(side_acceleration(motion, before)))
    assert largest == pytest.approx(FUSION.friction * GRAVITY, rel=0.01)


@pytest.mark.parametrize("grade", [0.03, -0.03, 0.10])
def test_brakes_hold_on_a_grade_without_the_least_motion(grade: float) -> None:
    creep = 600.0
    needed = abs(FUSION.mass * GRAVITY * math.sin(math.atan(grade)) - creep)
    motion = drive(Dynamics(FUSION, ORIGIN, grade=math.atan(grade)), 60.0, force=creep, brake=needed)
    assert (motion.x, motion.y, motion.speed, motion.distance) == (0.0, 0.0, 0.0, 0.0)


def test_too_little_brake_lets_the_car_roll_back() -> None:
    angle = math.atan(0.05)
    pull = FRICTIONLESS.mass * GRAVITY * math.sin(angle)
    motion = drive(Dynamics(FRICTIONLESS, ORIGIN, grade=angle), 2.0, brake=0.6 * pull)
    assert motion.speed == pytest.approx(-0.4 * GRAVITY * math.sin(angle) * 2.0, rel=1e-9)


def test_a_car_rolling_back_is_stopped_by_its_brakes_and_stays() -> None:
    motion = drive(Dynamics(FUSION, ORIGIN, speed=-1.0, grade=math.atan(0.05)), 2.0, brake=3000.0)
    rest = motion.x
    drive(motion, 5.0, brake=3000.0)
    assert (motion.speed, motion.x) == (0.0, rest)
    assert rest < 0.0


@given(
    speed=st.floats(-3.0, 30.0),
    steering=st.floats(-0.55, 0.55),
    force=st.floats(-7000.0, 7000.0),
    brake=st.floats(0.0, 2e4),
    grade=st.floats(-0.15, 0.15),
    mass_factor=st.floats(0.5, 2.0),
)
@example(speed=26.0, steering=0.5, force=-6699.0, brake=1964.0, grade=0.0, mass_factor=0.5)  # a spin of 6 rad/s
@settings(max_examples=60, deadline=None)
def test_nothing_blows_up_and_friction_never_speeds_the_car_up(
    speed: float, steering: float, force: float, brake: float, grade: float, mass_factor: float
) -> None:
    body = chassis(parameters(mass_factor=mass_factor))
    motion = Dynamics(body, ORIGIN, speed=speed, grade=grade)
    push = abs(force) / body.mass + GRAVITY * abs(math.sin(grade))
    # Were all energy of motion that of a spin.
    spin = math.sqrt(body.mass / body.yaw_inertia)
    for step in range(1, 401):
        before = motion.lateral_speed, motion.yaw_rate
        motion.advance(STEP, steering, force, brake)
        assert abs(motion.speed) <= abs(speed) + push * step * STEP + 1e-9
        if motion.speed > DYNAMIC_SPEED and abs(motion.acceleration) * STEP + DYNAMIC_SPEED < motion.speed:
            assert abs(side_acceleration(motion, before)) < 1.1 * FUSION.friction * GRAVITY
        assert abs(motion.yaw_rate) <= spin * (abs(speed) + push * step * STEP) + 1e-9, "more than any spin"
        assert math.isfinite(motion.x + motion.y + motion.heading + motion.lateral_speed)


@given(st.floats(-5.0, 40.0))
def test_blend_is_monotonic_between_its_ends(speed: float) -> None:
    assert 0.0 <= blend(speed) <= blend(speed + 0.1) <= 1.0
    assert (blend(speed) == 0.0) == (speed <= KINEMATIC_SPEED) or speed < KINEMATIC_SPEED + 1e-6
    assert blend(max(speed, DYNAMIC_SPEED)) == 1.0


def test_passing_through_the_blend_leaves_no_kick() -> None:
    """On a steady bend the yaw rate over speed is the circle's curvature, whichever model gives it."""
    motion = Dynamics(FRICTIONLESS, ORIGIN, speed=0.5)
    curvature = math.tan(0.05) / FUSION.wheelbase
    for _ in range(round(10.0 / STEP)):
        motion.advance(STEP, 0.05, 0.5 * FUSION.mass, 0.0)
        assert motion.yaw_rate == pytest.approx(motion.speed * curvature, rel=0.03)


def commonroad_vehicle(number: int):
    module = pytest.importorskip(f"vehiclemodels.parameters_vehicle{number}")
    return getattr(module, f"parameters_vehicle{number}")()


@pytest.mark.thorough(witnesses=4)
@pytest.mark.parametrize("number", [1, 2], ids=["ford_escort", "bmw_320i"])
@pytest.mark.parametrize("speed", [5.0, 10.0, 15.0, 25.0])
@pytest.mark.parametrize("acceleration", [0.0, -2.0, 1.5], ids=["constant", "braking", "driving"])
def test_agrees_with_the_commonroad_single_track_model(number: int, speed: float, acceleration: float) -> None:
    """A lane change, open loop: steering rate and acceleration in, 5 s (or down to 4 m/s) of motion out.

    Tolerances: 4 cm, 5e-4 rad, 1e-3 rad/s; theirs takes the speed along the path, ours along the heading.
    """
    integrate = pytest.importorskip("scipy.integrate")
    single_track = pytest.importorskip("vehiclemodels.vehicle_dynamics_st").vehicle_dynamics_st
    p = commonroad_vehicle(number)
    wheelbase = p.a + p.b
    amplitude = 0.6 * 2.0 * wheelbase / speed**2 * (2.0 * math.pi / 2.5)
    seconds = min(5.0, (speed - 4.0) / 2.0) if acceleration < 0.0 else 5.0
    gain = -p.tire.p_ky1 * p.m * 9.81 / wheelbase

    def steering_rate(time: float) -> float:
        return amplitude * math.cos(2.0 * math.pi * time / 2.5)

    def rates(time: float, state: np.ndarray) -> list[float]:
        return single_track(list(state), [steering_rate(time), acceleration], p)

    times = np.arange(1, round(seconds / STEP) + 1) * STEP
    reference = integrate.solve_ivp(
        rates, (0.0, times[-1]), [p.b, 0.0, 0.0, speed, 0.0, 0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-10
    ).y
    body = replace(
        FRICTIONLESS, mass=p.m, yaw_inertia=p.I_z, wheelbase=wheelbase, front_axle_to_mass=p.a, mass_height=p.h_s,
        cornering_stiffness_front=gain * p.b, cornering_stiffness_rear=gain * p.a, friction=10.0,
    )  # fmt: skip
    motion = Dynamics(body, ORIGIN, speed=speed)
    for index, time in enumerate(times):
        steering = amplitude * 2.5 / (2.0 * math.pi) * math.sin(2.0 * math.pi * (time - 0.5 * STEP) / 2.5)
        motion.advance(STEP, steering, p.m * acceleration, 0.0)
        x, y, _, _, heading, yaw_rate, _ = reference[:, index]
        our_x = motion.x + p.b * math.cos(motion.heading)
        our_y = motion.y + p.b * math.sin(motion.heading)
        assert motion.yaw_rate == pytest.approx(yaw_rate, abs=1e-3)
        assert motion.heading == pytest.approx(heading, abs=5e-4)
        assert math.hypot(our_x - x, our_y - y) < 0.04
    assert np.ptp(reference[1]) > 0.1, "the manoeuvre must move the car sideways"


SLIPPING = replace(FRICTIONLESS, combined_slip=True)


def force_of_tyres(motion: Dynamics, before: tuple[float, float]) -> float:
    """Of all tyres together over the mass [m/s2]: nothing else acts on a body without drag on the level."""
    return math.hypot(motion.acceleration, side_acceleration(motion, before))


@pytest.mark.parametrize("steering", [0.03, 0.1, -0.3])
@pytest.mark.parametrize("brake", [0.3, 0.7, 1.0, 2.0])
def test_braking_and_steering_together_ask_for_no_more_than_the_grip(steering: float, brake: float) -> None:
    """Force over weight from the motion alone; capped apart, the same manoeuvre takes up to 1.41 times the grip."""
    limit = SLIPPING.friction * GRAVITY
    largest = {}
    for body in (SLIPPING, FRICTIONLESS):
        motion, largest[body] = Dynamics(body, ORIGIN, speed=20.0), 0.0
        while motion.speed > DYNAMIC_SPEED + 0.5 and motion.distance < 200.0:
            before = motion.lateral_speed, motion.yaw_rate
            motion.advance(STEP, steering, 0.0, brake * limit * body.mass)
            largest[body] = max(largest[body], force_of_tyres(motion, before))
    assert largest[SLIPPING] < 1.01 * limit
    if brake >= 0.7 and abs(steering) > 0.05:
        assert largest[FRICTIONLESS] > 1.15 * limit


@pytest.mark.parametrize("brake", [0.0, 0.5, 0.9])
def test_sliding_tyres_hold_their_force_in_the_direction_that_was_asked_for(brake: float) -> None:
    """First step of a car that runs straight on, against the closed form of the circle for both axles."""
    friction, steering, mass = SLIPPING.friction, 0.25, SLIPPING.mass
    length, ahead = SLIPPING.wheelbase, SLIPPING.front_axle_to_mass
    front_load, rear_load = mass * GRAVITY * (length - ahead) / length, mass * GRAVITY * ahead / length
    side = SLIPPING.cornering_stiffness_front * steering / front_load
    share = min(1.0, friction / math.hypot(brake, side))
    longitudinal = (front_load * share + rear_load * min(1.0, friction / max(brake, 1e-9))) * brake
    motion = Dynamics(SLIPPING, ORIGIN, speed=20.0)
    motion.advance(STEP, steering, 0.0, brake * mass * GRAVITY)
    assert motion.acceleration == pytest.approx(-longitudinal / mass, rel=1e-9)
    # The bound of the side force; load that shifts within the step is that of its own deceleration.
    shift = mass * SLIPPING.mass_height / length * motion.acceleration
    sideways = (front_load - shift) * math.sqrt(friction**2 - (share * brake) ** 2)
    assert share < 1.0
    assert motion.yaw_rate == pytest.approx(STEP * ahead * sideways / SLIPPING.yaw_inertia, rel=0.03)


@pytest.mark.parametrize("braking", [2.0, 5.0, 8.0])
def test_a_bend_at_the_limit_leaves_the_side_force_of_the_circle(braking: float) -> None:
    """On a wheel turned far in: lateral acceleration sqrt((friction g)^2 - braking^2), within what the yawing takes."""
    limit = SLIPPING.friction * GRAVITY
    motion = Dynamics(
        replace(SLIPPING, cornering_stiffness_front=6e5, cornering_stiffness_rear=6e5), ORIGIN, speed=25.0
    )
    used = []
    for step in range(160):
        before = motion.lateral_speed, motion.yaw_rate
        motion.advance(STEP, 0.08 * min(1.0, step / 100.0), 0.0, braking * SLIPPING.mass)
        used.append(abs(side_acceleration(motion, before)) / math.sqrt(limit**2 - motion.acceleration**2))
    assert 0.93 < max(used) < 1.01


@given(
    speed=st.floats(0.0, 25.0),
    steering=st.floats(-0.03, 0.03),
    force=st.floats(0.0, 4000.0),
    brake=st.floats(0.0, 4000.0),
)
@settings(max_examples=40, deadline=None)
def test_far_from_the_limit_the_circle_changes_nothing(
    speed: float, steering: float, force: float, brake: float
) -> None:
    steering *= min(1.0, 64.0 / max(speed, 1.0) ** 2)
    apart, together = Dynamics(FUSION, ORIGIN, speed), Dynamics(replace(FUSION, combined_slip=True), ORIGIN, speed)
    for _ in range(100):
        apart.advance(STEP, steering, force, brake)
        together.advance(STEP, steering, force, brake)
    for name in ("x", "y", "heading", "speed", "lateral_speed", "yaw_rate"):
        assert getattr(together, name) == getattr(apart, name)


def test_full_braking_straight_ahead_is_that_of_the_grip_with_the_circle_too() -> None:
    motion = drive(Dynamics(SLIPPING, ORIGIN, speed=20.0), 5.0, brake=1e5)
    assert motion.x == pytest.approx(20.0**2 / (2.0 * SLIPPING.friction * GRAVITY), abs=1e-3)


def test_a_parked_car_stands_on_a_hill_with_the_circle_too() -> None:
    motion = drive(Dynamics(SLIPPING, ORIGIN, grade=0.1), 5.0, brake=math.inf)
    assert (motion.x, motion.speed) == (0.0, 0.0)
