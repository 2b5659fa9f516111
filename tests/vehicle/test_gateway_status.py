"""What the gateway says of the car and of itself to whoever shows or records it."""

from __future__ import annotations

import math

import pytest

from tests.vehicle.car import CALIBRATION, FUSION, PERIOD, Car, Rig
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import Gear
from vve_sumo.vehicle.limits import Limits
from vve_sumo.vehicle.standstill import REST_TIME, WHEEL_REST

S = ArmingState


def test_before_the_first_report_nothing_is_known():
    gateway = Gateway(FUSION, CALIBRATION, period=PERIOD)
    assert math.isnan(gateway.monitor.wheel_speed)
    assert math.isnan(gateway.monitor.measured_steering)
    assert (gateway.monitor.gear, gateway.monitor.sequence, gateway.monitor.last_dbw_report) == ("none", -1, -math.inf)
    assert gateway.done is False


def test_speed_steering_gear_and_sequence_are_those_of_the_newest_reports():
    rig = Rig()
    rig.step()
    assert rig.gateway.monitor.gear == "park"
    rig.cruise(5.0)
    rig.run(2.0, steering=0.05)
    reported = rig.car.speed, rig.car.wheel_angle / FUSION.steering_ratio
    rig.step(steering=0.05)
    assert (rig.gateway.monitor.wheel_speed, rig.gateway.monitor.measured_steering) == pytest.approx(reported, abs=0.01)
    assert rig.gateway.monitor.gear == "drive"
    assert rig.gateway.monitor.sequence == rig.sequence


def test_the_kit_was_last_heard_when_its_last_report_came():
    rig = Rig()
    rig.cruise(5.0)
    heard = rig.now
    assert rig.gateway.monitor.last_dbw_report == pytest.approx(heard)
    rig.car.silent |= {frame.id for frame in rig.car.reports()}
    rig.run(0.5)
    assert rig.gateway.monitor.last_dbw_report == pytest.approx(heard)


def test_in_shadow_every_status_says_so_and_no_other_does():
    for shadow in (True, False):
        rig = Rig(gateway=Gateway(FUSION, CALIBRATION, period=PERIOD, shadow=shadow))
        assert all(("shadow" in status.reasons) is shadow for status in rig.run(0.5))


def test_a_drive_is_over_once_the_car_stands_and_not_before():
    """The driver takes over at 5 m/s and lets the car roll, then brakes it to rest."""
    rig = Rig()
    rig.cruise(5.0)
    assert rig.gateway.done is False
    rig.car.override = True
    rig.step()
    assert rig.run(2.0)[-1].state is S.FAULT
    assert rig.car.speed > 1.0
    assert rig.gateway.done is False
    rig.car.driver_brake = True
    rig.run(15.0)
    assert rig.car.speed == 0.0
    assert rig.gateway.done is True


#: From 0.30 m/s the receiver's mean, with a lag of 0.1 s, falls below 0.05 m/s at rest: 0.1 ln(30 / 5) [s].
AVERAGED = 0.18


def test_a_car_stands_for_a_while_before_its_drive_is_over():
    """Wheels that have only just come to zero may roll again."""
    rig = Rig()
    rig.cruise(2.0)
    rig.car.override = rig.car.driver_brake = True
    while rig.car.speed >= WHEEL_REST:
        rig.step()
        assert rig.gateway.done is False
    steps = 0
    while not rig.gateway.done:
        rig.step()
        steps += 1
    assert REST_TIME - PERIOD <= steps * PERIOD <= REST_TIME + AVERAGED + 3 * PERIOD


def test_who_does_nothing_is_not_told_that_it_is_too_early():
    rig = Rig()
    assert not any("go_too_early" in status.reasons for status in rig.run(0.2))
    assert "go_too_early" in rig.step(command=OperatorCommand.GO).reasons
    assert "go_too_early" not in rig.step().reasons


def test_a_car_that_was_never_engaged_has_no_drive_to_be_over():
    rig = Rig(Car(gear=Gear.DRIVE))
    rig.run(5.0)
    assert rig.gateway.done is False


@pytest.mark.parametrize(("late", "elapsed"), [(0.5, 2 * PERIOD), (0.0, 0.0), (-0.01, 0.0)])
def test_a_step_at_a_wrong_time_brakes_for_two_periods_at_most(late: float, elapsed: float) -> None:
    """Half a second late, in the same instant as the step before, before it: the braking rises with the rig's jerk."""
    rig = Rig()
    rig.cruise(6.0)
    rig.run(1.0)
    output = rig.gateway.step(rig.now + late, None, rig.car.reports())
    assert "timer_gap" in output.status.reasons
    assert output.status.acceleration == pytest.approx(-Limits().critical_jerk * elapsed, abs=1e-6)


def test_in_shadow_a_driver_who_drives_is_no_objection() -> None:
    rig = Rig(Car(driver_brake=True), Gateway(FUSION, CALIBRATION, period=PERIOD, shadow=True))
    rig.step(command=OperatorCommand.ENGAGE)
    rig.run(3.0)
    assert rig.step(command=OperatorCommand.GO).reasons == ("shadow",)
