"""`follow_and_stop` that slows early, by the times that signals tell, to pass the next one while it is green.

The scenario needs a sensor of kind `signals` by V2X; by sight nothing is known of times, and it only obeys.
"""

from __future__ import annotations

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import Vehicle

from . import follow_and_stop
from .follow_and_stop import FollowAndStop, steering_law

TUNING: dict[str, float | str | bool] = {
    key: value for key, value in follow_and_stop.TUNING.items() if key not in ("comfort", "signals")
}


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, follow_and_stop.RANGES)
    name = str(settled.pop("steering"))
    numbers = {key: float(value) for key, value in settled.items()} | {"comfort": 1.0}
    return FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers, pass_at_green=True)
