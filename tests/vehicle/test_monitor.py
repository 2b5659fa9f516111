"""What gateway and observer share: which faults are found, whose speed is believed, and when a drive is over."""

from __future__ import annotations

import math
from typing import Any

import pytest

from tests.setpoints import setpoint
from tests.vehicle.bare import BARE, CAR, Saying
from vve_sumo.values import Frame, Setpoint
from vve_sumo.vehicle.dataspeed.layout import BRAKE_REPORT
from vve_sumo.vehicle.interface import Gear, GearState, Report, SteeringState, WheelSpeeds, YawRate
from vve_sumo.vehicle.monitor import Monitor

STALE = ["brake_report_stale", "throttle_report_stale", "steering_report_stale", "wheel_speeds_stale"]


class Bench:
    """A monitor, and a car that reports what the test tells it to."""

    def __init__(self) -> None:
        self.wire = Saying()
        self.monitor = Monitor(CAR, BARE, self.wire, wheel_bias=0.1)

    def say(self, now: float, *reports: Report) -> None:
        self.wire.said = reports
        assert self.monitor.reports.take(now, [Frame(BRAKE_REPORT, b"")]) == []

    def check_motion(self, now: float, elapsed: float = 0.0, idle: bool = True) -> list[str]:
        return self.monitor.check_motion(now, elapsed, idle=idle, braking=None, steering=math.nan)


def wheels(speed: float) -> WheelSpeeds:
    """All wheels at a speed of their treads [m/s]."""
    rate = speed / CAR.wheel_radius
    return WheelSpeeds(rate, rate, rate, rate)


def wish(sequence: int, now: float = 0.0, **stamped: Any) -> Setpoint:
    where = {"x": 0.0, "y": 0.0, "heading": 0.0, "speed": 0.0, "yaw_rate": 0.0} | stamped
    return setpoint(where.pop("steering", 0.0), 0.0, sequence=sequence, time=now, expires=now + 0.1, **where)


def test_what_the_car_says_of_itself() -> None:
    bench = Bench()
    monitor = bench.monitor
    assert math.isnan(monitor.measured_steering)
    assert (monitor.gear, monitor.sequence, monitor.last_dbw_report) == ("none", -1, -math.inf)
    assert monitor.fresh is False
    bench.say(3.0, SteeringState(0.1 + 0.25 * CAR.steering_ratio, enabled=True), wheels(5.0), GearState(Gear.DRIVE))
    assert monitor.measured_steering == pytest.approx(0.25)
    assert monitor.wheel_speed == pytest.approx(5.0)
    assert (monitor.gear, monitor.last_dbw_report) == ("drive", 3.0)


def test_every_fault_is_found() -> None:
    """Of reports, of jumps in one of them, of a setpoint that is refused, and of the one before it."""
    bench = Bench()
    monitor = bench.monitor
    assert monitor.check_inputs(0.0, wish(7, faults=("geofence_breach",)))[-1] == "geofence_breach"
    for tick in range(6):
        bench.say(0.01 * tick, YawRate(0.0, 0.1 * (tick % 2)))
    refused = wish(8, steering=math.nan, faults=("pose_stale",))
    assert monitor.check_inputs(0.05, refused) == [
        *STALE, "gear_report_stale", "report_invalid", "reports_inconsistent", "setpoint_not_finite", "pose_stale",
        "geofence_breach",
    ]  # fmt: skip
    assert (monitor.sequence, monitor.fresh) == (7, False)
    assert monitor.check_inputs(0.05, None)[-2:] == ["reports_inconsistent", "geofence_breach"]


def test_a_setpoint_that_is_out_of_order_is_noted_and_its_faults_count() -> None:
    bench = Bench()
    monitor = bench.monitor
    monitor.check_inputs(0.0, wish(7))
    assert (monitor.notes, monitor.fresh) == ([], True)
    assert monitor.check_inputs(0.0, wish(7, faults=("geofence_breach",)))[-2:] == ["report_invalid", "geofence_breach"]
    assert (monitor.notes, monitor.fresh) == (["setpoint_out_of_order"], False)
    assert monitor.check_inputs(0.0, wish(8))[-1] == "report_invalid"
    assert (monitor.notes, monitor.fresh) == ([], True)
    monitor.check_inputs(0.0, None)
    assert (monitor.notes, monitor.fresh) == ([], False)


# Whose speed is believed.


def compared(bench: Bench, now: float, elapsed: float = 0.0) -> tuple[float, float]:
    """The speeds by the wheels and by the receiver that are believed."""
    assert bench.check_motion(now, elapsed) == []
    return bench.monitor.speed, bench.monitor.gnss_speed


def test_speeds_are_believed_while_they_are_fresh() -> None:
    bench = Bench()
    monitor = bench.monitor
    assert all(map(math.isnan, compared(bench, 0.0)))
    bench.say(0.0, wheels(5.0))
    monitor.check_inputs(0.05, wish(1, 0.05, speed=5.25))
    by_wheels, by_receiver = compared(bench, 0.1)
    assert by_wheels == pytest.approx(5.0)
    assert by_receiver == 5.25
    by_wheels, by_receiver = compared(bench, 0.12)
    assert math.isnan(by_wheels)
    assert by_receiver == 5.25
    assert all(map(math.isnan, compared(bench, 0.2)))


def test_a_speed_that_the_drive_only_guesses_is_not_believed() -> None:
    bench = Bench()
    monitor = bench.monitor
    for sequence, faults, believed in ((1, ("geofence_breach",), True), (2, ("pose_stale",), False)):
        monitor.check_inputs(0.0, wish(sequence, speed=5.0, faults=faults))
        assert math.isfinite(compared(bench, 0.0)[1]) is believed


def test_wheels_and_receiver_that_disagree_are_a_fault() -> None:
    bench = Bench()
    monitor = bench.monitor
    for tick in range(12):
        now = 0.02 * tick
        bench.say(now, wheels(5.0), YawRate(0.0, 0.0))
        monitor.check_inputs(now, wish(tick, now, speed=10.0))
        faults = bench.check_motion(now, 0.02)
    assert "speed_mismatch" in faults


def test_wheels_that_turn_and_never_change_are_no_evidence_of_rest() -> None:
    """40 mm/s, to the last bit, for more than five seconds; and zero for as long as they are fresh."""
    bench = Bench()
    monitor = bench.monitor
    for now, certain in ((0.0, True), (4.75, True), (5.0, True), (5.25, False)):
        bench.say(now, wheels(0.04))
        compared(bench, now, 0.02)
        assert monitor.standstill.certain is certain
    for now, certain in ((6.0, True), (60.0, True)):
        bench.say(now, wheels(0.0))
        compared(bench, now, 0.02)
        assert monitor.standstill.certain is certain
    compared(bench, 61.0, 0.02)
    assert monitor.standstill.certain is False, "an old report is none"


# Before and after a drive.


def test_a_drive_needs_a_setpoint_and_a_car_that_stands() -> None:
    bench = Bench()
    monitor = bench.monitor
    assert monitor.missing(0.0) == ["no_setpoint", "not_standing"]
    monitor.check_inputs(0.0, wish(7))
    bench.say(0.0, wheels(0.0))
    bench.check_motion(0.0)
    assert monitor.missing(0.0) == []
    assert monitor.missing(0.2) == ["no_setpoint"]


def test_the_next_drives_setpoints_may_count_from_zero_again() -> None:
    monitor = Bench().monitor
    monitor.check_inputs(0.0, wish(7))
    monitor.forget_setpoints()
    assert monitor.sequence == -1
    monitor.check_inputs(0.0, wish(0))
    assert (monitor.sequence, monitor.fresh) == (0, True)


@pytest.mark.parametrize(("certain", "at_rest"), [(True, True), (True, False), (False, True), (False, False)])
def test_who_watches_a_car_is_at_ease_where_it_stands_for_certain(certain: bool, at_rest: bool) -> None:
    monitor = Bench().monitor
    monitor.standstill.certain, monitor.standstill.at_rest = certain, at_rest
    assert monitor.supervision_over is (certain and at_rest)


def test_a_car_is_let_go_after_ten_seconds_without_motion() -> None:
    """Of a car that reports nothing nobody knows whether it stands; nothing says that it moves, either."""
    for idle, supervision_over in ((True, [False, False, True]), (False, [False] * 3)):
        bench, seen = Bench(), []
        for now in (0.0, 9.99, 10.0):
            bench.check_motion(now, idle=idle)
            seen.append(bench.monitor.supervision_over)
        assert seen == supervision_over
    bench = Bench()
    for tick in range(300):
        bench.say(0.1 * tick, wheels(5.0 + 0.1 * (tick % 2)))
        bench.check_motion(0.1 * tick, 0.1)
        assert not bench.monitor.supervision_over, "it moves"
