"""Whether the car brakes as hard as its brakes are told to, and does not push where nothing was asked.

It compares the car's speed with what the calibrated car would do at the least with the pedals that it was told; it
knows no reason for a command and gives reason codes.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from vve_sumo.values import Vehicle
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.calibration import GRAVITY, Calibration

# Brakes of a car that is 15 % heavier than declared and gives 10 % less torque have a share of 0.78.
BRAKE_SHARE: Final = 0.75  # of the commanded torque that the brakes must give at least
# An unknown grade of 1.5 % and the noise of speeds: the car may gain so much more than it should [m/s2].
ACCELERATION_MARGIN: Final = 0.25
# What the car's drive force may exceed its calibration by, and the time that it takes longer to fade.
PUSH_SHARE: Final = 1.5
PUSH_MARGIN: Final = 0.3  # [m/s2]
SPEED_EXCESS: Final = 0.25  # faster than the weakest car that is still sound by this is a fault [m/s]
SATELLITE_EXCESS: Final = 0.10  # and by the receiver's speed this much at least, where it is known [m/s]
MIN_SPEED: Final = 0.5  # slower than this nothing is judged: creep, holding and the grade are not known well [m/s]
ACCELERATION_LAG: Final = 0.1  # of the measured acceleration [s]


class BrakeMonitor:
    """A one-sided cumulative sum (Page, Biometrika 41, 1954) of the speed that the car has too much.

    `step` is called once a step with the pedals that the car was told at the step before.
    """

    def __init__(self, vehicle: Vehicle, calibration: Calibration) -> None:
        self._calibration = calibration
        self._delay, self._lag = vehicle.brake_delay, vehicle.brake_lag
        self._push_lag = PUSH_SHARE * calibration.drive_lag
        self.reset()

    def reset(self) -> None:
        """Forget the past: the car stands, or somebody else drives it."""
        self._time = 0.0  # its own, by the steps' lengths [s]
        self._told: deque[tuple[float, float]] = deque(((-math.inf, 0.0),))  # time and brake torque
        self._torque = 0.0  # that should be there by now [N m]
        self._push = 0.0  # acceleration by the engine that there may still be [m/s2]
        self._acceleration = 0.0  # measured [m/s2]
        self._speeds: tuple[float, float] | None = None  # by wheels and receiver, a step ago
        self._excess = self._satellite_excess = 0.0

    def step(
        self, elapsed: float, pedals: Pedals, wheels: float, satellite: float, grade: float
    ) -> list[str]:  # fmt: skip
        """Reason codes at speeds `wheels` and `satellite` [m/s], NaN where one is not known, on `grade` [rad]."""
        before, self._speeds = self._speeds, (wheels, satellite)
        self._follow(elapsed, pedals)
        if before is None or elapsed <= 0.0 or not wheels > MIN_SPEED:
            self._excess = self._satellite_excess = 0.0
            return []
        gained, satellite_gained = wheels - before[0], satellite - before[1]
        allowed = self._most(wheels, grade) * elapsed
        self._excess = _added(self._excess, gained - allowed)
        self._satellite_excess = _added(self._satellite_excess, satellite_gained - allowed)
        if math.isfinite(gained):
            share = elapsed / (ACCELERATION_LAG + elapsed)
            self._acceleration += (gained / elapsed - self._acceleration) * share
        # One that is wrong about the speed, frozen wheels or a receiver that lies, is not a matter of the brakes.
        confirmed = self._satellite_excess > SATELLITE_EXCESS or not math.isfinite(satellite)
        if not (self._excess > SPEED_EXCESS and confirmed):
            return []
        return ["brake_not_following" if self._torque > 0.0 else "drive_not_following"]

    def _follow(self, elapsed: float, pedals: Pedals) -> None:
        """Let brakes and engine answer to what they were told."""
        self._time += elapsed
        queue = self._told
        queue.append((self._time, pedals.brake_torque))
        while len(queue) > 1 and queue[1][0] <= self._time - self._delay:
            queue.popleft()
        if elapsed > 0.0:
            self._torque += (queue[0][1] - self._torque) * elapsed / (self._lag + elapsed)
        if pedals.throttle > 0.0:
            self._push = math.inf
            return
        if self._push == math.inf:
            # The pedal was just let go: what the car gains now is what it can go on gaining.
            self._push = PUSH_SHARE * max(self._acceleration, 0.0) + PUSH_MARGIN
        self._push -= self._push * elapsed / (self._push_lag + elapsed)

    def _most(self, speed: float, grade: float) -> float:
        """The most that a sound car may gain now [m/s2]."""
        calibration = self._calibration
        force = PUSH_SHARE * calibration.creep(speed) - calibration.drag(speed)
        force -= BRAKE_SHARE * calibration.brake_force(self._torque)
        return force / calibration.mass - GRAVITY * math.sin(grade) + self._push + ACCELERATION_MARGIN


def _added(excess: float, more: float) -> float:
    """The sum, never below zero; what is not known adds nothing."""
    if more == -math.inf:
        return 0.0
    return max(excess + more, 0.0) if math.isfinite(more) else excess
