"""A car that is commanded an acceleration: what it is asked for, and that mass and drag are reckoned in one place."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import vehicles
from tests.ports.interface_bench import HELD, NEUTRAL
from tests.vehicle.whole_car import LOT
from vve_sumo.physical_constants import AIR_DENSITY, GRAVITY
from vve_sumo.plant.car import Car
from vve_sumo.vehicle.actuation import Actuation, Pedals
from vve_sumo.vehicle.effective_deceleration import effective_deceleration, of_model
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import (
    HANDS_OFF,
    AccelerationLimits,
    ActuationCommand,
    DriverInputs,
    Gear,
    InterfaceConfig,
    load,
)
from vve_sumo.vehicle.motion_control import MotionCommand

FUSION = vehicles.FUSION
CALIBRATION, VEHICLE = FUSION.calibration, FUSION.vehicle
STEP = 0.02
EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "own_car" / "campus_shuttle.toml"


def actuation() -> Actuation:
    return Actuation(CALIBRATION, VEHICLE.brake_delay, VEHICLE.brake_lag)


@given(st.floats(-9.0, 3.0), st.floats(-0.1, 0.1), st.floats(2.1, 30.0))
def test_the_inverse_model_is_newtons_law(acceleration, slope, speed):
    """Above the speed of creep: m a = F - m g sin - rolling - air."""
    force = CALIBRATION.force(acceleration, slope, speed)
    drag = CALIBRATION.rolling_resistance * CALIBRATION.mass * GRAVITY
    drag += 0.5 * AIR_DENSITY * CALIBRATION.drag_area * speed**2
    net = force - CALIBRATION.mass * GRAVITY * slope - drag
    assert net / CALIBRATION.mass == pytest.approx(acceleration, abs=1e-9)


@given(st.floats(-3.5, 2.0), st.floats(3.0, 20.0))
def test_pedals_and_acceleration_say_the_same(acceleration, speed):
    """The pedals are those that give the acceleration by the calibrated car, which is asked for beside them."""
    law = actuation()
    law.step(1.0, 0.0, 0.0, STEP)
    pedals = law.step(acceleration, speed, 0.0, STEP)
    force = CALIBRATION.drive_force(pedals.throttle, speed) - CALIBRATION.brake_force(pedals.brake_torque)
    force += CALIBRATION.creep(speed) - CALIBRATION.drag(speed)
    given_ = force / CALIBRATION.mass
    if pedals.brake_torque > 0.0 or pedals.throttle > 0.0:
        assert given_ == pytest.approx(pedals.acceleration, abs=1e-9)
    else:
        assert abs(given_ - pedals.acceleration) <= 0.1 + 1e-9, "the band in which no pedal is pressed"


def test_a_held_car_is_asked_for_what_its_holding_torque_gives():
    law = actuation()
    for _ in range(50):
        pedals = law.step(0.0, 0.0, 0.0, STEP)
    assert pedals.brake_torque > 0.0
    assert pedals.acceleration == pytest.approx(-pedals.brake_torque / CALIBRATION.brake_gain)


@given(st.lists(st.tuples(st.floats(-6.0, 3.0), st.floats(0.0, 20.0)), max_size=30))
def test_a_stop_never_asks_for_driving(steps):
    law = actuation()
    law.step(1.0, 0.0, 0.0, STEP)
    for acceleration, speed in steps:
        assert law.step(acceleration, speed, 0.0, STEP, brakes_only=True).acceleration <= 0.0


def test_a_stop_without_a_speed_asks_for_no_less_than_was_wanted():
    pedals = actuation().without_speed(2.4, -0.05)
    assert pedals.acceleration == -2.4
    assert pedals.throttle == 0.0


def test_what_a_wire_can_ask_for_is_the_same_in_both_ways():
    facts = load(FUSION.interface).facts
    assert facts.largest_brake_torque(550.0) == facts.brake_torque_limit
    other = replace(facts, acceleration_limits=AccelerationLimits(-4.0, 2.0))
    assert other.largest_brake_torque(550.0) == 2200.0


def test_the_simulated_car_gives_an_acceleration_by_itself_on_a_grade_and_lets_the_foot_win():
    wire = InterfaceConfig("generic", {"mapping_file": str(EXAMPLE)})
    parameters = vehicles.parameters(noise=0.0, grade=math.atan(0.03), interface=wire)
    car = Car(parameters, (0.0, 0.0, 0.0), LOT, 1_447_000_000.0, np.random.SeedSequence(1))
    interface, ticks = load(wire), 0

    def drive(seconds: float, command: ActuationCommand, driver: DriverInputs = HANDS_OFF) -> float:
        """Return the mean acceleration [m/s2]."""
        nonlocal ticks
        before, begun = car.truth().speed, ticks
        while ticks - begun < round(seconds / STEP):
            ticks += 1
            car.step(ticks * STEP, interface.encode(command), driver)
        return (car.truth().speed - before) / seconds

    drive(2.0, HELD._replace(gear=Gear.DRIVE))
    assert car.interface.gear is Gear.DRIVE
    wanted = NEUTRAL._replace(enable=True, acceleration=1.0)
    drive(2.0, wanted)
    assert drive(2.0, wanted) == pytest.approx(1.0, abs=0.05), "uphill, against drag"
    drive(1.0, wanted._replace(acceleration=-1.5))
    assert drive(1.0, wanted._replace(acceleration=-1.5)) == pytest.approx(-1.5, abs=0.05)
    assert drive(0.2, wanted, DriverInputs(brake_pedal=0.33)) < 0.0, "a foot brakes whatever is asked for"
    assert car.brake_torque > 3000.0


def test_how_hard_the_car_brakes_counts_with_what_the_wire_takes():
    model = replace(FUSION, interface=InterfaceConfig("generic", {"mapping_file": str(EXAMPLE)}))
    assert of_model(model).value == of_model(FUSION).value, "the wire takes 6 m/s2, the car gives 5.9"
    facts = replace(load(model.interface).facts, acceleration_limits=AccelerationLimits(-4.0, 2.0))
    weak = effective_deceleration(VEHICLE, CALIBRATION, FUSION.limits, facts)
    assert weak.value == 4.0
    assert weak.limiting.part == "wire"
    assert "takes -4 m/s2" in weak.shortfall_text()


def test_no_car_is_asked_for_more_braking_than_its_brakes_give():
    """The wire takes 6 m/s2; the brakes of this one give 3 m/s2, and a fault asks for all there is."""
    wire = InterfaceConfig("generic", {"mapping_file": str(EXAMPLE)})
    weak = replace(VEHICLE, brake_torque_limit=3.0 * CALIBRATION.brake_gain)
    gateway = Gateway(weak, CALIBRATION, interface=load(wire))
    assert gateway._motion.hardest == pytest.approx(-3.0)
    reader = load(wire)
    gateway._motion.step = lambda *_: MotionCommand(Pedals(9e3, 0.0, -9.0), -9.0, 0.0, ())
    said = [reader.commanded(frame) for frame in gateway.step(0.0, None, ()).frames]
    (asked,) = [each.acceleration for each in said if each is not None and not math.isnan(each.acceleration)]
    assert asked == pytest.approx(-3.0, abs=1e-3)
