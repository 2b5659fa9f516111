"""Brakes with all there is when nothing less avoids contact: a layer under the comfortable stop.

It knows the brakes as declared, and no comfort. Once begun it goes on until the car stands.
"""

from __future__ import annotations

from vve_sumo.laws import stopping_distance
from vve_sumo.values import Vehicle

from .tracks import Target

MARGIN = 2.0  #: rest of the gap that full braking shall leave [m]
FULL = -9.0  #: asked for while it lasts [m/s2]: all there is, whatever the road; the gateway holds the car's limit
REST_SPEED = 0.05  #: [m/s]
FIRST_ORDER_RAMP = 2.0  #: a first-order lag T loses as much way as a linear ramp over 2 T


class Emergency:
    """Compares the way that full braking takes, relative to the target, with the gap."""

    def __init__(self, vehicle: Vehicle, period: float) -> None:
        """`period` of the tick [s], which the command waits on its way."""
        self._deceleration = vehicle.deceleration_limit
        self._delay = vehicle.brake_delay + period
        self._build_up = FIRST_ORDER_RAMP * vehicle.brake_lag
        self.braking = False  #: latched until standstill

    def step(self, target: Target | None, speed: float) -> bool:
        """Tell whether to brake fully now at a speed [m/s]."""
        if self.braking:
            self.braking = speed > REST_SPEED
        elif target is not None and speed > REST_SPEED:
            self.braking = self.way(speed - target.speed) + MARGIN >= target.gap and speed > target.speed
        return self.braking

    def way(self, closing_speed: float) -> float:
        """Gap that full braking uses up [m] until nothing closes any more."""
        return stopping_distance(closing_speed, self._deceleration, self._delay, self._build_up)
