"""What the sensors see that is not there, or miss: a sample in, an altered sample out, before any wire encodes it.

Because every kind of wire encodes the same altered sample, a phantom lies on the same side on all of them, each in its
own sense of the angle. Phantoms lie along the track of the nominal drive, so that "in the way" is where the brain
itself drives. It must not know wires, nor what a phantom is to cause.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Protocol

import numpy as np

from vve_sumo.values import Actors, Detections, Floats, Pose
from vve_sumo.wire.sample import Sample, SampleContent

#: directions in which phantoms are seen, to both sides of the car's axis [rad]: an ESR's medium range has 45 degrees
FIELD_OF_VIEW: Final = math.radians(45.0)
#: phantoms are seen from as far and up to as far [m]: beneath the farthest of an ESR's medium range
NEAREST, FARTHEST = 0.5, 60.0
#: box of a phantom for senses that see boxes: a car [m], and how well radars see it [m2]
_LENGTH, _WIDTH, _CROSS_SECTION = 4.6, 1.8, 10.0


class ScanFault(Protocol):
    """One fault of what the sensors see; `step` is called once a tick, in order."""

    def step(self, sample: Sample, active: bool) -> Sample:
        """Return what the sensors say in place of `sample`; `sample` itself where not `active`."""
        ...


class TrackPlace(NamedTuple):
    """A place on a track."""

    x: float  #: map [m]
    y: float  #: map [m]
    heading: float  #: of the track [rad]


class DrivenTrack:
    """Where the rear axle of a drive went, by the distance driven; straight on behind its end."""

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

    def place(self, driven: float, aside: float = 0.0) -> TrackPlace:
        """Return the place at a distance driven [m], `aside` of the track [m], left positive."""
        end = float(self._driven[-1])
        within = min(max(driven, 0.0), end)
        x, y, heading = (float(np.interp(within, self._driven, row)) for row in (self._x, self._y, self._heading))
        beyond = driven - within
        cos, sin = math.cos(heading), math.sin(heading)
        return TrackPlace(x + beyond * cos - aside * sin, y + beyond * sin + aside * cos, heading)

    def seen_from(self, driven: float, ahead: float) -> tuple[float, float]:
        """Return the place `ahead` [m] farther along the track in the car's axes there: forward, left [m]."""
        here, there = self.place(driven), self.place(driven + ahead)
        dx, dy = there.x - here.x, there.y - here.y
        cos, sin = math.cos(here.heading), math.sin(here.heading)
        return cos * dx + sin * dy, cos * dy - sin * dx

    def curvature(self, driven: float) -> float:
        """Return the curvature of the track at a distance driven, over a metre on either side [1/m], left positive."""
        return 0.5 * (self.place(driven + 1.0).heading - self.place(driven - 1.0).heading)


@dataclass(frozen=True, slots=True)
class Phantom:
    """A target that is not there."""

    ahead: float  #: of the front bumper along the track when the fault begins [m]
    aside: float = 0.0  #: of the track [m], left positive
    speed: float = 0.0  #: along the track [m/s]
    mirrored: bool = False  #: stands at the place that the car's axis, when the fault begins, reflects it to


class Seen(NamedTuple):
    """A phantom from the middle of the front bumper."""

    range: float  #: [m]
    azimuth: float  #: [rad], left positive
    range_rate: float  #: [m/s], opening positive


class Phantoms:
    """Targets beside those that are there."""

    def __init__(self, track: DrivenTrack, begins: float, bumper: float, phantoms: Sequence[Phantom]) -> None:
        """`begins` is the drive time at which they lie as they say [s]; `bumper` lies ahead of the rear axle [m]."""
        self._track, self._begins, self._bumper = track, begins, bumper
        self._driven = track.driven(begins)
        self._phantoms = tuple(phantoms)

    def step(self, sample: Sample, active: bool) -> Sample:
        """Return the sample with the phantoms among its detections and actors."""
        measured = sample.measured
        if not active or measured is None or not sample.radar_valid:
            return sample
        return replace(sample, measured=self._among(measured))

    def _among(self, measured: SampleContent) -> SampleContent:
        scan = measured.scan
        pose = _earlier(measured.pose, measured.scan_age)
        found = [one for one in (self._seen(phantom, pose, scan.time) for phantom in self._phantoms) if _visible(one)]
        shown = Detections(
            time=scan.time,
            range=np.concatenate([scan.range, [one.range for one in found]]),
            azimuth=np.concatenate([scan.azimuth, [one.azimuth for one in found]]),
            range_rate=np.concatenate([scan.range_rate, [one.range_rate for one in found]]),
            mode=np.concatenate([scan.mode, np.zeros(len(found), np.int8)]),
        )
        return replace(measured, scan=shown, actors=self._actors(measured.actors))

    def _seen(self, phantom: Phantom, pose: Pose, time: float) -> Seen:
        place = self._place(phantom, time)
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        dx = place.x - pose.x - self._bumper * cos
        dy = place.y - pose.y - self._bumper * sin
        distance = max(math.hypot(dx, dy), 1e-6)
        # The bumper moves along the car's axis, and aside as the car turns. On the inside of a bend the way is shorter.
        aside = pose.yaw_rate * self._bumper
        speed = phantom.speed * (1.0 - self._track.curvature(self._along(phantom, time)) * phantom.aside)
        vx = speed * math.cos(place.heading) - pose.speed * cos + aside * sin
        vy = speed * math.sin(place.heading) - pose.speed * sin - aside * cos
        azimuth = math.atan2(cos * dy - sin * dx, cos * dx + sin * dy)
        return Seen(distance, azimuth, (vx * dx + vy * dy) / distance)

    def _place(self, phantom: Phantom, time: float) -> TrackPlace:
        place = self._track.place(self._along(phantom, time), phantom.aside)
        return _reflected(place, self._track.place(self._driven)) if phantom.mirrored else place

    def _along(self, phantom: Phantom, time: float) -> float:
        return self._driven + self._bumper + phantom.ahead + phantom.speed * (time - self._begins)

    def _actors(self, actors: Actors) -> Actors:
        """Return the actors with the phantoms' boxes, whose nearest side is what a radar sees of them."""
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
        }
        columns = {name: np.concatenate([getattr(actors, name), row]) for name, row in rows.items()}
        ids = (*actors.ids, *(f"phantom_{n}" for n in range(len(places))))
        return Actors(time=actors.time, ids=ids, **columns)


class Missing:
    """No detection, in scans that are valid."""

    def step(self, sample: Sample, active: bool) -> Sample:
        """Return the sample without its detections."""
        measured = sample.measured
        if not active or measured is None:
            return sample
        scan = Detections(measured.scan.time, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, np.int8))
        return replace(sample, measured=replace(measured, scan=scan))


def _visible(one: Seen) -> bool:
    return abs(one.azimuth) <= FIELD_OF_VIEW and NEAREST <= one.range <= FARTHEST


def _earlier(pose: Pose, age: float) -> Pose:
    """Return a pose as it was `age` [s] ago, by its speed and yaw rate alone."""
    heading = pose.heading - pose.yaw_rate * age
    middle = pose.heading - 0.5 * pose.yaw_rate * age
    x, y = pose.x - pose.speed * age * math.cos(middle), pose.y - pose.speed * age * math.sin(middle)
    return replace(pose, x=x, y=y, heading=heading)


def _reflected(place: TrackPlace, axis: TrackPlace) -> TrackPlace:
    """Return a place on the other side of the line through `axis` along its heading."""
    cos, sin = math.cos(axis.heading), math.sin(axis.heading)
    left = cos * (place.y - axis.y) - sin * (place.x - axis.x)
    return TrackPlace(place.x + 2.0 * left * sin, place.y - 2.0 * left * cos, 2.0 * axis.heading - place.heading)
