"""The monitors of a driver's foot and of frozen reports, each against a closed form, a brute force or a sound plant."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import vehicles
from tests.vehicle.car import CALIBRATION, FUSION, GRAVITY
from vve_sumo.plant.actuators import Lagged
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.command_echo import ECHO_TIME, OPENING_CHANGE, TORQUE_CHANGE, CommandEcho
from vve_sumo.vehicle.dataspeed.controller import BRAKE_RAMP
from vve_sumo.vehicle.driver_braking import (
    LATCH_TIME,
    LATCH_TORQUE,
    RELEASE_RATE,
    REPORT_DELAY,
    UNASKED_TIME,
    UNASKED_TORQUE,
    DriverBrakingDetector,
)
from vve_sumo.vehicle.slowing_monitor import DECELERATION_MARGIN, SPEED_DEFICIT, SlowingMonitor

STEP, FINE = 0.02, 0.005  # of the gateway and of the plant [s]
TORQUES = st.one_of(st.just(0.0), st.floats(0.0, 3400.0))
#: How long a command of the Fusion explains a torque [s]: its brakes' delay and three lags beside.
DELAY = REPORT_DELAY + FUSION.brake_delay + 3.0 * FUSION.brake_lag
#: Commands that stay for some steps each.
COMMANDS = st.lists(st.tuples(TORQUES, st.integers(1, 30)), min_size=1, max_size=12)


def spread(commands: list[tuple[float, int]]) -> list[float]:
    return [torque for torque, steps in commands for _ in range(steps)]


# Brake torque that nobody commanded.


@given(COMMANDS)
def test_the_largest_of_the_last_commands_is_that_of_a_brute_force(commands):
    signs, torques = DriverBrakingDetector(FUSION), spread(commands)
    times = [index * STEP for index in range(len(torques))]
    for index, (now, torque) in enumerate(zip(times, torques, strict=True)):
        recent = [torques[n] for n in range(index + 1) if times[n] >= now - DELAY]
        assert signs._largest(now, torque) == max(recent)


@given(COMMANDS)
def test_what_the_commands_explain_falls_no_faster_than_a_brake_lets_go(commands):
    """In closed form: the largest over all commands of its torque, less RELEASE_RATE from DELAY after it on."""
    signs, torques = DriverBrakingDetector(FUSION), spread(commands)
    for index, torque in enumerate(torques):
        signs.step(index * STEP, STEP, torque, math.nan, math.nan)
        # How many steps a command is still among the recent ones; one that is just as old may not be.
        whole = math.floor(DELAY / STEP - 1e-9)
        explained = max(
            commanded - RELEASE_RATE * STEP * max(index - n - whole, 0)
            for n, commanded in enumerate(torques[: index + 1])
        )
        assert signs._explained == pytest.approx(max(explained, 0.0), abs=1.01 * RELEASE_RATE * STEP)
        assert signs._explained >= explained - 1e-6, "never less than what the brakes may still give"


@settings(max_examples=60, deadline=None)
@given(COMMANDS, st.sampled_from([vehicles.FUSION.vehicle, vehicles.MKZ.vehicle]), st.integers(0, 3))
def test_no_sequence_of_commands_through_ramp_delay_and_lag_looks_like_a_foot(commands, vehicle, phase):
    """The DBW controller's ramp, the actuator's delay and lag, a report every 20 ms, at any phase to the gateway."""
    signs, brakes = DriverBrakingDetector(vehicle), Lagged(vehicle.brake_delay, vehicle.brake_lag, FINE)
    ramped = reported = 0.0
    torques = spread(commands)
    for index, (before, torque) in enumerate(pairwise([0.0, *torques, *[0.0] * 50])):
        assert not signs.step(index * STEP, STEP, before, reported, 0.0), index
        for fine in range(round(STEP / FINE)):
            change = min(max(torque - ramped, -BRAKE_RAMP * FINE), BRAKE_RAMP * FINE)
            ramped += change
            actual = brakes.step(ramped)
            if fine == phase:
                reported = actual
    assert not signs.brakes_latched


@given(st.floats(0.0, 3000.0), st.floats(UNASKED_TORQUE + 1.0, 3000.0))
def test_a_foot_beyond_the_command_is_found_after_two_reports(commanded, foot):
    signs = DriverBrakingDetector(FUSION)
    for index in range(50):
        assert not signs.step(index * STEP, STEP, commanded, commanded, 0.0)
    found = next(
        n for n in range(100) if signs.step((50 + n) * STEP, STEP, commanded, 1.15 * commanded + foot, math.nan)
    )
    assert found * STEP == pytest.approx(UNASKED_TIME, abs=STEP)


@given(st.floats(0.0, 3000.0), st.floats(-3000.0, UNASKED_TORQUE))
def test_a_torque_that_is_hardly_more_or_less_is_nobodys(commanded, beyond):
    signs = DriverBrakingDetector(FUSION)
    assert not any(signs.step(n * STEP, STEP, commanded, 1.15 * commanded + beyond - 1e-6, 0.0) for n in range(50))


def test_a_torque_that_is_not_reported_is_nobodys():
    signs = DriverBrakingDetector(FUSION)
    assert not any(signs.step(n * STEP, STEP, 0.0, math.nan, math.nan) for n in range(50))
    assert not signs.brakes_latched


@pytest.mark.parametrize(("reported", "foot"), [(LATCH_TORQUE + 1.0, 0.0), (0.0, LATCH_TORQUE + 1.0)])
def test_a_strong_foot_is_taken_to_have_the_brakes_until_the_next_engagement(reported, foot):
    signs, latched = DriverBrakingDetector(FUSION), []
    for index in range(20):
        signs.step(index * STEP, STEP, 0.0, reported, foot)
        latched.append(signs.brakes_latched)
    assert latched.index(True) * STEP == pytest.approx(LATCH_TIME, abs=STEP / 2)
    signs.step(20 * STEP, STEP, 0.0, 0.0, 0.0)
    assert signs.brakes_latched, "though the foot has lifted"
    signs.reset()
    assert not signs.brakes_latched


# Reports that repeat no command.


@pytest.mark.parametrize(("change", "largest"), [(TORQUE_CHANGE, 3000.0), (OPENING_CHANGE, 0.8)])
def test_a_frozen_report_is_found_in_the_time_of_an_echo_after_the_command_has_changed(change, largest):
    for to in (1.01 * change, largest):
        echo = CommandEcho(change)
        assert not any(echo.step(n * STEP, 0.0, 0.0) for n in range(100)), "a constant command freezes nothing"
        found = next(n for n in range(100) if echo.step((100 + n) * STEP, to, 0.0))
        assert found * STEP == pytest.approx(ECHO_TIME, abs=STEP / 2)


@given(COMMANDS, st.integers(1, 4), st.floats(0.0, 3.0))
def test_a_report_that_repeats_its_command_late_and_rounded_is_never_frozen(commands, late, quantum):
    """Up to 80 ms late, a report of 50 Hz; rounded to as much as 3 N m."""
    echo, torques = CommandEcho(TORQUE_CHANGE), spread(commands)
    for index, torque in enumerate(torques):
        said = torques[max(index - late, 0)]
        said = round(said / quantum) * quantum if quantum > 0.1 else said
        assert not echo.step(index * STEP, torque, said)


@given(COMMANDS)
def test_where_no_command_is_reported_nothing_is_frozen(commands):
    echo = CommandEcho(TORQUE_CHANGE)
    assert not any(echo.step(index * STEP, torque, math.nan) for index, torque in enumerate(spread(commands)))


@given(st.floats(0.0, TORQUE_CHANGE - 1.0), st.integers(1, 100))
def test_a_small_change_proves_nothing(change, steps):
    echo = CommandEcho(TORQUE_CHANGE)
    echo.step(0.0, 1000.0, 1000.0)
    assert not any(echo.step((n + 1) * STEP, 1000.0 + change, 1000.0) for n in range(steps))


def test_a_reset_begins_anew():
    echo = CommandEcho(TORQUE_CHANGE)
    for index in range(5):
        echo.step(index * STEP, 1000.0 * (index > 0), 0.0)
    echo.reset()
    assert not any(echo.step((5 + n) * STEP, 1000.0, 0.0) for n in range(50))


# A foot that shows in the car's motion alone.


def coasting(monitor: SlowingMonitor, seconds: float = 2.0, speed: float = 10.0) -> None:
    for _ in range(round(seconds / STEP)):
        assert not monitor.step(STEP, Pedals(0.0, 0.0), speed, speed, 0.0)


@pytest.mark.parametrize("foot", [2.0, 4.0, 8.0])
def test_a_foot_on_a_coasting_car_is_found_by_the_speed_that_is_missing(foot):
    """The deficit grows by the deceleration less the margin and half as much drag again: SPEED_DEFICIT over that."""
    drag = 1.5 * CALIBRATION.drag(10.0) / CALIBRATION.mass
    monitor = SlowingMonitor(FUSION, CALIBRATION)
    coasting(monitor)
    speeds = (10.0 - foot * STEP * (n + 1) for n in range(200))
    number = next(n for n, v in enumerate(speeds) if monitor.step(STEP, Pedals(0.0, 0.0), v, v, 0.0))
    expected = SPEED_DEFICIT / (foot - DECELERATION_MARGIN - drag)
    assert (number + 1) * STEP == pytest.approx(expected, abs=1.5 * STEP)


def test_a_receiver_that_sees_no_deceleration_denies_the_foot():
    monitor, wheels = SlowingMonitor(FUSION, CALIBRATION), 10.0
    coasting(monitor)
    for _ in range(10):
        wheels -= 1.5 * STEP
        assert not monitor.step(STEP, Pedals(0.0, 0.0), wheels, 10.0, 0.0)


def test_wheels_that_fall_to_zero_in_a_step_are_no_foot_without_a_receiver_either():
    monitor = SlowingMonitor(FUSION, CALIBRATION)
    coasting(monitor)
    assert not any(monitor.step(STEP, Pedals(0.0, 0.0), 0.0, math.nan, 0.0) for _ in range(100))


WISHES = st.lists(st.tuples(st.floats(-3.5, 2.0), st.integers(10, 80)), min_size=1, max_size=10)


@settings(max_examples=60, deadline=None)
@given(WISHES, st.sampled_from([0.85, 1.0, 1.15]), st.sampled_from([0.9, 1.0, 1.1]), st.floats(-0.03, 0.03))
def test_no_sequence_of_pedals_on_a_sound_car_looks_like_a_foot(wishes, mass_factor, gain_factor, grade):
    """Pedals by the plain model, through the plant's delays and lags; mass and brakes are not as calibrated."""
    monitor = SlowingMonitor(FUSION, CALIBRATION)
    brakes = Lagged(FUSION.brake_delay, FUSION.brake_lag, FINE)
    engine = Lagged(vehicles.parameters().throttle_delay, CALIBRATION.drive_lag, FINE)
    speed, ramped, mass = 8.0, 0.0, CALIBRATION.mass * mass_factor
    commanded = Pedals(0.0, 0.0)
    for wish, steps in wishes:
        for _ in range(steps):
            assert not monitor.step(STEP, commanded, speed, speed, grade)
            force = CALIBRATION.mass * (wish + GRAVITY * math.sin(grade)) + CALIBRATION.drag(speed)
            push = CALIBRATION.throttle(force, speed) if force > 0.0 else 0.0
            commanded = Pedals(CALIBRATION.brake_torque(-force) if force < 0.0 else 0.0, push)
            for _ in range(round(STEP / FINE)):
                ramped += min(max(commanded.brake_torque - ramped, -BRAKE_RAMP * FINE), BRAKE_RAMP * FINE)
                braking = gain_factor * CALIBRATION.brake_force(brakes.step(ramped))
                pushing = CALIBRATION.drive_force(engine.step(commanded.throttle), speed) + CALIBRATION.creep(speed)
                along = pushing - CALIBRATION.drag(speed) - braking
                speed = max(speed + (along / mass - GRAVITY * math.sin(grade)) * FINE, 0.0)
