"""The gateway while it drives: the car does what was asked for, and every tick sends its frames."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from tests.vehicle.car import CALIBRATION, FUSION, PERIOD, Car, Rig
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.gateway import Gateway

S = ArmingState


def slope(rig: Rig, duration: float, **arguments) -> float:
    """Mean acceleration over the next while [m/s2]."""
    before = rig.car.speed
    rig.run(duration, **arguments)
    return (rig.car.speed - before) / duration


@pytest.mark.thorough
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
            command=(OperatorCommand.ENGAGE, OperatorCommand.STOP, OperatorCommand.DISARM, None)[tick // 50 % 4],
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
