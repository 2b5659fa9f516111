"""How far the car is off its path: what every steering law here works on, sensor and model offsets taken out.

It must not know which law steers.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.path import PathProjection, ReferencePath
from vve_sumo.values import Pose, Vehicle

MIN_SPEED: Final = 1.0  #: below it the direction of motion drowns in the receiver's velocity noise [m/s]
SETTLING_TIME: Final = 1.0  #: of the misalignment estimate [s]: slow beside the steering loop, quick beside a drive
MISALIGNMENT_LIMIT = math.radians(2.0)  #: more than this is a fault of the rig and not for a controller to hide


class Deviation(NamedTuple):
    """Where the rear axle is beside the path, and how it is turned."""

    s: float  #: of the rear axle along the path [m]
    d: float  #: of the rear axle from the path [m], left positive
    heading_error: float  #: course less the path's heading [rad], left positive; 0 on a steady bend
    yaw_rate_error: float  #: yaw rate less what the path asks for [rad/s]
    speed: float  #: [m/s], never negative
    curvature: float  #: of the path where the car will be when the steering answers [1/m], left positive


def steady_sideslip(vehicle: Vehicle, speed: float, curvature: float) -> float:
    """Course less heading at the rear axle on a steady bend [rad]: the slip that its tyres need."""
    rear_load = vehicle.mass * vehicle.front_axle_to_mass / vehicle.wheelbase
    return -rear_load * speed * speed * curvature / vehicle.cornering_stiffness_rear


def steady_steering(vehicle: Vehicle, speed: float, curvature: float) -> float:
    """Road-wheel angle that holds a curvature [rad]: (L + K V^2) times the curvature."""
    return (vehicle.wheelbase + vehicle.understeer_gradient * speed * speed) * curvature


def tyre_response_time(vehicle: Vehicle, speed: float) -> float:
    """How long the rear axle's curvature lags a slowly turning road wheel [s], above walking pace.

    First moment of the single track's impulse response from steering to the rear axle's lateral
    acceleration: the yaw rate's lag, plus the build-up of the rear axle's slip.
    """
    cf, cr = vehicle.cornering_stiffness_front, vehicle.cornering_stiffness_rear
    lf, lr = vehicle.front_axle_to_mass, vehicle.wheelbase - vehicle.front_axle_to_mass
    m, inertia, v = vehicle.mass, vehicle.yaw_inertia, max(speed, MIN_SPEED)
    a11, a12 = -(cf + cr) / (m * v), (cr * lr - cf * lf) / (m * v) - v
    a21, a22 = (cr * lr - cf * lf) / (inertia * v), -(cf * lf * lf + cr * lr * lr) / (inertia * v)
    b1, b2 = cf / m, cf * lf / inertia
    yaw = -(a11 + a22) / (a11 * a22 - a12 * a21) - b2 / (a21 * b1 - a11 * b2)
    return yaw - steady_sideslip(vehicle, v, 1.0) / v


def turned(angle: float) -> float:
    """Return the angle brought into -pi to pi."""
    return math.remainder(angle, math.tau)


class DeviationObserver:
    """Works out the deviation, and learns how the receiver's heading is misaligned with the car.

    A dual-antenna heading is off by the mounting. The receiver's velocity is not: averaged, the sideslip it
    shows less the sideslip that the tyres need is the misalignment.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._misalignment = 0.0
        self._actuator = vehicle.steering_delay + vehicle.steering_lag

    def step(self, pose: Pose, path: ReferencePath, projection: PathProjection, period: float) -> Deviation:
        """Advance by a period [s]; `pose` and `projection` are the rear axle's."""
        speed = max(pose.speed, 0.0)
        slip = steady_sideslip(self._vehicle, speed, projection.curvature)
        if speed > MIN_SPEED:
            residual = math.atan2(pose.lateral_speed, speed) - slip
            learnt = self._misalignment + (residual - self._misalignment) * period / SETTLING_TIME
            self._misalignment = min(max(learnt, -MISALIGNMENT_LIMIT), MISALIGNMENT_LIMIT)
        # A command waits one period on its way and is held for another, half of it on average.
        answer = 1.5 * period + self._actuator + tyre_response_time(self._vehicle, speed)
        return Deviation(
            projection.s,
            projection.d,
            turned(pose.heading + slip + self._misalignment - projection.heading),
            pose.yaw_rate - speed * projection.curvature,
            speed,
            path.at(projection.s + speed * answer).curvature,
        )
