"""The handover step by step, over reports as the kit sends them: what is waited for, and when it is given up."""

from __future__ import annotations

import pytest

from vve_sumo.vehicle.dataspeed import codec, messages
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.engagement import Engagement
from vve_sumo.vehicle.interface import Gear
from vve_sumo.vehicle.reports import CarReports

LAG = 0.05  # [rad]
BEGUN = 10.0  # [s]


def reports(enabled: bool = True, gear: Gear = Gear.DRIVE) -> CarReports:
    """A car that says this; the brake module alone may not be enabled."""
    said = CarReports(0.3, DataspeedDbw1())
    for message in (
        codec.BrakeReport(messages.BrakeReportKind.PEDAL, 0.15, 0.15, 0.15, enabled=enabled),
        codec.ThrottleReport(0.15, 0.15, 0.15, enabled=True),
        codec.SteeringReport(0.0, 0.0, 0.0, 0.0, enabled=True),
        codec.GearReport(gear),
    ):
        said.take(0.0, [codec.encode(message)])
    return said


def begun(shadow: bool = False) -> Engagement:
    subject = Engagement(LAG, shadow)
    subject.begin(BEGUN)
    return subject


@pytest.mark.parametrize("shadow", [False, True])
def test_nothing_is_handed_over_before_it_begins(shadow):
    subject = Engagement(LAG, shadow)
    assert (subject.enabled, subject.in_drive) == (False, False)
    assert not subject.settled(100.0)
    assert subject.dropped_out(reports(enabled=False)) == []
    assert not subject.may_go([])


def test_the_kit_has_four_tenths_of_a_second_to_confirm():
    subject, silent = begun(), reports(enabled=False)
    assert subject.follow(BEGUN, silent, 0.0) == []
    assert subject.follow(BEGUN + 0.4, silent, 0.0) == []
    assert subject.waits_for([]) == ["engaging"]
    assert subject.follow(BEGUN + 0.4001, silent, 0.0) == ["handshake_timeout"]
    assert subject.follow(BEGUN + 0.5, reports(), 0.0) == []
    assert subject.enabled


def test_confirmed_is_settled_when_the_time_for_it_is_over():
    subject = begun()
    assert not subject.settled(BEGUN + 1.0), "nobody has confirmed"
    subject.follow(BEGUN + 0.1, reports(), 0.0)
    assert not subject.settled(BEGUN + 0.4)
    assert subject.settled(BEGUN + 0.4001)


def test_the_car_has_three_seconds_from_the_confirmation_to_shift():
    subject, parked = begun(), reports(gear=Gear.PARK)
    assert subject.follow(BEGUN + 0.3, parked, 0.0) == []
    assert subject.waits_for([]) == ["shifting"]
    assert subject.follow(BEGUN + 3.3, parked, 0.0) == []
    assert subject.follow(BEGUN + 3.3001, parked, 0.0) == ["gear_not_confirmed"]
    assert not subject.may_go([])


def test_a_gear_that_was_there_and_is_not_is_lost():
    subject = begun()
    assert subject.follow(BEGUN + 0.1, reports(), 0.0) == []
    assert subject.in_drive
    assert subject.follow(BEGUN + 0.2, reports(gear=Gear.NEUTRAL), 0.0) == ["gear_lost"]
    assert subject.in_drive, "it is not asked for anew"


def test_a_car_that_is_in_drive_is_given_all_the_time_in_the_world():
    subject = begun()
    assert subject.follow(BEGUN, reports(), 0.0) == []
    assert subject.follow(BEGUN + 60.0, reports(), 0.0) == []


def test_a_module_that_drops_out_is_named_once_all_have_confirmed():
    subject, weak = begun(), reports(enabled=False)
    assert subject.dropped_out(weak) == []
    subject.follow(BEGUN + 0.1, reports(), 0.0)
    assert subject.dropped_out(weak) == ["brake_disabled"]
    assert subject.follow(BEGUN + 0.2, weak, 0.0) == ["brake_disabled"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("error", "ends"), [(0.149, []), (0.151, ["steering_not_following"]), (float("nan"), ["steering_not_following"])]
)
def test_the_steering_may_lag_by_a_tenth_and_its_own_lag_for_half_a_second(sign, error, ends):
    subject = begun()
    assert subject.follow(BEGUN, reports(), sign * error) == []
    assert subject.follow(BEGUN + 0.4999, reports(), sign * error) == []
    assert subject.follow(BEGUN + 0.5, reports(), sign * error) == ends


def test_engaging_anew_forgets_what_was():
    subject = begun()
    subject.follow(BEGUN, reports(), 1.0)
    subject.begin(BEGUN + 0.3)
    assert (subject.enabled, subject.in_drive) == (False, False)
    assert subject.follow(BEGUN + 0.6, reports(), 1.0) == [], "differs for 0.3 s of this drive"
    assert subject.follow(BEGUN + 1.1, reports(), 1.0) == ["steering_not_following"]


def test_the_driver_keeps_the_car_standing():
    subject = begun()
    subject.follow(BEGUN + 0.1, reports(), 0.0)
    assert subject.waits_for([]) == ["waiting_for_go"]
    assert subject.may_go([])
    assert subject.waits_for(["driver_on_brake"]) == ["driver_on_brake"]
    assert not subject.may_go(["driver_on_brake"])


@pytest.mark.parametrize(("confirmed", "gear"), [(False, Gear.DRIVE), (True, Gear.PARK)])
def test_the_car_goes_only_when_kit_and_gear_are_there(confirmed, gear):
    subject = begun()
    subject.follow(BEGUN + 0.1, reports(confirmed, gear), 0.0)
    assert not subject.may_go([])


def test_shadow_mode_awaits_nothing():
    subject = begun(shadow=True)
    assert subject.enabled
    assert subject.may_go([])
    idle = reports(enabled=False, gear=Gear.PARK)
    assert subject.follow(BEGUN + 10.0, idle, 1.0) == []
    assert subject.dropped_out(idle) == []
