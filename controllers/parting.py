"""Foresees where what crosses the way will be in it, and whether it has gone past, whole, before the car gets there.

It is taken to go straight on over the ground: where the path bends, that is neither along nor across the path. It must
not know brakes, nor who is worth braking for.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vve_sumo.path import Corridor, ReferencePath

from .crossing import LEFT, ON_FOOT, PREDICTION_HORIZON
from .trend import Trend

MAX_BODY_LENGTH: Final = 18.0  #: of the body that may follow the point that is seen, an articulated bus [m]
MIN_CLEARANCE: Final = 2.0  #: that must stay between it and the front bumper [m]
SIDE_REACH: Final = 5.0  #: what is in the band so far behind the bumper would be met by the car's side [m]
STEP: Final = 0.1  #: of the forecast [s]
WAY_STEP: Final = 0.25  #: of the line that it goes on [m]
BODY = np.linspace(0.0, MAX_BODY_LENGTH, 13)  #: places along it that are looked at [m]


def goes_past(
    path: ReferencePath, corridor: Corridor, s: float, across: Trend, along: float, bumper: float, pace: float
) -> bool:
    """Tell whether all of it leaves the corridor before the front bumper comes within MIN_CLEARANCE of it.

    It is seen at `s` [m], goes at `along` [m/s] along the path and as the trend says across; the bumper is at
    s = `bumper` [m] and keeps its `pace` [m/s]. One on foot may stop at any step: of them this foretells nothing.
    """
    here = path.at(s)
    cos, sin = math.cos(here.heading), math.sin(here.heading)
    vx, vy = along * cos - across.rate * sin, along * sin + across.rate * cos
    speed = math.sqrt(vx * vx + vy * vy)
    if speed <= ON_FOOT:
        return False
    x, y = here.x - across.value * sin - BODY * (vx / speed), here.y + across.value * cos - BODY * (vy / speed)
    for step in range(round(PREDICTION_HORIZON / STEP) + 1):
        time = step * STEP
        sigma = LEFT * math.sqrt(across.ahead(time)[1])
        places_s, places_d = path.locate(x + vx * time, y + vy * time, bumper - SIDE_REACH, s + MAX_BODY_LENGTH)
        inside = [
            at_s
            for at_s, at_d in zip(places_s.tolist(), places_d.tolist(), strict=True)
            if corridor.contains(at_s, math.copysign(max(abs(at_d) - sigma, 0.0), at_d))
        ]
        if not inside:
            return True
        if min(inside) < bumper + pace * time + MIN_CLEARANCE:
            return False
    return False


def nearest_in_way(
    path: ReferencePath, corridor: Corridor, s: float, across: Trend, along: float, bumper: float
) -> float:
    """Return the least s [m] of the corridor that any part of it touches from now on; inf where it touches none.

    The arguments are those of `goes_past`, and it is taken to go straight on as there. All of it passes the place where
    it is seen: how surely it keeps to its line counts from there. Who stops on his way stays beyond that s as well.
    Of one on foot, or of unknown motion (NaN), nothing is foretold: -inf.
    """
    here = path.at(s)
    cos, sin = math.cos(here.heading), math.sin(here.heading)
    vx, vy = along * cos - across.rate * sin, along * sin + across.rate * cos
    speed = math.sqrt(vx * vx + vy * vy)
    if not speed > ON_FOOT:
        return -math.inf
    ways = np.arange(-MAX_BODY_LENGTH, speed * PREDICTION_HORIZON, WAY_STEP)
    x, y = here.x - across.value * sin + ways * (vx / speed), here.y + across.value * cos + ways * (vy / speed)
    places_s, places_d = path.locate(x, y, bumper - SIDE_REACH, s + MAX_BODY_LENGTH)
    nearest = math.inf
    for way, at_s, at_d in zip(ways.tolist(), places_s.tolist(), places_d.tolist(), strict=True):
        sigma = LEFT * math.sqrt(across.ahead(abs(way) / speed)[1])
        if at_s < nearest and corridor.contains(at_s, math.copysign(max(abs(at_d) - sigma, 0.0), at_d)):
            nearest = at_s
    return nearest
