"""Casts the rays of a turning lidar: what each meets first of bodies, walls and the ground, how far, and how squarely.

Rays leave in firings, one ray a channel, while the sensor turns and moves and the bodies move. All rays are compared
with what lies in their direction alone: the bearing of a firing rises evenly, so that the firings that a body or a wall
can meet are one interval. Plane geometry with heights; the ground is flat at height 0. Knows no noise.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.path import Indices
from vve_sumo.sensors.body_shapes import Blocks
from vve_sumo.sensors.street import Walls
from vve_sumo.values import Floats

#: what a ray met, where it is no row of the blocks
GROUND: Final = -1
WALL: Final = -2
NOTHING: Final = -3

#: Nearer to the sensor than this, a body or wall is compared with every firing [m]: its bearing changes quickly.
CLOSE: Final = 2.0
#: the least tangent or component of a direction, so that every quotient is finite
LEVEL: Final = 1e-12


class Firings(NamedTuple):
    """The rays of successive firings: F firings of C channels."""

    x: Floats  #: of the sensor at each firing, map [m] (F)
    y: Floats  #: (F)
    height: float  #: of the sensor above the ground [m]
    age: Floats  #: from each firing to the time for which bodies are given [s] (F)
    azimuth: Floats  #: of each firing's first ray in the map [rad], counter-clockwise, evenly spaced (F)
    spread: Floats  #: of each channel's ray after the first, in shares of the step to the next firing, 0 to 1 (C)
    elevation: Floats  #: of each channel's ray [rad], up positive (C)

    @property
    def step(self) -> float:
        """Angle from one firing to the next [rad], not 0."""
        return float(self.azimuth[-1] - self.azimuth[0]) / (len(self.azimuth) - 1)


class Hits(NamedTuple):
    """What rays met; arrays are firings by channels."""

    range: Floats  #: along the ray [m]; infinite for nothing
    what: NDArray[np.int32]  #: row of the block; GROUND, WALL or NOTHING
    cosine: Floats  #: of the angle between ray and the normal of the surface, 0 to 1

    def first(self, firings: int) -> Hits:
        """Return what the rays of the first firings met."""
        return Hits(self.range[:firings], self.what[:firings], self.cosine[:firings])


class _Directions(NamedTuple):
    """Components of the rays in the map, over a horizontal metre."""

    x: Floats  #: F by C
    y: Floats  #: F by C
    rise: Floats  #: C


class _Candidates(NamedTuple):
    """Pairs of a body or wall and a firing that may meet, in the order of the firings."""

    row: Indices
    firing: Indices


def cast(firings: Firings, blocks: Blocks, walls: Walls, reach: float) -> Hits:
    """Return what each ray meets first within a reach [m]; at least two firings, over at most a whole turn.

    A sensor inside a body does not see it. Sides of a body that is seen through no other count, its top and its bottom
    too; walls have neither.
    """
    bearing = firings.azimuth[:, None] + firings.spread * firings.step
    rise = np.tan(firings.elevation)
    rise[np.abs(rise) < LEVEL] = LEVEL
    directions = _Directions(np.cos(bearing), np.sin(bearing), rise)
    away, what, cosine = _ground(firings, rise)
    for nearest in (_blocks(firings, directions, blocks), _walls(firings, directions, walls)):
        if nearest is not None:
            _take(nearest, away, what, cosine)
    far = away / np.cos(firings.elevation)
    beyond = ~(far <= reach)
    far[beyond], what[beyond], cosine[beyond] = math.inf, NOTHING, 0.0
    return Hits(far, what, cosine)


def _ground(firings: Firings, rise: Floats) -> tuple[Floats, NDArray[np.int32], Floats]:
    shape = len(firings.x), len(rise)
    down = rise < 0.0
    away = np.where(down, firings.height / np.where(down, -rise, 1.0), math.inf)
    cosine = np.where(down, np.abs(np.sin(firings.elevation)), 0.0)
    what = np.where(down, GROUND, NOTHING).astype(np.int32)
    return (
        np.broadcast_to(away, shape).copy(),
        np.broadcast_to(what, shape).copy(),
        np.broadcast_to(cosine, shape).copy(),
    )


class _Met(NamedTuple):
    """How candidates meet: for each pair and channel."""

    firing: Indices  #: of each pair, not falling
    what: NDArray[np.int32]  #: of each pair
    away: Floats  #: horizontal distance [m] (pairs by channels); infinite where they do not meet
    cosine: Floats  #: pairs by channels


def _take(met: _Met, away: Floats, what: NDArray[np.int32], cosine: Floats) -> None:
    """Put the nearest of what rays met in place of what lies behind it."""
    begins = np.flatnonzero(np.diff(met.firing, prepend=-1))
    nearest = np.minimum.reduceat(met.away, begins, axis=0)
    group = np.repeat(np.arange(len(begins)), np.diff(begins, append=len(met.firing)))
    pair, channel = np.nonzero((met.away == nearest[group]) & (met.away < away[met.firing]))
    firing = met.firing[pair]
    away[firing, channel] = met.away[pair, channel]
    what[firing, channel] = met.what[pair]
    cosine[firing, channel] = met.cosine[pair, channel]


def _blocks(firings: Firings, directions: _Directions, blocks: Blocks) -> _Met | None:
    ahead = np.multiply.outer((1.0, 1.0, -1.0, -1.0), blocks.half_length)
    left = np.multiply.outer((1.0, -1.0, 1.0, -1.0), blocks.half_width)
    corners_x = blocks.x + ahead * blocks.cos - left * blocks.sin
    corners_y = blocks.y + ahead * blocks.sin + left * blocks.cos
    row, firing = _candidates(firings, corners_x, corners_y, blocks.speed_x, blocks.speed_y)
    if not len(row):
        return None
    age, cos, sin = firings.age[firing], blocks.cos[row], blocks.sin[row]
    east = firings.x[firing] - blocks.x[row] + blocks.speed_x[row] * age
    north = firings.y[firing] - blocks.y[row] + blocks.speed_y[row] * age
    ray_x, ray_y = directions.x[firing], directions.y[firing]
    along = ray_x * cos[:, None] + ray_y * sin[:, None]
    across = ray_y * cos[:, None] - ray_x * sin[:, None]
    own = (east * cos + north * sin)[:, None], (north * cos - east * sin)[:, None]
    sides = (
        _slab(own[0], along, -blocks.half_length[row][:, None], blocks.half_length[row][:, None]),
        _slab(own[1], across, -blocks.half_width[row][:, None], blocks.half_width[row][:, None]),
        _slab(firings.height, directions.rise[None, :], blocks.bottom[row][:, None], blocks.top[row][:, None]),
    )
    entry = np.maximum(np.maximum(sides[0][0], sides[1][0]), sides[2][0])
    leave = np.minimum(np.minimum(sides[0][1], sides[1][1]), sides[2][1])
    away = np.where((entry <= leave) & (entry > 0.0), entry, math.inf)
    level = np.cos(firings.elevation)
    cosine = np.where(entry == sides[0][0], np.abs(along), np.abs(across)) * level
    cosine = np.where(entry == sides[2][0], np.abs(np.sin(firings.elevation)), cosine)
    return _Met(firing, row.astype(np.int32), away, cosine)


def _slab(at: Floats | float, moves: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return where rays enter and leave what lies between two planes, over a horizontal metre."""
    moves = np.where(np.abs(moves) < LEVEL, LEVEL, moves)
    one, other = (low - at) / moves, (high - at) / moves
    return np.minimum(one, other), np.maximum(one, other)


def _walls(firings: Firings, directions: _Directions, walls: Walls) -> _Met | None:
    if not len(walls.x):
        return None
    ends_x, ends_y = np.stack((walls.x, walls.x + walls.along_x)), np.stack((walls.y, walls.y + walls.along_y))
    still = np.zeros(len(walls.x))
    row, firing = _candidates(firings, ends_x, ends_y, still, still)
    if not len(row):
        return None
    east, north = (walls.x[row] - firings.x[firing])[:, None], (walls.y[row] - firings.y[firing])[:, None]
    along_x, along_y = walls.along_x[row][:, None], walls.along_y[row][:, None]
    ray_x, ray_y = directions.x[firing], directions.y[firing]
    cross = ray_x * along_y - ray_y * along_x
    cross = np.where(np.abs(cross) < LEVEL, LEVEL, cross)
    away = (east * along_y - north * along_x) / cross
    share = (east * ray_y - north * ray_x) / cross
    height = firings.height + away * directions.rise
    meets = (away > 0.0) & (share >= 0.0) & (share <= 1.0) & (height >= 0.0) & (height <= walls.top[row][:, None])
    cosine = np.abs(cross) / np.hypot(along_x, along_y) * np.cos(firings.elevation)
    what = np.full(len(row), WALL, np.int32)
    return _Met(firing, what, np.where(meets, away, math.inf), cosine)


def _candidates(firings: Firings, x: Floats, y: Floats, speed_x: Floats, speed_y: Floats) -> _Candidates:
    """Return every pair of a convex outline and a firing one of whose rays can meet it.

    `x` and `y` are the outlines' corners (corners by outlines), which move [m/s]. Between the first and the last firing
    a corner and the sensor move along straight lines, so that the corner's bearing stays between those at both.
    """
    last, step = len(firings.x) - 1, firings.step
    bearings, near = [], np.zeros(x.shape[1], bool)
    for at in (0, last):
        east, north = x - speed_x * firings.age[at] - firings.x[at], y - speed_y * firings.age[at] - firings.y[at]
        bearings.append(np.arctan2(north, east))
        near |= np.hypot(east.mean(axis=0), north.mean(axis=0)) < CLOSE + _radius(x, y)
    angles = np.concatenate(bearings)
    middle = angles[0]
    offsets = np.remainder(angles - middle + math.pi, math.tau) - math.pi
    low, high = offsets.min(axis=0), offsets.max(axis=0)
    ends = np.stack((middle + low, middle + high)) - firings.azimuth[0]
    first, after = np.sort(ends / step, axis=0)
    turn = abs(math.tau / step)
    # The interval is shifted by whole turns to where it begins in the first one; its end may reach into the next.
    shift = np.floor(first / turn) * turn
    rows, begins, counts = [], [], []
    for turns in (0.0, -turn):
        begin = np.where(near, 0, np.maximum(np.ceil(first - shift + turns) - 1, 0))
        end = np.where(near, last if turns == 0.0 else -1, np.minimum(np.floor(after - shift + turns), last))
        here = np.flatnonzero(end >= begin)
        rows.append(here)
        begins.append(begin[here])
        counts.append(end[here] - begin[here] + 1)
    row, begin, count = (np.concatenate(parts).astype(np.intp) for parts in (rows, begins, counts))
    owner = np.repeat(row, count)
    firing = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count - begin, count)
    order = np.argsort(firing, kind="stable")
    return _Candidates(owner[order], firing[order])


def _radius(x: Floats, y: Floats) -> Floats:
    """Return the greatest distance of an outline's corners from their mean [m]."""
    away: Floats = np.hypot(x - x.mean(axis=0), y - y.mean(axis=0)).max(axis=0)
    return away
