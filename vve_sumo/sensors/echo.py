"""Computes error-free range, azimuth and range rate of each actor's nearest point that the antenna sees.

Pure functions of the ego's pose and the actors. Must not know noise, cycles, or how boxes hide each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from vve_sumo.sensors.visibility import AntennaBox, Sector, Sight, nearest_visible
from vve_sumo.values import Actors, Point, Pose, Vehicle

_COLUMNS = ("x", "y", "heading", "length", "width", "speed", "lateral_speed", "radar_cross_section")


@dataclass(frozen=True, slots=True)
class Mount:
    """Where the antenna sits, from the middle of the front bumper."""

    x: float = -0.1  #: forward [m]; behind the grille (assumption)
    y: float = 0.0  #: left [m]
    yaw: float = 0.0  #: of the boresight [rad], counter-clockwise from the car's forward axis


class Echo(NamedTuple):
    """The error-free measurement of one actor."""

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


def echoes(antenna: Antenna, actors: Actors, sectors: Sequence[Sector]) -> tuple[list[Echo], int]:
    """The nearest visible point of every actor in view, in row order; and the number of non-finite actors.

    Actors with a value that is not finite are left out and hide nothing. Other actors hide each other; the ego's
    own body hides nothing. The point moves as its actor's centre does, along the heading and across it.
    """
    targets, refused = _in_view(antenna, actors, sectors)
    boxes = [target[3] for target in targets]
    return [_echo(antenna, sight, *targets[sight.box]) for sight in nearest_visible(boxes, sectors)], refused


def _in_view(
    antenna: Antenna, actors: Actors, sectors: Sequence[Sector]
) -> tuple[list[tuple[int, float, float, AntennaBox]], int]:
    """Row, speeds along and across, and box in the antenna's frame of every finite actor near the view.

    And how many actors are not finite.
    """
    own_x, own_y, own_heading = antenna.x, antenna.y, antenna.heading
    cos, sin = math.cos(own_heading), math.sin(own_heading)
    slope = max(sector.slope_max for sector in sectors)
    farthest, secant = max(sector.range_max for sector in sectors), math.sqrt(1.0 + slope * slope)
    found: list[tuple[int, float, float, AntennaBox]] = []
    if not actors.ids:
        return found, 0
    refused = 0
    columns = zip(*(getattr(actors, name).tolist() for name in _COLUMNS), strict=True)
    for row, (x, y, heading, length, width, speed, lateral, cross_section) in enumerate(columns):
        if not math.isfinite(x + y + heading + length + width + speed + lateral + cross_section):
            refused += 1
            continue
        east, north = x - own_x, y - own_y
        ahead, aside, radius = east * cos + north * sin, north * cos - east * sin, 0.5 * (length + width)
        reach = farthest + radius
        if ahead * ahead + aside * aside <= reach * reach and abs(aside) - slope * ahead <= secant * radius:
            turn = heading - own_heading
            box = AntennaBox(ahead, aside, math.cos(turn), math.sin(turn), 0.5 * length, 0.5 * width)
            found.append((row, speed, lateral, box))
    return found, refused


def _echo(antenna: Antenna, sight: Sight, row: int, speed: float, lateral: float, box: AntennaBox) -> Echo:
    _, x, y, sector = sight
    speed_x = speed * box.cos - lateral * box.sin - antenna.speed
    speed_y = speed * box.sin + lateral * box.cos - antenna.lateral_speed
    distance = math.sqrt(x * x + y * y)
    # At contact the direction is undefined: take the speed along the boresight.
    range_rate = (speed_x * x + speed_y * y) / distance if distance > 0.0 else speed_x
    return Echo(row, distance, math.atan2(y, x), range_rate, sector)
