"""One law for an agent and for a controller: keeps the desired speed, stops 5 m before the nearest detection."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.conftest import REPOSITORY
from vve_sumo.bridges.observed_numbers import FEATURES, ObservationEncoder
from vve_sumo.controller import Controller, Tuning, load
from vve_sumo.values import ControlCommand, Observation, Vehicle

PLACE = {feature.name: number for number, feature in enumerate(FEATURES)}
TICKS_PER_ACTION = 5


def acceleration(observed: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the action of a vector."""
    gap, speed = (float(observed[PLACE[name]]) for name in ("ahead_1_m", "speed_mps"))
    allowed = math.sqrt(max(0.0, 2.0 * 2.0 * (gap - 6.0)))
    wanted = min(float(observed[PLACE["desired_speed_mps"]]), allowed)
    return np.array([min(max(1.5 * (wanted - speed), -3.4), 1.5) if wanted > 0.5 else -2.0], np.float32)


class Law:
    """The law as a controller, which decides every fifth tick and steers as another controller does."""

    def __init__(self, vehicle: Vehicle, own: Controller) -> None:
        self._encoder, self._own, self._calls = ObservationEncoder(vehicle), own, 0

    def step(self, observation: Observation) -> ControlCommand:
        if self._calls % TICKS_PER_ACTION == 0:
            self._wanted = float(acceleration(self._encoder.encode(observation))[0])
        self._calls += 1
        return ControlCommand(self._own.step(observation).steering, self._wanted, note="agent")


def make(vehicle: Vehicle, tuning: Tuning) -> Law:
    """Return the controller."""
    return Law(vehicle, load("brake_at", vehicle, tuning, [REPOSITORY / "controllers"]))
