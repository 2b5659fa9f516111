"""Monitors that the car brakes as hard as commanded and does not accelerate without a command.

It compares the car's gain in speed with the largest that the weakest car still sound would have under the commanded
pedals. The result is reason codes; the reason for a command is not known here.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from vve_sumo.physical_constants import GRAVITY
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.setpoint_validation import Debounce

# A car that is 15 % heavier than declared, and whose brakes give 10 % less torque, has a share of 0.78.
BRAKE_SHARE: Final = 0.75  # of the commanded torque that the brakes must give at least
# Acceleration allowed beyond the modelled one, for an unknown grade of 1.5 % and the noise of the speeds [m/s2].
ACCELERATION_MARGIN: Final = 0.25
# Factor by which the car's drive force may be larger, and fade more slowly, than calibrated.
PUSH_SHARE: Final = 1.5
PUSH_MARGIN: Final = 0.3  # [m/s2]
SPEED_EXCESS: Final = 0.25  # faster than the weakest car that is still sound by this is a fault [m/s]
GNSS_EXCESS: Final = 0.10  # and by the receiver's speed this much at least, where it is known [m/s]
MIN_SPEED: Final = 0.1  # slower than this the car counts as standing, and `HoldMonitor` judges it [m/s]
# A car that was standing under a holding torque and is faster than this for this long is not held by its brakes.
ROLL_SPEED: Final = 0.08  # of the fastest wheel; reports resolve 13 mm/s on a Fusion [m/s]
GNSS_ROLL_SPEED: Final = 0.10  # of the receiver's averaged speed; a standing receiver's stays below half of it [m/s]
ROLL_TIME: Final = 0.1  # [s]
# A body that rocks after a stop moves the receiver to and fro, so its speed has to last longer [s].
GNSS_ROLL_TIME: Final = 0.3
ACCELERATION_LAG: Final = 0.1  # of the measured acceleration [s]


@dataclass(slots=True)
class SpeedExcess:
    """A one-sided cumulative sum (Page, Biometrika 41, 1954) of how much faster one measured speed is than allowed.

    While the speed is unknown, what it may gain is added up, so that nothing is forgotten of a sensor that fails every
    other time.
    """

    value: float = 0.0  #: [m/s]
    _speed: float = math.nan  # when it was last known [m/s]
    _elapsed: float = 0.0  # since then [s]
    _allowed: float = 0.0  # gain since then [m/s]

    def step(self, elapsed: float, speed: float, most: float) -> float:
        """Take a speed after `elapsed` [s] in which at most the acceleration `most` [m/s2] was allowed.

        Returns the acceleration since the speed was last known [m/s2]. A speed of NaN or infinity is unknown; NaN is
        returned for it, and for the first that is known.
        """
        self._elapsed += elapsed
        self._allowed = max(self._allowed + most * elapsed, -self._speed)  # nothing brakes to below zero
        if not math.isfinite(speed):
            return math.nan
        gained = speed - self._speed
        acceleration = gained / self._elapsed
        self.value = cusum_step(self.value, gained - self._allowed)
        self._speed, self._elapsed, self._allowed = speed, 0.0, 0.0
        return acceleration


class BrakeMonitor:
    """Judges the excess of the wheels' and the receiver's speed over the largest of a sound car.

    `step` is called once a gateway step with the pedals commanded at the step before.
    """

    def __init__(self, vehicle: Vehicle, calibration: Calibration) -> None:
        self._calibration = calibration
        self._delay, self._lag = vehicle.brake_delay, vehicle.brake_lag
        self._push_lag = PUSH_SHARE * calibration.drive_lag
        self.reset()

    def reset(self) -> None:
        """Forget the past: the gateway does not command the car."""
        self._time = 0.0  # its own, by the steps' lengths [s]
        self._commanded_torques: deque[tuple[float, float]] = deque(((-math.inf, 0.0),))  # time and brake torque
        self._torque = 0.0  # that should be there by now [N m]
        self._push = 0.0  # acceleration by the engine that there may still be [m/s2]
        self._acceleration = 0.0  # measured [m/s2]
        self._speed = 0.0  # by the wheels if they are known, else by the receiver; if neither is, the last one [m/s]
        self._excess, self._gnss_excess = SpeedExcess(), SpeedExcess()

    def step(
        self, elapsed: float, pedals: Pedals, wheels: float, gnss: float, grade: float, others_brake: bool = False
    ) -> list[str]:
        """Reason codes at speeds `wheels` and `gnss` [m/s] on `grade` [rad]; NaN is a speed not known or not believed.

        Where the DBW controller brakes by itself (`others_brake`), how hard it does is not known: the car may only not
        gain speed.
        """
        self._follow(elapsed, pedals)
        wheels_known, gnss_known = math.isfinite(wheels), math.isfinite(gnss)
        if wheels_known or gnss_known:
            self._speed = wheels if wheels_known else gnss
        if elapsed <= 0.0 or self._speed <= MIN_SPEED:
            self._excess, self._gnss_excess = SpeedExcess(), SpeedExcess()
            return []
        most = self._most(self._speed, grade, 0.0 if others_brake else self._torque)
        acceleration, gnss_acceleration = (
            self._excess.step(elapsed, wheels, most), self._gnss_excess.step(elapsed, gnss, most)
        )  # fmt: skip
        if acceleration != acceleration:
            acceleration = gnss_acceleration
        if math.isfinite(acceleration):
            self._acceleration += (acceleration - self._acceleration) * elapsed / (ACCELERATION_LAG + elapsed)
        # An excess in one of two speeds alone points at frozen wheels or a wrong receiver, not at the brakes.
        if wheels_known:
            fast = self._excess.value > SPEED_EXCESS
            confirmed = not gnss_known or self._gnss_excess.value > GNSS_EXCESS
        else:
            fast, confirmed = self._gnss_excess.value > SPEED_EXCESS, True
        if not (fast and confirmed):
            return []
        braked = self._torque > 0.0 or others_brake
        return ["brake_not_following" if braked else "drive_not_following"]

    def _follow(self, elapsed: float, pedals: Pedals) -> None:
        """Advance the modelled brake torque and engine acceleration under the commanded `pedals`."""
        torque, throttle, _acceleration = pedals
        self._time += elapsed
        queue, oldest = self._commanded_torques, self._time - self._delay
        queue.append((self._time, torque))
        while len(queue) > 1 and queue[1][0] <= oldest:
            queue.popleft()
        if elapsed > 0.0:
            self._torque += (queue[0][1] - self._torque) * elapsed / (self._lag + elapsed)
        if throttle > 0.0:
            self._push = math.inf
            return
        if self._push == math.inf:
            # The throttle was just released: the acceleration of now bounds what the engine may still give.
            self._push = PUSH_SHARE * max(self._acceleration, 0.0) + PUSH_MARGIN
        self._push -= self._push * elapsed / (self._push_lag + elapsed)

    def _most(self, speed: float, grade: float, torque: float) -> float:
        """Largest acceleration that a sound car may have now [m/s2]."""
        calibration = self._calibration
        force = PUSH_SHARE * calibration.creep(speed) - calibration.drag(speed)
        force -= BRAKE_SHARE * calibration.brake_force(torque)
        return force / calibration.mass - GRAVITY * math.sin(grade) + self._push + ACCELERATION_MARGIN


class HoldMonitor:
    """Monitors that a car that stands under a commanded holding torque goes on standing."""

    def __init__(self) -> None:
        self._was_at_rest = False
        self._rolls_long, self._moves_long = Debounce(ROLL_TIME), Debounce(GNSS_ROLL_TIME)

    def reset(self) -> None:
        """Forget the past: the gateway does not hold the car."""
        self._was_at_rest = False
        self._rolls_long.reset()
        self._moves_long.reset()

    def step(self, now: float, held: bool, stands: bool, fastest_wheel: float, gnss: float) -> bool:
        """Return whether the car rolls off although it is `held`; that it `stands` is certain.

        `fastest_wheel` and the receiver's averaged speed `gnss` are in m/s, NaN where unknown. Either is enough.
        """
        self._was_at_rest = held and (self._was_at_rest or stands)
        rolls = self._rolls_long.step(now, self._was_at_rest and fastest_wheel > ROLL_SPEED)
        moves = self._moves_long.step(now, self._was_at_rest and abs(gnss) > GNSS_ROLL_SPEED)
        return rolls or moves


def cusum_step(excess: float, more: float) -> float:
    """Return the cumulative sum, never below zero; NaN and +inf add nothing, -inf resets it to zero."""
    if more == -math.inf:
        return 0.0
    if not math.isfinite(more):
        return excess
    total = excess + more
    return 0.0 if total < 0.0 else total
