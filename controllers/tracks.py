"""Turns radar scans into things on the path: where along it, how fast, how far beside it.

Every thing is kept by its station on the path, so what stands still keeps its place while the car moves, and
averages its noise away. It must not know what is done about the things.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vve_sumo.path import Corridor, Path, Station
from vve_sumo.values import Pose, Situation, Vehicle

RANGE_SIGMA, RATE_SIGMA, AZIMUTH_SIGMA = 0.25, 0.15, math.radians(0.6)  #: of the radar, quantisation included
AGILITY = 1.0  #: spectral density of a target's acceleration [m2/s3]
DRIFT = 0.02  #: of a target across the path [m2/s]
GATE = 3.5  #: standard deviations within which a detection belongs to a track
LANE = 5.0  #: detections farther beside the path are left alone [m]
HORIZON = 150.0  #: detections farther along the path are left alone [m]
CONFIRMED = 3  #: hits before a track counts
COAST, COAST_TENTATIVE, COAST_AT_REST = 0.6, 0.2, 5.0  #: a track lives on unseen for so long [s]
MARGIN = 0.3  #: kept on both sides of the swept body [m]
HYSTERESIS = 0.3  #: a target that is in the way must clear the band by this much to be out of it [m]


class Target(NamedTuple):
    """The nearest thing in the way."""

    gap: float  #: along the path from the front bumper to its nearest point [m]
    speed: float  #: along the path [m/s], oncoming negative


class Sighting(NamedTuple):
    """One detection, on the path."""

    s: float  #: [m]
    offset: float  #: [m], left positive
    offset_variance: float  #: [m2]
    speed: float  #: along the path [m/s]; NaN where it moves across the line of sight


class Track:
    """A Kalman filter on station and speed, another on the lateral offset."""

    __slots__ = ("hits", "in_way", "offset", "offset_variance", "p_s", "p_sv", "p_v", "s", "seen", "speed", "time")

    def __init__(self, time: float, sighting: Sighting) -> None:
        self.time = self.seen = time
        self.s, self.offset, self.offset_variance = sighting.s, sighting.offset, sighting.offset_variance
        self.speed = 0.0 if math.isnan(sighting.speed) else sighting.speed
        self.p_s, self.p_sv = RANGE_SIGMA**2, 0.0
        self.p_v = 4.0 if math.isnan(sighting.speed) else RATE_SIGMA**2
        self.hits, self.in_way = 1, False

    def predict(self, time: float) -> None:
        """Move on to a time [s] at constant speed."""
        dt = time - self.time
        self.time = time
        self.s += self.speed * dt
        self.p_s += dt * (2.0 * self.p_sv + dt * self.p_v) + AGILITY * dt**3 / 3.0
        self.p_sv += dt * self.p_v + AGILITY * dt * dt / 2.0
        self.p_v += AGILITY * dt
        self.offset_variance += DRIFT * dt

    def distance(self, sighting: Sighting) -> float:
        """Return the greatest of the differences to a sighting, in standard deviations."""
        off_s = abs(sighting.s - self.s) / math.sqrt(self.p_s + RANGE_SIGMA**2)
        off_side = abs(sighting.offset - self.offset) / math.sqrt(self.offset_variance + sighting.offset_variance)
        if math.isnan(sighting.speed):
            return max(off_s, off_side)
        return max(off_s, off_side, abs(sighting.speed - self.speed) / math.sqrt(self.p_v + RATE_SIGMA**2))

    def update(self, sighting: Sighting) -> None:
        """Take a sighting in."""
        self.hits += 1
        self.seen = self.time
        gain = self.offset_variance / (self.offset_variance + sighting.offset_variance)
        self.offset += gain * (sighting.offset - self.offset)
        self.offset_variance *= 1.0 - gain
        gain_s, gain_v = self.p_s / (self.p_s + RANGE_SIGMA**2), self.p_sv / (self.p_s + RANGE_SIGMA**2)
        self._correct(sighting.s - self.s, gain_s, gain_v, self.p_s, self.p_sv)
        if not math.isnan(sighting.speed):
            gain_s, gain_v = self.p_sv / (self.p_v + RATE_SIGMA**2), self.p_v / (self.p_v + RATE_SIGMA**2)
            self._correct(sighting.speed - self.speed, gain_s, gain_v, self.p_sv, self.p_v)

    def _correct(self, error: float, gain_s: float, gain_v: float, seen_s: float, seen_v: float) -> None:
        """Kalman correction by a scalar whose covariances with station and speed are `seen_s` and `seen_v`."""
        self.s += gain_s * error
        self.speed += gain_v * error
        self.p_s, self.p_sv, self.p_v = (
            self.p_s - gain_s * seen_s,
            self.p_sv - gain_s * seen_v,
            self.p_v - gain_v * seen_v,
        )


class Tracker:
    """Keeps the tracks and says which is the nearest in the way."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._corridor: Corridor | None = None
        self._tracks: list[Track] = []
        self._scanned = -math.inf

    def step(self, situation: Situation, station: Station) -> Target | None:
        """Take in a scan if it is new, and return the nearest target at the situation's time."""
        if self._corridor is None:
            self._corridor = self._corridor_of(situation.path)
        scan = situation.detections.time
        if scan > self._scanned:
            self._scanned = scan
            self._take_in(scan, _sightings(situation, station, self._vehicle.rear_axle_to_bumper))
            self._forget(scan, situation.pose)
            self._judge(self._corridor)
        return self._nearest(situation.time, station.s + self._vehicle.rear_axle_to_bumper)

    def _take_in(self, time: float, sightings: list[Sighting]) -> None:
        for track in self._tracks:
            track.predict(time)
        free = list(self._tracks)
        for sighting in sightings:
            near = min(free, key=lambda track: track.distance(sighting), default=None)
            if near is not None and near.distance(sighting) < GATE:
                near.update(sighting)
                free.remove(near)
            else:
                self._tracks.append(Track(time, sighting))

    def _forget(self, time: float, pose: Pose) -> None:
        long = COAST_AT_REST if pose.speed < 0.1 else COAST
        self._tracks = [
            track
            for track in self._tracks
            if time - track.seen <= (long if track.hits >= CONFIRMED else COAST_TENTATIVE)
        ]

    def _corridor_of(self, path: Path) -> Corridor:
        vehicle = self._vehicle
        return Corridor(path, vehicle.rear_axle_to_bumper, vehicle.rear_overhang, vehicle.width, MARGIN)

    def _judge(self, corridor: Corridor) -> None:
        for track in self._tracks:
            # In: surely inside the band, by one standard deviation. Out: clear of it by the hysteresis.
            shift = -HYSTERESIS if track.in_way else math.sqrt(track.offset_variance)
            outward = max(abs(track.offset) + shift, 0.0)
            track.in_way = corridor.contains(track.s, math.copysign(outward, track.offset))

    def _nearest(self, time: float, bumper: float) -> Target | None:
        nearest = None
        for track in self._tracks:
            if track.in_way and track.hits >= CONFIRMED:
                gap = track.s + track.speed * (time - track.time) - bumper
                if nearest is None or gap < nearest.gap:
                    nearest = Target(gap, track.speed)
        return nearest


def _sightings(situation: Situation, station: Station, front: float) -> list[Sighting]:
    """Bring a scan's detections onto the path, from where the car was when the scan was made."""
    pose, scan = situation.pose, situation.detections
    if not scan.range.size:
        return []
    since = situation.time - scan.time
    heading = pose.heading - pose.yaw_rate * since
    cos, sin = math.cos(heading), math.sin(heading)
    bumper_x = pose.x - (pose.speed * cos - pose.lateral_speed * sin) * since + front * cos
    bumper_y = pose.y - (pose.speed * sin + pose.lateral_speed * cos) * since + front * sin
    ranges, azimuths = scan.range.tolist(), scan.azimuth.tolist()
    sights = [(math.cos(heading + azimuth), math.sin(heading + azimuth)) for azimuth in azimuths]
    lines = np.array(sights)
    s, offset = situation.path.locate(
        bumper_x + scan.range * lines[:, 0], bumper_y + scan.range * lines[:, 1], station.s, station.s + HORIZON
    )
    across = pose.lateral_speed + pose.yaw_rate * front
    found = []
    columns = zip(ranges, azimuths, sights, scan.range_rate.tolist(), s.tolist(), offset.tolist(), strict=True)
    for reach, azimuth, (sight_x, sight_y), rate, at_s, at_offset in columns:
        if not abs(at_offset) < LANE:
            continue
        direction = situation.path.at(at_s).heading
        along_sight = math.cos(direction) * sight_x + math.sin(direction) * sight_y
        radial = rate + pose.speed * math.cos(azimuth) + across * math.sin(azimuth)
        speed = radial / along_sight if along_sight > 0.5 else math.nan
        found.append(Sighting(at_s, at_offset, (AZIMUTH_SIGMA * reach) ** 2 + 0.1**2, speed))
    return found
