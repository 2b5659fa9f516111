"""How hard a stop brakes, where it steers, and what it says of itself while more goes wrong on the way to rest."""

from __future__ import annotations

import pytest

from tests.vehicle.car import CALIBRATION, FUSION, PERIOD, Car, Rig
from tests.vehicle.test_evidence import wheels
from tests.vehicle.test_waiting import IN_THE_BEND, stopping_in_a_bend
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import Gear
from vve_sumo.vehicle.limits import EmergencyBraking, Limits

S = ArmingState
#: Somebody else's command, which asks for the harder stop.
ANOTHER_WRITER = (Frame(codec.BRAKE_COMMAND, bytes(8)),)


def cruising(speed: float = 8.0, **limits: float | EmergencyBraking) -> Rig:
    interface = DataspeedDbw1(codec.Variant.DBW1_2024)
    rig = Rig(gateway=Gateway(FUSION, CALIBRATION, limits=Limits(**limits), period=PERIOD, interface=interface))
    rig.cruise(speed)
    return rig


def test_an_ordinary_stop_is_not_softer_than_the_braking_before_it():
    rig = cruising(12.0)
    assert rig.run(1.5, -3.5)[-1].acceleration == -3.5
    statuses = rig.run(0.6, None)
    assert statuses[-1].state is S.STOPPING
    assert {status.acceleration for status in statuses} == {-3.5}


def test_a_stop_of_a_car_that_brakes_gently_brakes_harder():
    rig = cruising()
    rig.run(1.0, -1.0)
    rig.step(-1.0, command=OperatorCommand.STOP)
    assert rig.run(1.0, -1.0)[-1].acceleration == -2.4


@pytest.mark.parametrize("asked", [-1.0, -20.0])
def test_an_emergency_makes_a_stop_no_softer_and_no_harder_than_the_emergency_limit(asked):
    rig = cruising(12.0)
    rig.step(command=OperatorCommand.STOP)
    rig.run(0.6)
    status = rig.run(0.5, asked, emergency=True)[-1]
    assert status.state is S.STOPPING
    assert status.acceleration == (-2.4 if asked == -1.0 else -9.0)


def test_braking_that_is_no_emergency_makes_a_stop_no_harder():
    rig = cruising(10.0)
    rig.step(command=OperatorCommand.STOP)
    assert rig.run(1.0, -3.5)[-1].acceleration == -2.4


def test_a_gentle_rig_stops_as_gently_and_sets_in_as_slowly_as_it_says():
    rig = cruising(4.0, stop_deceleration=0.5, stop_jerk=0.5)
    begun = rig.step(command=OperatorCommand.STOP).acceleration
    assert begun == pytest.approx(-0.5 * PERIOD)
    assert rig.run(1.2)[-1].acceleration == -0.5


def test_a_rig_whose_ordinary_stop_is_the_harder_one_keeps_it_in_trouble():
    """Neither an emergency that asks for little nor a critical fault makes the stop softer or slower."""
    for step in ({"extra": ANOTHER_WRITER}, {"acceleration": -1.0, "emergency": True}):
        rig = cruising(8.0, stop_deceleration=5.0, stop_jerk=40.0)
        status = rig.step(command=OperatorCommand.STOP, **step)
        assert status.acceleration == pytest.approx(-40.0 * PERIOD)
        assert rig.run(0.4, **step)[-1].acceleration == -5.0


def test_brakes_that_do_not_follow_are_asked_for_all_that_an_emergency_may():
    rig = cruising()
    rig.car.brake_gain = 0.0
    rig.step(command=OperatorCommand.STOP)
    while "brake_not_following" not in (status := rig.step()).reasons:
        before = status.acceleration
    assert status.acceleration == pytest.approx(before - 30.0 * PERIOD)
    assert rig.run(0.5)[-1].acceleration == -9.0


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_a_car_at_rest_is_held_as_it_was_held_before_it_started(gain):
    """Also one whose brakes are weak, which all of their torque had to stop."""
    rig = Rig()
    rig.stand_by()
    held = rig.run(0.5)[-1].brake_torque
    rig.step(command=OperatorCommand.GO)
    while rig.car.speed < 4.0:
        rig.step(1.5)
    rig.car.brake_gain, rig.car.shift_time = gain, 10.0
    rig.step(command=OperatorCommand.STOP)
    while (status := rig.step()).state is not S.STOPPED:
        pass
    assert ("brake_not_following" in status.reasons) is (gain < 1.0)
    assert rig.run(1.0)[-1].brake_torque == pytest.approx(held)


@pytest.mark.parametrize("how", ["silent", "turning"])
def test_a_car_in_park_whose_wheels_do_not_say_that_it_stands_is_not_let_go(how):
    rig = cruising(2.0)
    rig.step(command=OperatorCommand.STOP)
    while rig.car.gear is not Gear.PARK:
        rig.step()
    if how == "silent":
        rig.car.silent = set(wheels(0.0))
    else:
        rig.car.forged = wheels(0.5)
    assert {status.state for status in rig.run(2.0)} == {S.STOPPED}


# What it says.


@pytest.mark.parametrize(
    ("command", "reason"), [(OperatorCommand.END, "drive_over"), (OperatorCommand.DISARM, "disarm_asked")]
)
def test_the_end_of_a_drive_is_a_stop_that_says_so(command, reason):
    rig = cruising(3.0)
    status = rig.step(command=command)
    assert (status.state, status.reasons) == (S.STOPPING, (reason,))


def test_a_stop_needs_no_setpoints_and_blames_nobody_for_their_absence():
    rig = cruising(3.0)
    rig.step(command=OperatorCommand.STOP)
    assert {status.reasons for status in rig.run(1.0, None)} == {("stop_asked",)}


def test_a_driver_who_takes_over_a_car_that_stops_hides_not_why_it_did():
    rig = cruising(5.0)
    rig.step(command=OperatorCommand.STOP)
    rig.car.override = True
    status = rig.step()
    assert (status.state, status.reasons) == (S.FAULT, ("stop_asked", "driver_override"))


def test_a_second_fault_before_a_drive_does_not_hide_the_first():
    rig = Rig()
    rig.run(0.5)
    rig.tick += 10
    assert rig.step().reasons == ("timer_gap",)
    assert rig.step(extra=ANOTHER_WRITER).reasons == ("timer_gap", "another_writer")


def test_what_is_wrong_for_long_is_said_once():
    rig = cruising(3.0)
    assert rig.run(0.5, extra=ANOTHER_WRITER)[-1].reasons == ("another_writer",)


@pytest.mark.parametrize("frames", [(), ANOTHER_WRITER])
def test_brakes_that_another_node_commands_are_nobodys_foot(frames: tuple[Frame, ...]) -> None:
    rig = cruising(8.0)
    rig.car.foreign_torque = 2000.0
    seen = [rig.step(extra=frames) for _ in range(60)]
    assert seen[-1].state is S.STOPPING
    assert any("driver_inferred" in status.reasons for status in seen) == (not frames)


# Where it steers.


def test_a_car_that_rolled_on_and_stands_again_leaves_its_wheels_where_they_are_now():
    rig = stopping_in_a_bend()
    rig.run(0.04, None)
    rig.car.forged = wheels(1.0)
    assert rig.run(0.5, None)[-1].steering == pytest.approx(IN_THE_BEND, abs=0.01)
    rig.car.wheel_angle, rig.car.forged = 0.06 * FUSION.steering_ratio, {}
    assert rig.run(1.5, None)[-1].steering == pytest.approx(0.06, abs=1e-3)


def test_the_next_drive_stops_with_the_angle_that_its_own_wheels_have():
    rig = Rig()
    rig.cruise(3.0)
    rig.run(1.0, steering=0.1)
    rig.step(command=OperatorCommand.STOP)
    assert rig.run(1.0)[-1].steering == pytest.approx(0.1, abs=1e-3)
    while rig.step().state is not S.READY:
        pass
    rig.engage()
    rig.run(1.0, 1.0)
    rig.run(0.5, 0.0, steering=-0.05)
    rig.step(command=OperatorCommand.STOP)
    assert rig.run(0.5)[-1].steering == pytest.approx(-0.05, abs=2e-3)


@pytest.mark.parametrize("angle", [-9.0, 9.0])
def test_a_report_beyond_the_lock_is_the_lock(angle):
    """Nine radians of the steering wheel would be 0.61 of the wheels, and the car's lock is at 0.55."""
    rig = Rig(Car(wheel_angle=angle))
    assert abs(rig.step().steering) == pytest.approx(FUSION.steering_limit)
    assert rig.step().steering * angle > 0.0


def test_before_the_first_report_the_wheels_are_taken_to_be_straight():
    rig = Rig()
    status = rig.gateway.step(0.0, None, []).status
    assert (status.steering, status.acceleration) == (0.0, 0.0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_biased_steering_wheel_is_not_turned_beyond_its_wires_end(side):
    """At the wheels' lock 8.2 rad of the steering wheel and a bias of 2 rad: the wire ends at 9.6."""
    interface = DataspeedDbw1(codec.Variant.DBW1_2024)
    gateway = Gateway(FUSION, CALIBRATION, period=PERIOD, interface=interface, wheel_bias=2.0 * side)
    encoded = []
    encode = interface.encode
    interface.encode = lambda command: (encoded.append(command), encode(command))[1]
    rig = Rig(Car(wheel_angle=9.5 * side), gateway)
    rig.engage()
    rig.run(1.0, 0.8, steering=side * 0.6)
    largest = max(abs(command.wheel_angle) for command in encoded)
    assert 9.0 < largest <= layout.WHEEL_ANGLE_LIMIT[codec.Variant.DBW1_2024]
