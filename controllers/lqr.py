"""Steers by full state feedback on the lateral error model, its gains from the Riccati equation.

Errors e, e', psi, psi' of the centre of mass (Rajamani, Vehicle Dynamics and Control, 2nd ed., 2.5); gains are
computed when the controller is made, for a table of speeds.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vve_sumo.path import Floats
from vve_sumo.values import Observation, Vehicle

from .deviation import Deviation, steady_steering

SPEEDS = tuple(float(speed) for speed in range(2, 26))  #: at which gains are computed [m/s]
DIGITS: Final = 9  #: gains are rounded, so that the last bits of a linear algebra library never reach a setpoint


def lateral_error_model(vehicle: Vehicle, speed: float) -> tuple[Floats, Floats]:
    """A, shape (4, 4), and B, shape (4, 1), of the errors [e, e', psi, psi'] under a road-wheel angle [rad]."""
    cf, cr = vehicle.cornering_stiffness_front, vehicle.cornering_stiffness_rear
    lf, lr = vehicle.front_axle_to_mass, vehicle.wheelbase - vehicle.front_axle_to_mass
    m, inertia, v = vehicle.mass, vehicle.yaw_inertia, speed
    moment = cf * lf - cr * lr
    a = [
        [0.0, 1.0, 0.0, 0.0],
        [0.0, -(cf + cr) / (m * v), (cf + cr) / m, -moment / (m * v)],
        [0.0, 0.0, 0.0, 1.0],
        [0.0, -moment / (inertia * v), moment / inertia, -(cf * lf * lf + cr * lr * lr) / (inertia * v)],
    ]
    return np.array(a), np.array([[0.0], [cf / m], [0.0], [cf * lf / inertia]])


def gains(vehicle: Vehicle, speed: float, period: float, weights: tuple[float, ...], effort: float) -> Floats:
    """Gains, shape (4,), of the discrete regulator with Q = diag(weights), R = effort, sampled every period [s]."""
    from scipy.linalg import expm, solve_discrete_are

    # Zero-order hold: the exponential of [A B; 0 0] holds both sampled matrices (Van Loan 1978).
    held = np.zeros((5, 5))
    held[:4, :4], held[:4, 4:] = lateral_error_model(vehicle, speed)
    sampled = expm(held * period)
    ad, bd = sampled[:4, :4], sampled[:4, 4:]
    cost = solve_discrete_are(ad, bd, np.diag(weights), np.array([[effort]]))
    solution = np.linalg.solve(effort + bd.T @ cost @ bd, bd.T @ cost @ ad)
    return np.asarray(solution[0], dtype=np.float64)


class LateralRegulator:
    """State feedback, gains interpolated over speed, the bend's own angle fed forward."""

    def __init__(
        self, vehicle: Vehicle, period: float, settling_time: float = 0.8, settling_length: float = 4.0
    ) -> None:
        """The dearer of both, in time [s] or way [m], sets how soon a deviation shall be gone."""
        self._vehicle = vehicle
        self._rear = vehicle.wheelbase - vehicle.front_axle_to_mass
        rows = []
        for speed in SPEEDS:
            way = max(settling_length, settling_time * speed)
            # With cheap control the gain on e tends to sqrt(weight / effort): asked for 2 L / way^2.
            wanted = 2.0 * steady_steering(vehicle, speed, 1.0) / (way * way)
            found = gains(vehicle, speed, period, (wanted * wanted, 0.0, 0.0, 0.0), 1.0)
            rows.append([round(gain, DIGITS) for gain in found.tolist()])
        self._table = rows

    def steer(self, deviation: Deviation, observation: Observation) -> float:
        """Return the road-wheel angle [rad]."""
        speed, psi, psi_rate = deviation.speed, deviation.heading_error, deviation.yaw_rate_error
        sine = math.sin(psi)
        states = (deviation.d + self._rear * sine, speed * sine + self._rear * psi_rate, psi, psi_rate)
        place = min(max(speed - SPEEDS[0], 0.0), len(SPEEDS) - 1.001)
        row = int(place)
        share = place - row
        low, high = self._table[row], self._table[row + 1]
        feedback = 0.0
        for state, below, above in zip(states, low, high, strict=True):
            feedback += state * (below + share * (above - below))
        return steady_steering(self._vehicle, speed, deviation.curvature) - feedback
