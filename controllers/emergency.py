"""Brakes with all there is when nothing less avoids contact: a layer under the comfortable stop.

It knows the brakes as declared, and no comfort. For what is in the way it brakes until the car stands. For one who is
foreseen, and not in the way yet, it brakes in two stages by how probable it is that he comes, and lets go when the
danger goes: whether a pedestrian stops at the kerb is known only some tenths of a second before he has stopped (Keller
and Gavrila, *IEEE Transactions on Intelligent Transportation Systems* 15, 494, 2014).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from vve_sumo.laws import stopping_distance
from vve_sumo.values import Vehicle

from .tracks import Target

MARGIN: Final = 2.0  #: rest of the gap that full braking shall leave [m]
#: Before a place that one who crosses keeps beyond: 0.5 m [m] and a tenth of the way to rest, at most MARGIN
CROSSING_MARGIN, WORSE_BRAKES = 0.5, 0.1
#: Asked for while it lasts [m/s2]: all there is, whatever the road; the gateway holds the car's limit
FULL: Final = -9.0
PARTIAL, EARLIER = -4.0, 0.3  #: for one who is foreseen: so hard [m/s2], so long before it must be full [s]
FULL_FROM: Final = 0.7  #: probability from which one who is foreseen is braked for fully
LASTS: Final = 1.0  #: braking goes on for what is in the way, if it had to begin within so long anyway [s]
JERK: Final = 30.0  #: with which the gateway lets it build up [m/s3]
REST_SPEED: Final = 0.05  #: [m/s]
FIRST_ORDER_RAMP: Final = 2.0  #: a first-order lag T loses as much way as a linear ramp over 2 T


class Emergency:
    """Compares the way that full braking takes, relative to the target, with the gap."""

    def __init__(self, vehicle: Vehicle, period: float) -> None:
        """`period` of the tick [s], which the command waits on its way."""
        self._deceleration = vehicle.deceleration_limit
        self._delay = vehicle.brake_delay + period
        self._build_up = FIRST_ORDER_RAMP * vehicle.brake_lag + vehicle.deceleration_limit / JERK
        self.braking = False  #: partly or fully
        self.demand = 0.0  #: acceleration to ask for while it brakes [m/s2]
        self._latched = False  #: whether it brakes until standstill

    def step(self, targets: Iterable[Target], speed: float) -> bool:
        """Tell whether to brake now at a speed [m/s]."""
        if not speed > REST_SPEED:
            self.braking, self.demand, self._latched = False, 0.0, False
            return False
        dangers = list(targets)
        urgent = [target for target in dangers if self._is_urgent(target, speed, 0.0)]
        self._latched = self._latched or any(not target.foreseen for target in urgent)
        # One who was foreseen comes into the way while the car brakes: UN R152 wants 5 m/s2 demanded, or more, for him.
        come = self.braking and any(not target.foreseen and self._is_urgent(target, speed, LASTS) for target in dangers)
        lasts = come or any(target.foreseen for target in dangers)
        sure = any(target.probability >= FULL_FROM for target in urgent)
        fully = self._latched or sure or come or (self.demand == FULL and lasts)
        early = any(target.foreseen and self._is_urgent(target, speed, EARLIER) for target in dangers)
        self.braking = fully or early or (self.braking and lasts)
        self.demand = 0.0 if not self.braking else FULL if fully else PARTIAL
        return self.braking

    def _is_urgent(self, target: Target, speed: float, early: float) -> bool:
        """Tell whether full braking must begin within `early` [s]."""
        closing = speed - target.speed
        if not (closing > 0.0 and self.way(speed, target) + MARGIN + early * closing >= target.gap):
            return False
        # Who crosses obliquely never comes nearer along the path than this place: the car need only stop before it.
        stops = stopping_distance(speed, self._deceleration, self._delay, self._build_up)
        margin = min(MARGIN, CROSSING_MARGIN + WORSE_BRAKES * stops)
        return not stops + margin + early * speed < target.keeps_beyond  # a NaN excuses nobody

    def way(self, speed: float, target: Target) -> float:
        """Gap to a target that full braking from a speed [m/s] uses up [m] until nothing closes any more.

        A target that brakes goes on braking to rest (the rule of RSS, Shalev-Shwartz, 2017, with its deceleration as
        it is measured). What counts is when both are equally fast: after that the gap grows, or both stand.
        """
        closing = speed - target.speed
        if not (target.braking > 0.0 and target.speed > 0.0):
            return stopping_distance(closing, self._deceleration, self._delay, self._build_up)
        late, surplus = self._delay + 0.5 * self._build_up, self._deceleration - target.braking
        rest = target.speed / target.braking
        if surplus <= 0.0 or closing + self._deceleration * late > surplus * rest:
            stops = stopping_distance(speed, self._deceleration, self._delay, self._build_up)
            return stops - 0.5 * target.speed * rest
        grown = closing + target.braking * late
        return late * (closing + 0.5 * target.braking * late) + max(grown, 0.0) ** 2 / (2.0 * surplus)
