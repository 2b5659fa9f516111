"""What the gateway makes of a car that somebody else drives: a driver in a rehearsal, after a drive, or taking over."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from tests.vehicle.car import CALIBRATION, FUSION, PERIOD, Car, Rig
from tests.vehicle.test_evidence import wheels
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import Gear

S = ArmingState


@dataclass
class Driven(Car):
    """A car with a driver, who accelerates it as he likes once `foot` says so; None leaves the pedals to the kit."""

    foot: float | None = None  #: [m/s2]

    def _advance(self, dt: float, torque_wish: float) -> None:
        if self.foot is None:
            super()._advance(dt, torque_wish)
        else:
            self.speed = max(self.speed + self.foot * dt, 0.0)
            self._torque = 550.0 * max(-self.foot, 0.0)


def rehearsing() -> Rig:
    """A rehearsal that follows its setpoints, of a car that stands in drive with the driver's foot on the brake."""
    car = Driven(gear=Gear.DRIVE, driver_brake=True)
    rig = Rig(car, Gateway(FUSION, CALIBRATION, period=PERIOD, shadow=True))
    rig.step(command=OperatorCommand.ENGAGE)
    rig.step(command=OperatorCommand.GO)
    car.driver_brake, car.foot = False, 0.0
    return rig


def test_in_a_rehearsal_the_driver_does_other_things_than_the_setpoints_say():
    """Setpoints brake and steer, the driver accelerates straight on: neither brakes nor steering are to blame."""
    rig = rehearsing()
    rig.car.wheel_angle = rig.car._angle_wish = 0.01
    rig.run(0.1)
    rig.car.foot = 2.0
    statuses = rig.run(2.0, -1.0, steering=0.1)
    assert rig.car.speed == pytest.approx(4.0, rel=0.01)
    assert {(status.state, status.reasons) for status in statuses} == {(S.ENGAGED, ("shadow",))}


def test_after_a_drive_the_driver_drives_off_without_being_told_that_the_car_does_not_follow():
    rig = Rig(Driven())
    rig.cruise(3.0)
    rig.car.override = True
    rig.step()
    rig.car.override = False
    assert rig.step(command=OperatorCommand.DISARM).state is S.DISARMED
    rig.car.foot = 2.0
    reasons = {reason for status in rig.run(1.0) for reason in status.reasons}
    assert reasons == {"not_standing", "driver_not_on_brake"}


def test_a_driver_may_brake_as_hard_as_the_car_can():
    """Wheels fall silent at 8 m/s; the driver brakes, and two seconds later they say zero: the car stands."""
    rig = Rig(Driven())
    rig.cruise(8.0)
    rig.car.override, rig.car.silent = True, set(wheels(0.0))
    rig.car.foot = -6.0
    rig.run(2.0, None)
    assert rig.car.speed == 0.0
    rig.car.silent = set()
    rig.run(0.4, None)
    assert rig.gateway.done


def test_wheels_that_fall_to_zero_are_no_standstill_of_a_car_that_nobody_brakes():
    """Nor do they become one in a quarter of a minute; once its driver brakes, they do."""
    rig = Rig(Driven())
    rig.cruise(6.0)
    rig.car.override = True
    rig.step()
    rig.car.override, rig.car.foot, rig.car.forged = False, 0.0, wheels(0.0)
    rig.run(15.0, None)
    assert rig.car.speed > 5.0
    assert not rig.gateway.monitor.standstill.certain
    rig.car.driver_brake, rig.car.foot = True, -3.0
    rig.run(3.0, None)
    assert rig.gateway.monitor.standstill.certain


def taken_over() -> Rig:
    """A car under way whose driver has taken it over and is on no pedal any more."""
    rig = Rig(Driven())
    rig.cruise(3.0)
    rig.car.override = True
    rig.step()
    rig.car.override, rig.car.foot = False, 0.0
    return rig


def test_a_taken_over_car_that_rolls_with_no_foot_on_a_pedal_calls_for_its_driver():
    rig = taken_over()
    statuses = rig.run(3.0)
    assert (statuses[-1].state, rig.car.speed > 2.0) == (S.FAULT, True)
    assert "driver_needed" in statuses[-1].reasons


def test_who_takes_over_a_second_time_is_called_as_late_as_the_first():
    rig = taken_over()
    assert "driver_needed" in rig.run(3.0)[-1].reasons
    rig.step(command=OperatorCommand.DISARM)
    rig.car.foot, rig.car.driver_brake = -3.0, True
    rig.run(2.0)
    rig.step(command=OperatorCommand.ENGAGE)
    rig.car.foot, rig.car.driver_brake = None, False
    rig.run(1.0)
    rig.step(command=OperatorCommand.GO)
    assert rig.run(2.5, 1.5)[-1].state is S.ENGAGED
    rig.car.override = True
    rig.step()
    rig.car.override, rig.car.foot = False, 0.0
    statuses = rig.run(3.0)
    first = next(n for n, status in enumerate(statuses) if "driver_needed" in status.reasons)
    assert first * PERIOD == pytest.approx(1.0, abs=0.1)


def test_a_taken_over_car_that_stands_calls_for_nobody():
    rig = taken_over()
    rig.car.foot, rig.car.driver_brake = -3.0, True
    rig.run(2.0)
    rig.car.foot, rig.car.driver_brake = 0.0, False
    statuses = rig.run(5.0)
    assert (statuses[-1].state, rig.car.speed) == (S.FAULT, 0.0)
    assert not any("driver_needed" in status.reasons for status in statuses)


def test_who_drives_on_after_a_drive_that_the_gateway_ended_is_not_called():
    """A second node that commands is a fault of its own; nobody has taken over a car that the gateway commanded."""
    rig = Rig(Driven())
    rig.cruise(3.0)
    rig.step(command=OperatorCommand.STOP)
    while rig.step(0.0).state is not S.READY:
        assert rig.now < 40.0
    rig.car.gear, rig.car._wanted, rig.car.foot = Gear.DRIVE, Gear.DRIVE, 2.0
    rig.run(1.0)
    rig.car.foot = 0.0
    statuses = [rig.step(extra=(Frame(min(layout.COMMAND_IDS), bytes(8)),)) for _ in range(150)]
    assert (statuses[-1].state, rig.car.speed > 1.0) == (S.FAULT, True)
    assert not any("driver_needed" in status.reasons for status in statuses)


def test_who_takes_over_a_car_that_was_held_for_long_is_not_left_at_once():
    """Ten seconds without a sign of motion count from when the driver has the car."""
    rig = Rig()
    rig.cruise(2.0)
    rig.car.silent = set(wheels(0.0))
    assert rig.run(14.0)[-1].state is S.STOPPED
    rig.car.override = True
    assert rig.step().state is S.FAULT
    rig.run(5.0)
    assert not rig.gateway.done


def test_wheels_that_stay_the_same_after_a_step_at_no_time_still_say_that_the_car_moves():
    rig = Rig()
    rig.cruise(5.0)
    rig.car.override, rig.car.forged = True, wheels(5.0)
    rig.gateway.step(math.nan, None, rig.car.reports())
    rig.run(12.0, None)
    assert not rig.gateway.done


def test_a_rehearsal_enables_nothing_clears_nothing_and_asks_for_no_gear():
    """All the way through a drive, of a car in park for which the gateway would ask for drive, and at last for park."""
    rig = Rig(gateway=Gateway(FUSION, CALIBRATION, period=PERIOD, shadow=True))
    acts = {5: OperatorCommand.ENGAGE, 20: OperatorCommand.GO, 40: OperatorCommand.STOP}
    states = set()
    for tick in range(100):
        states.add(rig.step(1.0, command=acts.get(tick)).state)
        brake, throttle, steering, gear = rig.commands()
        assert not any(command.enable or command.clear for command in (brake, throttle, steering))
        assert (gear.gear, gear.clear) == (Gear.NONE, False)
    assert {S.READY, S.ENGAGED, S.STOPPED} <= states


def test_in_a_rehearsal_a_driver_who_takes_over_changes_nothing():
    rig = rehearsing()
    rig.car.override = True
    statuses = rig.run(0.5)
    assert {(status.state, status.reasons) for status in statuses} == {(S.ENGAGED, ("shadow",))}


def test_a_rehearsal_that_calls_for_the_driver_still_says_that_it_is_one():
    """The wheels are silent, and the receiver alone says that the car stands."""
    rig = rehearsing()
    rig.car.silent = set(wheels(0.0))
    assert {"shadow", "standstill_uncertain", "driver_needed"} <= set(rig.run(4.0)[-1].reasons)


def test_who_says_go_to_a_car_that_goes_is_not_told_that_it_is_too_early():
    rig = Rig()
    rig.cruise(3.0)
    assert rig.step(command=OperatorCommand.GO).reasons == ()


def test_a_driver_at_the_pedals_hides_nothing_else():
    rig = Rig()
    rig.cruise(3.0)
    rig.car.driver_brake = True
    assert rig.step(sequence=1).reasons == ("driver_on_brake", "setpoint_out_of_order")


def test_a_driver_at_the_pedals_is_granted_no_acceleration_from_the_first_step_on():
    rig = Rig()
    rig.cruise(3.0)
    rig.run(0.5, 1.5)
    rig.car.driver_brake = True
    assert all(status.acceleration <= 0.0 for status in rig.run(0.3, 1.5))


def test_a_driver_who_takes_over_while_the_kit_is_being_enabled_has_the_car():
    rig = Rig(Car(gear=Gear.DRIVE, driver_brake=True))
    rig.run(0.1)
    rig.step(command=OperatorCommand.ENGAGE)
    rig.car.override = True
    status = rig.step()
    assert (status.state, status.reasons) == (S.FAULT, ("driver_override",))


def test_an_override_of_old_that_a_confirmed_kit_still_reports_ends_the_drive():
    """The gear module holds on to it after the command, while the others confirm; nobody moved the lever."""
    rig = Rig()
    rig.car.forged = {layout.GEAR_REPORT: codec.encode(codec.GearReport(Gear.PARK, override=True))}
    rig.run(0.1)
    begun = rig.now
    assert rig.step(command=OperatorCommand.ENGAGE).state is S.ENGAGED
    while rig.step().state is S.ENGAGED:
        assert rig.now - begun < 0.5
    assert rig.now - begun > 0.4
    assert rig.step().state in (S.STOPPING, S.STOPPED)
