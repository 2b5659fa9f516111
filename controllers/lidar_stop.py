"""`follow_and_stop` by a lidar in place of the radar.

The scenario needs a sensor of kind `lidar`; the tuning key `sensor` names it, `forward_m` and `height_m` say where it
is.
"""

from __future__ import annotations

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import Vehicle

from . import follow_and_stop
from .follow_and_stop import FollowAndStop, steering_law
from .lidar_detections import LidarDetections

TUNING: dict[str, float | str | bool] = {
    **follow_and_stop.TUNING,
    "sensor": "roof",  #: name of the scenario's lidar
    "forward_m": 1.4,  #: of the lidar from the rear axle
    "height_m": 1.9,  #: of the lidar over the road
}
RANGES: dict[str, tuple[float, float]] = {
    **follow_and_stop.RANGES,
    "forward_m": (-5.0, 15.0),
    "height_m": (0.2, 5.0),
}


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, RANGES)
    name, sensor = str(settled.pop("steering")), str(settled.pop("sensor"))
    numbers = {key: float(value) for key, value in settled.items()}
    sense = LidarDetections(vehicle, sensor, numbers["forward_m"], numbers["height_m"])
    return FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers, sense=sense)
