"""The gateway commands each car within its own limits: those of the vehicle, its calibration, its wire and its rig."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.vehicle.car import CALIBRATION, FUSION, PERIOD, Car, Rig
from vve_sumo.errors import ConfigError
from vve_sumo.values import ArmingState, Vehicle
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.dataspeed.layout import WHEEL_ANGLE_LIMIT, WHEEL_RATE_LIMIT, Variant
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import InterfaceFacts
from vve_sumo.vehicle.limits import Limits

S = ArmingState


def rig_of(vehicle: Vehicle = FUSION, variant: Variant = Variant.DBW1_2024, **arguments: object) -> Rig:
    gateway = Gateway(vehicle, CALIBRATION, period=PERIOD, interface=DataspeedDbw1(variant), **arguments)
    return Rig(Car(variant=variant), gateway)


def turned(rig: Rig) -> tuple[float, float]:
    """Turn a crawling car as far as it goes; the greatest road-wheel angle granted, and the wire's angle [rad]."""
    rig.engage()
    granted = wire = 0.0
    for tick in range(500):
        status = rig.step(0.8 if tick < 20 else 0.0, steering=2.0)
        if status.state is not S.ENGAGED:
            break
        granted, wire = max(granted, status.steering), max(wire, rig.commands()[2].wheel_angle)
    return granted, wire


@pytest.mark.parametrize("variant", list(Variant))
def test_a_vehicle_with_a_small_steering_limit_is_turned_no_farther(variant):
    granted, wire = turned(rig_of(replace(FUSION, steering_limit=0.1), variant))
    assert granted == pytest.approx(0.1, abs=1e-9)
    assert wire == pytest.approx(0.1 * FUSION.steering_ratio, abs=0.01)


@pytest.mark.parametrize("variant", list(Variant))
def test_a_wire_that_ends_before_the_vehicle_does_bounds_the_angle(variant):
    """A steering ratio of 60: the wire's largest steering-wheel angle turns the wheels by 0.16 rad at most."""
    vehicle = replace(FUSION, steering_ratio=60.0, steering_limit=0.5)
    granted, wire = turned(rig_of(vehicle, variant))
    assert granted <= WHEEL_ANGLE_LIMIT[variant] / 60.0 + 1e-9
    assert granted > 0.05
    assert wire <= WHEEL_ANGLE_LIMIT[variant]


@pytest.mark.parametrize("variant", list(Variant))
@pytest.mark.parametrize(("limit", "expected"), [(0.2, "vehicle"), (5.0, "wire")])
def test_the_rate_of_the_steering_wheel_is_the_smaller_one_of_vehicle_and_wire(variant, limit, expected):
    vehicle = replace(FUSION, steering_rate_limit=limit)
    rig = rig_of(vehicle, variant)
    rig.engage()
    rate = rig.commands()[2].wheel_rate
    wanted = limit * FUSION.steering_ratio if expected == "vehicle" else WHEEL_RATE_LIMIT[variant]
    assert rate == pytest.approx(wanted, abs=math.radians(4.0))
    assert rate <= wanted + 1e-9


class WeakWire(DataspeedDbw1):
    """A wire that takes less brake torque than any car."""

    @property
    def facts(self) -> InterfaceFacts:
        return replace(super().facts, brake_torque_limit=900.0)


@pytest.mark.parametrize(
    ("declared", "calibrated", "interface"),
    [(900.0, 3250.0, DataspeedDbw1), (3250.0, 900.0, DataspeedDbw1), (3250.0, 3250.0, WeakWire)],
)
def test_brakes_that_do_not_answer_are_pressed_as_hard_as_car_calibration_and_wire_allow(
    declared, calibrated, interface
):
    vehicle, calibration = (replace(them, brake_torque_limit=most)
                            for them, most in ((FUSION, declared), (CALIBRATION, calibrated)))  # fmt: skip
    rig = Rig(gateway=Gateway(vehicle, calibration, period=PERIOD, interface=interface(Variant.DBW1_2024)))
    rig.cruise(4.0)
    rig.car.brake_gain = 0.0
    statuses = [rig.step(command=OperatorCommand.STOP), *rig.run(1.0)]
    assert "brake_not_following" in statuses[-1].reasons
    assert rig.commands()[0].value == pytest.approx(900.0, abs=0.5)


def test_a_car_that_is_declared_slow_to_steer_may_lag_behind_by_as_much():
    """0.59 rad/s for 0.6 s beside the 0.15 rad that every car may be off: 0.3 rad are no fault of its steering."""
    vehicle = replace(FUSION, steering_rate_limit=0.59, steering_delay=0.3, steering_lag=0.3)
    rig = Rig(gateway=Gateway(vehicle, CALIBRATION, period=PERIOD, interface=DataspeedDbw1(Variant.DBW1_2024)))
    rig.cruise(1.0)
    rig.car.steering_stuck = True
    statuses = rig.run(1.5, steering=0.3)
    assert max(status.steering for status in statuses) == pytest.approx(0.3)
    assert not any("steering_not_following" in status.reasons for status in statuses)


@pytest.mark.parametrize("period", [0.1001, 1.0, math.nan])
def test_a_step_longer_than_the_wires_patience_is_refused(period):
    with pytest.raises(ConfigError, match=rf"lets go after 0\.1 s, but a step takes {period:g} s$"):
        Gateway(FUSION, CALIBRATION, period=period, interface=DataspeedDbw1(Variant.DBW1_2024))


def test_a_step_as_long_as_the_wires_patience_is_taken():
    Gateway(FUSION, CALIBRATION, period=0.1, interface=DataspeedDbw1(Variant.DBW1_2024))


def test_a_drive_that_has_not_begun_is_not_over():
    """A car that stands, disarmed, since the gateway's start."""
    rig = Rig()
    assert not rig.gateway.done
    rig.run(5.0)
    assert not rig.gateway.done


def test_a_rig_with_a_gentler_stop_is_stopped_gently():
    rig = rig_of(limits=Limits(stop_deceleration=1.0))
    rig.cruise(6.0)
    rig.step(command=OperatorCommand.STOP)
    moving = [status for status in rig.run(3.0, None) if rig.car.speed > 0.5]
    assert min(status.acceleration for status in moving) == pytest.approx(-1.0, abs=1e-9)


def test_the_default_step_is_twenty_milliseconds():
    """Two steps late is a fault, one is not."""
    for late, faulty in ((0.039, False), (0.0415, True)):
        rig = Rig(gateway=Gateway(FUSION, CALIBRATION))
        rig.run(1.0)
        output = rig.gateway.step(rig.now + late, None, rig.car.reports())
        assert ("timer_gap" in output.status.reasons) is faulty


def test_what_an_operator_does_has_the_words_that_a_record_keeps():
    assert [command.value for command in OperatorCommand] == ["engage", "go", "stop", "stop_by_page", "end", "disarm"]


def test_a_steering_wheel_that_is_mounted_askew_points_straight_where_it_was_calibrated_to():
    """Two radians of it, counted the wrong way, would be 0.27 rad of the wheels and a steering that is stuck."""
    rig = rig_of(wheel_bias=2.0)
    rig.car.wheel_angle = rig.car._angle_wish = 2.0
    rig.engage()
    statuses = rig.run(1.0)
    assert {(status.state, status.reasons) for status in statuses} == {(S.ENGAGED, ())}
    assert statuses[-1].steering == pytest.approx(0.0, abs=1e-3)
