"""Puts phantoms into what a camera lists, a V2X receiver knows and a lidar's turn brings, or takes true bodies out.

Each function returns another content and leaves the given one as it is. This module must not know wires, nor when a
fault is active.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from vve_sumo.body_kinds import TYPICAL, number_of
from vve_sumo.certify.track import TrackPlace
from vve_sumo.frames import MapFrame, wrap_angle
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.values import CameraObjects, Floats, Pose, ReportedObjects, RoadEvents, Stations
from vve_sumo.wire.sample import LidarTurn, earlier_pose
from vve_sumo.wire.vlp16 import AZIMUTHS, RANGE_QUANTUM

#: size of a phantom [m]: a car
LENGTH, WIDTH, HEIGHT = 4.6, 1.8, TYPICAL["car"].height
#: half of the azimuth range in which a camera lists phantoms [rad], and the farthest [m]: a Mobileye sees 52 degrees
CAMERA_VIEW, CAMERA_RANGE = math.radians(26.0), 80.0
#: of the first phantom: a Mobileye's numbers end at 63, and a camera gives its own from 1 on
CAMERA_NUMBER: Final = 50
#: of the first phantom; stations have numbers of 32 bits drawn at random
STATION_NUMBER: Final = 900_000_000
#: between two messages of a phantom [s]: the shortest that EN 302 637-2 allows
MESSAGE_PERIOD: Final = 0.1
#: radius in which a phantom's message says that the station is [m]
UNCERTAINTY: Final = 0.5
#: of a phantom in a lidar's turn [percent], and its farthest return [m]
REFLECTIVITY, LIDAR_RANGE = 30, 100.0
#: a return from higher than this is none of the road [m]
ROAD_HEIGHT: Final = 0.2

Table = TypeVar("Table", bound=CameraObjects | Stations | ReportedObjects | RoadEvents)


class LidarMount(NamedTuple):
    """Where a lidar is, and where its channels look."""

    x: float  #: forward from the rear axle [m]
    y: float  #: to the left [m]
    z: float  #: above the ground [m]
    yaw: float  #: of its x axis from the car's forward axis [rad], counter-clockwise
    elevations: tuple[float, ...]  #: of each channel [rad], up positive


class PhantomBody(NamedTuple):
    """A phantom at one moment."""

    rear: TrackPlace  #: the middle of its rear, and its heading, map
    speed: float  #: along its heading [m/s]


#: returns the phantoms at a drive time [s]
Bodies = Callable[[float], Sequence[PhantomBody]]


def with_listed(objects: CameraObjects, bodies: Sequence[PhantomBody], pose: Pose, bumper: float) -> CameraObjects:
    """Return a camera's list with the phantoms in its view; `pose` is the car's when the picture was taken."""
    rows = []
    for number, body in enumerate(bodies):
        x, y = _from_bumper(body.rear.x, body.rear.y, pose, bumper)
        if 0.0 < math.hypot(x, y) <= CAMERA_RANGE and abs(math.atan2(y, x)) <= CAMERA_VIEW:
            relative = body.speed * math.cos(body.rear.heading - pose.heading) - pose.speed
            rows.append((CAMERA_NUMBER + number, 1 if body.speed == 0.0 else 3, x, y, relative))
    count, columns = len(rows), [[row[n] for row in rows] for n in range(5)] if rows else [[]] * 5
    return _extended(
        objects,
        number=columns[0],
        kind=[number_of("car")] * count,
        status=columns[1],
        x=columns[2],
        y=columns[3],
        relative_speed=columns[4],
        width=[WIDTH] * count,
        length=[LENGTH] * count,
    )


def with_stations(
    stations: Stations, bodies: Bodies, begins: float, now: float, pose: Pose, bumper: float, frame: MapFrame
) -> Stations:
    """Return what a receiver knows at drive time `now` [s] with the phantoms' last CAMs, one in MESSAGE_PERIOD.

    The first come at `begins` [s]. `pose` is the car's at `now`; `frame` is that of the map. Of true stations `x`, `y`
    and `heading` stay as they were seen from the car when the receiver last said something.
    """
    stations = replace(stations, time=now, age=stations.age + (now - stations.time))
    age = math.fmod(max(now - begins, 0.0) + 1e-6, MESSAGE_PERIOD)
    shown = bodies(now - age)
    geodetic, places, headings = [], [], []
    for body in shown:
        x, y, heading = body.rear
        cos, sin = math.cos(heading), math.sin(heading)
        geodetic.append(frame.to_geodetic(x + LENGTH * cos, y + LENGTH * sin))
        places.append(_from_bumper(x + 0.5 * LENGTH * cos, y + 0.5 * LENGTH * sin, pose, bumper))
        headings.append(heading)
    count = len(shown)
    return _extended(
        stations,
        number=[STATION_NUMBER + number for number in range(count)],
        message=[int(MessageId.CAM)] * count,
        kind=[number_of("car")] * count,
        age=[age] * count,
        latitude=[latitude for latitude, _longitude in geodetic],
        longitude=[longitude for _latitude, longitude in geodetic],
        x=[x for x, _y in places],
        y=[y for _x, y in places],
        heading=[wrap_angle(heading - pose.heading) for heading in headings],
        true_heading=[
            wrap_angle(heading - frame.convergence(*where)) for heading, where in zip(headings, geodetic, strict=True)
        ],
        speed=[body.speed for body in shown],
        yaw_rate=[0.0] * count,
        acceleration=[0.0] * count,
        length=[LENGTH] * count,
        width=[WIDTH] * count,
        uncertainty=[UNCERTAINTY] * count,
    )


def with_returns(
    turn: LidarTurn, bodies: Sequence[PhantomBody], pose: Pose, now: float, mount: LidarMount
) -> LidarTurn:
    """Return a lidar's turn in which rays come back from the phantoms, where they are nearer than what is there.

    `bodies` are those at the turn's time, `pose` the car's at drive time `now` [s]. The small turn of the lidar between
    the first and the last channel of a firing is left out: 0.12 degrees of a VLP-16.
    """
    firings = len(turn.azimuth)
    later: Floats = turn.firing_period * np.arange(1 - firings, 1, dtype=np.float64)
    x, y, heading = _lidar_places(pose, now - turn.time - later, mount)
    direction = heading + mount.yaw - turn.azimuth * (math.tau / AZIMUTHS)
    level = np.full(firings, np.inf)
    for body in bodies:
        level = np.minimum(level, _distance_to(body, later, x, y, direction))
    hit, elevation = np.isfinite(level), np.array(mount.elevations)
    flat = np.where(hit, level, 1.0)[:, None]
    slant, height = flat / np.cos(elevation), mount.z + flat * np.tan(elevation)
    there = turn.range.reshape(firings, -1).astype(np.int64)
    quanta = np.rint(slant / RANGE_QUANTUM).astype(np.int64)
    shown = hit[:, None] & (height >= 0.0) & (height <= HEIGHT) & (slant <= LIDAR_RANGE)
    shown &= (there == 0) | (quanta < there)
    reflectivity = np.where(shown.ravel(), np.uint8(REFLECTIVITY), turn.reflectivity)
    return replace(
        turn, range=np.where(shown, quanta, there).astype(np.uint16).ravel(), reflectivity=reflectivity.astype(np.uint8)
    )


def without_rows(table: Table) -> Table:
    """Return a camera's list, or what a receiver knows, without any object, station or event."""
    changed: dict[str, Any] = {}
    for name in table.__slots__:
        value = getattr(table, name)
        if isinstance(value, np.ndarray):
            changed[name] = value[:0]
        elif isinstance(value, ReportedObjects | RoadEvents):
            changed[name] = without_rows(value)
    return replace(table, **changed)


def without_bodies(turn: LidarTurn, mount: LidarMount) -> LidarTurn:
    """Return a lidar's turn in which nothing but the road comes back."""
    ranges = turn.range.reshape(len(turn.azimuth), -1)
    height = mount.z + RANGE_QUANTUM * ranges * np.sin(mount.elevations)
    return replace(turn, range=np.where(height > ROAD_HEIGHT, 0, ranges).astype(np.uint16).ravel())


def _extended(table: Table, **columns: Sequence[Any]) -> Table:
    added: dict[str, Any] = {
        name: np.concatenate([getattr(table, name), np.asarray(column, getattr(table, name).dtype)])
        for name, column in columns.items()
    }
    return replace(table, **added)


def _from_bumper(x: float, y: float, pose: Pose, bumper: float) -> tuple[float, float]:
    """Return how far a point of the map is ahead of the front bumper, and left of the car's axis [m]."""
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    dx, dy = x - pose.x, y - pose.y
    return cos * dx + sin * dy - bumper, cos * dy - sin * dx


def _lidar_places(pose: Pose, age: Floats, mount: LidarMount) -> tuple[Floats, Floats, Floats]:
    """Return where a lidar was, and the car's heading [rad], each `age` [s] before a pose."""
    before = [earlier_pose(pose, one) for one in age.tolist()]
    heading = np.array([one.heading for one in before])
    cos, sin = np.cos(heading), np.sin(heading)
    x = np.array([one.x for one in before]) + mount.x * cos - mount.y * sin
    return x, np.array([one.y for one in before]) + mount.x * sin + mount.y * cos, heading


def _distance_to(body: PhantomBody, later: Floats, x: Floats, y: Floats, direction: Floats) -> Floats:
    """Return the level distance along rays to a phantom [m], inf where they miss it; it is `later` [s] at the ray."""
    cos, sin = math.cos(body.rear.heading), math.sin(body.rear.heading)
    dx, dy = x - body.rear.x, y - body.rear.y
    along, aside = cos * dx + sin * dy - body.speed * later, cos * dy - sin * dx
    turned = direction - body.rear.heading
    with np.errstate(divide="ignore"):
        ends = -along / np.cos(turned), (LENGTH - along) / np.cos(turned)
        sides = (-0.5 * WIDTH - aside) / np.sin(turned), (0.5 * WIDTH - aside) / np.sin(turned)
    nearest = np.maximum(np.minimum(*ends), np.minimum(*sides))
    farthest = np.minimum(np.maximum(*ends), np.maximum(*sides))
    return np.where((nearest <= farthest) & (nearest > 0.0), nearest, np.inf)
