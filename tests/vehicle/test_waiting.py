"""How long the gateway waits before it says or does something, what it commands meanwhile, and what it forgets.

Times are counted by hand; a gateway that has driven before is compared with one that has not.
"""

from __future__ import annotations

import math

import pytest

from tests.vehicle.car import FUSION, PERIOD, Car, Rig
from tests.vehicle.test_evidence import wheels
from vve_sumo.values import ArmingState, FallbackPath
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.interface import Gear

S = ArmingState
#: Of a moment that is found by stepping: the step itself, and the one that notices [s].
STEPS = 3 * PERIOD


def test_zero_wheels_without_a_receiver_call_for_the_driver_after_three_seconds():
    """From 8.5 m/s half the brakes need 7 s to bring the car to rest: until then standstill is uncertain."""
    rig = Rig()
    rig.cruise(8.5)
    rig.car.forged = wheels(0.0)
    begun = rig.now + PERIOD
    while "standstill_uncertain" not in rig.step(None).reasons:
        assert rig.now - begun < 5.0
    assert rig.now - begun == pytest.approx(3.0, abs=STEPS)
    assert "driver_needed" in rig.step(None).reasons


def test_frozen_wheels_count_for_five_seconds_and_then_the_driver_for_ten():
    """The receiver says that the car stands, frozen wheels that it moves: they tell nothing after 5 s."""
    rig = Rig()
    rig.cruise(4.0)
    rig.car.forged = wheels(rig.car.speed)
    frozen = rig.now + PERIOD
    while rig.car.speed > 0.0:
        rig.step(-1.0)
    assert rig.now - frozen < 4.0
    rig.car.override = rig.car.driver_brake = True
    while not rig.gateway.done:
        rig.step(-1.0)
        assert rig.now - frozen < 20.0
    assert rig.now - frozen == pytest.approx(5.0 + 10.0, abs=STEPS)


def unknown_speed(rig: Rig, acceleration: float) -> float:
    """Brake torque for a deceleration where nobody knows the speed [N m]: mass and creep count, drag does not."""
    calibration = rig.gateway._motion.actuation._calibration
    return calibration.brake_torque(calibration.mass * -acceleration + calibration.creep_force)


def test_a_speed_that_is_known_counts_drag():
    rig = Rig()
    rig.cruise(8.0)
    status = rig.run(1.0, command=OperatorCommand.STOP)[-1]
    assert not math.isclose(status.brake_torque, unknown_speed(rig, status.acceleration), rel_tol=1e-3)
    assert status.brake_torque <= FUSION.brake_torque_limit


def test_frozen_wheels_tell_no_speed_and_no_way_along_the_path():
    rig = Rig()
    rig.cruise(8.0)
    fallback_path = FallbackPath(1.0, (0.02,) * 60)
    # A speed that the receiver agrees with, and the same to the last bit.
    rig.car.forged = wheels(rig.car.speed)
    while rig.step(0.0, speed=rig.car.speed, fallback_path=fallback_path).state is S.ENGAGED:
        pass
    held = rig.gateway.monitor.measured_steering
    statuses = rig.run(1.0, fallback_path=fallback_path)
    assert statuses[-1].reasons[0] == "wheel_speeds_frozen"
    assert statuses[-1].brake_torque >= unknown_speed(rig, statuses[-1].acceleration) * (1.0 - 1e-9)
    assert [status.steering for status in statuses[10:]] == pytest.approx([held] * 40, abs=1e-3)


def test_wheels_that_the_receiver_contradicts_tell_no_speed():
    rig = Rig()
    rig.cruise(8.0)
    while (status := rig.step(0.0, speed=rig.car.speed + 4.0)).state is S.ENGAGED:
        pass
    assert status.reasons[0] == "speed_mismatch"
    status = rig.run(1.0)[-1]
    assert status.brake_torque == pytest.approx(unknown_speed(rig, status.acceleration), rel=1e-9)


@pytest.mark.parametrize("how", ["zero", "silent"])
def test_wheels_that_say_nothing_of_a_moving_car_tell_no_speed(how):
    """There is no receiver any more that could contradict them."""
    rig = Rig()
    rig.cruise(8.0)
    if how == "zero":
        rig.car.forged = wheels(0.0)
    else:
        rig.car.silent = set(wheels(0.0))
    status = rig.run(1.0, None)[-1]
    assert status.brake_torque == pytest.approx(unknown_speed(rig, status.acceleration), rel=1e-9)


def test_wheels_that_say_zero_of_a_moving_car_tell_no_way_along_the_path():
    rig = Rig()
    rig.cruise(8.0)
    fallback_path = FallbackPath(1.0, tuple(0.002 * n for n in range(30)))
    rig.run(0.2, fallback_path=fallback_path)
    rig.car.forged = wheels(0.0)
    statuses = rig.run(1.0, None)
    stopping = [status for status in statuses if status.state is S.STOPPING]
    assert stopping[0].reasons[0] == "setpoint_expired"
    assert [status.steering for status in stopping[5:]] == pytest.approx([stopping[5].steering] * len(stopping[5:]))


def test_a_car_that_rolls_to_rest_for_long_needs_no_driver():
    rig = Rig()
    rig.cruise(10.0)
    statuses = [rig.step(command=OperatorCommand.STOP)] + [rig.step() for _ in range(400)]
    assert sum(status.state is S.STOPPING for status in statuses) * PERIOD > 3.5
    assert not any("driver_needed" in status.reasons for status in statuses)


# Steering on the fallback path: the wheels stay straight, so that holding them is told from following a bend.

BEND = FallbackPath(1.0, (0.05,) * 20)
IN_THE_BEND = math.atan(FUSION.wheelbase * 0.05)


def stopping_in_a_bend() -> Rig:
    rig = Rig()
    rig.cruise(3.0)
    rig.run(0.2, fallback_path=BEND)
    rig.car.shift_time = math.inf
    rig.car.steering_stuck, rig.car.wheel_angle = True, 0.0
    rig.step(command=OperatorCommand.STOP, fallback_path=BEND)
    assert rig.run(0.5, None)[-1].steering == pytest.approx(IN_THE_BEND, abs=0.02)
    while not rig.gateway.monitor.standstill.certain:
        rig.step(None)
    return rig


def test_wheels_that_say_zero_of_a_moving_car_do_not_tell_where_on_its_path_it_is():
    rig = Rig()
    rig.cruise(8.0)
    rig.run(0.2, fallback_path=BEND)
    rig.car.steering_stuck, rig.car.wheel_angle = True, 0.0
    rig.car.forged = wheels(0.0)
    statuses = rig.run(1.0, None)
    assert (statuses[-1].state, {status.steering for status in statuses}) == (S.STOPPING, {0.0})


def test_a_car_that_stands_turns_no_wheel():
    rig = stopping_in_a_bend()
    assert rig.step(None).state is S.STOPPING
    status = rig.run(1.0, None)[-1]
    assert (status.state, status.steering) == (S.STOPPED, 0.0)


def test_a_car_that_seems_to_stand_leaves_its_wheels():
    rig = stopping_in_a_bend()
    turned = [rig.step(None).steering for _ in range(4)]
    assert turned == sorted(turned, reverse=True)
    assert turned[0] > turned[-1]


def test_a_car_that_rolls_away_after_it_was_stopped_follows_no_path():
    rig = stopping_in_a_bend()
    while rig.step(None).state is not S.STOPPED:
        pass
    rig.run(1.0, None)
    rig.car.forged = wheels(1.0)
    statuses = rig.run(1.0, None)
    assert {status.state for status in statuses} == {S.STOPPED}
    assert statuses[-1].steering == 0.0


def test_a_car_that_rolls_on_after_it_seemed_to_stand_follows_the_path():
    rig = stopping_in_a_bend()
    rig.run(0.04, None)
    rig.car.forged = wheels(1.0)
    statuses = rig.run(0.5, None)
    assert {status.state for status in statuses} == {S.STOPPING}
    assert statuses[-1].steering == pytest.approx(IN_THE_BEND, abs=0.01)


# What is forgotten.


def driven_and_parked() -> Rig:
    rig = Rig(Car(grade=0.04))
    rig.cruise(3.0)
    rig.step(command=OperatorCommand.STOP)
    while rig.gateway._arming.state is not S.DISARMED:
        rig.step(0.0)
    rig.run(1.0)
    return rig


def test_whoever_engages_again_finds_the_brakes_as_the_first_one_did():
    first, again = Rig(Car(grade=0.04)), driven_and_parked()
    first.run(1.0)
    torques = [[rig.step(command=OperatorCommand.ENGAGE).brake_torque] + [rig.step().brake_torque for _ in range(5)]
               for rig in (first, again)]  # fmt: skip
    assert torques[0] == pytest.approx(torques[1], rel=1e-6)
    assert torques[0][0] < torques[0][-1]


def test_after_parking_the_next_controller_may_count_from_zero():
    rig = Rig()
    rig.engage()
    rig.step(command=OperatorCommand.STOP)
    while rig.step(None).state is not S.DISARMED:
        pass
    rig.sequence = -1
    assert rig.step().state is S.READY
    assert rig.gateway.monitor.sequence == 0


def test_a_fault_before_the_next_drive_says_nothing_of_the_last_one():
    rig = driven_and_parked()
    rig.tick += 10
    status = rig.step()
    assert status.state is S.FAULT
    assert status.reasons[0] == "timer_gap"
    assert "stop_asked" not in status.reasons


def test_a_fault_that_is_acknowledged_is_forgotten():
    rig = Rig()
    rig.run(1.0)
    rig.tick += 10
    rig.step()
    rig.run(0.5)
    assert "timer_gap" in rig.step().reasons
    rig.step(command=OperatorCommand.DISARM)
    assert "timer_gap" not in rig.step().reasons


def test_an_emergency_of_the_drive_before_is_none_of_the_next():
    rig = Rig()
    rig.cruise(3.0)
    rig.run(0.1, -9.0, emergency=True)
    rig.step(command=OperatorCommand.STOP)
    while rig.step().state is not S.READY:
        pass
    rig.stand_by()
    rig.step(command=OperatorCommand.STOP)
    assert rig.run(1.0)[-1].acceleration == -2.4


def test_park_is_waited_for_again_in_the_next_drive():
    """A bus that fails at once: the car stands in park, and is held until a shift on its way would have come out."""
    rig = driven_and_parked()
    assert rig.step().reasons == ("stop_asked",)
    assert rig.step(command=OperatorCommand.ENGAGE).reasons == ("engaging",)
    held = [rig.step(process_faults=("bus_down",))]
    assert held[0].state is S.STOPPED
    while held[-1].state is S.STOPPED:
        held.append(rig.step())
    assert len(held) * PERIOD == pytest.approx(1.0, abs=STEPS)


def test_the_next_drive_begins_with_no_acceleration_and_the_angle_that_the_wheels_have():
    rig = Rig()
    rig.cruise(3.0)
    rig.run(1.0, 1.0, steering=-0.1)
    rig.car.override = True
    rig.step()
    rig.car = Car(x=rig.car.x, y=rig.car.y, heading=rig.car.heading, wheel_angle=0.2 * FUSION.steering_ratio)
    rig.car._angle_wish = rig.car.wheel_angle
    rig.step(command=OperatorCommand.DISARM)
    rig.run(0.5)
    rig.stand_by()
    assert rig.step(2.0, 0.2).steering == pytest.approx(0.2, abs=1e-3)
    assert rig.step(2.0, 0.2, command=OperatorCommand.GO).acceleration == pytest.approx(5.0 * PERIOD)


def test_a_gear_that_did_not_come_is_not_asked_for_after_the_drive():
    rig = Rig(Car(shift_time=math.inf))
    rig.step(command=OperatorCommand.ENGAGE)
    while rig.step().state in (S.ENGAGED, S.STOPPED):
        pass
    for _ in range(10):
        assert rig.step().state is S.READY
        assert rig.commands()[3].gear is Gear.NONE


# What is said of a driver at the pedals.


@pytest.mark.parametrize("wish", [0.5, -0.5])
def test_a_drivers_foot_is_the_reason_of_the_stop_whatever_was_asked(wish):
    rig = Rig()
    rig.cruise(4.0)
    rig.car.driver_brake = True
    status = rig.run(0.5, wish)[-1]
    assert (status.state, status.reasons) == (S.STOPPING, ("driver_on_brake", "driver_inferred"))
