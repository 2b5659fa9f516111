"""Nominal driving with stop and go, bends and slopes, of a car that is not as calibrated: not one event."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import takewhile

import pytest

from controllers import follow_and_stop
from tests import vehicles
from tests.exhaustive import with_slow
from tests.vehicle.closed_loop import ClosedLoop, Slowing, straight, winding
from vve_sumo.controller import Controller
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState, ControlCommand, Observation
from vve_sumo.vehicle.model import IDEAL, Imperfections


class StopAndGo:
    """A controller that drives as another one does, and comes to rest once in every `period` [s]."""

    def __init__(self, other: Controller, period: float, deceleration: float) -> None:
        self._other, self._period, self._deceleration = other, period, deceleration

    def step(self, observation: Observation) -> ControlCommand:
        command = self._other.step(observation)
        if observation.time % self._period < 0.55 * self._period:
            return command
        return replace(command, acceleration=min(command.acceleration, -self._deceleration))


CARS = {
    "light, strong brakes, downhill": {"mass_factor": 0.85, "brake_gain_factor": 1.1, "grade": -math.atan(0.03)},
    "heavy, weak brakes, downhill": {"mass_factor": 1.15, "brake_gain_factor": 0.9, "grade": -math.atan(0.03)},
    "heavy, weak brakes, uphill": {"mass_factor": 1.15, "brake_gain_factor": 0.9, "grade": math.atan(0.03)},
    "light, strong brakes, uphill": {"mass_factor": 0.85, "brake_gain_factor": 1.1, "grade": math.atan(0.03)},
    "slippery": {"friction": 0.5},
}


@pytest.mark.thorough
@pytest.mark.parametrize("car", with_slow(CARS, lambda car: car.startswith("heavy")))
@pytest.mark.parametrize(("speed", "period", "deceleration"), [(8.0, 14.0, 3.4), (5.0, 9.0, 1.5)])
def test_a_minute_of_stop_and_go_is_without_an_event(car, speed, period, deceleration):
    parameters = vehicles.parameters(**CARS[car])
    controller = StopAndGo(follow_and_stop.make(parameters.vehicle, {}), period, deceleration)
    loop = ClosedLoop(winding(800.0), speed, parameters=parameters, controller=controller)
    begun, stops, fastest, moved = False, 0, 0.0, False
    for ticked in takewhile(lambda ticked: ticked.now < 60.0, loop.ticks()):
        state, reasons = ticked.status.state, ticked.status.reasons
        begun |= state is ArmingState.ENGAGED and not reasons
        if begun:
            assert (state, reasons) == (ArmingState.ENGAGED, ()), ticked
        stops += moved and ticked.truth.speed == 0.0
        moved, fastest = ticked.truth.speed > 0.0, max(fastest, ticked.truth.speed)
    assert stops >= 3
    assert fastest > 0.8 * speed


@pytest.mark.parametrize("imperfections", [IDEAL, vehicles.FUSION.measured], ids=["ideal", "measured"])
def test_a_car_that_stops_before_its_late_fixes_do_has_no_frozen_wheels(imperfections: Imperfections) -> None:
    """Fixes are 0.25 s older than they say: as the wheels come to rest from 3 m/s2 the receiver still says 0.75 m/s."""
    parameters = vehicles.parameters(hidden_delay=0.25, imperfections=imperfections)
    controller = Slowing(follow_and_stop.make(parameters.vehicle, {}), 7.0, 3.0)
    loop = ClosedLoop(straight(), 5.0, parameters=parameters, controller=controller)
    fastest, stood = 0.0, 0.0
    for ticked in takewhile(lambda ticked: ticked.now < 12.0, loop.ticks()):
        fastest = max(fastest, ticked.truth.speed)
        if fastest > 4.5 and ticked.truth.speed == 0.0:
            stood += PERIOD
        assert ticked.status.state is not ArmingState.STOPPING, ticked.status.reasons
    assert stood > 1.0
