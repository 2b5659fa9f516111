"""The driver takes over: a real override has the car at once, a false one stops it."""

from __future__ import annotations

import math

import pytest

from tests.vehicle.car import PERIOD, Car, Rig, enabled
from tests.vehicle.forged_reports import ENABLED_BRAKE, ENABLED_STEERING, ENABLED_THROTTLE, forged
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.interface import Gear

S = ArmingState


@pytest.mark.thorough(witnesses=2)
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
        rig.step(command=OperatorCommand.STOP)
        rig.run(1.0 if before == "stopping" else 7.0)
    counter = rig.commands()[0].counter
    status = rig.step(1.0, extra=(codec.encode(report),))
    assert (status.state, status.brake_torque, status.throttle) == (S.FAULT, 0.0, 0.0)
    assert "driver_override" in status.reasons
    assert enabled(rig) == {False}
    assert {command.counter for command in rig.commands()[:3]} == {(counter + 1) % 256}
    taken_over = set(status.reasons)
    for status in rig.run(1.0, acceleration=2.0, command=OperatorCommand.ENGAGE):
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
    assert ("brakes_latched" in status.reasons) is (report is UNCONFIRMED[0])
    while (status := rig.step(1.0)).state is S.STOPPING:
        assert enabled(rig) == {True}
        assert "driver_needed" in status.reasons or rig.car.speed < 0.1
    assert status.state is S.STOPPED
    assert rig.car.speed == 0.0


@pytest.mark.parametrize(
    ("stopped", "gear", "confirmed"),
    [
        (False, Gear.DRIVE, False),
        (False, Gear.PARK, True),
        (False, Gear.NEUTRAL, True),
        (True, Gear.DRIVE, False),
        (True, Gear.PARK, False),  # the gateway asks for it
        (True, Gear.NEUTRAL, True),
    ],
)
def test_a_shifter_in_another_gear_than_the_gateways_confirms_its_override(stopped, gear, confirmed):
    rig = Rig()
    rig.cruise(5.0)
    if stopped:
        rig.car.shift_time = math.inf
        rig.step(command=OperatorCommand.STOP)
        while rig.step(0.0).state is not S.STOPPED:
            assert rig.now < 60.0
    status = rig.step(0.0, extra=(codec.encode(codec.GearReport(gear, override=True)),))
    assert ("driver_override" in status.reasons) is confirmed
    assert ("override_unconfirmed" in status.reasons) is not confirmed


def test_a_held_car_whose_brakes_a_foot_has_taken_is_not_let_go():
    """The foot was strong enough to latch the brake module, whose reports do not say so."""
    rig = Rig()
    rig.stand_by()
    rig.car.foreign_torque = 3000.0
    rig.run(1.0)
    rig.car.foreign_torque = 0.0
    rig.run(1.0)
    status = rig.step(1.0, command=OperatorCommand.GO)
    assert {"brakes_latched", "go_too_early"} <= set(status.reasons)
    statuses = rig.run(2.0, 1.0)
    assert {status.throttle for status in statuses} == {0.0}
    assert rig.car.speed == 0.0


#: the brake module says that the driver has taken the brakes, and its pedal's sensor that nobody is on it
BRAKE_CLAIM = codec.encode(ENABLED_BRAKE._replace(override=True, enabled=False))


def test_an_override_is_confirmed_by_brakes_that_nobody_commands():
    rig = Rig()
    rig.cruise(10.0)
    rig.car.foreign_torque = 1500.0
    while "driver_inferred" not in rig.step(0.0).reasons:
        assert rig.car.speed > 8.0
    status = rig.step(0.0, extra=(BRAKE_CLAIM,))
    assert (status.state, status.throttle) == (S.FAULT, 0.0)
    assert "driver_override" in status.reasons


def test_brakes_that_another_node_commands_confirm_no_override():
    rig = Rig()
    rig.cruise(10.0)
    rig.car.foreign_torque = 3000.0
    writer = Frame(min(layout.COMMAND_IDS), bytes(8))
    for _ in range(25):
        status = rig.step(0.0, extra=(writer, BRAKE_CLAIM))
    assert "driver_override" not in status.reasons
    assert {"another_writer", "override_unconfirmed"} <= set(status.reasons)
    assert status.state is S.STOPPING


def test_a_brake_torque_that_may_be_frozen_confirms_no_override():
    """It is that of the last braking, to the bit."""
    rig = Rig()
    rig.cruise(10.0)
    rig.run(1.0, -2.0)
    rig.car.forged = {frame.id: frame for frame in rig.car.reports() if frame.id == layout.BRAKE_INFO}
    while "driver_inferred" not in rig.step(0.0).reasons:
        assert rig.car.speed > 5.0
    status = rig.step(0.0, extra=(BRAKE_CLAIM,))
    assert status.state is S.STOPPING
    assert "override_unconfirmed" in status.reasons
    assert "driver_override" not in status.reasons


def test_one_override_that_is_confirmed_is_enough():
    rig = Rig()
    rig.cruise(10.0)
    hands = ENABLED_STEERING._replace(override=True, enabled=False, torque=-5.0)
    claimed = ENABLED_THROTTLE._replace(override=True, enabled=False)
    status = rig.step(1.0, extra=(codec.encode(hands), codec.encode(claimed)))
    assert status.state is S.FAULT
    assert "driver_override" in status.reasons


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
    seen = [rig.step(2.0, command=OperatorCommand.GO) for _ in range(round(8.0 / PERIOD))]
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
    status = rig.step(1.0, command=OperatorCommand.DISARM)
    assert (status.state, status.reasons) == (S.FAULT, ("driver_override",))
    assert rig.step(1.0, command=OperatorCommand.DISARM).state is S.DISARMED


def test_an_override_that_the_act_does_not_clear_is_not_fought():
    rig = Rig(Car(override=True))
    latched = codec.encode(ENABLED_BRAKE._replace(override=True, enabled=False))
    rig.car.forged = forged(latched)
    rig.step(command=OperatorCommand.ENGAGE)
    statuses = rig.run(1.0)
    assert statuses[-1].reasons == ("handshake_timeout",)
