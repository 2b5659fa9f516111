"""Monitors that the car brakes as hard as commanded and does not accelerate without a command.

It compares the car's gain in speed with the largest that the weakest car still sound would have under the commanded
pedals. The result is reason codes; the reason for a command is not known here.
"""

from __future__ import annotations

import math
from collections import deque
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
SATELLITE_EXCESS: Final = 0.10  # and by the receiver's speed this much at least, where it is known [m/s]
MIN_SPEED: Final = 0.1  # slower than this the car counts as standing, and `HoldMonitor` judges it [m/s]
# A car that was standing under a holding torque and is faster than this for this long is not held by its brakes.
ROLL_SPEED: Final = 0.08  # of the fastest wheel; reports resolve 13 mm/s on a Fusion [m/s]
SATELLITE_ROLL_SPEED: Final = (
    0.10  # of the receiver's averaged speed; a standing receiver's stays below half of it [m/s]
)
ROLL_TIME: Final = 0.1  # [s]
# A body that rocks after a stop moves the receiver to and fro, so its speed has to last longer [s].
SATELLITE_ROLL_TIME: Final = 0.3
ACCELERATION_LAG: Final = 0.1  # of the measured acceleration [s]


class BrakeMonitor:
    """A one-sided cumulative sum (Page, Biometrika 41, 1954) of the car's excess speed.

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
        self._told: deque[tuple[float, float]] = deque(((-math.inf, 0.0),))  # time and brake torque
        self._torque = 0.0  # that should be there by now [N m]
        self._push = 0.0  # acceleration by the engine that there may still be [m/s2]
        self._acceleration = 0.0  # measured [m/s2]
        self._speeds: tuple[float, float] | None = None  # by wheels and receiver, a step ago
        self._by_wheels = True
        self._excess = self._satellite_excess = 0.0

    def step(
        self, elapsed: float, pedals: Pedals, wheels: float, satellite: float, grade: float, others_brake: bool = False
    ) -> list[str]:
        """Reason codes at speeds `wheels` and `satellite` [m/s], NaN where one is not known, on `grade` [rad].

        Where the DBW controller brakes by itself (`others_brake`), how hard it does is not known: the car may only not
        gain speed.
        """
        by_wheels = math.isfinite(wheels)
        if by_wheels is not self._by_wheels:
            self._by_wheels, self._speeds = by_wheels, None
        wheels = wheels if by_wheels else satellite  # without wheels the receiver is all there is
        before, self._speeds = self._speeds, (wheels, satellite)
        self._follow(elapsed, pedals)
        if before is None or elapsed <= 0.0 or not wheels > MIN_SPEED:
            self._excess = self._satellite_excess = 0.0
            return []
        wheels_before, satellite_before = before
        gained, satellite_gained = wheels - wheels_before, satellite - satellite_before
        allowed = self._most(wheels, grade, 0.0 if others_brake else self._torque) * elapsed
        self._excess = added(self._excess, gained - allowed)
        self._satellite_excess = added(self._satellite_excess, satellite_gained - allowed)
        if math.isfinite(gained):
            share = elapsed / (ACCELERATION_LAG + elapsed)
            self._acceleration += (gained / elapsed - self._acceleration) * share
        # An excess in one of two speeds alone points at frozen wheels or a wrong receiver, not at the brakes.
        confirmed = self._satellite_excess > SATELLITE_EXCESS or not math.isfinite(satellite)
        if not (self._excess > SPEED_EXCESS and confirmed):
            return []
        braked = self._torque > 0.0 or others_brake
        return ["brake_not_following" if braked else "drive_not_following"]

    def _follow(self, elapsed: float, pedals: Pedals) -> None:
        """Advance the modelled brake torque and engine acceleration under the commanded `pedals`."""
        torque, throttle = pedals
        self._time += elapsed
        queue, oldest = self._told, self._time - self._delay
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
        self._rolls_long, self._moves_long = Debounce(ROLL_TIME), Debounce(SATELLITE_ROLL_TIME)

    def reset(self) -> None:
        """Forget the past: the gateway does not hold the car."""
        self._was_at_rest = False
        self._rolls_long.reset()
        self._moves_long.reset()

    def step(self, now: float, held: bool, stands: bool, fastest_wheel: float, satellite: float) -> bool:
        """Return whether the car rolls off although it is `held`; that it `stands` is certain.

        `fastest_wheel` and the receiver's averaged speed `satellite` are in m/s, NaN where unknown. Either is enough.
        """
        self._was_at_rest = held and (self._was_at_rest or stands)
        rolls = self._rolls_long.step(now, self._was_at_rest and fastest_wheel > ROLL_SPEED)
        moves = self._moves_long.step(now, self._was_at_rest and abs(satellite) > SATELLITE_ROLL_SPEED)
        return rolls or moves


def added(excess: float, more: float) -> float:
    """Return the cumulative sum, never below zero; NaN and +inf add nothing, -inf resets it to zero."""
    if more == -math.inf:
        return 0.0
    if not math.isfinite(more):
        return excess
    total = excess + more
    return 0.0 if total < 0.0 else total
