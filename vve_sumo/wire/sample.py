"""Defines what the virtual sensors say at one tick, for the encoders of the outgoing wires.

A sample that is not valid carries its time, and at most what the ego's on-board unit tells others of the ego: nothing
that an encoder could send by mistake for what is to be driven by.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.frames import Placement
from vve_sumo.intersections import SignalPhase
from vve_sumo.timing import PERIOD
from vve_sumo.values import Actors, CameraObjects, Detections, Fix, FixQuality, Floats, Pose, Stations, StopLines

NO_SCAN: Final = Detections(-math.inf, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, np.int8))
#: of a tick's time, in ticks
_ROUNDING: Final = 1e-6
#: an older scan is shown by nobody [s]
MAX_SCAN_AGE: Final = 0.3
#: an older list of a camera is shown by nobody [s]
MAX_LIST_AGE: Final = 0.5


@dataclass(frozen=True, slots=True)
class LidarTurn:
    """A turn of a lidar in whole numbers, small enough for a datagram: F firings of C channels."""

    time: float  #: drive time of the last firing [s]
    firing_period: float  #: from one firing to the next [s]
    azimuth: NDArray[np.uint16]  #: of each firing from the lidar's x axis, clockwise [0.01 degree] (F)
    azimuth_offset: Floats  #: of each channel's ray from that of the first [rad], left positive (C)
    elevation: Floats  #: of each channel [rad], up positive (C)
    range: NDArray[np.uint16]  #: along the ray [2 mm], 0 where nothing came back: firing after firing (F x C)
    reflectivity: NDArray[np.uint8]  #: apparent [percent] (F x C)


@dataclass(frozen=True, slots=True)
class SampleContent:
    """What a valid sample carries."""

    fix: Fix  #: of the receiver's output point at the virtual place, predicted to the sample's time
    pose: Pose  #: of the rear axle on the virtual road, predicted to the sample's time
    scan: Detections  #: the newest of the sensor that every scenario has, in drive time, which is -inf before the first
    scan_age: float  #: since the scan was measured [s]; inf before the first
    actors: Actors  #: on the virtual road, as the sensors saw them
    others: Mapping[str, Detections] = field(default_factory=dict)  #: the newest of each other sensor of detections
    #: of each lidar whose turn came out at this tick, where a wire carries them
    turns: Mapping[str, LidarTurn] = field(default_factory=dict)
    turn: LidarTurn | None = None  #: of the lidar that a wire is of
    lists: Mapping[str, CameraObjects] = field(
        default_factory=dict
    )  #: the newest of each camera, where a wire carries it
    objects: CameraObjects | None = None  #: of the camera that a wire is of
    #: what each V2X receiver knows of others, where a wire carries it
    stations_by_receiver: Mapping[str, Stations] = field(default_factory=dict)
    stations: Stations | None = None  #: of the receiver that a wire is of
    #: what each sense of signals knows of stop lines, where a wire carries it
    lines: Mapping[str, StopLines] = field(default_factory=dict)
    stop_lines: StopLines | None = None  #: of the sense that a wire is of
    #: what the signals of the virtual road show, by SUMO's ids, where a wire carries it
    signals: Mapping[str, SignalPhase] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class OwnMotion:
    """Where the ego knows itself to be, for what its on-board unit says of it to others."""

    pose: Pose  #: of the rear axle on the virtual road
    position_sigma: float  #: of the receiver's, on each axis [m]


@dataclass(frozen=True, slots=True)
class Sample:
    """What the virtual sensors say at one tick."""

    sequence: int  #: `sequence_of` its tick: counts ticks up by one, also those that are skipped
    time: float  #: GNSS time [s since 1980-01-06, no leap seconds]
    drive_time: float  #: the same on the drive's clock [s]
    measured: SampleContent | None  #: None: the outputs are invalid
    #: also while the outputs are invalid: nobody drives by it. None where no wire carries it, or the pose has a fault
    own: OwnMotion | None = None
    faults: tuple[str, ...] = ()  #: reason codes of the tick, each of which makes the sample invalid
    state: str = ""  #: of the gateway, as the drive knew it last; empty before that

    @property
    def valid(self) -> bool:
        """Whether anybody may drive by it."""
        return self.measured is not None

    @property
    def radar_valid(self) -> bool:
        """Whether it holds a scan that is not too old."""
        return self.measured is not None and self.measured.scan_age <= MAX_SCAN_AGE

    def seen_by(self, sensor: str) -> Sample:
        """Return the same with the newest scan, or the turn, of another sensor; with none where it has none of that."""
        if self.measured is None:
            return self
        scan = self.measured.others.get(sensor, NO_SCAN)
        age = self.drive_time - scan.time  # infinite before the first
        seen = replace(
            self.measured,
            scan=scan,
            scan_age=age,
            turn=self.measured.turns.get(sensor),
            objects=self.measured.lists.get(sensor),
            stations=self.measured.stations_by_receiver.get(sensor),
            stop_lines=self.measured.lines.get(sensor),
        )
        return replace(self, measured=seen)


def sequence_of(drive_time: float) -> int:
    """Return the sequence of the tick that was the last at a drive time [s]; 1 for the tick at time 0, or before it.

    It follows from the time alone, so that the drive and the process of its wires count alike without a word.
    """
    return max(1 + math.floor(drive_time / PERIOD + _ROUNDING), 1)


def earlier_pose(pose: Pose, age: float) -> Pose:
    """Return the pose `age` [s] earlier, at constant speed and yaw rate."""
    heading = pose.heading - pose.yaw_rate * age
    middle = pose.heading - 0.5 * pose.yaw_rate * age
    x, y = pose.x - pose.speed * age * math.cos(middle), pose.y - pose.speed * age * math.sin(middle)
    return replace(pose, x=x, y=y, heading=heading)


def virtual_fix(pose: Pose, placement: Placement, newest: Fix) -> Fix:
    """Return the fix of a receiver that stood at a pose on the virtual road.

    `placement` carries the virtual road's own map; quality, accuracies and altitude are those of the `newest` real fix,
    for the virtual place is known no better than the real one.
    """
    exact = placement.unplace(pose)
    return replace(
        exact,
        altitude=newest.altitude,
        roll=newest.roll,
        velocity_down=newest.velocity_down,
        locked=newest.locked,
        quality=newest.quality,
        position_sigma=newest.position_sigma,
        velocity_sigma=newest.velocity_sigma,
        heading_sigma=newest.heading_sigma,
        differential_age=newest.differential_age,
    )


def no_fix(time: float, drive_time: float) -> Fix:
    """Return the fix of a receiver that knows the time [s of GNSS time] and nothing else."""
    unknown = math.nan
    return Fix(
        time=time,
        time_received=drive_time,
        latitude=0.0,
        longitude=0.0,
        altitude=0.0,
        heading=unknown,
        pitch=unknown,
        roll=unknown,
        velocity_north=unknown,
        velocity_east=unknown,
        velocity_down=unknown,
        yaw_rate=unknown,
        acceleration=unknown,
        locked=False,
        quality=FixQuality.NONE,
    )
