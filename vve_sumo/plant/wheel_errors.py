"""Errors of the simulated vehicle's wheel-speed sensors.

A tone ring that runs off centre passes its sensor at a rate that varies once per revolution. On the Fusion's recordings
that is the largest part of what looks like noise: a sine of the wheel's own frequency, of the same share of the wheel
speed at 40 and at 52 rad/s, and another for each wheel. The rest is taken as jitter in proportion to the speed and the
step of the report. So a wheel at rest has no error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from vve_sumo.plant.noise import white
from vve_sumo.vehicle.interface import WheelSpeeds
from vve_sumo.vehicle.model import Imperfections


class WheelError(NamedTuple):
    """Systematic errors of one wheel, as shares of its speed."""

    runout: float  #: amplitude once per revolution
    larger: float  #: by which it turns faster than a wheel of the mean radius


class WheelErrors:
    """Turns true wheel speeds, one set each `period`, into measured ones."""

    def __init__(self, imperfections: Imperfections, size: float, period: float, seeds: np.random.SeedSequence) -> None:
        """`size` is a factor on all errors; the angles at which the wheels start are drawn from `seeds`."""
        phases, jitter = seeds.spawn(2)
        self._wheels = [WheelError(size * one.runout, size * one.larger) for one in _of_each_wheel(imperfections)]
        self._angles = np.random.Generator(np.random.PCG64(phases)).uniform(0.0, math.tau, len(self._wheels)).tolist()
        self._jitter, self._draws = size * imperfections.wheel_jitter, white(jitter)
        self._quantum = imperfections.wheel_quantum
        self._period = period

    def measured(self, true: WheelSpeeds) -> WheelSpeeds:
        """Return what the sensors measure of the present speeds [rad/s]."""
        return WheelSpeeds(*self._each(true))

    def _each(self, true: WheelSpeeds) -> Iterator[float]:
        for number, (mean, error) in enumerate(zip(true, self._wheels, strict=True)):
            speed = mean * (1.0 + error.larger)
            angle = self._angles[number] = math.remainder(self._angles[number] + self._period * speed, math.tau)
            share = error.runout * math.cos(angle) + self._jitter * next(self._draws)
            yield _in_steps(speed * (1.0 + share), self._quantum)


def _of_each_wheel(of: Imperfections) -> tuple[WheelError, ...]:
    """Return the errors in the order of `WheelSpeeds`; what one side has more the other has less."""
    front, rear = 0.5 * of.wheel_front_right_over_left, 0.5 * of.wheel_rear_right_over_left
    return (
        WheelError(of.wheel_runout_front_left, -front),
        WheelError(of.wheel_runout_front_right, front),
        WheelError(of.wheel_runout_rear_left, -rear),
        WheelError(of.wheel_runout_rear_right, rear),
    )


def _in_steps(value: float, step: float) -> float:
    return step * round(value / step) if step > 0.0 else value
