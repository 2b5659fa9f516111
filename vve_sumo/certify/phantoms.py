"""False targets and missed detections of the sensors: a sample in, an altered sample out, before any wire encodes it.

Every kind of wire encodes the same altered sample, so a phantom lies on the same side on all of them, and all senses
see it at one place. Phantoms lie along the track of the nominal drive, so that they are on the path where the brain
itself drives. This module must not know wires, nor the reaction that a phantom requires.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Protocol

import numpy as np

from vve_sumo.body_kinds import number_of
from vve_sumo.certify import phantom_contents as contents
from vve_sumo.certify.phantom_contents import HEIGHT, LENGTH, WIDTH, LidarMount, PhantomBody
from vve_sumo.certify.track import DrivenTrack, TrackPlace
from vve_sumo.frames import MapFrame
from vve_sumo.values import Actors, CameraObjects, Detections, Pose, Stations
from vve_sumo.wire.sample import MAX_SCAN_AGE, Sample, SampleContent, earlier_pose

#: half of the azimuth range of phantoms [rad]: an ESR's medium range has 45 degrees
FIELD_OF_VIEW: Final = math.radians(45.0)
#: least and largest range of phantoms [m]: within an ESR's medium range
MIN_RANGE, MAX_RANGE = 0.5, 60.0
#: of a phantom [m2]
_CROSS_SECTION: Final = 10.0


class Installation(NamedTuple):
    """Where a car's sensors are, and the map that they are on."""

    bumper: float  #: from the rear axle to the front bumper [m]
    frame: MapFrame  #: of the virtual road's map
    lidars: Mapping[str, LidarMount]  #: by the sensor's name


class ScanFault(Protocol):
    """A fault of the sensors' data; `step` is called once a tick, in order."""

    def step(self, sample: Sample, active: bool) -> Sample:
        """Return the faulty sample in place of `sample`; `sample` itself where not `active`."""
        ...


@dataclass(frozen=True, slots=True)
class Phantom:
    """A false target."""

    ahead: float  #: distance ahead of the front bumper along the track when the fault begins [m]
    d: float = 0.0  #: lateral, from the track [m], left positive
    speed: float = 0.0  #: along the track [m/s]
    mirrored: bool = False  #: mirrored at the car's axis at the begin of the fault


class PhantomDetection(NamedTuple):
    """A phantom as detected from the middle of the front bumper."""

    range: float  #: [m]
    azimuth: float  #: [rad], left positive
    range_rate: float  #: [m/s], opening positive


class Phantoms:
    """A fault that adds phantoms to the true targets."""

    def __init__(
        self, track: DrivenTrack, begins: float, installation: Installation, phantoms: Sequence[Phantom]
    ) -> None:
        """`begins`: time of the phantoms' positions [s]."""
        self._track, self._begins, self._installed = track, begins, installation
        self._bumper, self._driven = installation.bumper, track.driven(begins)
        self._phantoms = tuple(phantoms)

    def step(self, sample: Sample, active: bool) -> Sample:
        """Return the sample with the phantoms among what every sensor says, and among its actors."""
        measured, now = sample.measured, sample.drive_time
        if not active or measured is None:
            return sample

        def pose_at(time: float) -> Pose:
            return earlier_pose(measured.pose, now - time)

        return replace(sample, measured=self._with_phantoms(measured, now, pose_at))

    def _with_phantoms(self, measured: SampleContent, now: float, pose_at: Callable[[float], Pose]) -> SampleContent:
        def scanned(scan: Detections) -> Detections:
            return self._scanned(scan, pose_at(scan.time)) if now - scan.time <= MAX_SCAN_AGE else scan

        def listed(objects: CameraObjects) -> CameraObjects:
            bodies = self._bodies(objects.time)
            return contents.with_listed(objects, bodies, pose_at(objects.time), self._bumper)

        def heard(stations: Stations) -> Stations:
            car, frame = (measured.pose, self._bumper), self._installed.frame
            return contents.with_stations(stations, self._bodies, self._begins, now, *car, frame)

        turns = {
            name: contents.with_returns(turn, self._bodies(turn.time), measured.pose, now, self._installed.lidars[name])
            for name, turn in measured.turns.items()
        }
        return replace(
            measured,
            scan=scanned(measured.scan),
            others={name: scanned(scan) for name, scan in measured.others.items()},
            actors=self._actors(measured.actors),
            turns=turns,
            lists={name: listed(one) if math.isfinite(one.time) else one for name, one in measured.lists.items()},
            stations_by_receiver={name: heard(one) for name, one in measured.stations_by_receiver.items()},
        )

    def _bodies(self, time: float) -> list[PhantomBody]:
        return [PhantomBody(self._place(phantom, time), phantom.speed) for phantom in self._phantoms]

    def _scanned(self, scan: Detections, pose: Pose) -> Detections:
        visible = [
            detection
            for detection in (self._detection(phantom, pose, scan.time) for phantom in self._phantoms)
            if _visible(detection)
        ]
        return Detections(
            time=scan.time,
            range=np.concatenate([scan.range, [detection.range for detection in visible]]),
            azimuth=np.concatenate([scan.azimuth, [detection.azimuth for detection in visible]]),
            range_rate=np.concatenate([scan.range_rate, [detection.range_rate for detection in visible]]),
            mode=np.concatenate([scan.mode, np.zeros(len(visible), np.int8)]),
        )

    def _detection(self, phantom: Phantom, pose: Pose, time: float) -> PhantomDetection:
        place = self._place(phantom, time)
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        dx = place.x - pose.x - self._bumper * cos
        dy = place.y - pose.y - self._bumper * sin
        distance = max(math.hypot(dx, dy), 1e-6)
        # The bumper moves along the car's axis, and sideways as the car turns. The inside of a bend is shorter.
        sideways = pose.yaw_rate * self._bumper
        speed = phantom.speed * (1.0 - self._track.curvature(self._along(phantom, time)) * phantom.d)
        vx = speed * math.cos(place.heading) - pose.speed * cos + sideways * sin
        vy = speed * math.sin(place.heading) - pose.speed * sin - sideways * cos
        azimuth = math.atan2(cos * dy - sin * dx, cos * dx + sin * dy)
        return PhantomDetection(distance, azimuth, (vx * dx + vy * dy) / distance)

    def _place(self, phantom: Phantom, time: float) -> TrackPlace:
        place = self._track.place(self._along(phantom, time), phantom.d)
        return _reflected(place, self._track.place(self._driven)) if phantom.mirrored else place

    def _along(self, phantom: Phantom, time: float) -> float:
        return self._driven + self._bumper + phantom.ahead + phantom.speed * (time - self._begins)

    def _actors(self, actors: Actors) -> Actors:
        """Return the actors with the phantoms' boxes, whose nearest side is the radar's target."""
        places = [self._place(phantom, actors.time) for phantom in self._phantoms]
        half = 0.5 * LENGTH
        rows = {
            "x": [place.x + half * math.cos(place.heading) for place in places],
            "y": [place.y + half * math.sin(place.heading) for place in places],
            "heading": [place.heading for place in places],
            "speed": [phantom.speed for phantom in self._phantoms],
            "length": [LENGTH for _ in places],
            "width": [WIDTH for _ in places],
            "radar_cross_section": [_CROSS_SECTION for _ in places],
            "lateral_speed": [0.0 for _ in places],
            "height": [HEIGHT for _ in places],
        }
        columns = {name: np.concatenate([getattr(actors, name), row]) for name, row in rows.items()}
        kind = np.concatenate([actors.kind, np.full(len(places), number_of("car"), np.int8)])
        ids = (*actors.ids, *(f"phantom_{n}" for n in range(len(places))))
        return Actors(time=actors.time, ids=ids, kind=kind, **columns)


class MissedDetections:
    """A fault that takes everything but the road out of what every sensor says, which stays valid."""

    def __init__(self, installation: Installation) -> None:
        """Take where the lidars are: height tells a body from the road."""
        self._lidars = installation.lidars

    def step(self, sample: Sample, active: bool) -> Sample:
        """Return the sample without its detections, objects, stations and returns from bodies."""
        measured = sample.measured
        if not active or measured is None:
            return sample
        turns = {name: contents.without_bodies(turn, self._lidars[name]) for name, turn in measured.turns.items()}
        return replace(
            sample,
            measured=replace(
                measured,
                scan=_emptied(measured.scan),
                others={name: _emptied(scan) for name, scan in measured.others.items()},
                turns=turns,
                lists={name: contents.without_rows(one) for name, one in measured.lists.items()},
                stations_by_receiver={
                    name: contents.without_rows(one) for name, one in measured.stations_by_receiver.items()
                },
            ),
        )


def _emptied(scan: Detections) -> Detections:
    return Detections(scan.time, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, np.int8))


def _visible(detection: PhantomDetection) -> bool:
    return abs(detection.azimuth) <= FIELD_OF_VIEW and MIN_RANGE <= detection.range <= MAX_RANGE


def _reflected(place: TrackPlace, axis: TrackPlace) -> TrackPlace:
    """Return the mirror image of a pose at the line through `axis` along its heading."""
    cos, sin = math.cos(axis.heading), math.sin(axis.heading)
    left = cos * (place.y - axis.y) - sin * (place.x - axis.x)
    return TrackPlace(place.x + 2.0 * left * sin, place.y - 2.0 * left * cos, 2.0 * axis.heading - place.heading)
