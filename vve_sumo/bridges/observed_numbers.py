"""A controller's observation as numbers with names and units: what learning agents and FMUs are given at a tick.

They hold nothing that a controller may not know. The module knows neither agents nor FMUs.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.laws import clamp
from vve_sumo.values import Observation, Vehicle

#: radar detections in an observation
DETECTIONS: Final = 4
#: farthest detection in an observation, ahead of the front bumper along the path [m]; stands for "none", too
FARTHEST: Final = 200.0
#: detections farther beside the path are left out [m]: two lanes
FARTHEST_BESIDE: Final = 7.0
#: distances ahead of the rear axle at which the path's curvature is observed [m]
PREVIEW: Final = (0.0, 10.0, 20.0, 40.0)
#: a scan is not older than this in an observation [s]; stands for "no scan yet", too
OLDEST_SCAN: Final = 1.0


class Feature(NamedTuple):
    """One number of an observation."""

    name: str  #: ends in the unit
    low: float  #: smallest value; smaller ones are cut
    high: float  #: largest value; larger ones are cut
    meaning: str


def _detection(number: int) -> tuple[Feature, ...]:
    which = f"of detection {number}"
    return (
        Feature(
            f"ahead_{number}_m", 0.0, FARTHEST, f"from the front bumper along the path {which}; {FARTHEST:g}: none"
        ),
        Feature(f"beside_{number}_m", -FARTHEST_BESIDE, FARTHEST_BESIDE, f"from the path {which}, left positive"),
        Feature(f"range_rate_{number}_mps", -100.0, 100.0, f"{which}, opening positive"),
    )


#: in the order of the vector
FEATURES: Final[tuple[Feature, ...]] = (
    Feature("speed_mps", -20.0, 80.0, "of the rear axle along the heading"),
    Feature("acceleration_mps2", -15.0, 15.0, "rate of change of the speed"),
    Feature("yaw_rate_radps", -3.0, 3.0, "counter-clockwise"),
    Feature("deviation_m", -50.0, 50.0, "of the rear axle from the path, left positive"),
    Feature("heading_error_rad", -math.pi, math.pi, "heading of the car minus that of the path, counter-clockwise"),
    Feature("steering_rad", -1.0, 1.0, "road-wheel angle that the car reports, left positive; 0 before a report"),
    Feature("desired_speed_mps", 0.0, 80.0, "that the scenario asks for where nothing forbids it"),
    Feature("remaining_m", 0.0, 1e5, "along the path from the rear axle to the path's end"),
    *(
        Feature(
            f"curvature_{ahead:.0f}_per_m", -1.0, 1.0, f"of the path {ahead:g} m ahead of the rear axle, left positive"
        )
        for ahead in PREVIEW
    ),
    Feature("scan_age_s", 0.0, OLDEST_SCAN, f"of the newest radar scan; {OLDEST_SCAN:g}: none yet"),
    *(feature for number in range(1, DETECTIONS + 1) for feature in _detection(number)),
)

REMAINING: Final = [feature.name for feature in FEATURES].index("remaining_m")
LOW: Final = np.array([feature.low for feature in FEATURES], np.float32)
HIGH: Final = np.array([feature.high for feature in FEATURES], np.float32)
_NONE: Final = (FARTHEST, 0.0, 0.0)


class ObservationEncoder:
    """Encodes the observations of one drive, in the order of their ticks."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._bumper = vehicle.rear_axle_to_bumper
        self._s: float | None = None

    def encode(self, observation: Observation) -> NDArray[np.float32]:
        """Return the vector of `FEATURES`, every number within its bounds."""
        return np.clip(np.array(self.numbers(observation), np.float32), LOW, HIGH)

    def numbers(self, observation: Observation) -> list[float]:
        """Return the numbers of `FEATURES` within their bounds, in their order."""
        pose, path = observation.pose, observation.path
        foot = path.project(pose.x, pose.y, self._s)
        self._s = here = foot.s
        steering = observation.steering
        numbers = [
            pose.speed,
            pose.acceleration,
            pose.yaw_rate,
            foot.d,
            math.remainder(pose.heading - foot.heading, math.tau),
            steering if math.isfinite(steering) else 0.0,
            observation.desired_speed,
            path.length - here,
            *(path.at(here + ahead).curvature for ahead in PREVIEW),
            min(observation.time - observation.radar.time, OLDEST_SCAN),
        ]
        for detection in self._detections(observation, here):
            numbers += detection
        return [clamp(number, feature.low, feature.high) for number, feature in zip(numbers, FEATURES, strict=True)]

    def _detections(self, observation: Observation, here: float) -> list[tuple[float, float, float]]:
        """Return distance ahead and beside [m] and range rate [m/s] of the nearest detections along the path."""
        pose, path, scan = observation.pose, observation.path, observation.radar
        found = []
        if len(scan.range):
            # The scan is older than the pose: each range is brought to the tick by its own rate.
            far = np.maximum(scan.range + scan.range_rate * (observation.time - scan.time), 0.0)
            bearing = pose.heading + scan.azimuth
            x = pose.x + self._bumper * math.cos(pose.heading) + far * np.cos(bearing)
            y = pose.y + self._bumper * math.sin(pose.heading) + far * np.sin(bearing)
            front = here + self._bumper
            s, beside = path.locate(x, y, here, front + FARTHEST)
            rows = zip(s.tolist(), beside.tolist(), scan.range_rate.tolist(), strict=True)
            found = sorted(
                (clamp(at - front, 0.0, FARTHEST), d, rate) for at, d, rate in rows if abs(d) <= FARTHEST_BESIDE
            )
        return (found + [_NONE] * DETECTIONS)[:DETECTIONS]
