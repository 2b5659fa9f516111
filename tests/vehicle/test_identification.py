"""The fits find what an independent simulation was given, say how far to trust it, and say what they cannot know."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import vehicles
from tests.exhaustive import with_slow
from vve_sumo.physical_constants import AIR_DENSITY, GRAVITY
from vve_sumo.vehicle import identification
from vve_sumo.vehicle.identification import FirstOrderResponse, Log, Series

FUSION, DECLARED = vehicles.FUSION.vehicle, vehicles.FUSION.calibration

#: a car that differs in everything from what is declared
TRUE = {
    "wheel_radius": 0.331,
    "heading_misalignment": math.radians(-0.7),
    "acceleration_bias": 0.04,
    "steering_delay": 0.07,
    "steering_lag": 0.12,
    "steering_ratio": 16.1,
    "steering_wheel_bias": math.radians(-3.0),
    "brake_gain": 640.0,
    "brake_delay": 0.06,
    "brake_lag": 0.09,
    "drive_force_limit": 5200.0,
    "drive_delay": 0.1,
    "drive_lag": 0.35,
    "creep_force": 450.0,
    "creep_speed": 1.6,
    "rolling_resistance": 0.017,
    "drag_area": 0.8,
}
FINE, END = 0.001, 60.0
TICKS = np.arange(0.0, END, 0.02)


def pedal_program(time):
    """Brake torque [N m] and throttle over time: three pulls, three brakings, a long steady stretch."""
    torque, throttle = np.zeros_like(time), np.zeros_like(time)
    for begin, length, value in (
        (1.0, 6.0, 0.25),
        (12.0, 4.0, 0.4),
        (22.0, 3.5, 0.5),
        (34.0, 3.0, 0.4),
        (37.0, 21.0, 0.06),
    ):
        throttle[(time >= begin) & (time < begin + length)] = value
    for begin, length, value in ((8.5, 2.6, 700.0), (17.0, 2.7, 1300.0), (26.5, 2.4, 1900.0)):
        torque[(time >= begin) & (time < begin + length)] = value
    return torque, throttle


def steering_program(time):
    """Steering-wheel angle over time [rad]: steps and a sine, slower than the rate limit."""
    turning = np.where((time > 40.0) & (time < 47.0), np.clip(np.sin(1.7 * (time - 40.0)) * 3.0, -1.0, 1.0), 0.0)
    return math.radians(25.0) * np.where(time >= 48.0, np.sin(2.5 * (time - 48.0)), turning)


def lagged(command, delay, lag):
    """Dead time and lag by small steps; `command` is sampled every FINE, as is the answer."""
    late = np.concatenate((np.full(round(delay / FINE), command[0]), command))[: len(command)]
    answer, value = [], command[0]
    for target in late.tolist():
        value += (target - value) * FINE / (lag + 0.5 * FINE)
        answer.append(value)
    return np.array(answer)


def simulate(true=TRUE, *, noise=1.0, seed=0, brakes=1.0, wheel=1.0, rate=math.inf, pitch=0.0):
    """The log of a drive, by Euler steps of FINE; `noise` scales noise of a good receiver and of wheel sensors."""
    draw = np.random.default_rng(seed).standard_normal
    time = np.arange(0.0, END, FINE)
    held = np.floor(time / 0.02 + 1e-6).astype(int)
    torque, throttle = (values[held] for values in pedal_program(TICKS))
    torque = brakes * torque
    command = wheel * steering_program(TICKS)[held]
    braking = lagged(torque, true["brake_delay"], true["brake_lag"])
    pulling = lagged(throttle, true["drive_delay"], true["drive_lag"])
    angle = lagged(command, true["steering_delay"], true["steering_lag"])
    if math.isfinite(rate):
        angle = np.concatenate(([0.0], np.cumsum(np.clip(np.diff(angle), -rate * FINE, rate * FINE))))
    speed, acceleration = _rolled(true, braking, pulling, pitch)
    road = (angle - true["steering_wheel_bias"]) / true["steering_ratio"]
    yaw_rate = speed * road / (FUSION.wheelbase + FUSION.understeer_gradient * speed**2)
    rear = FUSION.mass * FUSION.front_axle_to_mass / FUSION.wheelbase / FUSION.cornering_stiffness_rear
    slip = -rear * speed * yaw_rate - true["heading_misalignment"]

    def sampled(values, every, sigma):
        picked = slice(0, None, round(every / FINE))
        return Series(time[picked], values[picked] + noise * sigma * draw(len(time[picked])))

    lateral = sampled(speed * np.tan(slip), 0.01, 0.025)
    measured = sampled(speed, 0.01, 0.025)
    return Log(
        brake_torque=Series(TICKS, brakes * pedal_program(TICKS)[0]),
        throttle=Series(TICKS, pedal_program(TICKS)[1]),
        wheel_command=Series(TICKS, wheel * steering_program(TICKS)),
        wheel_angle=sampled(angle, 0.02, math.radians(0.05)),
        wheels=sampled(speed / true["wheel_radius"], 0.01, 0.02),
        speed=measured,
        slip=Series(lateral.time, np.arctan2(lateral.value, np.maximum(measured.value, 0.5))),
        yaw_rate=sampled(yaw_rate, 0.01, 5e-4),
        acceleration=sampled(acceleration + true["acceleration_bias"], 0.01, 0.02),
        grade=sampled(np.full_like(time, pitch), 0.01, 0.0),
        obedient=((1.5, END - 0.5),),
    )


def _rolled(true, braking, pulling, pitch):
    mass, speed, speeds, accelerations = DECLARED.mass, 0.0, [], []
    air, rolling = 0.5 * AIR_DENSITY * true["drag_area"] / mass, true["rolling_resistance"] * GRAVITY
    fall = GRAVITY * math.sin(pitch)
    for brake, throttle in zip(braking.tolist(), pulling.tolist(), strict=True):
        push = throttle * true["drive_force_limit"] + true["creep_force"] * max(1.0 - speed / true["creep_speed"], 0.0)
        hold = rolling + brake / true["brake_gain"]
        change = push / mass - air * speed * speed - fall - hold
        new = max(speed + change * FINE, 0.0)
        accelerations.append((new - speed) / FINE)
        speed = new
        speeds.append(speed)
    return np.array(speeds), np.array(accelerations)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", with_slow(range(3), lambda seed: seed == 0))
def test_finds_all_that_the_car_was_given(seed):
    found = identification.identify(simulate(seed=seed), FUSION, DECLARED).estimates
    assert found.keys() == TRUE.keys()
    for name, estimate in found.items():
        assert estimate.good, (name, estimate)
        # Five standard deviations, and what the simulation's own steps are worth.
        slack = 2.0 * FINE if name.endswith(("delay", "lag")) else 0.002 * abs(TRUE[name])
        assert estimate.value == pytest.approx(TRUE[name], abs=5.0 * estimate.sigma + slack), name


@pytest.mark.thorough
def test_a_slope_that_the_receiver_reports_is_no_drag():
    found = identification.identify(simulate(pitch=0.02), FUSION, DECLARED).estimates
    assert found["rolling_resistance"].value == pytest.approx(TRUE["rolling_resistance"], abs=5e-4)
    assert found["brake_gain"].value == pytest.approx(TRUE["brake_gain"], rel=0.005)


@pytest.mark.thorough
def test_a_heavier_car_shows_as_weaker_pedals():
    """Mass is not told apart: 20 % more of it is 20 % more torque for the same deceleration."""
    heavy = TRUE | {"brake_gain": 1.2 * 640.0, "drive_force_limit": 5200.0 / 1.2, "creep_force": 450.0 / 1.2}
    found = identification.identify(simulate(heavy), FUSION, DECLARED).estimates
    assert found["brake_gain"].value == pytest.approx(768.0, rel=0.005)
    assert found["drive_force_limit"].value == pytest.approx(5200.0 / 1.2, rel=0.005)


@pytest.mark.thorough
def test_without_braking_there_is_no_brake_gain():
    found = identification.identify(simulate(brakes=0.0), FUSION, DECLARED).estimates
    for name in ("brake_gain", "brake_delay", "brake_lag"):
        assert not found[name].good, name
    assert found["brake_gain"].problem == "nothing in this drive to learn it from"
    assert found["drive_force_limit"].good


@pytest.mark.thorough
def test_without_steering_there_is_no_ratio():
    found = identification.identify(simulate(wheel=0.0), FUSION, DECLARED).estimates
    for name in ("steering_delay", "steering_lag", "steering_ratio"):
        assert not found[name].good, name
    assert found["brake_gain"].good


@pytest.mark.thorough
def test_a_steering_motor_that_cannot_keep_up_is_no_lag():
    """Half the rate that the commands have: no delay and lag describe that."""
    found = identification.identify(simulate(rate=0.4), FUSION, DECLARED).estimates
    assert "what is tolerated" in found["steering_lag"].problem


@pytest.mark.thorough
def test_air_drag_that_does_not_show_is_left_as_declared():
    """At parking speeds the fit of all else must not suffer from what it cannot tell."""
    noisy = simulate(noise=3.0)
    slow = replace(noisy, obedient=((1.5, 12.0),))
    found = identification.identify(slow, FUSION, DECLARED).estimates
    assert not found["drag_area"].good
    assert found["brake_gain"].value == pytest.approx(TRUE["brake_gain"], rel=0.05)


def test_a_drive_that_holds_nothing_is_all_poor():
    empty = replace(simulate(), obedient=((0.0, 0.1),))
    estimates = identification.identify(empty, FUSION, DECLARED).estimates
    assert {name for name, found in estimates.items() if found.good} == {"acceleration_bias"}


def test_standard_deviations_are_those_of_repetitions():
    """A line under noise that hangs together, many times over: the scatter of its slope is what one fit says."""
    time = np.arange(0.0, 40.0, 0.01)
    limits = (identification.UNBOUND, identification.UNBOUND)
    slopes, sigmas = [], []
    for seed in range(60):
        white = np.random.default_rng(seed).standard_normal(len(time))
        together = np.convolve(white, np.full(20, 1.0 / 20.0), mode="same")
        fit = identification._fit(
            lambda guess: guess[0] + guess[1] * time, Series(time, 1.0 + 2.0 * time + together), (0.0, 0.0), limits
        )
        slopes.append(fit.values[1])
        sigmas.append(fit.sigmas[1])
    assert np.mean(slopes) == pytest.approx(2.0, abs=0.01)
    assert np.mean(sigmas) == pytest.approx(np.std(slopes), rel=0.3)


@pytest.mark.thorough
@settings(max_examples=30, deadline=None)
@given(
    delay=st.floats(0.0, 0.2),
    lag=st.floats(0.01, 0.5),
    targets=st.lists(st.floats(-5.0, 5.0), min_size=2, max_size=12),
    spacing=st.floats(0.011, 0.4),
)
def test_the_answer_is_that_of_small_steps(delay, lag, targets, spacing):
    """Also its integral; against Euler steps of half a millisecond."""
    step = 0.0005
    starts = spacing * np.arange(len(targets))
    answer = FirstOrderResponse(Series(starts, np.array(targets)), delay, lag)
    time = np.arange(0.0, starts[-1] + delay + 1.0, step)
    value, integral, values, integrals = targets[0], 0.0, [], []
    for now in time.tolist():
        target = targets[max(int(np.searchsorted(starts, now - delay, side="right")) - 1, 0)]
        values.append(value)
        integrals.append(integral)
        integral += value * step
        value += (target - value) * -math.expm1(-step / lag)
    assert answer.at(time) == pytest.approx(np.array(values), abs=20.0 * step / lag)
    since = time >= starts[0] + delay
    gained = answer.integral(time[since])
    wanted = np.array(integrals)[since]
    assert gained - gained[0] == pytest.approx(wanted - wanted[0], abs=0.02)


def test_commands_are_passed_on_no_faster_than_the_kit_turns():
    commands = Series(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 2.0, -2.0, -2.0]))
    passed = identification.rate_limited(commands, 4.0)
    assert np.abs(np.diff(passed.value)).max() <= 4.0 * identification.SLEW_STEP + 1e-12
    assert passed.at(np.array([0.9, 1.25, 1.6, 2.5, 2.99])) == pytest.approx([0.0, 1.0, 2.0, 0.0, -1.96], abs=0.03)
