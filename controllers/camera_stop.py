"""`follow_and_stop` by a camera's list of objects in place of the radar.

The scenario needs a sensor of kind `camera`; the tuning key `sensor` names it, `focal_length_px` and `height_m` say how
well it knows distances.
"""

from __future__ import annotations

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import Vehicle

from . import follow_and_stop
from .camera_detections import CameraDetections
from .follow_and_stop import FollowAndStop, steering_law

TUNING: dict[str, float | str | bool] = {
    **follow_and_stop.TUNING,
    "sensor": "front",  #: name of the scenario's camera
    "focal_length_px": 1312.0,  #: half its columns over the tangent of half its field of view
    "height_m": 1.3,  #: of the camera over the road
}
RANGES: dict[str, tuple[float, float]] = {
    **follow_and_stop.RANGES,
    "focal_length_px": (50.0, 20000.0),
    "height_m": (0.2, 5.0),
}


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, RANGES)
    name, sensor = str(settled.pop("steering")), str(settled.pop("sensor"))
    numbers = {key: float(value) for key, value in settled.items()}
    sense = CameraDetections(sensor, numbers["focal_length_px"], numbers["height_m"])
    return FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers, sense=sense)
