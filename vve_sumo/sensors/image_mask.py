"""Draws bodies and walls into the mask of a pinhole camera: which pixel shows which body, and how much each is hidden.

Upright blocks on flat ground, drawn one after the other with a buffer of depths. Pure functions; the module knows no
noise and no class of body.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.path import Indices
from vve_sumo.sensors.body_shapes import Blocks
from vve_sumo.sensors.runs import runs
from vve_sumo.sensors.street import Walls
from vve_sumo.values import Floats

#: what a pixel shows where it is no row of the blocks
NOBODY: Final = -1
WALL: Final = -2
#: nearer than this before the camera nothing is drawn [m]
NEAREST: Final = 0.1
LEVEL: Final = 1e-12


class Pinhole(NamedTuple):
    """A camera without distortion that looks along the horizon."""

    columns: int  #: pixels
    rows: int  #: pixels
    focal: float  #: focal length [pixels]

    @property
    def half_angle(self) -> float:
        """Angle from the axis to the left and the right edge of the picture [rad]."""
        return math.atan(0.5 * self.columns / self.focal)


class CameraPlace(NamedTuple):
    """Where a camera is."""

    x: float  #: map [m]
    y: float  #: map [m]
    z: float  #: above the ground [m]
    heading: float  #: of its axis [rad], counter-clockwise from the map's +x


class Drawn(NamedTuple):
    """Where a block would be in the mask if it were alone."""

    rows: slice
    columns: slice
    pixels: int  #: that it would fill


class Mask(NamedTuple):
    """What the pixels show, from a row of the picture on: those above and below the mask show nobody."""

    first_row: int  #: row of the picture that the mask begins with
    block: NDArray[np.int32]  #: row of the block, NOBODY or WALL (rows by columns)
    depth: NDArray[np.float32]  #: along the axis [m], infinite for nobody (rows by columns)
    drawn: dict[int, Drawn]  #: by the block's row, of each that is in the picture
    alone: dict[int, int]  #: pixels that all blocks of an actor would fill together if it were alone, by its row

    def visible_pixels(self, block: int) -> NDArray[np.bool_]:
        """Return which pixels of a block's own window show it."""
        drawn = self.drawn[block]
        seen: NDArray[np.bool_] = self.block[drawn.rows, drawn.columns] == block
        return seen


class _Uprights(NamedTuple):
    """Blocks and walls in the camera's frame; arrays have an entry each."""

    owner: Indices  #: row of the block, or WALL
    ahead: Floats  #: of the middle, along the axis [m]
    right: Floats  #: of the middle [m]
    cos: Floats  #: of its heading from the axis
    sin: Floats  #: of its heading from the axis, left positive
    half_length: Floats  #: [m]
    half_width: Floats  #: [m]
    bottom: Floats  #: above the ground [m]
    top: Floats  #: above the ground [m]


class _Shapes(NamedTuple):
    """What of the picture blocks and walls fill, each as if it were alone: for each column a run of rows."""

    owner: Indices  #: row of the block, or WALL (shapes)
    column: Indices  #: the first one of each (shapes)
    begin: Indices  #: of the columns of each in what follows (shapes)
    depth: NDArray[np.float32]  #: along the axis [m] (columns of all shapes)
    first: Indices  #: row (columns of all shapes)
    after: Indices  #: row after the last one (columns of all shapes)


def mask_of(view: Pinhole, at: CameraPlace, blocks: Blocks, walls: Walls, reach: float) -> Mask:
    """Return the mask of a camera; what is farther along the axis than a reach [m] is not drawn.

    A block's depth at a column is that of its near side there, for its top too. A camera inside a block does not see
    it.
    """
    shapes = _shapes(_uprights(view, at, blocks, walls, reach), view, at.z, reach)
    if not len(shapes.owner):
        return _empty(0, 0, view)
    tops, bottoms = np.minimum.reduceat(shapes.first, shapes.begin), np.maximum.reduceat(shapes.after, shapes.begin)
    pixels = np.add.reduceat(np.maximum(shapes.after - shapes.first, 0), shapes.begin)
    mask = _empty(int(tops.min()), int(bottoms.max()), view)
    ends = np.append(shapes.begin[1:], len(shapes.depth))
    for owner, column, begin, end, top, bottom, count in zip(
        *(values.tolist() for values in (shapes.owner, shapes.column, shapes.begin, ends, tops, bottoms, pixels)),
        strict=True,
    ):
        if bottom > top:
            own = slice(begin, end)
            rows, columns = slice(top - mask.first_row, bottom - mask.first_row), slice(column, column + end - begin)
            _draw(mask, owner, rows, columns, shapes.depth[own], shapes.first[own], shapes.after[own])
            if owner != WALL:
                mask.drawn[owner] = Drawn(rows, columns, count)
    mask.alone.update(_alone(shapes, view, blocks.actor))
    return mask


def _empty(first_row: int, after_row: int, view: Pinhole) -> Mask:
    shape = max(after_row - first_row, 0), view.columns
    return Mask(first_row, np.full(shape, NOBODY, np.int32), np.full(shape, math.inf, np.float32), {}, {})


def _alone(shapes: _Shapes, view: Pinhole, actor: Indices) -> dict[int, int]:
    """Return how many pixels the blocks of each actor fill together: those that lie over each other count once."""
    count = np.diff(shapes.begin, append=len(shapes.depth))
    owner, column = np.repeat(shapes.owner, count), np.repeat(shapes.column - shapes.begin, count)
    body = np.flatnonzero(owner != WALL)
    whose = actor[owner[body]]
    place = whose * view.columns + column[body] + body
    order = np.lexsort((shapes.first[body], place))
    # One line of rows: every column of every actor has a stretch of its own, and runs of rows go by where they begin.
    begins, ends = ((place * (view.rows + 1) + rows[body])[order] for rows in (shapes.first, shapes.after))
    covered = np.concatenate(([-1], np.maximum.accumulate(ends)[:-1])) if len(ends) else ends
    filled = np.bincount(whose[order], np.maximum(ends - np.maximum(begins, covered), 0))
    return {int(row): int(filled[row]) for row in np.flatnonzero(filled)}


def _draw(
    mask: Mask, owner: int, rows: slice, columns: slice, depth: NDArray[np.float32], first: Indices, after: Indices
) -> None:
    """Draw what fills rows `first` to `after` of the picture in each of some columns where nothing nearer is."""
    row = np.arange(mask.first_row + rows.start, mask.first_row + rows.stop)[:, np.newaxis]
    block, nearest = mask.block[rows, columns], mask.depth[rows, columns]
    shows = (row >= first) & (row < after) & (depth < nearest)
    np.copyto(block, owner, where=shows)
    np.copyto(nearest, depth, where=shows)


def _uprights(view: Pinhole, at: CameraPlace, blocks: Blocks, walls: Walls, reach: float) -> _Uprights:
    """Return the blocks, and then the walls as blocks without width, that may be in the picture."""
    length, flat = np.hypot(walls.along_x, walls.along_y), np.zeros(len(walls.x))
    x = np.concatenate((blocks.x, walls.x + 0.5 * walls.along_x))
    y = np.concatenate((blocks.y, walls.y + 0.5 * walls.along_y))
    own_cos = np.concatenate((blocks.cos, walls.along_x / length))
    own_sin = np.concatenate((blocks.sin, walls.along_y / length))
    cos, sin = math.cos(at.heading), math.sin(at.heading)
    east, north = x - at.x, y - at.y
    every = _Uprights(
        np.concatenate((np.arange(len(blocks.x)), np.full(len(walls.x), WALL))),
        east * cos + north * sin,
        east * sin - north * cos,
        own_cos * cos + own_sin * sin,
        own_sin * cos - own_cos * sin,
        np.concatenate((blocks.half_length, 0.5 * length)),
        np.concatenate((blocks.half_width, flat)),
        np.concatenate((blocks.bottom, flat)),
        np.concatenate((blocks.top, walls.top)),
    )
    radius = np.hypot(every.half_length, every.half_width)
    widest = 0.5 * view.columns / view.focal
    near = (every.ahead > -radius) & (every.ahead - radius < reach)
    near &= np.abs(every.right) - widest * every.ahead < radius * math.hypot(1.0, widest)
    return _Uprights._make(values[near] for values in every)


def _shapes(parts: _Uprights, view: Pinhole, height: float, reach: float) -> _Shapes:
    """Return what blocks and walls fill of the picture of a camera at a height [m], none of those that fill nothing."""
    slope, row_slope = _slopes(view.columns, view.focal), _slopes(view.rows, view.focal)
    part, column = _columns(parts, slope)
    enters, leaves = _depths(parts, part, slope[column])
    seen = np.flatnonzero((enters <= leaves) & (enters > NEAREST) & (enters <= reach))
    # A block is convex: the columns that show it are neighbours.
    first = seen[np.flatnonzero(np.diff(part[seen], prepend=-1))]
    count = seen[np.flatnonzero(np.diff(part[seen], append=-1))] - first + 1
    shown, (shape, kept) = part[first], runs(first, count)
    part, enters, leaves = shown[shape], enters[kept], leaves[kept]
    above, below = (height - parts.top)[part], (height - parts.bottom)[part]
    return _Shapes(
        parts.owner[shown],
        column[first],
        np.cumsum(count) - count,
        enters.astype(np.float32),
        np.searchsorted(row_slope, above / np.where(above > 0.0, leaves, enters)),
        np.searchsorted(row_slope, below / np.where(below > 0.0, enters, leaves)),
    )


def _slopes(count: int, focal: float) -> Floats:
    """Return the slopes of a picture's columns to the right, or of its rows downwards."""
    pixels: Floats = np.arange(count, dtype=np.float64)
    return (pixels + 0.5 - 0.5 * count) / focal


#: signs of the corners of a block along and across its heading
_AHEAD: Final = np.array([[-1.0], [-1.0], [1.0], [1.0]])
_LEFT: Final = np.array([[-1.0], [1.0], [-1.0], [1.0]])


def _columns(parts: _Uprights, slope: Floats) -> tuple[Indices, Indices]:
    """Return the columns that blocks and walls may fill, with the row of each one's block or wall."""
    along, across = _AHEAD * parts.half_length, _LEFT * parts.half_width
    ahead = parts.ahead + along * parts.cos - across * parts.sin
    right = parts.right - along * parts.sin - across * parts.cos
    beside = np.minimum.reduce(ahead) <= NEAREST
    slopes = right / np.where(beside, 1.0, ahead)
    begin = np.where(beside, 0, slope.searchsorted(np.minimum.reduce(slopes)))
    after = np.where(beside, len(slope), slope.searchsorted(np.maximum.reduce(slopes), "right"))
    return runs(begin, after - begin)


def _depths(parts: _Uprights, part: Indices, slope: Floats) -> tuple[Floats, Floats]:
    """Return at which depths the planes through columns of some slopes enter and leave blocks, given by their rows."""
    # The camera in the block's frame, and the step along each column's plane for a metre of depth.
    own_x = -parts.ahead * parts.cos + parts.right * parts.sin
    own_y = parts.ahead * parts.sin + parts.right * parts.cos
    cos, sin = parts.cos[part], parts.sin[part]
    enters_x, leaves_x = _slab(cos - slope * sin, own_x, parts.half_length, part)
    enters_y, leaves_y = _slab(-sin - slope * cos, own_y, parts.half_width, part)
    return np.maximum(enters_x, enters_y), np.minimum(leaves_x, leaves_y)


def _slab(step: Floats, own: Floats, half: Floats, part: Indices) -> tuple[Floats, Floats]:
    step = np.where(np.abs(step) < LEVEL, LEVEL, step)
    one, other = (-half - own)[part] / step, (half - own)[part] / step
    return np.minimum(one, other), np.maximum(one, other)
