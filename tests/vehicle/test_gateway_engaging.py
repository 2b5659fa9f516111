"""The gateway before it drives: two acts of the operator, what refuses them, and what gives up at rest."""

from __future__ import annotations

import math

import pytest

from tests.vehicle.car import Car, Rig, enabled
from tests.vehicle.forged_reports import ENABLED_THROTTLE, forged
from vve_sumo.values import ArmingState, FallbackPath
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.interface import Gear

S = ArmingState


def test_nothing_is_commanded_before_the_operator_acts():
    rig = Rig()
    for status in rig.run(1.0, acceleration=2.0, steering=0.3):
        assert (status.state, status.brake_torque, status.throttle) == (S.READY, 0.0, 0.0)
        brake, throttle, steering, gear = rig.commands()
        assert enabled(rig) == {False}
        assert not any(command.clear for command in rig.commands())
        assert (brake.value, throttle.value, steering.wheel_angle, gear.gear) == (0.0, 0.0, 0.0, Gear.NONE)


@pytest.mark.parametrize("variant", codec.Variant)
@pytest.mark.parametrize("gear", [Gear.PARK, Gear.DRIVE])
def test_two_acts_one_to_hold_the_car_and_one_to_let_it_go(gear, variant):
    rig = Rig(Car(gear=gear, variant=variant, driver_brake=gear is Gear.DRIVE))
    status = rig.step(1.0, 0.2, command=OperatorCommand.ENGAGE)
    assert (status.state, status.reasons) == (S.ENGAGED, ("engaging",))
    assert all(command.clear for command in rig.commands())
    seen = []
    while status.reasons != ("waiting_for_go",):
        status = rig.step(1.0, 0.2)
        seen += status.reasons
        assert status.throttle == status.steering == 0.0 < status.brake_torque
        assert rig.commands()[3].gear is (Gear.DRIVE if status.reasons == ("shifting",) else Gear.NONE)
        assert not any(command.clear for command in rig.commands())
        rig.car.driver_brake &= len(seen) < 20
    assert list(dict.fromkeys(seen)) == ["shifting" if gear is Gear.PARK else "driver_on_brake", "waiting_for_go"]
    for status in rig.run(2.0, acceleration=2.0, steering=0.2):
        assert (status.reasons, status.throttle, status.steering) == (("waiting_for_go",), 0.0, 0.0)
        assert status.acceleration == rig.car.speed == 0.0
    assert rig.step(1.0, command=OperatorCommand.GO).reasons == ()
    rig.run(1.0, acceleration=1.0)
    assert rig.car.speed > 0.4
    assert enabled(rig) == {True}


def test_go_counts_only_when_it_is_waited_for():
    rig = Rig()
    assert rig.step(1.0, command=OperatorCommand.GO).reasons == ("go_too_early",)
    assert rig.step(1.0, command=OperatorCommand.ENGAGE).reasons == ("engaging",)
    assert rig.step(1.0, command=OperatorCommand.GO).reasons == ("go_too_early", "shifting")
    while rig.step(1.0).reasons == ("shifting",):
        pass
    rig.car.driver_brake = True
    assert rig.step(1.0, command=OperatorCommand.GO).reasons == ("go_too_early", "driver_on_brake")
    rig.car.driver_brake = False
    rig.car.forged = forged(ENABLED_THROTTLE._replace(driver=True))
    assert rig.step(1.0, command=OperatorCommand.GO).reasons == ("go_too_early", "driver_on_throttle")
    rig.car.forged = {}
    assert {status.throttle for status in rig.run(1.0, acceleration=1.0)} == {0.0}
    assert rig.step(1.0, command=OperatorCommand.GO).reasons == ()
    assert rig.step(1.0, command=OperatorCommand.GO).reasons == ()
    rig.step(command=OperatorCommand.STOP)
    assert "go_too_early" in rig.step(1.0, command=OperatorCommand.GO).reasons


def test_a_go_of_the_drive_before_does_not_count_for_the_next():
    rig = Rig()
    rig.engage()
    rig.step(command=OperatorCommand.STOP)
    rig.run(4.0)
    assert rig.step().state is S.READY
    rig.stand_by()
    assert {(v.reasons, v.throttle) for v in rig.run(1.0, acceleration=2.0)} == {(("waiting_for_go",), 0.0)}


@pytest.mark.parametrize(
    ("reason", "car", "step"),
    [
        ("not_standing", {"speed": 0.3}, {}),
        ("gear_not_park_or_drive", {"gear": Gear.REVERSE}, {}),
        ("gear_not_park_or_drive", {"gear": Gear.NEUTRAL}, {}),
        ("driver_not_on_brake", {"gear": Gear.DRIVE}, {}),
        ("dbw_already_enabled", {"enabled": True}, {}),
        ("profile_invalid", {}, {"fallback_path": FallbackPath(0.0, (0.0,))}),
        ("bus_down", {}, {"process_faults": ("bus_down",)}),
        ("a_code_that_nobody_knows", {}, {"process_faults": ("a_code_that_nobody_knows",)}),
        ("no_setpoint", {}, {"acceleration": None}),
        ("setpoint_lifetime", {}, {"expires": 0.2}),
        ("setpoint_not_finite", {}, {"acceleration": math.nan}),
        ("pose_not_trusted", {}, {"faults": ("pose_not_trusted",)}),
        ("brake_report_stale", {"silent": {layout.BRAKE_REPORT}}, {}),
        ("throttle_report_stale", {"silent": {layout.THROTTLE_REPORT}}, {}),
        ("steering_report_stale", {"silent": {layout.STEERING_REPORT}}, {}),
        ("gear_report_stale", {"silent": {layout.GEAR_REPORT}}, {}),
        ("wheel_speeds_stale", {"silent": {layout.WHEEL_SPEEDS}}, {}),
        ("yaw_rate_stale", {"silent": {layout.YAW_RATE}}, {}),
    ],
)
def test_what_is_missing_is_named_and_the_act_is_refused(reason, car, step):
    rig = Rig(Car(**car))
    status = rig.step(command=OperatorCommand.ENGAGE, **({"acceleration": 0.0} | step))
    assert status.state is S.DISARMED
    assert reason in status.reasons
    assert enabled(rig) == {False}


def test_a_foot_on_the_throttle_is_not_ready():
    rig = Rig()
    report = codec.ThrottleReport(0.2, 0.15, 0.15, enabled=False, driver=True)
    status = rig.step(command=OperatorCommand.ENGAGE, extra=(codec.encode(report),))
    assert (status.state, status.reasons) == (S.DISARMED, ("driver_on_throttle",))


def test_an_override_latched_from_before_is_cleared_by_the_act_and_by_nothing_else():
    rig = Rig(Car(override=True))
    rig.run(0.2)
    assert rig.car.override
    rig.engage()
    assert not rig.car.override
    assert rig.step().state is S.ENGAGED


def test_a_kit_that_does_not_confirm_in_time_is_given_up_at_rest():
    rig = Rig()
    rig.car.forged[layout.STEERING_REPORT] = codec.encode(codec.SteeringReport(0.0, 0.0, 0.0, 0.0, enabled=False))
    rig.step(command=OperatorCommand.ENGAGE)
    statuses = rig.run(0.4)
    assert statuses[-1].state is S.ENGAGED
    status = rig.step()
    assert (status.state, status.reasons) == (S.STOPPED, ("handshake_timeout",))
    assert rig.car.speed == 0.0
    status = rig.run(1.1)[-1]
    assert (status.state, status.reasons) == (S.READY, ("handshake_timeout",))
    assert rig.gateway.done


def test_a_gear_that_does_not_come_is_given_up_at_rest():
    rig = Rig(Car(shift_time=math.inf))
    rig.step(command=OperatorCommand.ENGAGE)
    statuses = rig.run(3.2, acceleration=2.0, command=OperatorCommand.GO)
    assert statuses[-1].state is S.STOPPED
    assert statuses[-1].reasons == ("gear_not_confirmed", "go_too_early")
    assert {status.throttle for status in statuses} == {0.0}


def test_a_shift_that_comes_too_late_does_not_find_the_car_let_go():
    """Given up in park while the gear box is on its way to drive: the car must be held until that has come out."""
    rig = Rig(Car(shift_time=3.1))
    rig.step(command=OperatorCommand.ENGAGE)
    while rig.step().state is S.ENGAGED:
        pass
    rig.car.gear, rig.car.shift_time = Gear.DRIVE, math.inf  # the shift comes out after all
    assert {(v.state, rig.car.speed) for v in rig.run(20.0)} == {(S.STOPPED, 0.0)}
    assert enabled(rig) == {True}
