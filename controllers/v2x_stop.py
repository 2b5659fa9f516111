"""`follow_and_stop` that also waits for who will cross the path by their V2X messages, before the radar sees them.

The scenario needs a sensor of kind `v2x`; the tuning key `sensor` names it.
"""

from __future__ import annotations

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import Vehicle

from . import follow_and_stop
from .follow_and_stop import FollowAndStop, steering_law
from .warned import Warned

TUNING: dict[str, float | str | bool] = {
    **{key: value for key, value in follow_and_stop.TUNING.items() if key != "comfort"},
    "sensor": "obu",  #: name of the scenario's V2X receiver
}


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, follow_and_stop.RANGES)
    name, sensor = str(settled.pop("steering")), str(settled.pop("sensor"))
    numbers = {key: float(value) for key, value in settled.items()} | {"comfort": 1.0}
    return FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers, warned=Warned(vehicle, sensor))
