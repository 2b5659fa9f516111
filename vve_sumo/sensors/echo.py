"""What an antenna without error would measure of the actors: range, azimuth and range rate of what it sees of each.

Pure functions of the ego's pose and the actors. Must not know noise, cycles, or how boxes hide each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.sensors.visibility import Boxes, Indices, Sector, Sight, nearest_visible
from vve_sumo.values import Actors, Floats, Point, Pose, Vehicle

Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Mount:
    """Where the antenna sits, from the middle of the front bumper."""

    x: float = -0.1  #: forward [m]; behind the grille (assumption)
    y: float = 0.0  #: left [m]
    yaw: float = 0.0  #: of the boresight [rad], counter-clockwise from the car's forward axis


class Echo(NamedTuple):
    """What an antenna without error would measure of one actor."""

    row: int  #: of the actor
    range: float  #: antenna to seen point [m]
    azimuth: float  #: from the boresight [rad], left positive
    range_rate: float  #: [m/s], opening positive
    mode: int  #: index of the first sector that covers the point


class Antenna(NamedTuple):
    """Where the antenna is in the map and how it moves."""

    x: float  #: map [m]
    y: float  #: map [m]
    heading: float  #: of the boresight [rad], counter-clockwise from the map's +x
    speed: float  #: along the boresight [m/s]
    lateral_speed: float  #: across it [m/s], left positive


def antenna_at(pose: Pose, mount: Mount, vehicle: Vehicle) -> Antenna:
    """Rigid-body motion of the antenna: velocity of the rear axle plus yaw rate times lever arm."""
    if pose.point is not Point.REAR_AXLE:
        raise ValueError(f"radar: the pose must be the rear axle's, got {pose.point}")
    ahead = vehicle.rear_axle_to_bumper + mount.x
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    forward = pose.speed - pose.yaw_rate * mount.y
    leftward = pose.lateral_speed + pose.yaw_rate * ahead
    cos_yaw, sin_yaw = math.cos(mount.yaw), math.sin(mount.yaw)
    return Antenna(
        pose.x + ahead * cos - mount.y * sin,
        pose.y + ahead * sin + mount.y * cos,
        pose.heading + mount.yaw,
        forward * cos_yaw + leftward * sin_yaw,
        leftward * cos_yaw - forward * sin_yaw,
    )


def finite_rows(actors: Actors) -> Bools:
    """Which rows hold finite values only."""
    with np.errstate(invalid="ignore", over="ignore"):
        body = actors.x + actors.y + actors.heading + actors.length + actors.width
        return np.isfinite(body + actors.speed + actors.radar_cross_section)


def echoes(antenna: Antenna, actors: Actors, rows: Bools, sectors: Sequence[Sector]) -> list[Echo]:
    """The nearest visible point of every actor in view among the chosen rows, in row order.

    Actors hide each other, the ego's own body hides nothing. The point moves with its actor's speed along its heading.
    The values of the chosen rows must be finite.
    """
    row, centre = _in_view(antenna, actors, rows, sectors)
    turns = (actors.heading[row] - antenna.heading).tolist()
    # Scalar trigonometry: numpy's own on arrays differs in its last bits between processors.
    cos, sin = [math.cos(turn) for turn in turns], [math.sin(turn) for turn in turns]
    half_size = 0.5 * np.array((actors.length[row], actors.width[row]))
    boxes = Boxes(centre, np.array(cos), np.array(sin), half_size)
    numbers, speeds = row.tolist(), actors.speed[row].tolist()
    return [
        _echo(numbers[i], sight, speeds[i] * cos[i] - antenna.speed, speeds[i] * sin[i] - antenna.lateral_speed)
        for i, sight in ((sight.box, sight) for sight in nearest_visible(boxes, sectors))
    ]


def _in_view(antenna: Antenna, actors: Actors, chosen: Bools, sectors: Sequence[Sector]) -> tuple[Indices, Floats]:
    """Rows whose circle around the box meets a sector, and their centres in the antenna's frame as two rows."""
    cos, sin = math.cos(antenna.heading), math.sin(antenna.heading)
    with np.errstate(invalid="ignore", over="ignore"):
        east, north = actors.x - antenna.x, actors.y - antenna.y
        x, y = east * cos + north * sin, north * cos - east * sin
        radius = 0.5 * (actors.length + actors.width)
        range_squared, aside = x * x + y * y, np.abs(y)
        near = np.zeros(x.size, np.bool_)
        for range_max, slope_max in sectors:
            reach = radius + range_max
            outside = aside - slope_max * x
            near |= (range_squared <= reach * reach) & (outside <= math.sqrt(1.0 + slope_max * slope_max) * radius)
    (rows,) = np.nonzero(near & chosen)
    return rows, np.array((x[rows], y[rows]))


def _echo(row: int, sight: Sight, speed_x: float, speed_y: float) -> Echo:
    _, x, y, sector = sight
    distance = math.sqrt(x * x + y * y)
    # Touching: the direction is lost, and what counts is the closing speed along the boresight.
    range_rate = (speed_x * x + speed_y * y) / distance if distance > 0.0 else speed_x
    return Echo(row, distance, math.atan2(y, x), range_rate, sector)
