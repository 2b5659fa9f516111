"""False targets and missed detections of the sensors: a sample in, an altered sample out, before any wire encodes it.

Every kind of wire encodes the same altered sample, so a phantom lies on the same side on all of them. Phantoms lie
along the track of the nominal drive, so that they are on the path where the brain itself drives. This module must not
know wires, nor the reaction that a phantom requires.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Protocol

import numpy as np

from vve_sumo.body_kinds import TYPICAL, number_of
from vve_sumo.values import Actors, Detections, Floats, Pose
from vve_sumo.wire.sample import Sample, SampleContent

#: half of the azimuth range of phantoms [rad]: an ESR's medium range has 45 degrees
FIELD_OF_VIEW: Final = math.radians(45.0)
#: least and largest range of phantoms [m]: within an ESR's medium range
MIN_RANGE, MAX_RANGE = 0.5, 60.0
#: box of a phantom for sensors that report boxes: a car [m], and its radar cross section [m2]
_LENGTH, _WIDTH, _CROSS_SECTION = 4.6, 1.8, 10.0


class ScanFault(Protocol):
    """A fault of the sensors' data; `step` is called once a tick, in order."""

    def step(self, sample: Sample, active: bool) -> Sample:
        """Return the faulty sample in place of `sample`; `sample` itself where not `active`."""
        ...


class TrackPlace(NamedTuple):
    """A pose on a track."""

    x: float  #: map [m]
    y: float  #: map [m]
    heading: float  #: of the track [rad]


class DrivenTrack:
    """The track of a drive's rear axle by the distance driven; straight beyond its end."""

    def __init__(self, time: Floats, x: Floats, y: Floats, heading: Floats) -> None:
        """Columns of the true pose, a row a tick: drive time [s], map [m], [rad]; rows that are NaN are left out."""
        known = np.isfinite(x) & np.isfinite(y) & np.isfinite(heading)
        self._time, self._x, self._y = time[known], x[known], y[known]
        self._heading = np.unwrap(heading[known])
        steps = np.hypot(np.diff(self._x), np.diff(self._y))
        self._driven = np.concatenate([[0.0], np.cumsum(steps)])[: len(self._x)]

    def driven(self, time: float) -> float:
        """Return the distance driven by a drive time [m]."""
        return float(np.interp(time, self._time, self._driven))

    def place(self, driven: float, offset: float = 0.0) -> TrackPlace:
        """Return the pose at a distance driven [m], with a lateral `offset` from the track [m], left positive."""
        end = float(self._driven[-1])
        within = min(max(driven, 0.0), end)
        x, y, heading = (float(np.interp(within, self._driven, row)) for row in (self._x, self._y, self._heading))
        beyond = driven - within
        cos, sin = math.cos(heading), math.sin(heading)
        return TrackPlace(x + beyond * cos - offset * sin, y + beyond * sin + offset * cos, heading)

    def position_ahead(self, driven: float, ahead: float) -> tuple[float, float]:
        """Return the point `ahead` [m] along the track in the car's axes: forward, left [m]."""
        here, target = self.place(driven), self.place(driven + ahead)
        dx, dy = target.x - here.x, target.y - here.y
        cos, sin = math.cos(here.heading), math.sin(here.heading)
        return cos * dx + sin * dy, cos * dy - sin * dx

    def curvature(self, driven: float) -> float:
        """Return the curvature of the track at a distance driven, over a metre on either side [1/m], left positive."""
        return 0.5 * (self.place(driven + 1.0).heading - self.place(driven - 1.0).heading)


@dataclass(frozen=True, slots=True)
class Phantom:
    """A false target."""

    ahead: float  #: distance ahead of the front bumper along the track when the fault begins [m]
    offset: float = 0.0  #: lateral, from the track [m], left positive
    speed: float = 0.0  #: along the track [m/s]
    mirrored: bool = False  #: mirrored at the car's axis at the begin of the fault


class PhantomDetection(NamedTuple):
    """A phantom as detected from the middle of the front bumper."""

    range: float  #: [m]
    azimuth: float  #: [rad], left positive
    range_rate: float  #: [m/s], opening positive


class Phantoms:
    """A fault that adds phantoms to the true targets."""

    def __init__(self, track: DrivenTrack, begins: float, bumper: float, phantoms: Sequence[Phantom]) -> None:
        """`begins`: time of the phantoms' positions [s]; `bumper`: from the rear axle to the front bumper [m]."""
        self._track, self._begins, self._bumper = track, begins, bumper
        self._driven = track.driven(begins)
        self._phantoms = tuple(phantoms)

    def step(self, sample: Sample, active: bool) -> Sample:
        """Return the sample with the phantoms among its detections and actors."""
        measured = sample.measured
        if not active or measured is None or not sample.radar_valid:
            return sample
        return replace(sample, measured=self._with_phantoms(measured))

    def _with_phantoms(self, measured: SampleContent) -> SampleContent:
        scan = measured.scan
        pose = _earlier(measured.pose, measured.scan_age)
        visible = [
            detection
            for detection in (self._detection(phantom, pose, scan.time) for phantom in self._phantoms)
            if _visible(detection)
        ]
        shown = Detections(
            time=scan.time,
            range=np.concatenate([scan.range, [detection.range for detection in visible]]),
            azimuth=np.concatenate([scan.azimuth, [detection.azimuth for detection in visible]]),
            range_rate=np.concatenate([scan.range_rate, [detection.range_rate for detection in visible]]),
            mode=np.concatenate([scan.mode, np.zeros(len(visible), np.int8)]),
        )
        return replace(measured, scan=shown, actors=self._actors(measured.actors))

    def _detection(self, phantom: Phantom, pose: Pose, time: float) -> PhantomDetection:
        place = self._place(phantom, time)
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        dx = place.x - pose.x - self._bumper * cos
        dy = place.y - pose.y - self._bumper * sin
        distance = max(math.hypot(dx, dy), 1e-6)
        # The bumper moves along the car's axis, and sideways as the car turns. The inside of a bend is shorter.
        sideways = pose.yaw_rate * self._bumper
        speed = phantom.speed * (1.0 - self._track.curvature(self._along(phantom, time)) * phantom.offset)
        vx = speed * math.cos(place.heading) - pose.speed * cos + sideways * sin
        vy = speed * math.sin(place.heading) - pose.speed * sin - sideways * cos
        azimuth = math.atan2(cos * dy - sin * dx, cos * dx + sin * dy)
        return PhantomDetection(distance, azimuth, (vx * dx + vy * dy) / distance)

    def _place(self, phantom: Phantom, time: float) -> TrackPlace:
        place = self._track.place(self._along(phantom, time), phantom.offset)
        return _reflected(place, self._track.place(self._driven)) if phantom.mirrored else place

    def _along(self, phantom: Phantom, time: float) -> float:
        return self._driven + self._bumper + phantom.ahead + phantom.speed * (time - self._begins)

    def _actors(self, actors: Actors) -> Actors:
        """Return the actors with the phantoms' boxes, whose nearest side is the radar's target."""
        places = [self._place(phantom, actors.time) for phantom in self._phantoms]
        half = 0.5 * _LENGTH
        rows = {
            "x": [place.x + half * math.cos(place.heading) for place in places],
            "y": [place.y + half * math.sin(place.heading) for place in places],
            "heading": [place.heading for place in places],
            "speed": [phantom.speed for phantom in self._phantoms],
            "length": [_LENGTH for _ in places],
            "width": [_WIDTH for _ in places],
            "radar_cross_section": [_CROSS_SECTION for _ in places],
            "lateral_speed": [0.0 for _ in places],
            "height": [TYPICAL["car"].height for _ in places],
        }
        columns = {name: np.concatenate([getattr(actors, name), row]) for name, row in rows.items()}
        kind = np.concatenate([actors.kind, np.full(len(places), number_of("car"), np.int8)])
        ids = (*actors.ids, *(f"phantom_{n}" for n in range(len(places))))
        return Actors(time=actors.time, ids=ids, kind=kind, **columns)


class MissedDetections:
    """A fault that removes all detections from valid scans."""

    def step(self, sample: Sample, active: bool) -> Sample:
        """Return the sample without its detections."""
        measured = sample.measured
        if not active or measured is None:
            return sample
        scan = Detections(measured.scan.time, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, np.int8))
        return replace(sample, measured=replace(measured, scan=scan))


def _visible(detection: PhantomDetection) -> bool:
    return abs(detection.azimuth) <= FIELD_OF_VIEW and MIN_RANGE <= detection.range <= MAX_RANGE


def _earlier(pose: Pose, age: float) -> Pose:
    """Return the pose `age` [s] earlier, at constant speed and yaw rate."""
    heading = pose.heading - pose.yaw_rate * age
    middle = pose.heading - 0.5 * pose.yaw_rate * age
    x, y = pose.x - pose.speed * age * math.cos(middle), pose.y - pose.speed * age * math.sin(middle)
    return replace(pose, x=x, y=y, heading=heading)


def _reflected(place: TrackPlace, axis: TrackPlace) -> TrackPlace:
    """Return the mirror image of a pose at the line through `axis` along its heading."""
    cos, sin = math.cos(axis.heading), math.sin(axis.heading)
    left = cos * (place.y - axis.y) - sin * (place.x - axis.x)
    return TrackPlace(place.x + 2.0 * left * sin, place.y - 2.0 * left * cos, 2.0 * axis.heading - place.heading)
