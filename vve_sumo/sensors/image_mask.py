"""Draws bodies and walls into the mask of a pinhole camera: which pixel shows which body, and how much each is hidden.

Upright blocks on flat ground, drawn from the nearest on with a buffer of depths. Pure functions; the module knows no
noise and no class of body.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.sensors.body_shapes import Blocks
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
    """Where a block would be in the picture if it were alone."""

    rows: slice
    columns: slice
    pixels: int  #: that it would fill


class Mask(NamedTuple):
    """What the pixels show."""

    block: NDArray[np.int32]  #: row of the block, NOBODY or WALL (rows by columns)
    depth: NDArray[np.float32]  #: along the axis [m], infinite for nobody (rows by columns)
    drawn: dict[int, Drawn]  #: by the block's row, of each that is in the picture

    def seen(self, block: int) -> NDArray[np.bool_]:
        """Return which pixels of a block's own window show it."""
        drawn = self.drawn[block]
        seen: NDArray[np.bool_] = self.block[drawn.rows, drawn.columns] == block
        return seen


def mask_of(view: Pinhole, at: CameraPlace, blocks: Blocks, walls: Walls, reach: float) -> Mask:
    """Return the mask of a camera; what is farther along the axis than a reach [m] is not drawn.

    A block's depth at a column is that of its near side there, for its top too. A camera inside a block does not see
    it.
    """
    block = np.full((view.rows, view.columns), NOBODY, np.int32)
    depth = np.full((view.rows, view.columns), math.inf, np.float32)
    drawn = {}
    picture = _Picture(block, depth, _slopes(view.columns, view.focal), _slopes(view.rows, view.focal), at.z, reach)
    cos, sin = math.cos(at.heading), math.sin(at.heading)
    east, north = blocks.x - at.x, blocks.y - at.y
    ahead, right = east * cos + north * sin, east * sin - north * cos
    turn_cos, turn_sin = blocks.cos * cos + blocks.sin * sin, blocks.sin * cos - blocks.cos * sin
    radius = np.hypot(blocks.half_length, blocks.half_width)
    widest = 0.5 * view.columns / view.focal
    near = (
        (ahead > -radius) & (ahead - radius < reach) & (np.abs(right) - widest * ahead < radius * math.hypot(1, widest))
    )
    for row in np.flatnonzero(near).tolist():
        part = _Upright(
            float(ahead[row]), float(right[row]), float(turn_cos[row]), float(turn_sin[row]),
            float(blocks.half_length[row]), float(blocks.half_width[row]), float(blocks.bottom[row]),
            float(blocks.top[row]),
        )  # fmt: skip
        if (window := _draw(part, row, picture)) is not None:
            drawn[row] = window
    for part in _walls(at, walls, widest, reach):
        _draw(part, WALL, picture)
    return Mask(block, depth, drawn)


def _slopes(count: int, focal: float) -> Floats:
    """Return the slopes of a picture's columns to the right, or of its rows downwards."""
    pixels: Floats = np.arange(count, dtype=np.float64)
    return (pixels + 0.5 - 0.5 * count) / focal


class _Picture(NamedTuple):
    """A picture that is drawn."""

    block: NDArray[np.int32]
    depth: NDArray[np.float32]
    slope: Floats  #: of each column, right positive
    row_slope: Floats  #: of each row, down positive
    height: float  #: of the camera [m]
    reach: float  #: [m]


class _Upright(NamedTuple):
    """A block in the camera's frame."""

    ahead: float  #: of the middle, along the axis [m]
    right: float  #: of the middle [m]
    cos: float  #: of its heading from the axis
    sin: float  #: of its heading from the axis, left positive
    half_length: float  #: [m]
    half_width: float  #: [m]
    bottom: float  #: above the ground [m]
    top: float  #: above the ground [m]


def _walls(at: CameraPlace, walls: Walls, widest: float, reach: float) -> list[_Upright]:
    """Return the walls before the camera as blocks without width."""
    cos, sin = math.cos(at.heading), math.sin(at.heading)
    length = np.hypot(walls.along_x, walls.along_y)
    east, north = walls.x + 0.5 * walls.along_x - at.x, walls.y + 0.5 * walls.along_y - at.y
    ahead, right = east * cos + north * sin, east * sin - north * cos
    along, across = walls.along_x / length, walls.along_y / length
    turn_cos, turn_sin = along * cos + across * sin, across * cos - along * sin
    near = (ahead > -0.5 * length) & (ahead - 0.5 * length < reach)
    near &= np.abs(right) - widest * ahead < 0.5 * length * math.hypot(1.0, widest)
    columns = (ahead, right, turn_cos, turn_sin, 0.5 * length, walls.top)
    return [
        _Upright(x, y, c, s, half, 0.0, 0.0, top)
        for x, y, c, s, half, top in zip(*(column[near].tolist() for column in columns), strict=True)
    ]


def _draw(part: _Upright, owner: int, picture: _Picture) -> Drawn | None:
    """Draw a block where nothing nearer is; return where it would be alone, None where it is not in the picture."""
    columns = _columns(part, picture.slope)
    enters, leaves = _depths(part, picture.slope[columns])
    seen = np.flatnonzero((enters <= leaves) & (enters > NEAREST) & (enters <= picture.reach))
    if not len(seen):
        return None
    # A block is convex: the columns that show it are neighbours.
    own = slice(columns.start + int(seen[0]), columns.start + int(seen[-1]) + 1)
    enters, leaves = enters[seen[0] : seen[-1] + 1], leaves[seen[0] : seen[-1] + 1]
    above, below = picture.height - part.top, picture.height - part.bottom
    first = np.searchsorted(picture.row_slope, above / (leaves if above > 0.0 else enters))
    after = np.searchsorted(picture.row_slope, below / (enters if below > 0.0 else leaves))
    top, bottom = int(first.min()), int(after.max())
    if bottom <= top:
        return None
    rows = np.arange(top, bottom)[:, None]
    covered = (rows >= first) & (rows < after)
    far = enters.astype(np.float32)
    block, depth = picture.block[top:bottom, own], picture.depth[top:bottom, own]
    nearer = covered & (far < depth)
    np.copyto(block, owner, where=nearer)
    np.copyto(depth, far, where=nearer)
    return Drawn(slice(top, bottom), own, int(covered.sum()))


def _columns(part: _Upright, slope: Floats) -> slice:
    """Return the columns that a block may fill."""
    corners = [
        (
            part.ahead + end * part.half_length * part.cos - side * part.half_width * part.sin,
            part.right - end * part.half_length * part.sin - side * part.half_width * part.cos,
        )
        for end in (-1.0, 1.0)
        for side in (-1.0, 1.0)
    ]
    if min(ahead for ahead, _right in corners) <= NEAREST:
        return slice(0, len(slope))
    slopes = [right / ahead for ahead, right in corners]
    return slice(int(np.searchsorted(slope, min(slopes))), int(np.searchsorted(slope, max(slopes), "right")))


def _depths(part: _Upright, slope: Floats) -> tuple[Floats, Floats]:
    """Return at which depths the planes through columns enter and leave a block."""
    # The camera in the block's frame, and the step along each column's plane for a metre of depth.
    own_x = -part.ahead * part.cos + part.right * part.sin
    own_y = part.ahead * part.sin + part.right * part.cos
    step_x, step_y = part.cos - slope * part.sin, -part.sin - slope * part.cos
    enters, leaves = np.full(len(slope), -math.inf), np.full(len(slope), math.inf)
    for own, step, half in ((own_x, step_x, part.half_length), (own_y, step_y, part.half_width)):
        pace = np.where(np.abs(step) < LEVEL, LEVEL, step)
        one, other = (-half - own) / pace, (half - own) / pace
        enters, leaves = np.maximum(enters, np.minimum(one, other)), np.minimum(leaves, np.maximum(one, other))
    return enters, leaves
