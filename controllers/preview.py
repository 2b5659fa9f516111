"""Steers on the lateral deviation at a preview distance: the Ohio State path-following scheme.

y = h + ls sin(dpsi) is how far off the path a point ls ahead of the rear axle is; the law is PD on y plus the
angle that the bend itself needs (Emirler et al., Int. J. Vehicular Technology 2014, 259465).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from vve_sumo.values import Observation, Vehicle

from .deviation import Deviation, steady_steering


class Gains(NamedTuple):
    """What the law uses at one speed."""

    look_ahead: float  #: preview distance ls [m]
    proportional: float  #: road-wheel angle for each metre of y [rad/m]
    derivative: float  #: road-wheel angle for each m/s of y's rate [rad s/m]


@dataclass(frozen=True, slots=True)
class PreviewTuning:
    """A schedule over speed with three numbers.

    With kp = 2 L / ls^2 the deviation dies out over the way like a second-order system of damping 0.7
    and natural wave number sqrt(2) / ls, whatever the speed (single track, no slip).
    """

    look_ahead_time: float = 0.8  #: ls = this times speed [s]
    look_ahead_least: float = 4.0  #: but never shorter [m]
    derivative_time: float = 0.2  #: derivative over proportional gain [s], against the actuator's lag

    def at(self, vehicle: Vehicle, speed: float) -> Gains:
        """Gains at a speed [m/s]."""
        look_ahead = max(self.look_ahead_least, self.look_ahead_time * speed)
        proportional = 2.0 * steady_steering(vehicle, speed, 1.0) / (look_ahead * look_ahead)
        return Gains(look_ahead, proportional, self.derivative_time * proportional)


class PreviewSteering:
    """PD on the previewed deviation, the bend's own angle fed forward."""

    def __init__(self, vehicle: Vehicle, tuning: PreviewTuning) -> None:
        self._vehicle, self.tuning = vehicle, tuning

    def steer(self, deviation: Deviation, observation: Observation) -> float:
        """Return the road-wheel angle [rad]."""
        look_ahead, proportional, derivative = self.tuning.at(self._vehicle, deviation.speed)
        sine = math.sin(deviation.heading_error)
        previewed = deviation.d + look_ahead * sine
        rate = deviation.speed * sine + look_ahead * deviation.yaw_rate_error
        bend = steady_steering(self._vehicle, deviation.speed, deviation.curvature)
        return bend - proportional * previewed - derivative * rate
