"""The gateway in the loop with a car: engaging, driving, and everything that must bring the car to rest."""

from __future__ import annotations

import ast
import inspect
import itertools
import math
import pickle
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vehicle.car import CALIBRATION, FUSION, PERIOD, Car, Rig
from vve_sumo.values import ArmingState, FallbackPath, Frame, Setpoint
from vve_sumo.vehicle import (
    arming_machine,
    brake_monitor,
    engagement,
    gateway,
    monitor,
    plausibility,
    report_consistency,
    reports,
    response,
    setpoint_validation,
)
from vve_sumo.vehicle.arming import COMMANDING, CRITICAL, REASONS
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout, messages
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import Gear
from vve_sumo.vehicle.standstill import REST_TIME

S = ArmingState
IGNORE_PLACES = {codec.BRAKE_COMMAND: 3, codec.THROTTLE_COMMAND: 3, codec.STEERING_COMMAND: 2}


def slope(rig: Rig, duration: float, **arguments) -> float:
    """Mean acceleration over the next while [m/s2]."""
    before = rig.car.speed
    rig.run(duration, **arguments)
    return (rig.car.speed - before) / duration


def enabled(rig: Rig) -> set[bool]:
    return {command.enable for command in rig.commands()[:3]}


# Engaging.


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
    status = rig.step(1.0, 0.2, act=OperatorCommand.ENGAGE)
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
    assert rig.step(1.0, act=OperatorCommand.GO).reasons == ()
    rig.run(1.0, acceleration=1.0)
    assert rig.car.speed > 0.4
    assert enabled(rig) == {True}


def test_go_counts_only_when_it_is_waited_for():
    rig = Rig()
    assert rig.step(1.0, act=OperatorCommand.GO).reasons == ("go_too_early",)
    assert rig.step(1.0, act=OperatorCommand.ENGAGE).reasons == ("engaging",)
    assert rig.step(1.0, act=OperatorCommand.GO).reasons == ("go_too_early", "shifting")
    while rig.step(1.0).reasons == ("shifting",):
        pass
    rig.car.driver_brake = True
    assert rig.step(1.0, act=OperatorCommand.GO).reasons == ("go_too_early", "driver_on_brake")
    rig.car.driver_brake = False
    rig.car.forged = forged(ENABLED_THROTTLE._replace(driver=True))
    assert rig.step(1.0, act=OperatorCommand.GO).reasons == ("go_too_early", "driver_on_throttle")
    rig.car.forged = {}
    assert {status.throttle for status in rig.run(1.0, acceleration=1.0)} == {0.0}
    assert rig.step(1.0, act=OperatorCommand.GO).reasons == ()
    assert rig.step(1.0, act=OperatorCommand.GO).reasons == ()
    rig.step(act=OperatorCommand.STOP)
    assert "go_too_early" in rig.step(1.0, act=OperatorCommand.GO).reasons


def test_a_go_of_the_drive_before_does_not_count_for_the_next():
    rig = Rig()
    rig.engage()
    rig.step(act=OperatorCommand.STOP)
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
        ("bus_down", {}, {"found": ("bus_down",)}),
        ("a_code_that_nobody_knows", {}, {"found": ("a_code_that_nobody_knows",)}),
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
    status = rig.step(act=OperatorCommand.ENGAGE, **({"acceleration": 0.0} | step))
    assert status.state is S.DISARMED
    assert reason in status.reasons
    assert enabled(rig) == {False}


def test_a_foot_on_the_throttle_is_not_ready():
    rig = Rig()
    report = codec.ThrottleReport(0.2, 0.15, 0.15, enabled=False, driver=True)
    status = rig.step(act=OperatorCommand.ENGAGE, extra=(codec.encode(report),))
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
    rig.step(act=OperatorCommand.ENGAGE)
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
    rig.step(act=OperatorCommand.ENGAGE)
    statuses = rig.run(3.2, acceleration=2.0, act=OperatorCommand.GO)
    assert statuses[-1].state is S.STOPPED
    assert statuses[-1].reasons == ("gear_not_confirmed", "go_too_early")
    assert {status.throttle for status in statuses} == {0.0}


def test_a_shift_that_comes_too_late_does_not_find_the_car_let_go():
    """Given up in park while the gear box is on its way to drive: the car must be held until that has come out."""
    rig = Rig(Car(shift_time=3.1))
    rig.step(act=OperatorCommand.ENGAGE)
    while rig.step().state is S.ENGAGED:
        pass
    rig.car.gear, rig.car.shift_time = Gear.DRIVE, math.inf  # the shift comes out after all
    assert {(v.state, rig.car.speed) for v in rig.run(20.0)} == {(S.STOPPED, 0.0)}
    assert enabled(rig) == {True}


# Driving.


@pytest.mark.parametrize(("mass", "gain", "grade"), [*itertools.product((0.85, 1.15), (0.9, 1.1), (-0.03, 0.03))])
def test_ten_meters_per_second_then_the_brakes_then_a_minute_of_standing(mass, gain, grade):
    rig = Rig(Car(mass=mass * 1690.0, brake_gain=gain, grade=grade))
    rig.cruise(10.0)
    rig.run(1.5, acceleration=-2.5)
    assert slope(rig, 1.0, acceleration=-2.5) == pytest.approx(-2.5, abs=0.15)
    rig.run(5.0, acceleration=-2.5)
    assert rig.car.speed == 0.0
    for _ in range(round(60.0 / PERIOD)):
        rig.step(-0.5)
        assert rig.car.speed == 0.0
    assert rig.step().state is S.ENGAGED


def test_steering_goes_out_as_steering_wheel_angle_left_positive():
    rig = Rig()
    rig.cruise(5.0)
    statuses = rig.run(2.0, steering=0.1)
    assert statuses[-1].steering == pytest.approx(0.1)
    assert rig.commands()[2].wheel_angle == pytest.approx(0.1 * FUSION.steering_ratio, abs=math.radians(0.05))
    assert rig.car.yaw_rate > 0.0


def test_the_emergency_envelope_is_for_those_who_ask_for_it():
    rig = Rig()
    rig.cruise(12.0)
    assert rig.run(1.0, acceleration=-9.0)[-1].acceleration == -3.5
    assert rig.run(0.4, acceleration=-9.0, emergency=True)[-1].acceleration == -9.0
    assert rig.commands()[0].value == FUSION.brake_torque_limit


@pytest.mark.parametrize(("declared", "calibrated"), [(900.0, 3250.0), (3250.0, 900.0), (900.0, 900.0)])
def test_no_more_torque_goes_out_than_car_and_calibration_both_allow(declared: float, calibrated: float) -> None:
    car = replace(FUSION, brake_torque_limit=declared)
    rig = Rig(gateway=Gateway(car, calibration=replace(CALIBRATION, brake_torque_limit=calibrated), period=PERIOD))
    rig.cruise(12.0)
    rig.run(0.4, acceleration=-9.0, emergency=True)
    assert rig.commands()[0].value == pytest.approx(900.0, abs=0.5)


def test_counters_count_once_a_step_whatever_happens():
    rig = Rig()
    counters = []
    for tick in range(700):
        rig.step(
            -1.0 if tick % 3 else None,
            act=(OperatorCommand.ENGAGE, OperatorCommand.STOP, OperatorCommand.DISARM, None)[tick // 50 % 4],
        )
        brake, throttle, steering, _ = rig.commands()
        assert brake.counter == throttle.counter == steering.counter
        counters.append(brake.counter)
    assert counters == [tick % 256 for tick in range(700)]


def test_every_tick_sends_the_same_four_frames():
    rig = Rig()
    rig.engage()
    rig.step(1.0)
    assert [frame.id for frame in rig.frames] == [0x060, 0x062, 0x064, 0x066]
    assert [len(frame.data) for frame in rig.frames] == [8, 8, 8, 1]


# Everything that stops the car. Each row: reason, what is done to the rig from then on (a dict of arguments for every
# step, after an optional change of the car), and whether the stop must be the hard one.

ENABLED_BRAKE = codec.BrakeReport(messages.BrakeReportKind.PEDAL, 0.15, 0.15, 0.15, enabled=True)
ENABLED_THROTTLE = codec.ThrottleReport(0.15, 0.15, 0.15, enabled=True)
ENABLED_STEERING = codec.SteeringReport(0.0, 0.0, 10.0, 0.0, enabled=True)
FAULTS = [
    *[(f"{name}_report_stale", {"silent": {identifier}}, {}) for name, identifier in (
        ("brake", layout.BRAKE_REPORT), ("throttle", layout.THROTTLE_REPORT), ("steering", layout.STEERING_REPORT),
        ("gear", layout.GEAR_REPORT))],
    ("yaw_rate_stale", {"silent": {layout.YAW_RATE}}, {}),
    *[(f"{name}_fault", {"forged": report._replace(**{flag: True})}, {}) for name, report, flags in (
        ("brake", ENABLED_BRAKE, ("fault_channel_1", "fault_channel_2", "fault_power")),
        ("throttle", ENABLED_THROTTLE, ("fault_channel_1", "fault_channel_2", "fault_power")),
        ("steering", ENABLED_STEERING, ("fault_bus_1", "fault_bus_2", "fault_calibration", "fault_power")),
    ) for flag in flags],
    *[(reason, {"forged": report._replace(**changes)}, {}) for name, report in (
        ("brake", ENABLED_BRAKE), ("throttle", ENABLED_THROTTLE), ("steering", ENABLED_STEERING),
    ) for reason, changes in (
        (f"{name}_timeout", {"timeout": True, "enabled": False}), (f"{name}_disabled", {"enabled": False}),
        ("dbw_watchdog", {"fault_watchdog": True}),
    )],
    *[(reason, {"forged": report}, {}) for reason, report in (
        ("dbw_braking", ENABLED_BRAKE._replace(watchdog_braking=True)),
        ("report_invalid", ENABLED_STEERING._replace(wheel_angle=math.nan)),
        ("report_invalid", codec.YawRate(0.0, math.nan)),
        ("gear_fault", codec.GearReport(Gear.DRIVE, fault_bus=True)),
        ("gear_lost", codec.GearReport(Gear.NEUTRAL)))],
    ("report_malformed", {"forged": Frame(layout.BRAKE_REPORT, bytes(7))}, {}),
    *[("another_writer", {}, {"extra": (Frame(identifier, bytes(8)),)}) for identifier in sorted(layout.COMMAND_IDS)],
    ("setpoint_expired", {}, {"acceleration": None}),
    ("setpoint_expired", {}, {"sequence": 7}),
    ("setpoint_expired", {}, {"expires": 1e9}),
    ("setpoint_expired", {}, {"time": 1e9, "expires": 1e9}),
    ("setpoint_expired", {}, {"expires": 0.0}),
    ("setpoint_incomplete", {}, {"sequence": -1}),
    ("setpoint_incomplete", {}, {"expires": math.nan}),
    ("setpoint_incomplete", {}, {"time": math.nan}),
    ("setpoint_not_finite", {}, {"acceleration": math.nan}),
    ("setpoint_not_finite", {}, {"acceleration": -math.inf}),
    ("setpoint_not_finite", {}, {"steering": math.nan}),
    ("setpoint_not_finite", {}, {"grade": math.inf}),
    ("outside_geofence", {}, {"faults": ("outside_geofence",)}),
    ("setpoint_not_finite", {}, {"speed": math.nan}),
    ("yaw_rate_mismatch", {}, {"yaw_rate": 0.15}),
    ("setpoint_not_finite", {}, {"yaw_rate": math.nan}),
    ("profile_invalid", {}, {"fallback_path": FallbackPath(1.0, (0.0, math.nan))}),
    ("bus_down", {}, {"found": ("bus_down",)}),
    ("setpoint_corrupt", {}, {"found": ("setpoint_corrupt",)}),
    ("operator_gone", {}, {"found": ("operator_gone",)}),
    ("a_code_that_nobody_knows", {}, {"found": ("a_code_that_nobody_knows",)}),
    ("stop_asked", {}, {"act": OperatorCommand.STOP}),
    ("stop_asked_by_page", {}, {"act": OperatorCommand.STOP_BY_PAGE}),
    ("disarm_asked", {}, {"act": OperatorCommand.DISARM}),
]  # fmt: skip


def forged(message: object) -> dict[int, Frame]:
    frame = message if isinstance(message, Frame) else codec.encode(message)
    return {frame.id: frame}


@pytest.mark.parametrize(("reason", "car", "step"), FAULTS)
def test_whatever_goes_wrong_brings_the_car_to_rest_and_keeps_it_there(reason, car, step):
    rig = Rig()
    rig.cruise(10.0)
    rig.car.shift_time = math.inf  # and park is refused
    rig.car.silent = car.get("silent", set())
    rig.car.forged = forged(car["forged"]) if "forged" in car else {}
    arguments = {"acceleration": 1.0} | step
    first = rig.step(**arguments)
    arguments.pop("act", None)

    statuses = [first, *rig.run(0.7, **arguments)]
    at = next(i for i, status in enumerate(statuses) if status.state is not S.ENGAGED)
    assert statuses[at].state is S.STOPPING
    assert statuses[at].reasons[0] == reason
    assert all(status.throttle == 0.0 for status in statuses[at:])

    rig.car.enabled = True  # whatever a forged report says, this kit obeys
    before = rig.car.speed
    rig.run(1.5, **arguments)
    expected = 4.0 if reason in CRITICAL else 2.4
    after = rig.car.speed
    rig.run(0.4, **arguments)
    assert before > after
    assert (after - rig.car.speed) / 0.4 == pytest.approx(expected, abs=0.15)
    assert enabled(rig) == {True}

    statuses = rig.run(8.0, **arguments)
    assert statuses[-1].state is S.STOPPED
    assert {status.throttle for status in statuses} == {0.0}
    assert statuses[-1].reasons[0] == reason
    assert enabled(rig) == {True}
    rig.car.forged, rig.car.silent = {}, set()
    for tick in range(round(20.0 / PERIOD)):
        status = rig.step(2.0, act=(OperatorCommand.ENGAGE, OperatorCommand.GO, OperatorCommand.DISARM)[tick % 3])
        assert status.state is S.STOPPED, "no way from stopped to engaged, and none to a car that creeps"
        assert rig.car.speed == 0.0
    assert not rig.gateway.done


def test_without_wheel_speeds_the_car_is_stopped_blindly_and_held():
    rig = Rig()
    rig.cruise(10.0)
    rig.car.silent = {layout.WHEEL_SPEEDS}
    statuses = rig.run(10.0, acceleration=1.0, speed=0.0, faults=("pose_stale",))
    assert statuses[-1].state is S.STOPPING, "nobody can tell that it stands, and a guessed pose says nothing"
    assert "wheel_speeds_stale" in statuses[-1].reasons
    assert rig.car.speed == 0.0
    assert statuses[-1].brake_torque > 2000.0


def test_without_wheel_speeds_the_receiver_tells_after_a_while_that_the_car_stands():
    """It is held then, and left to its driver: nobody asks for park on the word of one."""
    rig = Rig()
    rig.cruise(10.0)
    rig.car.silent = {layout.WHEEL_SPEEDS}
    stood = math.inf
    while rig.step(1.0).state is not S.STOPPED:
        stood = rig.now if rig.car.speed > 0.3 else stood
    assert rig.now - stood == pytest.approx(3.25, abs=0.1)
    statuses = rig.run(5.0)
    assert {status.state for status in statuses} == {S.STOPPED}
    assert all({"standstill_uncertain", "driver_needed"} <= set(status.reasons) for status in statuses)
    assert rig.commands()[3].gear is Gear.NONE
    assert min(status.brake_torque for status in statuses) > 2000.0
    assert not rig.gateway.done


@pytest.mark.parametrize("wheel", range(4))
def test_an_invalid_wheel_counts_as_no_speed(wheel):
    rig = Rig()
    rig.cruise(10.0)
    speeds = [30.0] * 4
    speeds[wheel] = math.nan
    rig.car.forged = forged(codec.WheelSpeeds(*speeds))
    statuses = rig.run(6.0, acceleration=1.0)
    assert statuses[0].state is S.STOPPING
    assert "report_invalid" in statuses[0].reasons
    assert rig.car.speed == 0.0


def test_a_steering_that_does_not_follow_stops_the_car():
    rig = Rig()
    rig.cruise(5.0)
    rig.car.steering_stuck = True
    statuses = rig.run(4.0, steering=0.4)
    assert (statuses[-1].state, statuses[-1].reasons[0]) == (S.STOPPED, "steering_not_following")


@pytest.mark.parametrize("gap", [0.041, 0.5, 0.0, -0.02, math.nan, math.inf])
def test_a_gateway_that_was_not_run_in_time_stops_the_car(gap):
    rig = Rig()
    rig.cruise(10.0)
    late = rig.now + gap
    output = rig.gateway.step(late, rig.setpoint(1.0), rig.car.reports())
    assert (output.status.state, output.status.reasons[0]) == (S.STOPPING, "timer_gap")
    assert output.status.throttle == 0.0


def test_a_missed_period_is_forgiven():
    rig = Rig()
    rig.cruise(10.0)
    rig.tick += 1
    assert rig.step(0.0).state is S.ENGAGED


@pytest.mark.parametrize("trouble", ["timer_gap", "another_writer"])
def test_its_own_troubles_latch_before_engaging_too(trouble):
    rig = Rig()
    rig.run(0.1)
    if trouble == "timer_gap":
        rig.tick += 10
        status = rig.step()
    else:
        status = rig.step(extra=(Frame(layout.GEAR_COMMAND, b"\x04"),))
    assert (status.state, status.reasons) == (S.FAULT, (trouble,))
    assert rig.step(act=OperatorCommand.ENGAGE).state is S.FAULT
    assert rig.step(act=OperatorCommand.DISARM).state is S.DISARMED
    assert rig.step().state is S.READY


def test_a_lone_reordered_or_doubled_setpoint_is_passed_over_and_named():
    rig = Rig()
    rig.cruise(10.0)
    status = rig.step(2.0, sequence=rig.sequence)
    assert (status.state, status.reasons) == (S.ENGAGED, ("setpoint_out_of_order",))
    assert status.acceleration < 0.2
    assert rig.step(0.0).reasons == ()


def test_a_setpoint_is_used_until_it_expires_and_not_a_tick_longer():
    rig = Rig()
    rig.cruise(10.0)
    statuses = rig.run(0.14, acceleration=None)
    assert [status.state for status in statuses] == [S.ENGAGED] * 5 + [S.STOPPING] * 2


@pytest.mark.parametrize(("speed", "yaw_rate"), [(-0.6, 0.0), (0.6, 0.0), (0.0, 0.09), (0.0, -0.09)])
def test_small_differences_between_satellite_and_car_are_forgiven(speed, yaw_rate):
    rig = Rig()
    rig.cruise(10.0)
    for tick in range(100):
        # A gyroscope is never still to the last bit.
        rig.car.forged = forged(codec.YawRate(0.0, 0.001 * (tick % 2)))
        status = rig.step(0.0, speed=rig.car.speed + speed, yaw_rate=yaw_rate)
    assert status.state is S.ENGAGED


@pytest.mark.parametrize(("difference", "ticks"), [(-1.5, 24), (1.5, 24), (-10.0, 4)])
def test_a_short_difference_is_forgiven(difference, ticks):
    rig = Rig()
    rig.cruise(10.0)
    for tick in range(200):
        status = rig.step(0.0, speed=rig.car.speed + (difference if tick % (ticks + 1) else 0.0))
    assert status.state is S.ENGAGED


# How it stops.


def test_stopping_holds_the_angle_that_the_wheels_have():
    rig = Rig()
    rig.cruise(6.0)
    rig.run(1.0, steering=0.15)
    status = rig.step(1.0, steering=-0.3)  # a last wish that is never reached
    measured = rig.car.wheel_angle / FUSION.steering_ratio
    rig.step(acceleration=1.0, steering=-0.3, act=OperatorCommand.STOP)
    status = rig.step(acceleration=1.0, steering=-0.3)
    assert status.steering == pytest.approx(measured, abs=math.radians(0.1) / FUSION.steering_ratio)
    assert {v.steering for v in rig.run(6.0, steering=-0.3)} == {status.steering}


def test_a_steering_report_that_jumps_does_not_turn_the_wheels_at_once():
    """The wheels at the lock, by a report that lies as the stop begins: the command goes there by the limits."""
    rig = Rig()
    rig.cruise(10.0)
    before = rig.step().steering
    rig.car.forged = forged(codec.SteeringReport(8.0, 0.0, 10.0, 0.0, enabled=True))
    statuses = [rig.step(act=OperatorCommand.STOP), *rig.run(0.1)]
    largest = 10.0 * FUSION.wheelbase / rig.car.speed**2 * PERIOD
    for status in statuses:
        assert abs(status.steering - before) <= 1.1 * largest
        before = status.steering


def test_stopping_never_releases_brakes_that_are_on():
    rig = Rig()
    rig.cruise(12.0)
    rig.run(0.5, acceleration=-5.5, emergency=True)
    statuses = rig.run(0.8, acceleration=None)
    assert statuses[-1].state is S.STOPPING
    assert {status.acceleration for status in statuses} == {-5.5}


@pytest.mark.parametrize("ticks", [1, 3, 10, 30])
def test_a_fault_on_top_of_an_emergency_does_not_call_it_off(ticks):
    """However early the fault comes, the car stops no later than in the emergency alone, but for a tick's travel."""
    alone, both = Rig(), Rig()
    for rig in (alone, both):
        rig.cruise(12.0)
        rig.car.shift_time = math.inf
        rig.run(ticks * PERIOD, acceleration=-9.0, emergency=True)
    way, way_alone = 0.0, 0.0
    for _ in range(250):
        alone.step(-9.0, emergency=True)
        status = both.step(-9.0, emergency=True, faults=("virtual_contact",))
        way, way_alone = way + both.car.speed * PERIOD, way_alone + alone.car.speed * PERIOD
    assert status.state is S.STOPPED
    assert "virtual_contact" in status.reasons
    assert way <= way_alone + 0.3


@pytest.mark.parametrize("ticks", [1, 3, 10])
def test_a_controller_that_dies_in_an_emergency_does_not_call_it_off(ticks):
    """What comes from the drive then asks for nothing and is no emergency; the car is stopped as hard all the same."""
    rig = Rig()
    rig.cruise(12.0)
    rig.run(ticks * PERIOD, acceleration=-9.0, emergency=True)
    statuses = rig.run(0.6, acceleration=0.0, faults=("controller_raised",))
    assert statuses[-1].state is S.STOPPING
    assert statuses[-1].acceleration == pytest.approx(-9.0)


def test_an_emergency_asked_for_during_a_stop_is_heeded():
    rig = Rig()
    rig.cruise(12.0)
    assert rig.run(0.8, acceleration=0.0, faults=("off_path",))[-1].acceleration == pytest.approx(-2.4)
    assert rig.run(0.5, acceleration=-9.0, emergency=True)[-1].acceleration == pytest.approx(-9.0)
    assert rig.run(0.3, acceleration=0.0)[-1].acceleration == pytest.approx(-9.0), "and not released"


def test_what_a_refused_setpoint_says_is_wrong_counts_all_the_same():
    rig = Rig()
    rig.cruise(8.0)
    status = rig.step(1.0, sequence=0, faults=("pose_stale",))
    assert status.state is S.STOPPING
    assert "pose_stale" in status.reasons


def test_a_fault_beside_an_override_keeps_its_name():
    rig = Rig()
    rig.cruise(8.0)
    rig.car.override = True
    status = [rig.step(0.0, faults=("pose_stale",)) for _ in range(5)][-1]
    assert {"driver_override", "pose_stale"} <= set(status.reasons)


def test_stopping_sets_in_with_bounded_jerk_after_the_throttle_is_gone():
    rig = Rig()
    rig.cruise(10.0)
    rig.run(1.0, acceleration=1.5)
    granted = [rig.step(1.5, act=OperatorCommand.STOP).acceleration] + [v.acceleration for v in rig.run(1.0)]
    assert granted[0] == pytest.approx(-5.0 * PERIOD)
    assert max(a - b for a, b in itertools.pairwise(granted)) <= 5.0 * PERIOD + 1e-12
    assert granted[-1] == -2.4


def test_a_worse_fault_on_the_way_makes_it_brake_harder():
    rig = Rig()
    rig.cruise(12.0)
    rig.step(act=OperatorCommand.STOP)
    assert rig.run(1.0)[-1].acceleration == -2.4
    rig.step(extra=(Frame(codec.BRAKE_COMMAND, bytes(8)),))
    status = rig.run(0.3)[-1]
    assert (status.acceleration, status.reasons) == (-4.0, ("stop_asked", "another_writer"))


def test_stopped_uphill_it_never_touches_the_throttle():
    rig = Rig(Car(grade=0.03))
    rig.cruise(3.0)
    statuses = [rig.step(2.0, act=OperatorCommand.STOP), *rig.run(6.0)]
    assert {status.throttle for status in statuses} == {0.0}


#: From 0.30 m/s the receiver's mean, with a lag of 0.1 s, falls below 0.05 m/s at rest: 0.1 ln(30 / 5) [s].
AVERAGED = 0.18


def test_rest_is_standing_for_a_while():
    rig = Rig()
    rig.cruise(5.0)
    statuses = [rig.step(act=OperatorCommand.STOP)]
    standing = 0
    while statuses[-1].state is not S.STOPPED:
        statuses.append(rig.step())
        standing += rig.car.speed == 0.0
    assert standing * PERIOD == pytest.approx(0.3 + AVERAGED, abs=0.06)


def test_at_rest_it_asks_for_park_and_lets_go_only_there():
    rig = Rig(Car(shift_time=2.0))
    rig.cruise(5.0)
    rig.step(act=OperatorCommand.STOP)
    while rig.step().state is not S.STOPPED:
        assert rig.commands()[3].gear is Gear.NONE
    assert rig.commands()[3].gear is Gear.PARK
    status = rig.step(act=OperatorCommand.DISARM)
    assert (status.state, status.reasons) == (S.STOPPED, ("stop_asked", "not_in_park"))
    while rig.car.gear is not Gear.PARK:
        assert rig.step().state is S.STOPPED
        assert rig.commands()[3].gear is Gear.PARK
        assert enabled(rig) == {True}
        assert not rig.gateway.done
    ticks = 0
    while rig.step(faults=("pose_lost",)).state is S.STOPPED:
        ticks += 1
        assert enabled(rig) == {True}
    assert ticks * PERIOD == pytest.approx(1.0, abs=0.05)
    assert rig.gateway.done
    status = rig.step()
    assert (status.state, status.reasons) == (S.READY, ("stop_asked", "pose_lost")), "it still says how it ended"
    assert enabled(rig) == {False}
    assert {(v.state, v.brake_torque) for v in rig.run(5.0, acceleration=2.0)} == {(S.READY, 0.0)}


@pytest.mark.parametrize(
    "trouble",
    [
        {"silent": {layout.GEAR_REPORT}},
        {"silent": {layout.WHEEL_SPEEDS}},
        {"forged": codec.GearReport(Gear.PARK, fault_bus=True)},
    ],
)
def test_a_park_that_nobody_can_be_sure_of_lets_nothing_go(trouble):
    rig = Rig()
    rig.cruise(5.0)
    rig.step(act=OperatorCommand.STOP)
    while rig.step().state is not S.STOPPED:
        pass
    rig.car.silent = trouble.get("silent", set())
    rig.car.forged = forged(trouble["forged"]) if "forged" in trouble else {}
    assert {v.state for v in rig.run(10.0)} == {S.STOPPED}
    assert rig.car.gear is Gear.PARK or layout.WHEEL_SPEEDS in rig.car.silent
    assert enabled(rig) == {True}
    rig.car.silent, rig.car.forged = set(), {}
    rig.run(2.0)
    assert rig.gateway.done


def test_no_gear_is_asked_for_while_the_wheels_turn():
    rig = Rig(Car(shift_time=math.inf))
    rig.step(act=OperatorCommand.ENGAGE)
    rig.run(1.0)
    assert rig.commands()[3].gear is Gear.DRIVE
    rig.car.speed = 0.5
    rig.step()
    assert rig.commands()[3].gear is Gear.NONE
    rig.step(act=OperatorCommand.STOP)
    while rig.step().state is not S.STOPPED:
        assert rig.commands()[3].gear is Gear.NONE
    rig.step()
    assert rig.commands()[3].gear is Gear.PARK
    rig.car.speed = 0.5  # pushed from behind
    rig.step()
    assert rig.commands()[3].gear is Gear.NONE
    rig.car.speed = 0.0
    steps = 0
    while rig.commands()[3].gear is Gear.NONE:
        rig.step()
        steps += 1
    assert steps * PERIOD >= REST_TIME, "a car that rolled a moment ago may only seem to stand"


def test_a_brake_module_that_drops_out_calls_the_driver_while_the_car_moves():
    rig = Rig()
    rig.cruise(5.0)
    rig.car.forged = forged(ENABLED_BRAKE._replace(enabled=False))
    statuses = rig.run(0.1)
    assert "brake_disabled" in statuses[-1].reasons
    assert "driver_needed" in statuses[-1].reasons


def test_after_parking_another_controller_may_count_from_zero():
    rig = Rig()
    rig.engage()
    rig.step(act=OperatorCommand.STOP)
    rig.run(3.0)
    rig.sequence = -1
    assert rig.gateway.monitor.sequence > 100
    rig.step(act=OperatorCommand.DISARM)
    assert rig.gateway.monitor.sequence == -1
    rig.run(0.1)
    assert rig.gateway.monitor.sequence == rig.sequence
    rig.engage()
    assert not rig.gateway.done
    rig.run(1.0, acceleration=1.0)
    assert rig.car.speed > 0.3


# The driver.


@pytest.mark.parametrize("before", ["driving", "stopping", "stopped"])
@pytest.mark.parametrize(
    "report",
    [
        ENABLED_BRAKE._replace(override=True, enabled=False, driver_input=0.25),
        ENABLED_BRAKE._replace(override=True, enabled=False, driver=True),
        ENABLED_THROTTLE._replace(override=True, enabled=False, driver_input=0.35),
        ENABLED_STEERING._replace(override=True, enabled=False, torque=-5.0),
        codec.GearReport(Gear.NEUTRAL, override=True),
    ],
)
def test_the_driver_has_the_car_within_the_same_step_and_for_good(report, before):
    rig = Rig()
    rig.cruise(10.0)
    if before != "driving":
        rig.car.shift_time = math.inf
        rig.step(act=OperatorCommand.STOP)
        rig.run(1.0 if before == "stopping" else 7.0)
    counter = rig.commands()[0].counter
    status = rig.step(1.0, extra=(codec.encode(report),))
    assert (status.state, status.brake_torque, status.throttle) == (S.FAULT, 0.0, 0.0)
    assert "driver_override" in status.reasons
    assert enabled(rig) == {False}
    assert {command.counter for command in rig.commands()[:3]} == {(counter + 1) % 256}
    taken_over = set(status.reasons)
    for status in rig.run(1.0, acceleration=2.0, act=OperatorCommand.ENGAGE):
        assert status.state is S.FAULT
        assert set(status.reasons) <= taken_over
        assert enabled(rig) == {False}
        assert not any(command.clear for command in rig.commands())


UNCONFIRMED = [
    ENABLED_BRAKE._replace(override=True, enabled=False),
    ENABLED_THROTTLE._replace(override=True, enabled=False),
    ENABLED_STEERING._replace(override=True, enabled=False, torque=1.0),
    codec.GearReport(Gear.DRIVE, override=True),
]


@pytest.mark.parametrize("report", UNCONFIRMED)
def test_an_override_that_nothing_else_shows_brings_the_car_to_rest_and_calls_for_the_driver(report):
    """One report, wrong for one step; the brakes answer all the while."""
    rig = Rig()
    rig.cruise(10.0)
    status = rig.step(1.0, extra=(codec.encode(report),))
    assert (status.state, status.throttle) == (S.STOPPING, 0.0)
    assert {"override_unconfirmed", "driver_needed"} <= set(status.reasons)
    assert "driver_override" not in status.reasons
    while (status := rig.step(1.0)).state is S.STOPPING:
        assert enabled(rig) == {True}
        assert "driver_needed" in status.reasons or rig.car.speed < 0.1
    assert status.state is S.STOPPED
    assert rig.car.speed == 0.0


TOUCHES = [
    (ENABLED_BRAKE._replace(driver=True), "driver_on_brake"),
    (ENABLED_BRAKE._replace(driver_input=0.195), "driver_on_brake"),
    (ENABLED_THROTTLE._replace(driver=True), "driver_on_throttle"),
    (ENABLED_THROTTLE._replace(driver_input=0.20), "driver_on_throttle"),
]


@pytest.mark.parametrize(("report", "name"), TOUCHES)
def test_a_driver_at_the_pedals_ends_the_drive_at_once_and_for_good(report, name):
    """The bit of the module, or the position of its pedal, in one report alone: throttle zero in the same step."""
    rig = Rig()
    rig.cruise(8.0)
    assert rig.run(1.0, acceleration=1.0)[-1].throttle > 0.0
    status = rig.step(1.0, extra=(codec.encode(report),))
    assert (status.state, status.throttle, status.reasons) == (S.STOPPING, 0.0, (name,))
    assert enabled(rig) == {True}
    seen = [rig.step(2.0, act=OperatorCommand.GO) for _ in range(round(8.0 / PERIOD))]
    assert {status.throttle for status in seen} == {0.0}
    assert max(status.brake_torque for status in seen) > 500.0, "the brakes work on"
    assert (seen[-1].state, rig.car.speed) in {(S.STOPPED, 0.0), (S.DISARMED, 0.0), (S.READY, 0.0)}
    assert name in seen[-1].reasons or seen[-1].state in (S.DISARMED, S.READY)


@pytest.mark.parametrize(
    "report",
    [
        ENABLED_BRAKE._replace(driver_input=0.185),  # 115 N m
        ENABLED_THROTTLE._replace(driver_input=0.18),  # 4.6 %
        ENABLED_STEERING._replace(torque=1.9),
    ],
)
def test_an_untouched_pedals_offset_is_no_foot(report):
    rig = Rig()
    rig.cruise(8.0)
    for _ in range(4):
        assert rig.step(1.0, extra=(codec.encode(report),)).state is S.ENGAGED


def test_a_driver_who_takes_over_again_after_the_act_cleared_the_old_override_has_the_car():
    rig = Rig(Car(override=True))
    rig.engage()
    rig.run(2.0, acceleration=1.0)
    rig.car.override = True
    status = rig.step(1.0)
    assert (status.state, status.reasons) == (S.FAULT, ("driver_override",))
    assert enabled(rig) == {False}


def test_an_act_of_the_same_moment_does_not_wipe_away_that_the_driver_took_over():
    rig = Rig()
    rig.cruise(5.0)
    rig.car.override = True
    status = rig.step(1.0, act=OperatorCommand.DISARM)
    assert (status.state, status.reasons) == (S.FAULT, ("driver_override",))
    assert rig.step(1.0, act=OperatorCommand.DISARM).state is S.DISARMED


def test_an_override_that_the_act_does_not_clear_is_not_fought():
    rig = Rig(Car(override=True))
    latched = codec.encode(ENABLED_BRAKE._replace(override=True, enabled=False))
    rig.car.forged = forged(latched)
    rig.step(act=OperatorCommand.ENGAGE)
    statuses = rig.run(1.0)
    assert statuses[-1].reasons == ("handshake_timeout",)


# For every run of whatever happens.

ODD_SETPOINTS = st.builds(
    Setpoint,
    steering=st.floats(),
    acceleration=st.floats(),
    emergency=st.booleans(),
    sequence=st.integers(-1, 10_000),
    time=st.floats(0.0, 3.0) | st.just(math.nan),
    expires=st.floats(0.0, 3.0) | st.just(math.nan),
    speed=st.floats(),
    yaw_rate=st.floats(),
    grade=st.floats(),
    faults=st.sampled_from([(), (), ("pose_lost",)]),
)
ODD_FRAMES = st.builds(Frame, st.integers(0x060, 0x075), st.binary(max_size=8))


@settings(max_examples=60, deadline=None)
@given(
    st.booleans(),
    st.lists(
        st.tuples(
            st.none() | ODD_SETPOINTS | st.tuples(st.floats(-9, 3), st.floats(-1, 1), st.booleans()),
            st.lists(ODD_FRAMES, max_size=2),
            st.none() | st.sampled_from(OperatorCommand),
        ),
        min_size=1,
        max_size=60,
    ),
)
def test_whatever_comes_it_never_breaks_and_never_says_what_it_must_not(engaged, steps):
    rig, state, going = Rig(), S.DISARMED, engaged
    if engaged:
        rig.cruise(8.0)
        state = rig.step().state
    for odd, frames, act in steps:
        rig.tick += 1
        setpoint = rig.setpoint(odd[0], odd[1], emergency=odd[2]) if isinstance(odd, tuple) else odd
        status, out = rig.gateway.step(rig.now, setpoint, [*rig.car.reports(), *frames], act)
        rig.car.hear(out)
        rig.car.advance()
        for frame in out:
            if frame.id in IGNORE_PLACES:
                assert not frame.data[IGNORE_PLACES[frame.id]] & 4
        brake, throttle, steering, gear = (codec.decode(frame) for frame in out)
        assert brake.value == 0.0 or throttle.value == 0.0
        assert brake.enable == throttle.enable == steering.enable == (status.state in COMMANDING)
        assert brake.clear == gear.clear == (state is not S.ENGAGED and status.state is S.ENGAGED)
        going = status.state is S.ENGAGED and (
            going or (act is OperatorCommand.GO and "go_too_early" not in status.reasons)
        )
        assert going or throttle.value == 0.0
        assert not brake.clear or act is OperatorCommand.ENGAGE
        state = status.state
        assert all(map(math.isfinite, (status.steering, status.acceleration, status.brake_torque, status.throttle)))
        assert status.state is S.ENGAGED or throttle.value == 0.0
        assert abs(status.steering) <= FUSION.steering_limit + 1e-12


def test_the_same_inputs_give_the_same_bytes():
    def drive():
        rig = Rig()
        rig.cruise(6.0)
        rig.run(1.0, acceleration=-1.0, steering=0.2)
        return [rig.step(-2.0).brake_torque for _ in range(50)], rig.frames

    assert drive() == drive()


def test_it_can_be_sent_to_a_process_of_its_own():
    rig = Rig()
    rig.cruise(5.0)
    twin = pickle.loads(pickle.dumps(rig))
    assert (twin.step(-1.0, 0.1), twin.frames) == (rig.step(-1.0, 0.1), rig.frames)


#: Given by those who run the gateway.
OF_ITS_PROCESS = {"drive_gone", "external_brain", "operator_gone", "setpoint_corrupt", "stop_input"}


def test_every_reason_it_can_give_has_plain_words():
    """All string literals in the modules that give reasons and look like codes."""
    given_codes = set()
    for module in (
        gateway,
        arming_machine,
        monitor,
        setpoint_validation,
        engagement,
        plausibility,
        reports,
        report_consistency,
        brake_monitor,
        response,
    ):
        for node in ast.walk(ast.parse(inspect.getsource(module))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and "_" in node.value:
                given_codes.add(node.value)
    given_codes -= set(OperatorCommand)
    codes = {code for code in given_codes if code.islower() and " " not in code and not code.startswith("_")}
    assert codes - set(REASONS) == {"pose_stale"}, "the trust gate's own word, which a setpoint brings"
    assert set(REASONS) - codes == {"engaging", "shifting", "shadow"} | OF_ITS_PROCESS


def test_its_defaults_are_the_fusions():
    assert Gateway(FUSION, CALIBRATION).step(0.0, None, []).status.state is S.DISARMED


def test_a_calibrated_wheel_bias_is_taken_off_the_report_and_put_onto_the_command() -> None:
    """Commanded straight, the wheel is asked to the angle at which the wheels point straight, and reads as straight."""
    bias = math.radians(3.0)
    gateway = Gateway(FUSION, CALIBRATION, wheel_bias=bias)
    report = codec.encode(codec.SteeringReport(bias, math.nan, 0.0, 0.0, enabled=False))
    output = gateway.step(0.0, None, [report])
    assert gateway.monitor.measured_steering == pytest.approx(0.0, abs=math.radians(0.05) / FUSION.steering_ratio)
    command = codec.decode(output.frames[2], codec.Variant.DBW1_2024)
    assert isinstance(command, codec.SteeringCommand)
    assert command.wheel_angle == pytest.approx(bias, abs=math.radians(0.06))
