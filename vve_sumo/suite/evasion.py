"""The greatest clearance that a car can keep from bodies whose motion is given: by full braking, by a swerve, by both.

Speeds, times and the declared car in, metres out. Knows no controller: these bounds hold for every controller. The car
keeps its heading, and a swerve ends beside the path without a way back: both flatter the car.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.laws import sideways_reach
from vve_sumo.suite.physics import full_braking
from vve_sumo.timing import PERIOD
from vve_sumo.values import Floats, Vehicle
from vve_sumo.vehicle.limits import COMFORT, Limits

#: until a lidar's outlines tell of one who sets out, and how fast: three turns and half of another one of 0.1 s [s]
OUTLINED: Final = 0.35
TIMES: Final = np.arange(0.0, 20.0, 0.02)  #: instants at which motions are compared [s]
#: how far beside its path a swerve may end [m]; beside these, the whole room
ASIDE: Final = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)


class Room(NamedTuple):
    """How far beside its path a car may go [m]."""

    left: float
    right: float


class Body(NamedTuple):
    """A body's motion at TIMES, seen from where the car's front bumper is at the first of them."""

    x: Floats  #: of its centre, along the path [m]
    y: Floats  #: of its centre, left positive [m]
    length: float  #: along the path [m]
    width: float  #: across the path [m]


def greatest_clearance(
    vehicle: Vehicle, speed: float, bodies: Sequence[Body], room: Room, *, brakes: bool, steers: bool
) -> float:
    """Return the greatest least distance [m] from bodies that any manoeuvre keeps; 0 where each ends in contact.

    The need to act begins at the first of TIMES, with the car on its path at `speed` [m/s].
    """
    ways = [speed * TIMES] if steers else []
    if brakes:
        ways.append(full_braking(vehicle, speed).at(TIMES)[0])
    asides = _swerves(vehicle, room) if steers else np.zeros((1, len(TIMES)))
    return max(float(_least(vehicle, way, asides, bodies).max()) for way in ways)


@cache
def _swerves(vehicle: Vehicle, room: Room) -> Floats:
    """Return how far the car is to the left of its path in swerves as hard as the gateway lets them be [m].

    A row a swerve, a column an instant; the first row keeps to the path.
    """
    limits = Limits()
    late = OUTLINED + PERIOD + vehicle.steering_delay + vehicle.steering_lag
    reach = np.array(
        [sideways_reach(time - late, limits.lateral_acceleration, COMFORT.lateral_jerk) for time in TIMES.tolist()]
    )
    ends = [
        side * end
        for side, most in ((1.0, room.left), (-1.0, room.right))
        for end in (*(one for one in ASIDE if one < most), most)
    ]
    return np.array([np.zeros_like(reach), *(np.sign(end) * np.minimum(reach, abs(end)) for end in ends)])


def _least(vehicle: Vehicle, way: Floats, asides: Floats, bodies: Sequence[Body]) -> Floats:
    """Return the least distance between the car and the bodies on a way, for each row of `asides`."""
    centre = way - 0.5 * vehicle.length
    least = np.full(len(asides), np.inf)
    for body in bodies:
        along = np.maximum(np.abs(body.x - centre) - 0.5 * (body.length + vehicle.length), 0.0)
        across = np.maximum(np.abs(body.y - asides) - 0.5 * (body.width + vehicle.width), 0.0)
        least = np.minimum(least, np.sqrt((along * along + across * across).min(axis=1)))
    return least
