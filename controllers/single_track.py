"""The linear single track beside a path, stepped from tick to tick: what steering requests do to the deviation.

The state is that of a car on a straight path; in a bend the request counts from the angle that the bend itself needs.
It must not know which law steers, nor what is done with the predicted deviation.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

from vve_sumo.values import Vehicle

MIN_SPEED: Final = 1.0  #: of the tyres' model [m/s]: their poles go to infinity at standstill
DAMPING: Final = math.sqrt(0.5)  #: of the washout


class TyreModel(NamedTuple):
    """d/dt [lateral velocity of the mass centre, yaw rate] = [[a11, a12], [a21, a22]] x + [b1, b2] road-wheel angle."""

    a11: float
    a12: float
    a21: float
    a22: float
    b1: float
    b2: float


def tyre_model(vehicle: Vehicle, speed: float) -> TyreModel:
    """Return the linear single track at a speed [m/s] (Rajamani, Vehicle Dynamics and Control, 2nd ed., 2.3)."""
    cf, cr = vehicle.cornering_stiffness_front, vehicle.cornering_stiffness_rear
    lf, lr = vehicle.front_axle_to_mass, vehicle.wheelbase - vehicle.front_axle_to_mass
    m, inertia, v = vehicle.mass, vehicle.yaw_inertia, max(speed, MIN_SPEED)
    moment = cr * lr - cf * lf
    return TyreModel(
        -(cf + cr) / (m * v),
        moment / (m * v) - v,
        moment / (inertia * v),
        -(cf * lf * lf + cr * lr * lr) / (inertia * v),
        cf / m,
        cf * lf / inertia,
    )


def yaw_response_time(vehicle: Vehicle, speed: float) -> float:
    """Return how long the yaw rate lags a slowly turning road wheel [s]: the first moment of its impulse response."""
    a11, a12, a21, a22, b1, b2 = tyre_model(vehicle, speed)
    return -(a11 + a22) / (a11 * a22 - a12 * a21) - b2 / (a21 * b1 - a11 * b2)


class RequestDelay:
    """Returns the steering request that arrives at the wheels: older by a dead time, linear between two ticks."""

    def __init__(self, delay: float, period: float) -> None:
        """`delay` and `period` of the tick [s]."""
        self._whole, self._share = divmod(delay / period, 1.0)
        self._requests: deque[float] = deque(maxlen=int(self._whole) + 2)

    def clear(self, request: float = 0.0) -> None:
        """Let all earlier requests have been this one [rad]."""
        self._requests.extend([request] * (self._requests.maxlen or 0))

    def step(self, request: float) -> float:
        """Put a request in [rad], take the delayed one out [rad]."""
        if not self._requests:
            self.clear()
        self._requests.append(request)
        return self._requests[1] + self._share * (self._requests[0] - self._requests[1])


class LateralModel:
    """Predicts d, heading error and yaw-rate error; both integrals may be washed out.

    With a washout of natural frequency w the predicted d and heading are those of the integrating model behind
    s^2 / (s^2 + 2 D w s + w^2), D = 1 / sqrt(2), written without an integrator: they stay bounded whatever is asked.
    """

    def __init__(self, vehicle: Vehicle, period: float, washout: float, yaw_rate_lag: float) -> None:
        """`period` of the tick [s]; `washout` is w [rad/s], 0 for none.

        `yaw_rate_lag` is the time constant with which a pose's yaw rate is smoothed [s].
        """
        self._vehicle, self._period = vehicle, period
        self._damping, self._stiffness = 2.0 * DAMPING * washout, washout * washout
        self._lag_share = -math.expm1(-period / vehicle.steering_lag) if vehicle.steering_lag > 0.0 else 1.0
        self._smoothing = -math.expm1(-period / yaw_rate_lag) if yaw_rate_lag > 0.0 else 1.0
        # A command waits one tick on its way.
        self._delay = RequestDelay(period + vehicle.steering_delay, period)
        self.start(0.0, 0.0, 0.0, 0.0)

    def start(self, d: float, heading_error: float, yaw_rate_error: float, speed: float) -> None:
        """Begin at a deviation [m], [rad], [rad/s], at a speed [m/s], with the wheels straight."""
        self._delay.clear()
        self._wheel = self._turned = 0.0  # road-wheel angle [rad]; integral of the heading error [rad s]
        self.d = d  #: of the rear axle from the path [m], left positive
        self.heading_error = heading_error  #: course less the path's heading [rad], left positive
        self.yaw_rate_error = yaw_rate_error  #: yaw rate less what the path asks for [rad/s], as a pose has it
        self._yaw_rate = yaw_rate_error
        rear = self._vehicle.wheelbase - self._vehicle.front_axle_to_mass
        self._lateral_speed = rear * yaw_rate_error  # of the mass centre: the rear axle does not slip
        self._d_rate = speed * heading_error - self._damping * d

    def step(self, request: float, speed: float) -> None:
        """Advance by a period at a speed [m/s]; `request` is the road-wheel angle asked for at its beginning [rad]."""
        dt, before = self._period, self._wheel
        self._wheel += (self._delay.step(request) - before) * self._lag_share
        yaw, sideways = self._slip(0.5 * (before + self._wheel), speed)
        damping, stiffness = self._damping, self._stiffness
        heading = self.heading_error
        self.heading_error += (yaw - damping * heading - stiffness * self._turned) * dt
        self._turned += 0.5 * (heading + self.heading_error) * dt
        rate = self._d_rate
        self._d_rate += sideways + (speed * yaw - damping * rate - stiffness * self.d) * dt
        self.d += 0.5 * (rate + self._d_rate) * dt

    def _slip(self, wheel: float, speed: float) -> tuple[float, float]:
        """Advance the tyres; return the mean yaw rate [rad/s] and the change of the rear axle's lateral speed [m/s]."""
        a11, a12, a21, a22, b1, b2 = tyre_model(self._vehicle, speed)
        half, across, yaw = 0.5 * self._period, self._lateral_speed, self._yaw_rate
        # The trapezoidal rule, which is stable however fast the tyres settle.
        right1 = across + half * (a11 * across + a12 * yaw + 2.0 * b1 * wheel)
        right2 = yaw + half * (a21 * across + a22 * yaw + 2.0 * b2 * wheel)
        m11, m12, m21, m22 = 1.0 - half * a11, -half * a12, -half * a21, 1.0 - half * a22
        determinant = m11 * m22 - m12 * m21
        self._lateral_speed = (right1 * m22 - right2 * m12) / determinant
        self._yaw_rate = (m11 * right2 - m21 * right1) / determinant
        self.yaw_rate_error += (self._yaw_rate - self.yaw_rate_error) * self._smoothing
        rear = self._vehicle.wheelbase - self._vehicle.front_axle_to_mass
        sideways = self._lateral_speed - across - rear * (self._yaw_rate - yaw)
        return 0.5 * (yaw + self._yaw_rate), sideways
