"""Injects faults of the car's own sensors into what they measure, before the drive-by-wire interface reports it.

So these faults show through any interface that reports the sensor. It knows measurements and no frames.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vve_sumo.plant.injected_faults import Due
from vve_sumo.vehicle.interface import BrakeTorque, Measured, WheelSpeeds, YawRate

#: Kinds of fault of a sensor, with the report through which each shows.
SENSOR_KINDS: Final[dict[str, type]] = {
    "wheel_speed_invalid": WheelSpeeds,
    "wheel_speeds_zero": WheelSpeeds,
    "wheel_speeds_scaled": WheelSpeeds,
    "wheel_speeds_frozen": WheelSpeeds,
    "wheel_speeds_noisy": WheelSpeeds,
    "yaw_rate_frozen": YawRate,
    "yaw_rate_biased": YawRate,
    "brake_torque_frozen": BrakeTorque,
    "brake_torque_scaled": BrakeTorque,
}


class SensorFaults:
    """Alters measurements, one after the other."""

    def __init__(self, due: Due, random: np.random.Generator) -> None:
        """`random` is the source of noise."""
        self._due, self._random = due, random
        self._active = due.ever(*SENSOR_KINDS)
        self._wheels: WheelSpeeds | None = None  # frozen
        self._rates: YawRate | None = None  # frozen
        self._brake_torque: float | None = None  # frozen [N m]

    def alter(self, time: float, measured: Measured) -> Measured:
        """Return what the sensors say at `time` in place of what they measured."""
        if not self._active:
            return measured
        return self._alter_brakes(time, self._alter_rates(time, self._alter_speeds(time, measured)))

    def _alter_speeds(self, time: float, measured: Measured) -> Measured:
        """Wheel speeds, and the vehicle's speed that is computed from them."""
        value, wheels, speed = self._due.value, measured.wheels, measured.speed
        stands = value("wheel_speeds_zero", time) is not None
        if (factor := 0.0 if stands else value("wheel_speeds_scaled", time)) is not None:
            wheels, speed = WheelSpeeds(*(factor * wheel for wheel in wheels)), factor * speed
        if (sigma := value("wheel_speeds_noisy", time)) is not None:
            noise = self._random.standard_normal(len(wheels))
            wheels = WheelSpeeds(*(wheel + sigma * float(one) for wheel, one in zip(wheels, noise, strict=True)))
        if value("wheel_speed_invalid", time) is not None:
            wheels = wheels._replace(rear_left=math.nan)
        if value("wheel_speeds_frozen", time) is None:
            self._wheels = None
        else:
            wheels = self._wheels = self._wheels or wheels
        return measured._replace(wheels=wheels, speed=speed)

    def _alter_rates(self, time: float, measured: Measured) -> Measured:
        rates = measured.rates
        if (bias := self._due.value("yaw_rate_biased", time)) is not None:
            rates = rates._replace(yaw=rates.yaw + bias)
        if self._due.value("yaw_rate_frozen", time) is None:
            self._rates = None
        else:
            rates = self._rates = self._rates or rates
        return measured._replace(rates=rates)

    def _alter_brakes(self, time: float, measured: Measured) -> Measured:
        torque = measured.brake_torque
        if (factor := self._due.value("brake_torque_scaled", time)) is not None:
            torque *= factor
        if self._due.value("brake_torque_frozen", time) is None:
            self._brake_torque = None
        else:
            torque = self._brake_torque = torque if self._brake_torque is None else self._brake_torque
        return measured._replace(brake_torque=torque)
