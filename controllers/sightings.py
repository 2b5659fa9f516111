"""Brings a sensor's detections onto the path: where along it, how far beside it, how fast, and how well each is known.

Each is looked at from where the car was when it was made. It must not know what is made of them.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple, Protocol, TypeVar

import numpy as np

from vve_sumo.path import PathProjection, ReferencePath
from vve_sumo.values import Detections, Observation, Pose, SensorOutput

RANGE_SIGMA, RATE_SIGMA, AZIMUTH_SIGMA = 0.25, 0.15, math.radians(0.6)  #: of the radar, quantisation included
LANE: Final = 8.0  #: detections farther beside the path are left alone [m]
HORIZON: Final = 150.0  #: detections farther along the path are left alone [m]
REMEMBERED: Final = 1.0  #: where the car was is remembered for so long [s]: as long as the slowest radar takes
FACE: Final = 1.8  #: width of a body's rear, along which its nearest point slides while the car turns behind it [m]
BEHIND: Final = 1.0  #: the car is behind a body whose line, along the path there, the bumper is so near to [m]


_Output = TypeVar("_Output", bound=SensorOutput)


def output_of(observation: Observation, sensor: str, what: type[_Output], kind: str) -> _Output:
    """Return the newest output of a sensor by its name; raises TypeError where the scenario has none of that kind."""
    output = observation.sensors.get(sensor)
    if not isinstance(output, what):
        raise TypeError(f"the scenario has no sensor {sensor!r} of kind {kind}: name it by the tuning key sensor")
    return output


class Noise(NamedTuple):
    """How well a sensor knows where a detection is, and how fast: standard deviations."""

    range_sigma: float  #: [m]
    rate_sigma: float  #: [m/s]
    azimuth_sigma: float  #: [rad]
    growth: float = 0.0  #: by which both sigmas of range and rate grow with the square of the range [1/m, 1/(m s)]
    unknown_sigma: float = 2.0  #: of a speed along the path that is not measured [m/s]


class Sense(Protocol):
    """What the tracker sees by: a sensor, brought into the form of a radar's scan."""

    @property
    def noise(self) -> Noise:
        """How well the sensor knows its detections."""
        ...

    def scan(self, observation: Observation) -> Detections:
        """Return the newest detections; a range rate that the sensor does not measure is NaN."""
        ...


class Radar:
    """The radar itself."""

    noise: Final = Noise(RANGE_SIGMA, RATE_SIGMA, AZIMUTH_SIGMA)

    def scan(self, observation: Observation) -> Detections:
        """Return the newest scan."""
        return observation.radar


class Sighting(NamedTuple):
    """One detection, on the path."""

    s: float  #: [m]
    d: float  #: [m], left positive
    d_variance: float  #: [m2]
    speed: float  #: along the path [m/s] of one that does not cross; NaN where the line of sight crosses the path
    skew: float = 0.0  #: by how much a speed across the path adds to `speed`
    slide: float = 0.0  #: drift of the seen point along the rear of a body, where the path bends [m2/s]
    range_variance: float = RANGE_SIGMA**2  #: [m2]
    rate_variance: float = RATE_SIGMA**2  #: of the range rate, or of the speed where it is not known [m2/s2]


class AxleMotion(NamedTuple):
    """Where the rear axle was at a time, and how it moved."""

    time: float  #: [s]
    x: float  #: [m]
    y: float  #: [m]
    heading: float  #: [rad]
    speed: float  #: [m/s]
    lateral_speed: float  #: [m/s]
    yaw_rate: float  #: [rad/s]

    def moved(self, dt: float) -> AxleMotion:
        """Return where it was or will be after a time [s] of steady motion."""
        heading = self.heading + self.yaw_rate * dt
        cos, sin = math.cos(heading), math.sin(heading)
        x = self.x + (self.speed * cos - self.lateral_speed * sin) * dt
        y = self.y + (self.speed * sin + self.lateral_speed * cos) * dt
        return self._replace(time=self.time + dt, x=x, y=y, heading=heading)


class Memory:
    """Where the car was of late: a scan is looked at from where it was made, and it is old when it comes."""

    def __init__(self) -> None:
        self._past: deque[AxleMotion] = deque()

    def add(self, pose: Pose) -> None:
        """Remember a pose newer than all before."""
        self._past.append(
            AxleMotion(pose.time, pose.x, pose.y, pose.heading, pose.speed, pose.lateral_speed, pose.yaw_rate)
        )
        while self._past[0].time < pose.time - REMEMBERED:
            self._past.popleft()

    def at(self, time: float) -> AxleMotion:
        """Return the motion at a time [s], from the last pose remembered up to it, else from the first one."""
        past = next((past for past in reversed(self._past) if past.time <= time), self._past[0])
        return past.moved(time - past.time)


def sightings(
    scan: Detections, noise: Noise, then: AxleMotion, path: ReferencePath, projection: PathProjection, front: float
) -> list[Sighting]:
    """Bring a scan's detections onto the path, from where the car was when the scan was made."""
    heading = then.heading
    if not scan.range.size:
        return []
    bumper_x, bumper_y = then.x + front * math.cos(heading), then.y + front * math.sin(heading)
    ranges, azimuths = scan.range.tolist(), scan.azimuth.tolist()
    sights = [(math.cos(heading + azimuth), math.sin(heading + azimuth)) for azimuth in azimuths]
    lines = np.array(sights)
    s, d = path.locate(
        bumper_x + scan.range * lines[:, 0], bumper_y + scan.range * lines[:, 1], projection.s, projection.s + HORIZON
    )
    across = then.lateral_speed + then.yaw_rate * front
    here, found = path.at(projection.s).heading, []
    columns = zip(ranges, azimuths, sights, scan.range_rate.tolist(), s.tolist(), d.tolist(), strict=True)
    for reach, azimuth, (sight_x, sight_y), rate, at_s, at_d in columns:
        if not abs(at_d) < LANE:
            continue
        direction = path.at(at_s).heading
        cos_path, sin_path = math.cos(direction), math.sin(direction)
        along_sight = cos_path * sight_x + sin_path * sight_y
        radial = rate + then.speed * math.cos(azimuth) + across * math.sin(azimuth)
        speed, skew, slide = math.nan, 0.0, 0.0
        if along_sight > 0.5:
            speed, skew = radial / along_sight, (cos_path * sight_y - sin_path * sight_x) / along_sight
            if abs(skew) * reach < BEHIND:
                # As the car comes round the bend, the nearest point of what stands there goes across as the car does.
                slide = FACE * then.speed * abs(math.sin(direction - here))
        worse = noise.growth * reach * reach
        range_sigma, rate_sigma = noise.range_sigma + worse, noise.rate_sigma + worse
        variance = (noise.azimuth_sigma * reach) ** 2 + (range_sigma * math.sin(azimuth)) ** 2 + 0.1**2
        rate_variance = (noise.unknown_sigma if math.isnan(speed) else rate_sigma) ** 2
        found.append(Sighting(at_s, at_d, variance, speed, skew, slide, range_sigma**2, rate_variance))
    return found
