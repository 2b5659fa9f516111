"""An interface whose own code raises: a reason code that stops the car, with what the code said."""

from __future__ import annotations

import pytest

from tests.vehicle.whole_car import PARAMETERS, VEHICLE, WholeCar
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.gateway import Gateway


class Faulty(DataspeedDbw1):
    """Encodes and decodes as it should until it is broken."""

    broken = False
    deaf = False

    def decode(self, frame):
        if self.deaf:
            raise IndexError("no such byte")
        return super().decode(frame)

    def encode(self, command):
        if self.broken:
            raise OverflowError("int too large to convert")
        return super().encode(command)


@pytest.fixture
def car() -> WholeCar:
    faulty = Faulty()
    whole = WholeCar(gateway=Gateway(VEHICLE, calibration=PARAMETERS.calibration, interface=faulty))
    whole.engage()
    for _ in range(150):
        whole.step(1.5)
    return whole


def interface(car: WholeCar) -> Faulty:
    return car.gateway._interface  # type: ignore[return-value]


def test_an_encoder_that_raises_stops_the_car_and_says_why(car):
    interface(car).broken = True
    assert car.step(1.5).state is ArmingState.ENGAGED  # the step in which it happens sends nothing
    assert car.frames == ()
    status = car.step(1.5)
    assert status.state is ArmingState.STOPPING
    assert "interface_raised" in status.reasons
    assert car.gateway.interface_error.startswith("OverflowError: int too large to convert (test_interface_raises.py")


def test_the_watchdog_brakes_the_car_that_nothing_is_sent_to(car):
    interface(car).broken = True
    for _ in range(10):
        car.step(1.5)
    assert car.car.interface.watchdog_braking
    assert car.car.truth().acceleration < -1.0


def test_an_encoder_that_raises_once_is_a_stop_by_the_gateway_itself(car):
    interface(car).broken = True
    car.step(1.5)
    interface(car).broken = False
    status = car.step(1.5)
    assert "interface_raised" in status.reasons
    for _ in range(400):
        status = car.step(1.5)
    assert car.car.truth().speed == 0.0
    assert not car.car.interface.watchdog_braking
    assert car.gateway.interface_error == ""


def test_a_decoder_that_raises_stops_the_car_and_says_why(car):
    interface(car).deaf = True
    status = car.step(1.5)
    assert status.state is ArmingState.STOPPING
    assert "interface_raised" in status.reasons
    assert car.gateway.interface_error.startswith("IndexError: no such byte (test_interface_raises.py")
