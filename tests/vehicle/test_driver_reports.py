"""What shows a driver in the reports, and what contradicts or confirms it: each figure from both sides."""

from __future__ import annotations

import math

import pytest

from tests.vehicle.bare import Saying
from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed.layout import BRAKE_REPORT
from vve_sumo.vehicle.interface import (
    BrakeState,
    BrakeTorque,
    Report,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    YawRate,
)
from vve_sumo.vehicle.reports import CarReports

#: A report is read for a tenth of a second and a microsecond.
AGES = [(0.0, True), (0.1, True), (0.1 + 5e-7, True), (0.1 + 2e-6, False)]


class Car:
    """Reports of a car that says what a test wants."""

    def __init__(self, *reports: Report) -> None:
        self.wire = Saying()
        self.reports = CarReports(0.5, self.wire)
        self.say(0.0, *reports)

    def say(self, now: float, *reports: Report) -> None:
        self.wire.said = reports
        assert self.reports.take(now, [Frame(BRAKE_REPORT, b"")]) == []


def brake(driver_torque: float = math.nan, driver: bool = False) -> BrakeState:
    return BrakeState(enabled=True, driver=driver, driver_torque=driver_torque)


def throttle(driver_opening: float = math.nan, driver: bool = False) -> ThrottleState:
    return ThrottleState(enabled=True, driver=driver, driver_opening=driver_opening)


BRAKES = [(brake(150.0), False), (brake(150.1), True), (brake(), False), (brake(0.0, True), True), (brake(), False)]
THROTTLES = [(throttle(0.05), False), (throttle(0.0501), True), (throttle(), False), (throttle(0.0, True), True)]


@pytest.mark.parametrize(("report", "foot"), BRAKES)
def test_a_foot_on_the_brake_asks_for_150_newton_metres_or_is_the_modules_word(report: Report, foot: bool) -> None:
    car = Car(report)
    assert car.reports.driver() == ["driver_on_brake"] * foot
    assert car.reports.attended(0.0) is foot


@pytest.mark.parametrize(("report", "foot"), THROTTLES)
def test_a_foot_on_the_throttle_asks_for_a_twentieth_or_is_the_modules_word(report: Report, foot: bool) -> None:
    car = Car(report)
    assert car.reports.driver() == ["driver_on_throttle"] * foot
    assert car.reports.attended(0.0) is foot


def test_a_car_that_has_said_nothing_is_not_attended() -> None:
    assert Car().reports.attended(0.0) is False


@pytest.mark.parametrize(("age", "read"), AGES)
def test_old_reports_show_no_foot_and_no_torque(age: float, read: bool) -> None:
    for report in (brake(driver=True), throttle(driver=True)):
        assert Car(report).reports.attended(age) is read
    torque = Car(BrakeTorque(200.0)).reports.brake_torque(age)
    assert (torque == 200.0) if read else math.isnan(torque)


@pytest.mark.parametrize(("torque", "attended"), [(39.9, False), (40.0, True), (200.0, True), (math.nan, True)])
@pytest.mark.parametrize("report", [brake(driver=True), brake(500.0)])
def test_brake_torque_of_none_contradicts_a_foot_on_the_brake(report: Report, torque: float, attended: bool) -> None:
    assert Car(report, BrakeTorque(torque)).reports.attended(0.0) is attended


@pytest.mark.parametrize("report", [throttle(driver=True), throttle(0.5)])
def test_a_throttle_pedal_that_has_not_moved_for_half_a_second_has_no_foot_on_it(report: Report) -> None:
    car = Car()
    for now in (8.0, 8.0625, 8.125, 8.1875, 8.25, 8.3125, 8.375, 8.4375, 8.49, 8.5):
        car.say(now, report)
        assert car.reports.attended(now) is (now < 8.5), now
    car.say(8.5, throttle(0.6))
    assert car.reports.attended(8.5) is True


# A module's word that the driver took over.


@pytest.mark.parametrize(
    ("override", "reports", "confirmed"),
    [
        ("brake", (brake(0.0),), False),
        ("brake", (brake(150.1),), True),
        ("brake", (brake(math.nan),), True),
        ("brake", (brake(0.0), throttle(0.06)), True),
        ("brake", (brake(0.0), throttle(math.nan)), False),
        ("throttle", (throttle(0.0),), False),
        ("throttle", (throttle(0.0501),), True),
        ("throttle", (throttle(math.nan),), True),
        ("throttle", (throttle(0.0), brake(151.0)), True),
        ("throttle", (throttle(0.0), brake(math.nan)), False),
        *(("steering", (SteeringState(0.0, True, driver_torque=sign * 2.0),), False) for sign in (1.0, -1.0)),
        *(("steering", (SteeringState(0.0, True, driver_torque=sign * 2.01),), True) for sign in (1.0, -1.0)),
        ("steering", (SteeringState(0.0, True, driver_torque=math.nan),), True),
        ("steering", (SteeringState(0.0, True, driver_torque=0.0), brake(500.0)), False),
        ("gear", (brake(500.0),), False),
    ],
)
def test_something_else_confirms_an_override_or_nothing_else_is_reported(
    override: str, reports: tuple[Report, ...], confirmed: bool
) -> None:
    assert Car(*reports).reports.confirmed(override) is confirmed


# Which reports are read.


def test_brake_torque_is_read_where_it_comes_alone() -> None:
    wire = Saying()
    reports = CarReports(0.5, wire)
    alone = [number for number, kinds in wire.facts.reports.items() if set(kinds) == {BrakeTorque}]
    assert alone, "it would tell nothing"
    wire.said = (BrakeTorque(200.0),)
    assert math.isnan(reports.brake_torque(0.0))
    assert reports.age(BrakeTorque, 0.0) == math.inf
    reports.take(0.0, [Frame(alone[0], b"")])
    assert reports.brake_torque(0.0) == 200.0
    assert reports.age(BrakeTorque, 0.25) == 0.25


@pytest.mark.parametrize(
    ("here", "there"),
    [
        (WheelSpeeds(0.0, 0.0, 0.0, 0.0), WheelSpeeds(0.0, 0.0, 2.0, 2.0)),
        (YawRate(0.0, 0.0), YawRate(0.0, 0.1)),
        (SteeringState(0.0, enabled=True), SteeringState(0.1, enabled=True)),
    ],
)
def test_measurements_that_jump_to_and_fro_are_inconsistent(here: Report, there: Report) -> None:
    """1 m/s, 0.1 rad/s or 0.1 rad, at each report."""
    car = Car(WheelSpeeds(0.0, 0.0, 0.0, 0.0), YawRate(0.0, 0.0), SteeringState(0.0, enabled=True))
    for tick in range(6):
        car.say(0.02 * tick, there)
        car.say(0.02 * tick, here)
    assert car.reports.consistency.faults(0.1) == ["reports_inconsistent"]
