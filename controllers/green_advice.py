"""Speed advice to arrive at a signal while it is green (Pass-at-Green), from when its green begins at the earliest.

It must not know how the car brakes or what else is on the road. Speeds are only ever advised below the desired one.
"""

from __future__ import annotations

import math
from typing import Final

from .signal_stop import GREEN, Line

DECELERATION: Final = 1.0  #: to the advised speed [m/s2]
TRACKING: Final = 0.8  #: acceleration for each m/s off it [1/s]
AFTER: Final = 1.5  #: so long after the begin of green the line is to be passed [s]
BEFORE: Final = 1.0  #: so long before the end of green it is to be passed at the latest [s]
LEAST_SPEED: Final = 3.0  #: a lower one is not advised: the car stops instead [m/s]


def advised_speed(distance: float, speed: float, after: float) -> float | None:
    """Return the speed [m/s] that brings a car over a distance [m] in no less than a time [s], None where none does.

    The car slows by DECELERATION to it and keeps it: the greatest such speed, so the least is lost. With v the speed,
    d the distance, T the time and a the deceleration it is v - a T + sqrt(a^2 T^2 - 2 a (v T - d)); a car that is slow
    enough may go d / T.
    """
    if after <= 0.0:
        return math.inf
    early = speed * after - distance
    if early <= 0.0:
        return max(distance, 0.0) / after
    squared = (DECELERATION * after) ** 2 - 2.0 * DECELERATION * early
    if squared < 0.0:
        return None
    advised = speed - DECELERATION * after + math.sqrt(squared)
    return advised if advised >= LEAST_SPEED else None


def advised_acceleration(line: Line | None, distance: float, speed: float, desired: float, now: float) -> float:
    """Return the greatest acceleration by the advice for the next line [m/s2]; infinite where there is none.

    `distance` to the line [m], drive time `now` [s]. Without times of the signal nothing is advised.
    """
    if line is None or line.green_begin <= 0.0 or distance <= 0.0:
        return math.inf
    if line.phase in GREEN and distance <= max(speed, 0.5 * desired) * (line.end - now - BEFORE):
        return math.inf  # it is passed before this green ends
    advised = advised_speed(distance, speed, line.green_begin + AFTER - now)
    if advised is None or advised > desired:
        return math.inf
    return max(TRACKING * (advised - speed), -DECELERATION)
