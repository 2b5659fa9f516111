"""How much longer than its bound a stop of a sound car may be, from what is not known exactly of the car and the stop.

Knows a stop and the car as declared; it must not know how long the stop was.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.metrics.stopping import Stop
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.values import Vehicle

#: acceleration for each m/s by which the car is behind its reference [1/s]: that of the gateway's actuation
LOOP_GAIN: Final = 3.0
#: share of the demand: a passenger more or less (80 kg of 1700) is 5 % of mass, as is what wear and heat do to brakes
STRENGTH: Final = 0.05
#: of the grade that the pose tells: a receiver's pitch is aligned to 0.3 degrees
GRADE: Final = 0.005
#: of the speed while braking [m/s]: the estimate lay 0.005 to 0.009 m/s off the truth, root mean square
SPEED: Final = 0.01


class Tolerance(NamedTuple):
    """What a stop may exceed its bound by, term by term, each a distance [m]."""

    strength: float  #: mass and brakes are not exactly as declared, and the course ripples
    grade: float  #: the grade is not known exactly
    speed: float  #: the speed is not known exactly, throughout the stop
    tick: float  #: the moment of the onset is known to a tick

    @property
    def total(self) -> float:
        """Root of the sum of their squares: the terms have nothing to do with each other."""
        return math.hypot(*self)


def tolerance(stop: Stop, vehicle: Vehicle, period: float) -> Tolerance:
    """Return by how much a sound car's stop may exceed its bound; `period` is a tick's [s].

    NaN where the car gained speed on the way (`Stop.reversals`): the bound is a closed form of one braking.
    """
    if stop.reversals:
        return Tolerance(*[math.nan] * 4)
    course = math.hypot(stop.demand, stop.ripple)
    return Tolerance(
        _way(stop, vehicle, STRENGTH * course),
        _way(stop, vehicle, GRADE * GRAVITY),
        SPEED * stop.duration,
        stop.onset_speed * period / math.sqrt(12.0),
    )


def _way(stop: Stop, vehicle: Vehicle, lacking: float) -> float:
    """Return the way [m] that a lacking deceleration [m/s2] costs.

    The gateway's loop asks for more until what is lacking is made up for, as far as the brakes have it: until then the
    car is faster than asked, in the end by lacking / LOOP_GAIN, which costs that speed times the rest of the stop. What
    the brakes do not have costs as much as an open loop: half of it times the square of the time to stop. Brakes may be
    weaker than declared at their limit, too, and the course rises above its mean by its ripple.
    """
    at_limit = (1.0 - STRENGTH) * vehicle.deceleration_limit
    spare = min(lacking, max(at_limit - stop.demand - stop.ripple, 0.0))
    settled = stop.duration + math.expm1(-LOOP_GAIN * stop.duration) / LOOP_GAIN
    return spare / LOOP_GAIN * settled + 0.5 * (lacking - spare) * (stop.onset_speed / stop.demand) ** 2
