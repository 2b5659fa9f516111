"""Adaptive cruise control: keeps the speed, and behind another car a constant time gap; steers like `follow_and_stop`.

The law of the gap is `car_following.ConstantTimeGap`; everything else is that of `follow_and_stop`.
"""

from __future__ import annotations

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import Vehicle

from . import follow_and_stop
from .car_following import ConstantTimeGap
from .follow_and_stop import FollowAndStop, steering_law

LAW = ConstantTimeGap()
TUNING: dict[str, float | str | bool] = {
    key: value for key, value in follow_and_stop.TUNING.items() if key != "comfort"
}
TUNING |= {
    "gap_m": LAW.standstill_gap,  #: at rest
    "time_headway_s": LAW.time_gap,  #: on top of it, times the speed
    "gap_gain_per_s2": LAW.gap_gain,  #: acceleration for each metre that the gap is too long
    "speed_gain_per_s": LAW.speed_gain,  #: acceleration for each m/s that the car ahead is faster
}
RANGES: dict[str, tuple[float, float]] = {
    **follow_and_stop.RANGES,
    "gap_gain_per_s2": (0.01, 20.0),
    "speed_gain_per_s": (0.0, 20.0),
}


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, RANGES)
    name = str(settled.pop("steering"))
    numbers = {key: float(value) for key, value in settled.items()}
    law = ConstantTimeGap(
        numbers["gap_m"], numbers["time_headway_s"], numbers["gap_gain_per_s2"], numbers["speed_gain_per_s"]
    )
    return FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers | {"comfort": 1.0}, law)
