"""A car that is held, and brakes that do not hold it: said within half a second of its first motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicle.whole_car import LOT, PARAMETERS, PERIOD, WholeCar
from vve_sumo.plant.car import ActuatorFaults, Car, CarOutput
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.brake_monitor import GNSS_ROLL_SPEED, GNSS_ROLL_TIME, ROLL_SPEED, ROLL_TIME, HoldMonitor
from vve_sumo.vehicle.interface import HANDS_OFF, DriverInputs

S = ArmingState
ALARM = {"driver_needed", "brake_not_following"}


class CutOff(Car):
    """A car whose bus can be cut: it hears no command, and no report of it is heard."""

    cut = False

    def step(self, until: float, frames: tuple[Frame, ...], driver: DriverInputs = HANDS_OFF) -> CarOutput:
        output = super().step(until, () if self.cut else frames, driver)
        return CarOutput([], output.packets) if self.cut else output


def cut_off_car() -> WholeCar:
    return WholeCar(CutOff(PARAMETERS, (0.0, 0.0, 0.0), LOT, 1_447_000_000.0, np.random.SeedSequence(1)))


def held() -> WholeCar:
    """Engaged, in drive and held, with sound brakes."""
    whole = WholeCar()
    for _ in range(10):
        whole.step()
    whole.step(command=OperatorCommand.ENGAGE)
    while whole.step().reasons != ("waiting_for_go",):
        assert whole.tick < 200
    for _ in range(50):
        whole.step()
    return whole


def alarmed(whole: WholeCar) -> tuple[float, float]:
    """Time from the first motion to the alarm [s], and the way driven until then [m]."""
    begun, moved = whole.distance, math.inf
    for number in range(400):
        status = whole.step(0.0)
        if moved == math.inf and whole.car.truth().speed > 0.01:
            moved = number * PERIOD
        if ALARM & set(status.reasons):
            return number * PERIOD - moved, whole.distance - begun
    return math.inf, whole.distance - begun


@pytest.mark.parametrize(("share", "within"), [(0.0, 0.5), (0.05, 0.8)])
def test_a_car_held_on_dead_brakes_raises_the_alarm(share, within):
    """Brakes that still hold a little let the car gain speed more slowly; its way until the alarm is the same."""
    whole = held()
    whole.car.actuator_faults = ActuatorFaults(brake_share=share)
    time, way = alarmed(whole)
    assert time < within
    assert way < 0.1


def test_brakes_that_are_dead_from_the_start_raise_the_alarm_before_go():
    whole = WholeCar()
    whole.car.actuator_faults = ActuatorFaults(brake_share=0.0)
    for _ in range(10):
        whole.step()
    whole.step(command=OperatorCommand.ENGAGE)
    time, way = alarmed(whole)
    assert time < 0.5
    assert way < 0.1


def test_a_car_that_rolls_after_it_came_to_rest_raises_the_alarm():
    """At rest after a stop, before the gear is in park."""
    whole = WholeCar()
    whole.engage()
    for _ in range(150):
        whole.step(1.0)
    status = whole.step(command=OperatorCommand.STOP)
    while status.state is not S.STOPPED:
        status = whole.step()
    assert whole.car.truth().speed == 0.0
    whole.car.actuator_faults = ActuatorFaults(brake_share=0.0)
    time, way = alarmed(whole)
    assert time < 0.5
    assert way < 0.1


def test_sound_brakes_hold_without_a_word():
    whole = held()
    for _ in range(500):
        assert whole.step().reasons == ("waiting_for_go",)


@pytest.mark.parametrize("lasts", [0.12, 0.25, 0.5])
def test_a_dead_bus_is_no_fault_of_brakes_while_the_watchdog_brakes(lasts):
    whole = cut_off_car()
    whole.engage()
    for _ in range(300):
        whole.step(1.0 if whole.car.truth().speed < 5.0 else 0.0)
    seen = set()
    for number in range(400):
        whole.car.cut = number * PERIOD < lasts
        status = whole.step(0.0)
        seen |= set(status.reasons)
    assert whole.car.interface.controller.fault, "the watchdog did brake"
    assert whole.car.truth().speed == 0.0
    assert status.state is not S.ENGAGED
    assert "brake_not_following" not in seen
    assert "drive_not_following" not in seen
    assert "driver_inferred" not in seen, "the watchdog's braking is nobody's foot"


# The monitor alone.

STEP = 0.02


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.floats(0.0, 0.2), st.floats(-0.2, 0.2)), max_size=60))
def test_by_brute_force(steps):
    """It rolls if wheels or receiver were faster than their bound for their time, held ever since it stood."""
    monitor = HoldMonitor()
    for index, (held_now, stands, wheel, gnss) in enumerate(steps):
        expected = False
        for begin in range(index + 1):
            past = steps[begin : index + 1]
            stood = [n for n in range(index + 1) if steps[n][1] and all(held for held, _, _, _ in steps[n : index + 1])]
            lasted = (index - begin) * STEP + 1e-9
            rolls = lasted >= ROLL_TIME and all(speed > ROLL_SPEED for _, _, speed, _ in past)
            moves = lasted >= GNSS_ROLL_TIME and all(abs(mean) > GNSS_ROLL_SPEED for *_, mean in past)
            expected |= (rolls or moves) and bool(stood) and min(stood) <= begin
        assert monitor.step(index * STEP, held_now, stands, wheel, gnss) is expected
        assert not expected or held_now


def test_a_reset_forgets_that_it_stood():
    monitor = HoldMonitor()
    monitor.step(0.0, True, True, 0.0, 0.0)
    monitor.reset()
    assert not any(monitor.step(0.02 * n, True, False, 1.0, math.nan) for n in range(20))
