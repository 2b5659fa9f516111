"""What gateway and observer share: which faults are found, whose speed is believed, and when a drive is over."""

from __future__ import annotations

import math
from typing import Any

import pytest

from tests.setpoints import setpoint
from tests.vehicle.bare import BARE, CAR, Saying
from vve_sumo.values import ArmingState, Frame, Setpoint
from vve_sumo.vehicle.dataspeed.layout import BRAKE_REPORT
from vve_sumo.vehicle.interface import Gear, GearState, Report, SteeringState, WheelSpeeds, YawRate
from vve_sumo.vehicle.monitor import Monitor

STALE = ["brake_report_stale", "throttle_report_stale", "steering_report_stale", "wheel_speeds_stale"]


class Listening(Monitor):
    """A monitor that notes which setpoints it accepts."""

    def __init__(self) -> None:
        self.wire = Saying()
        super().__init__(CAR, BARE, self.wire, wheel_bias=0.1)
        self.accepted: list[int] = []

    def _accept(self, now: float, setpoint: Setpoint) -> None:
        self.accepted.append(setpoint.sequence)

    def say(self, now: float, *reports: Report) -> None:
        self.wire.said = reports
        assert self._reports.take(now, [Frame(BRAKE_REPORT, b"")]) == []


def wheels(speed: float) -> WheelSpeeds:
    """All wheels at a speed of their treads [m/s]."""
    rate = speed / CAR.wheel_radius
    return WheelSpeeds(rate, rate, rate, rate)


def wish(sequence: int, now: float = 0.0, **stamped: Any) -> Setpoint:
    where = {"x": 0.0, "y": 0.0, "heading": 0.0, "speed": 0.0, "yaw_rate": 0.0} | stamped
    return setpoint(where.pop("steering", 0.0), 0.0, sequence=sequence, time=now, expires=now + 0.1, **where)


def test_what_the_car_says_of_itself() -> None:
    monitor = Listening()
    assert math.isnan(monitor.measured_steering)
    assert (monitor.gear, monitor.sequence, monitor.last_dbw_report) == ("none", -1, -math.inf)
    monitor.say(3.0, SteeringState(0.1 + 0.25 * CAR.steering_ratio, enabled=True), wheels(5.0), GearState(Gear.DRIVE))
    assert monitor.measured_steering == pytest.approx(0.25)
    assert monitor.wheel_speed == pytest.approx(5.0)
    assert (monitor.gear, monitor.last_dbw_report) == ("drive", 3.0)


def test_every_fault_is_found() -> None:
    """Of reports, of jumps in one of them, of a setpoint that is refused, and of the one before it."""
    monitor = Listening()
    assert monitor._look(0.0, wish(7, faults=("geofence_breach",)))[-1] == "geofence_breach"
    for tick in range(6):
        monitor.say(0.01 * tick, YawRate(0.0, 0.1 * (tick % 2)))
    refused = wish(8, steering=math.nan, faults=("pose_stale",))
    assert monitor._look(0.05, refused) == [
        *STALE, "gear_report_stale", "report_invalid", "reports_inconsistent", "setpoint_not_finite", "pose_stale",
        "geofence_breach",
    ]  # fmt: skip
    assert (monitor.sequence, monitor.accepted) == (7, [7])
    assert monitor._look(0.05, None)[-2:] == ["reports_inconsistent", "geofence_breach"]


def test_a_setpoint_that_is_out_of_order_is_noted_and_its_faults_count() -> None:
    monitor = Listening()
    monitor._look(0.0, wish(7))
    monitor._notes = []
    assert monitor._look(0.0, wish(7, faults=("geofence_breach",)))[-2:] == ["report_invalid", "geofence_breach"]
    assert (monitor._notes, monitor.accepted) == (["setpoint_out_of_order"], [7])
    monitor._notes = []
    assert monitor._look(0.0, wish(8))[-1] == "report_invalid"
    assert (monitor._notes, monitor.accepted) == ([], [7, 8])


# Whose speed is believed.


def compared(monitor: Monitor, now: float, elapsed: float = 0.0) -> tuple[float, float]:
    """The speeds by the wheels and by the receiver that are believed."""
    assert monitor._compare(now, elapsed, False, None, math.nan) == []
    return monitor._speed, monitor._satellite_speed


def test_speeds_are_believed_while_they_are_fresh() -> None:
    monitor = Listening()
    assert all(map(math.isnan, compared(monitor, 0.0)))
    monitor.say(0.0, wheels(5.0))
    monitor._look(0.05, wish(1, 0.05, speed=5.25))
    by_wheels, by_receiver = compared(monitor, 0.1)
    assert by_wheels == pytest.approx(5.0)
    assert by_receiver == 5.25
    by_wheels, by_receiver = compared(monitor, 0.12)
    assert math.isnan(by_wheels)
    assert by_receiver == 5.25
    assert all(map(math.isnan, compared(monitor, 0.2)))


def test_a_speed_that_the_drive_only_guesses_is_not_believed() -> None:
    monitor = Listening()
    for sequence, faults, believed in ((1, ("geofence_breach",), True), (2, ("pose_stale",), False)):
        monitor._look(0.0, wish(sequence, speed=5.0, faults=faults))
        assert math.isfinite(compared(monitor, 0.0)[1]) is believed


def test_wheels_and_receiver_that_disagree_are_a_fault() -> None:
    monitor = Listening()
    for tick in range(12):
        now = 0.02 * tick
        monitor.say(now, wheels(5.0), YawRate(0.0, 0.0))
        monitor._look(now, wish(tick, now, speed=10.0))
        faults = monitor._compare(now, 0.02, True, None, math.nan)
    assert "speed_mismatch" in faults


def test_wheels_that_turn_and_never_change_are_no_evidence_of_rest() -> None:
    """40 mm/s, to the last bit, for more than five seconds; and zero for as long as they are fresh."""
    monitor = Listening()
    for now, certain in ((0.0, True), (4.75, True), (5.0, True), (5.25, False)):
        monitor.say(now, wheels(0.04))
        compared(monitor, now, 0.02)
        assert monitor._standstill.certain is certain
    for now, certain in ((6.0, True), (60.0, True)):
        monitor.say(now, wheels(0.0))
        compared(monitor, now, 0.02)
        assert monitor._standstill.certain is certain
    compared(monitor, 61.0, 0.02)
    assert monitor._standstill.certain is False, "an old report is none"


# When a drive is over.


@pytest.mark.parametrize(
    ("engaged", "state", "certain", "at_rest", "let_go", "over"),
    [
        (True, ArmingState.DISARMED, True, True, False, True),
        (True, ArmingState.FAULT, False, False, True, True),
        (True, ArmingState.DISARMED, True, False, False, False),
        (True, ArmingState.DISARMED, False, True, False, False),
        (True, ArmingState.STOPPED, True, True, True, False),
        (False, ArmingState.READY, True, True, True, False),
    ],
)
def test_a_drive_that_was_begun_is_over_once_the_car_stands_or_is_let_go(
    engaged: bool, state: ArmingState, certain: bool, at_rest: bool, let_go: bool, over: bool
) -> None:
    monitor = Listening()
    monitor._state, monitor._let_go = state, let_go
    monitor._standstill.certain, monitor._standstill.at_rest = certain, at_rest
    if engaged:
        monitor._has_been_engaged = True
    assert monitor.done is over


def test_a_car_is_let_go_after_ten_seconds_without_motion() -> None:
    long = Listening()._let_go_long
    assert [long.step(now, True) for now in (0.0, 9.99, 10.0)] == [False, False, True]
