"""Casts the rays of a turning lidar: what each meets first of bodies, walls and the ground, how far, and how squarely.

Rays leave in firings, one ray a channel, while the sensor turns and moves and the bodies move. All rays are compared
with what lies in their direction alone: the bearing of a firing rises evenly, so that the firings that a body or a wall
can meet are one interval, and so are the channels that can, in the order of their elevations. Plane geometry with
heights; the ground is flat at height 0. Knows no noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.path import Indices
from vve_sumo.sensors.body_shapes import Blocks
from vve_sumo.sensors.runs import runs
from vve_sumo.sensors.street import Walls
from vve_sumo.values import Floats

#: what a ray met, where it is no row of the blocks
GROUND: Final = -1
WALL: Final = -2
NOTHING: Final = -3

#: A body or wall that fills a greater angle during the firings is compared with all of them [rad]: one that the sensor
#: is in, or that passes it from one side to the other, has corners in no half plane and fills more than pi.
GREATEST_ANGLE: Final = 3.0
#: firings by which the interval that meets a body is wider than computed, and channels' tangents likewise: for rounding
MARGIN: Final = 1e-6
#: the least distance at which a body counts [m], so that every quotient is finite
NEAREST: Final = 1e-3
#: the least tangent or component of a direction, so that every quotient is finite
LEVEL: Final = 1e-12

_Flags = NDArray[np.bool_]


class Hits(NamedTuple):
    """What rays met; arrays are firings by channels, or have an entry a channel."""

    range: Floats  #: along the ray [m]; infinite for nothing
    what: NDArray[np.int32]  #: row of the block; GROUND, WALL or NOTHING
    cosine: Floats  #: of the angle between ray and the normal of the surface, 0 to 1


class Channels(NamedTuple):
    """What all firings have in common; arrays have an entry a channel."""

    elevation: Floats  #: of each channel's ray [rad], up positive
    spread: Floats  #: of each channel's ray after the first, in shares of the step to the next firing, 0 to 1
    height: float  #: of the sensor above the ground [m]
    reach: float  #: farther surfaces do not count [m]
    rise: Floats  #: of the rays over a horizontal metre
    level: Floats  #: horizontal part of a metre of the rays
    steep: Floats  #: vertical part of a metre of the rays, without its sign
    rising: Indices  #: the channels from the lowest elevation to the highest
    to_ground: Floats  #: horizontal distance at which the rays meet the ground [m], infinite for nowhere
    ground: Hits  #: what the rays meet where nothing stands in their way

    @classmethod
    def of(cls, elevation: Floats, spread: Floats, height: float, reach: float) -> Channels:
        """Return the channels of a sensor at a height."""
        rise, level, steep = np.tan(elevation), np.cos(elevation), np.abs(np.sin(elevation))
        rise[np.abs(rise) < LEVEL] = LEVEL
        down = rise < 0.0
        to_ground = np.where(down, height / np.where(down, -rise, 1.0), math.inf)
        far = to_ground / level
        meets = far <= reach
        what = np.where(meets, GROUND, NOTHING).astype(np.int32)
        ground = Hits(np.where(meets, far, math.inf), what, np.where(meets, steep, 0.0))
        return cls(elevation, spread, height, reach, rise, level, steep, np.argsort(rise), to_ground, ground)


class Stretch(NamedTuple):
    """Successive firings while sensor and bodies move straight and the sensor turns evenly, at most a whole turn."""

    x: Floats  #: of the sensor at each firing, map [m]
    y: Floats  #: of the sensor at each firing, map [m]
    age: Floats  #: from each firing to the time for which the bodies are given [s]
    azimuth: Floats  #: of each firing's first ray in the map [rad], counter-clockwise, evenly spaced
    step: float  #: angle from one firing to the next [rad], not 0
    blocks: Blocks
    walls: Walls


class _Firings(NamedTuple):
    """The firings of all stretches; arrays have an entry a firing."""

    channels: Channels
    x: Floats  #: of the sensor, map [m]
    y: Floats  #: of the sensor, map [m]
    age: Floats  #: to the time for which the bodies of the stretch are given [s]
    azimuth: Floats  #: of the first ray in the map [rad], counter-clockwise
    step: Floats  #: angle to the next firing of the stretch [rad]


class _Outlines(NamedTuple):
    """Bodies or walls from above, with their heights; arrays have an entry each."""

    span: Indices  #: the first and the last firing of each one's stretch (2 by outlines)
    x: Floats  #: of a place that moves with the corners, map [m]
    y: Floats  #: of that place, map [m]
    corners_x: Floats  #: of the corners from that place [m] (corners by outlines)
    corners_y: Floats  #: of the corners from that place [m] (corners by outlines)
    half_side: Floats  #: half of the longest side [m]
    speed_x: Floats | float  #: map [m/s]
    speed_y: Floats | float  #: map [m/s]
    bottom: Floats | float  #: above the ground [m]
    top: Floats  #: above the ground [m]


class _Candidates(NamedTuple):
    """Rays that may meet a body or wall, by pairs of an outline and a firing."""

    row: Indices  #: of the outline, of each pair
    firing: Indices  #: of each pair
    pair: Indices  #: of each ray
    channel: Indices  #: of each ray


class _Met(NamedTuple):
    """Rays that meet a body or wall."""

    ray: Indices  #: counted firing by firing and channel by channel
    channel: Indices
    away: Floats  #: horizontal distance [m]
    what: NDArray[np.int32]
    cosine: Floats


def cast(channels: Channels, stretches: Sequence[Stretch]) -> Hits:
    """Return what each ray meets first within reach, in one or more stretches of firings, one after the other.

    A block's row counts through the blocks of all stretches. Of two blocks that are as near, such as roofs in each
    other, the later one counts. A sensor inside a body does not see it. Sides of a body that is seen through no other
    count, its top and its bottom too; walls have neither.
    """
    firings, spans = _firings(channels, stretches)
    hits = Hits(*(at_every_firing(column, len(firings.x)) for column in channels.ground))
    away = at_every_firing(channels.to_ground, len(firings.x))
    blocks, walls = [stretch.blocks for stretch in stretches], [stretch.walls for stretch in stretches]
    for met in (
        _blocks(firings, spans.repeat([len(own.x) for own in blocks], axis=1), Blocks(*_joined(blocks))),
        _walls(firings, spans.repeat([len(own.x) for own in walls], axis=1), Walls(*_joined(walls))),
    ):
        if met is not None:
            _take(met, channels, hits, away)
    return hits


def _firings(channels: Channels, stretches: Sequence[Stretch]) -> tuple[_Firings, Indices]:
    """Return the firings of all stretches, and the first and the last one of each (2 by stretches)."""
    counts = [len(stretch.x) for stretch in stretches]
    x, y, age, azimuth = _joined([stretch[:4] for stretch in stretches])
    step = np.repeat([stretch.step for stretch in stretches], counts)
    after = np.cumsum(counts)
    return _Firings(channels, x, y, age, azimuth, step), np.stack((after - counts, after - 1))


def _joined(parts: Sequence[Iterable[NDArray[Any]]]) -> Iterator[NDArray[Any]]:
    """Return columns that are given in parts."""
    return map(np.concatenate, zip(*parts, strict=True))


def at_every_firing(of_channels: NDArray[Any], firings: int) -> NDArray[Any]:
    """Return what each channel has at every one of some firings: firings by channels."""
    return of_channels[np.newaxis].repeat(firings, axis=0)


def _take(met: _Met, channels: Channels, hits: Hits, away: Floats) -> None:
    """Put the nearest of what rays met within reach in place of what lies behind it, `away` [m] horizontally."""
    far = met.away / channels.level[met.channel]
    nearest = away.reshape(-1)
    closer = (met.away < nearest[met.ray]) & (far <= channels.reach)
    np.minimum.at(nearest, met.ray[closer], met.away[closer])
    first = np.flatnonzero(closer & (met.away == nearest[met.ray]))
    ray = met.ray[first]
    hits.range.reshape(-1)[ray] = far[first]
    hits.what.reshape(-1)[ray] = met.what[first]
    hits.cosine.reshape(-1)[ray] = met.cosine[first]


def _blocks(firings: _Firings, span: Indices, blocks: Blocks) -> _Met | None:
    if not len(blocks.x):
        return None
    channels = firings.channels
    row, firing, pair, channel = _candidates(firings, _outlines(span, blocks))
    if not len(pair):
        return None
    of_rays = _planes(firings, blocks, row, firing).take(pair, axis=1)
    cos, sin = of_rays[:2]
    ray_x, ray_y = _directions(channels, of_rays[2:4], channel)
    along, across = ray_x * cos + ray_y * sin, ray_y * cos - ray_x * sin
    moves = np.concatenate((along, across, channels.rise[channel])).reshape(3, -1)
    moves = np.where(np.abs(moves) < LEVEL, LEVEL, moves)
    one, other = of_rays[4:7] / moves, of_rays[7:] / moves
    enters, leaves = np.minimum(one, other), np.maximum(one, other)
    entry, leave = np.maximum.reduce(enters), np.minimum.reduce(leaves)
    meets = np.flatnonzero((entry <= leave) & (entry > 0.0))
    away, channel, pair = entry[meets], channel[meets], pair[meets]
    squarely, enters = np.abs(moves.take(meets, axis=1)), enters.take(meets, axis=1)
    cosine = np.where(away == enters[0], squarely[0], squarely[1]) * channels.level[channel]
    cosine = np.where(away == enters[2], channels.steep[channel], cosine)
    return _Met(firing[pair] * len(channels.rise) + channel, channel, away, row[pair].astype(np.int32), cosine)


#: signs of the corners of a block along and across its heading
_AHEAD: Final = np.array([[1.0], [1.0], [-1.0], [-1.0]])
_LEFT: Final = np.array([[1.0], [-1.0], [1.0], [-1.0]])


def _outlines(span: Indices, blocks: Blocks) -> _Outlines:
    ahead, left = _AHEAD * blocks.half_length, _LEFT * blocks.half_width
    return _Outlines(
        span,
        blocks.x,
        blocks.y,
        ahead * blocks.cos - left * blocks.sin,
        ahead * blocks.sin + left * blocks.cos,
        np.maximum(blocks.half_length, blocks.half_width),
        blocks.speed_x,
        blocks.speed_y,
        blocks.bottom,
        blocks.top,
    )


def _planes(firings: _Firings, blocks: Blocks, row: Indices, firing: Indices) -> Floats:
    """Return of pairs of a block and a firing what its rays need to be met with the block (10 by pairs).

    These are the components of the block's heading, the firing's azimuth and step, and where from the sensor the planes
    behind, to the right and below the block are, and those before, to the left and above, each along its normal [m].
    """
    x, y, cos, sin, half_length, half_width, bottom, top, speed_x, speed_y = (
        np.concatenate(blocks[1:]).reshape(len(blocks) - 1, -1).take(row, axis=1)
    )
    age, height = firings.age[firing], firings.channels.height
    east, north = firings.x[firing] - x + speed_x * age, firings.y[firing] - y + speed_y * age
    own_x, own_y = east * cos + north * sin, north * cos - east * sin
    near = -half_length - own_x, -half_width - own_y, bottom - height
    far = half_length - own_x, half_width - own_y, top - height
    return np.concatenate((cos, sin, firings.azimuth[firing], firings.step[firing], *near, *far)).reshape(10, -1)


def _directions(channels: Channels, azimuth_step: Floats, channel: Indices) -> tuple[Floats, Floats]:
    """Return the components of rays in the map over a horizontal metre, by their firings' azimuths and steps."""
    azimuth, step = azimuth_step
    bearing = azimuth + channels.spread[channel] * step
    return np.cos(bearing), np.sin(bearing)


def _walls(firings: _Firings, span: Indices, walls: Walls) -> _Met | None:
    channels = firings.channels
    if not len(walls.x):
        return None
    length = np.hypot(walls.along_x, walls.along_y)
    ends_x, ends_y = _ENDS * walls.along_x, _ENDS * walls.along_y
    outlines = _Outlines(span, walls.x, walls.y, ends_x, ends_y, 0.5 * length, 0.0, 0.0, 0.0, walls.top)
    row, firing, pair, channel = _candidates(firings, outlines)
    if not len(pair):
        return None
    along_x, along_y = walls.along_x[row], walls.along_y[row]
    east, north = walls.x[row] - firings.x[firing], walls.y[row] - firings.y[firing]
    behind = east * along_y - north * along_x
    of_firings = firings.azimuth[firing], firings.step[firing]
    of_pairs = along_x, along_y, east, north, behind, walls.top[row], length[row], *of_firings
    of_rays = np.concatenate(of_pairs).reshape(len(of_pairs), -1).take(pair, axis=1)
    along_x, along_y, east, north, behind, top, length = of_rays[:-2]
    ray_x, ray_y = _directions(channels, of_rays[-2:], channel)
    cross = ray_x * along_y - ray_y * along_x
    cross = np.where(np.abs(cross) < LEVEL, LEVEL, cross)
    away, share = behind / cross, (east * ray_y - north * ray_x) / cross
    height = channels.height + away * channels.rise[channel]
    meets = np.flatnonzero((away > 0.0) & (share >= 0.0) & (share <= 1.0) & (height >= 0.0) & (height <= top))
    channel, pair = channel[meets], pair[meets]
    cosine = np.abs(cross[meets]) / length[meets] * channels.level[channel]
    what = np.full(len(meets), WALL, np.int32)
    return _Met(firing[pair] * len(channels.rise) + channel, channel, away[meets], what, cosine)


#: of a wall, in shares of it
_ENDS: Final = np.array([[0.0], [1.0]])


def _candidates(firings: _Firings, outlines: _Outlines) -> _Candidates:
    """Return every ray that can meet a convex outline within reach, and some more."""
    x, y = _seen_corners(firings, outlines)
    around, row, begin, count = _firings_towards(firings, outlines, x, y)
    lowest, number = _channels_towards(firings.channels, outlines, x, y, around)
    kept = np.flatnonzero((count > 0) & (number[row] > 0))
    owner, firing = runs(begin[kept], count[kept])
    row = row[kept][owner]
    pair, rank = runs(lowest[row], number[row])
    return _Candidates(row, firing, pair, firings.channels.rising[rank])


def _seen_corners(firings: _Firings, outlines: _Outlines) -> tuple[Floats, Floats]:
    """Return where the corners are from the sensor at the first firing, and then at the last one [m].

    Both are (2 corners) by outlines. Between the two firings, sensor and corners move along straight lines, and so does
    what is returned.
    """
    age = firings.age[outlines.span]
    x = outlines.x - outlines.speed_x * age - firings.x[outlines.span]
    y = outlines.y - outlines.speed_y * age - firings.y[outlines.span]
    shape = 2 * len(outlines.corners_x), -1
    return (
        (x[:, np.newaxis] + outlines.corners_x).reshape(shape),
        (y[:, np.newaxis] + outlines.corners_y).reshape(shape),
    )


def _firings_towards(
    firings: _Firings, outlines: _Outlines, x: Floats, y: Floats
) -> tuple[_Flags, Indices, Indices, Indices]:
    """Return intervals of firings that can meet outlines.

    `x` and `y` are the corners as `_seen_corners` returns them. What is returned is for each outline whether the sensor
    is in it or may get there, and for each interval the row of its outline, its first firing, and how many there are.
    An outline has two intervals, because it may be behind the sensor when a turn begins and when it ends; some are
    empty. Between the first and the last firing the bearing of a corner stays between those at both.
    """
    (first, last), bearing = outlines.span, np.arctan2(y, x)
    step = firings.step[first]
    offset = bearing - bearing[0]
    offset -= math.tau * np.rint(offset / math.tau)
    low, high = np.minimum.reduce(offset), np.maximum.reduce(offset)
    around = high - low > GREATEST_ANGLE
    to_outline = bearing[0] - firings.azimuth[first]
    one, other = (to_outline + low) / step, (to_outline + high) / step
    turn = np.abs(math.tau / step)
    # The interval is shifted by whole turns to where it begins in the first one; its end may reach into the next.
    begin, end = np.minimum(one, other) - MARGIN, np.maximum(one, other) + MARGIN
    shift = np.floor(begin / turn) * turn
    begin, end = np.where(around, 0.0, begin - shift), np.where(around, last - first, end - shift)
    row = np.repeat(np.arange(len(begin)), 2)
    begin, end = np.stack((begin, begin - turn), -1).reshape(-1), np.stack((end, end - turn), -1).reshape(-1)
    # A firing's first ray may go before the interval, and another of its rays into it.
    begin = np.maximum(np.ceil(begin) - 1.0, 0.0).astype(np.intp)
    end = np.minimum(np.floor(end), (last - first)[row]).astype(np.intp)
    return around, row, first[row] + begin, end - begin + 1


def _channels_towards(
    channels: Channels, outlines: _Outlines, x: Floats, y: Floats, around: _Flags
) -> tuple[Indices, Indices]:
    """Return which channels can meet outlines within reach: the first one, from the lowest up, and how many.

    `x` and `y` are the corners as `_seen_corners` returns them; `around` says in which outlines the sensor may be.
    """
    square, last = np.maximum(x * x + y * y, NEAREST * NEAREST), len(x) // 2
    moved = (x[last] - x[0]) ** 2 + (y[last] - y[0]) ** 2
    # A point between two that are s apart and both r away or more is sqrt(r2 - s2 / 4) away or more: a side's, whose
    # ends are so between those of the first and the last firing.
    least = np.minimum.reduce(square) - outlines.half_side**2 - 0.25 * moved
    least = np.where(around, NEAREST, np.sqrt(np.maximum(least, NEAREST * NEAREST)))
    greatest = np.sqrt(np.maximum.reduce(square))
    bottom, top = outlines.bottom - channels.height, outlines.top - channels.height
    lowest = bottom / np.where(bottom < 0.0, least, greatest) - MARGIN
    highest = top / np.where(top < 0.0, greatest, least) + MARGIN
    rise = channels.rise[channels.rising]
    first, after = rise.searchsorted(lowest), rise.searchsorted(highest, "right")
    return first, np.where(least <= channels.reach + MARGIN, after - first, 0)
