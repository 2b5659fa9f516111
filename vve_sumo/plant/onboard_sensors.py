"""The simulated vehicle's own sensors: wheels, accelerometers, gyroscope.

They read the motion and change nothing; the interface decides what is reported, how finely and how often.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from vve_sumo.physical_constants import GRAVITY
from vve_sumo.plant.acceleration_errors import AccelerationErrors
from vve_sumo.plant.dynamics import Dynamics
from vve_sumo.plant.wheel_errors import WheelErrors
from vve_sumo.vehicle.interface import Accelerations, Measured, WheelSpeeds, YawRate


class Axles(NamedTuple):
    """Geometry that turns the car's motion into that of its wheels."""

    wheelbase: float  #: [m]
    track: float  #: [m]
    wheel_radius: float  #: rolling [m]


class SensorErrors(NamedTuple):
    """Errors of the sensors other than the gyroscope."""

    wheels: WheelErrors
    accelerations: AccelerationErrors


class OnboardSensors:
    """Turns the motion into measurements, with the errors of the gyroscope and, where given, of the other sensors."""

    def __init__(
        self,
        axles: Axles,
        gyro_noise: float,
        white: Iterator[float],
        gyro_bias: float = 0.0,
        errors: SensorErrors | None = None,
    ) -> None:
        """`gyro_noise` is the standard deviation of the yaw rate, `gyro_bias` its mean [rad/s], `white` its source."""
        self._axles = axles
        self._gyro_bias = gyro_bias
        self._gyro_noise = gyro_noise
        self._white = white
        self._errors = errors

    def measure(self, motion: Dynamics, road_angle: float, wheel_angle: float, brake_torque: float) -> Measured:
        """Return what is measured now, with the next errors.

        `road_angle` is the front wheels', `wheel_angle` the steering wheel's [rad], `brake_torque` the brakes' own
        estimate [N m].
        """
        felt = motion.acceleration + GRAVITY * math.sin(motion.grade)
        yaw_rate = motion.yaw_rate + self._gyro_bias + self._gyro_noise * next(self._white)
        wheels = self._wheels(motion, road_angle)
        accelerations = Accelerations(felt, motion.speed * motion.yaw_rate, GRAVITY)
        if (errors := self._errors) is not None:
            wheels, accelerations = errors.wheels.measured(wheels), errors.accelerations.measured(accelerations)
        return Measured(
            motion.speed,
            motion.acceleration,
            wheels,
            accelerations,
            YawRate(0.0, yaw_rate),
            wheel_angle,
            brake_torque,
        )

    def _wheels(self, motion: Dynamics, road_angle: float) -> WheelSpeeds:
        """Each wheel rolls with the speed of its place on the car along its own plane."""
        wheelbase, track, radius = self._axles
        half = 0.5 * track * motion.yaw_rate
        across = math.sin(road_angle) * (motion.lateral_speed + wheelbase * motion.yaw_rate)
        along = math.cos(road_angle)
        left, right = motion.speed - half, motion.speed + half
        return WheelSpeeds(
            (left * along + across) / radius, (right * along + across) / radius, left / radius, right / radius
        )
