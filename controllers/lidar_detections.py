"""Turns a lidar's points into detections: one for each thing that stands on the ground, at its nearest point.

A lidar measures no speed; the tracker tells it from where a thing is from turn to turn. It must not know the path.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy import ndimage

from vve_sumo.values import Detections, Observation, PointCloud, Vehicle

from .sightings import AxleMotion, Memory, Noise, output_of

GROUND: Final = 0.25  #: points lower than this over the road are the road's [m]
OVERHEAD: Final = 2.5  #: the car passes below what is higher than this [m]
AHEAD, ASIDE = 80.0, 20.0  #: how far from the front bumper things are looked for [m]
CELL: Final = 0.3  #: points in cells of this size that touch each other are one thing [m]
POINTS: Final = 2  #: of a thing, at least
GAP: Final = 3.0  #: between pieces of one thing, one behind the other, at most [m]
APART: Final = 1.5  #: steps from ray to ray between them, at most, where they are not in one direction
#: What is left of a point's error is that the nearest point is another one from turn to turn. Anything up to a car's
#: speed is thinkable of what is seen for the first time.
NOISE: Final = Noise(range_sigma=0.12, rate_sigma=8.0, azimuth_sigma=math.radians(0.2), unknown_sigma=8.0)
#: all corners of a cell touch
_TOUCHING: Final = np.ones((3, 3), np.int8)


class LidarDetections:
    """Keeps the detections of the newest turn."""

    noise: Final = NOISE

    def __init__(self, vehicle: Vehicle, sensor: str, forward: float, height: float) -> None:
        """`sensor` is the lidar's name; it is mounted `forward` of the rear axle [m] and so high over the road [m]."""
        self._sensor, self._height = sensor, height
        self._to_bumper = forward - vehicle.rear_axle_to_bumper
        self._forward = forward
        self._memory = Memory()
        self._newest = Detections(-math.inf, *_no_columns())

    def scan(self, observation: Observation) -> Detections:
        """Return the detections of the newest turn; raises TypeError where the scenario has no such lidar."""
        turn = output_of(observation, self._sensor, PointCloud, "lidar")
        self._memory.add(observation.pose)
        if turn.time > self._newest.time:
            x, y = self._places(turn)
            self._newest = Detections(turn.time, *_things(x, y, self._to_bumper, 2.0 * math.pi / len(turn.azimuth)))
        return self._newest

    def _places(self, turn: PointCloud) -> tuple[np.ndarray, np.ndarray]:
        """Return where the points are that stand on the road, ahead and left of the bumper at the turn's end [m]."""
        x, y, _height, _firing = standing(
            turn, self._memory.at(turn.time), self._forward, self._height, self._to_bumper
        )
        near = (x > 0.0) & (x < AHEAD) & (np.abs(y) < ASIDE)
        return x[near], y[near]


def standing(
    turn: PointCloud, axle: AxleMotion, forward: float, height: float, ahead: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a turn's points that stand on the road: ahead and left of a point, over the road [m], and their firings.

    A point is given from where the lidar was at its ray's time: the car has gone on and turned since. `axle` is the
    rear axle's motion at the turn's end. The lidar is `forward` of it [m], `height` over the road [m] and `ahead` of
    the point that is counted from [m].
    """
    firing, channel = np.nonzero(turn.range > 0.0)
    far, elevation = turn.range[firing, channel], turn.elevation[channel]
    over_road = far * np.sin(elevation) + height
    kept = (over_road > GROUND) & (over_road < OVERHEAD)
    firing, channel, far, elevation = firing[kept], channel[kept], far[kept], elevation[kept]
    azimuth, since = turn.azimuth[firing] + turn.azimuth_offset[channel], turn.time_offset[firing]
    level = far * np.cos(elevation)
    turned = axle.yaw_rate * since
    x, y = level * np.cos(azimuth + turned), level * np.sin(azimuth + turned)
    aside = axle.lateral_speed + axle.yaw_rate * forward
    return x + axle.speed * since + ahead, y + aside * since, over_road[kept], firing


def touching(x: np.ndarray, y: np.ndarray, behind: float, ahead: float, aside: float) -> np.ndarray:
    """Return of points that lie within these distances [m] the number of the piece that each belongs to, from 1."""
    rows, columns = ((x + behind) / CELL).astype(np.intp), ((y + aside) / CELL).astype(np.intp)
    grid = np.zeros((math.ceil((behind + ahead) / CELL) + 1, math.ceil(2.0 * aside / CELL) + 1), np.bool_)
    grid[rows, columns] = True
    labels, _count = ndimage.label(grid, _TOUCHING)
    pieces: np.ndarray = labels[rows, columns]
    return pieces


def _no_columns() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return np.empty(0), np.empty(0), np.empty(0), np.empty(0, np.int8)


def _things(
    x: np.ndarray, y: np.ndarray, lidar: float, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return range, azimuth, range rate and mode of each thing's nearest point, nearest things first.

    `lidar` is how far the lidar is ahead of the bumper [m], `step` the angle from one ray to the next [rad].
    """
    pieces = touching(x, y, 0.0, AHEAD, ASIDE)
    order = np.argsort(np.hypot(x, y), kind="stable")
    x, y = x[order], y[order]
    _, first, piece, sizes = np.unique(pieces[order], return_index=True, return_inverse=True, return_counts=True)
    known = np.flatnonzero(sizes >= POINTS)
    known = known[np.argsort(first[known])]
    goes_on = continuing(np.hypot(x - lidar, y), np.arctan2(y, x - lidar), piece, first, step)
    begins = np.logical_not(goes_on.any(axis=1))[known]
    near_x, near_y = x[first[known][begins]], y[first[known][begins]]
    unknown = np.full(len(near_x), np.nan)
    return np.hypot(near_x, near_y), np.arctan2(near_y, near_x), unknown, np.zeros(len(near_x), np.int8)


def continuing(far: np.ndarray, azimuth: np.ndarray, piece: np.ndarray, first: np.ndarray, step: float) -> np.ndarray:
    """Tell of each piece (row) which others (columns) it goes on: one that is next before it, in its direction.

    Points of a flank that is seen at a grazing angle lie far apart, and so do those of a roof from the rear's: such
    things fall into pieces. `far` and `azimuth` are of every point, seen from the lidar [m], [rad]; `piece` is its
    number, and `first` each piece's nearest point.
    """
    rightmost, leftmost, farthest = np.full(len(first), np.inf), np.full(len(first), -np.inf), np.zeros(len(first))
    np.minimum.at(rightmost, piece, azimuth)
    np.maximum.at(leftmost, piece, azimuth)
    np.maximum.at(farthest, piece, far)
    aside, reach = azimuth[first][:, None], far[first][:, None]
    margin = APART * step
    behind = (reach > far[first]) & (reach - farthest < GAP)
    goes_on: np.ndarray = behind & (aside > rightmost - margin) & (aside < leftmost + margin)
    return goes_on
