"""Each fault of the car itself and each act of its driver: what they do to its motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.plant.faulty_ride import AT, PARAMETERS, Ride, fault, lively, straight
from tests.plant.test_car import EPOCH, LOT, START
from vve_sumo.plant.car import HEALTHY
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.fault_injector import ACTUATOR_KINDS
from vve_sumo.plant.injected_faults import DRIVER_ACTIONS, KINDS, FaultClock, InjectedFault
from vve_sumo.vehicle.dataspeed.messages import BrakeInfo, BrakeReport, GearReport, SteeringReport, ThrottleReport
from vve_sumo.vehicle.interface import PEDAL_REST, Gear


def braking(now: float) -> tuple[float, float, float]:
    """Pull away, then hold the brakes at 600 N m."""
    return straight(now) if now < 2.4 else (600.0, 0.0, 0.0)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_weak_brakes_slow_the_car_by_their_share_and_believe_more(share):
    """Against the closed form: rolling drag and share times torque times gain."""
    ride = Ride(InjectedFault("brakes_weak", 0.2, 9.0, share), course=braking, seconds=4.0)
    speeds = {time: truth.speed for time, truth in ride.truths.items()}
    calibration = PARAMETERS.calibration
    drag = calibration.drag(speeds[3.55]) / calibration.mass
    expected = share * calibration.brake_force(600.0) / calibration.mass + drag
    # Whatever the idling engine still pushes is told by the one with no brakes at all.
    creep = calibration.creep(speeds[3.55]) / calibration.mass
    assert (speeds[3.5] - speeds[3.6]) / 0.1 == pytest.approx(expected - creep, abs=0.03)
    (believed,) = {info.torque_actual for time, info in ride.said(BrakeInfo) if 3.5 < time < 3.6}
    assert believed == pytest.approx(600.0, abs=4.0)


@pytest.mark.parametrize("kind", [*ACTUATOR_KINDS, "steering_stuck", "dbw_dropout"])
def test_other_faults_injected_in_place_of_one_restore_what_it_broke(kind):
    seeds = np.random.SeedSequence
    faults = [InjectedFault(kind, 0.0, 9.0, clock=FaultClock.DRIVE)]
    car = FaultInjectedCar(PARAMETERS, START, LOT, EPOCH, seeds(1), faults, seeds(0))
    car.step(0.1, [])

    def broken() -> bool:
        return any(module.broken for module in car.car.interface.controller.modules)  # type: ignore[attr-defined]

    assert broken() or car.car.actuator_faults != HEALTHY
    car.inject([InjectedFault("pose_lost", 0.0, 9.0)])
    car.step(0.2, [])
    assert not broken()
    assert car.car.actuator_faults == HEALTHY


def test_the_drivers_foot_gets_all_of_the_brakes():
    weak, foot = InjectedFault("brakes_weak", 0.2, 9.0, 0.0), InjectedFault("brake_override", 0.4, 9.0)
    both, alone = Ride(weak, foot), Ride(foot)
    assert both.car.truth().speed == pytest.approx(alone.car.truth().speed, abs=0.02)
    assert both.car.truth().speed < Ride(weak).car.truth().speed - 2.0


def test_an_open_throttle_pushes_with_its_share_and_the_report_knows_nothing_of_it():
    def coasting(now: float) -> tuple[float, float, float]:
        return straight(now) if now < 2.4 else (0.0, 0.0, 0.0)

    ride, plain = (Ride(*faults, course=coasting) for faults in ([InjectedFault("drive_unasked", AT, 9.0, 0.2)], []))
    speeds, usual = ({time: truth.speed for time, truth in each.truths.items()} for each in (ride, plain))
    calibration = PARAMETERS.calibration
    gained = ((speeds[4.4] - speeds[4.3]) - (usual[4.4] - usual[4.3])) / 0.1
    creep = (calibration.creep(speeds[4.35]) - calibration.creep(usual[4.35])) / calibration.mass
    drive = calibration.drive_force(0.2, speeds[4.35]) / calibration.mass
    assert gained == pytest.approx(drive + creep, abs=0.03)
    assert ride.said(ThrottleReport) == plain.said(ThrottleReport)


def speeds_of(ride: Ride) -> dict[float, float]:
    return {time: truth.speed for time, truth in ride.truths.items()}


def test_a_weak_engine_pushes_with_its_share():
    ride, plain = Ride(InjectedFault("throttle_weak", AT, 9.0, 0.25)), Ride()
    weak, usual = speeds_of(ride), speeds_of(plain)
    calibration, at = PARAMETERS.calibration, round(plain.began + AT, 2)
    lost = ((usual[at + 0.1] - usual[at]) - (weak[at + 0.1] - weak[at])) / 0.1
    assert lost == pytest.approx(0.75 * calibration.drive_force(0.3, usual[at]) / calibration.mass, rel=0.05)
    assert ride.said(ThrottleReport) == plain.said(ThrottleReport)


def test_binding_brakes_slow_the_car_by_their_torque_and_no_report_shows_it():
    ride, plain = Ride(InjectedFault("brakes_drag", AT, 9.0, 400.0)), Ride()
    bound, usual = speeds_of(ride), speeds_of(plain)
    calibration, at = PARAMETERS.calibration, round(plain.began + AT, 2)
    lost = ((usual[at + 0.1] - usual[at]) - (bound[at + 0.1] - bound[at])) / 0.1
    assert lost == pytest.approx(calibration.brake_force(400.0) / calibration.mass, rel=0.05)
    for kind in (BrakeReport, ThrottleReport):
        assert ride.said(kind) == plain.said(kind)
    torques = [[info.torque_actual for _, info in each.said(BrakeInfo)] for each in (ride, plain)]
    assert torques[0] == torques[1]


@pytest.mark.parametrize(("kind", "value"), [("steering_stuck", math.nan), ("steering_weak", 0.0)])
def test_a_steering_wheel_that_is_stuck_stays_and_its_report_says_so(kind, value):
    ride = Ride(fault(kind, value), course=lively)
    during = {report.wheel_angle for time, report in ride.said(SteeringReport) if ride.during(time)}
    commands = {report.command for time, report in ride.said(SteeringReport) if ride.during(time)}
    assert len(during) == 1 < len(commands)
    assert ride.said(SteeringReport)[-1][1].wheel_angle not in during


def test_a_weak_steering_follows_slower():
    angles = {
        share: [
            report.wheel_angle
            for _, report in Ride(InjectedFault("steering_weak", 0.2, 9.0, share), course=lively).said(SteeringReport)
        ]
        for share in (1.0, 0.02)
    }
    assert max(angles[0.02][150:]) - min(angles[0.02][150:]) < 0.7 * (max(angles[1.0][150:]) - min(angles[1.0][150:]))


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("lever", "engaged"), [(Gear.NEUTRAL, Gear.NEUTRAL), (Gear.REVERSE, Gear.DRIVE), (Gear.PARK, Gear.DRIVE)]
)
def test_the_drivers_lever_is_followed_where_a_rolling_car_allows_it_and_is_an_override(lever, engaged):
    ride = Ride(InjectedFault("gear_lever", AT, 9.0, lever))
    reports = ride.said(GearReport)
    assert {report.override for time, report in reports if time < ride.began + AT} == {False}
    late = [report for time, report in reports if time > ride.began + AT + 1.0]
    assert {report.override for report in late} == {True}
    assert {report.gear for report in late} == {engaged}
    assert ride.car.truth().speed < Ride().car.truth().speed - 1.0 or engaged is Gear.DRIVE


def test_a_driver_leaves_park_at_rest_with_a_foot_on_the_brake_only():
    lever = InjectedFault("gear_lever", 0.5, 0.7, Gear.REVERSE, clock=FaultClock.DRIVE)
    foot = InjectedFault("brake_override", 0.2, 1.5, 0.25, clock=FaultClock.DRIVE)
    for faults, gear in ((lever,), Gear.PARK), ((lever, foot), Gear.REVERSE):
        car = FaultInjectedCar(
            PARAMETERS, START, LOT, EPOCH, np.random.SeedSequence(1), faults, np.random.SeedSequence(2)
        )
        car.step(1.5, [])
        assert car.car.interface.gear is gear
        assert car.driver_inputs.gear is Gear.NONE


def test_what_the_driver_truly_does_is_known_whatever_the_reports_say():
    foot = InjectedFault("brake_override", 1.0, 1.0, 0.3, clock=FaultClock.DRIVE)
    silent = InjectedFault("bus_silent", 0.0, 9.0, clock=FaultClock.DRIVE)
    seeds = np.random.SeedSequence
    car = FaultInjectedCar(PARAMETERS, START, LOT, EPOCH, seeds(1), [foot, silent], seeds(2))
    for step in range(1, 500):
        assert car.step(step / 200, []).reports == []
        assert car.driver_inputs.brake_pedal == (0.3 if 200 < step <= 400 else PEDAL_REST), step
    assert {"brake_override", "gear_lever"} <= DRIVER_ACTIONS <= KINDS.keys()
