"""Drives like the Intelligent Driver Model, the reference of traffic research; steers like `follow_and_stop`.

The law of the gap is `car_following.IntelligentDriver` with the paper's parameters; everything else is that of
`follow_and_stop`.
"""

from __future__ import annotations

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import Vehicle

from . import follow_and_stop
from .car_following import IntelligentDriver
from .follow_and_stop import FollowAndStop, steering_law

LAW = IntelligentDriver()
TUNING: dict[str, float | str | bool] = {
    key: value for key, value in follow_and_stop.TUNING.items() if key != "comfort"
}
TUNING |= {
    "gap_m": LAW.standstill_gap,  #: at rest
    "time_headway_s": LAW.time_gap,  #: on top of it, times the speed
    "acceleration_m_s2": LAW.greatest_acceleration,  #: greatest, from rest on a free road
    "deceleration_m_s2": LAW.comfortable_deceleration,  #: comfortable, when closing in
}
RANGES: dict[str, tuple[float, float]] = {
    **follow_and_stop.RANGES,
    "acceleration_m_s2": (0.1, 5.0),
    "deceleration_m_s2": (0.1, 9.0),
}


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, RANGES)
    name = str(settled.pop("steering"))
    numbers = {key: float(value) for key, value in settled.items()}
    law = IntelligentDriver(
        numbers["gap_m"], numbers["time_headway_s"], numbers["acceleration_m_s2"], numbers["deceleration_m_s2"]
    )
    return FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers | {"comfort": 1.0}, law)
