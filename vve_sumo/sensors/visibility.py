"""Which boxes a point antenna sees past each other, and the nearest point of each that it sees.

Plane geometry in the antenna's frame: the antenna at the origin, its boresight along +x, +y to the left. Must not
know radar, noise, time or the street. Costs grow with the square of the number of boxes.

The method: (x, y) -> (y/x, 1/x) maps what lies ahead of the antenna so that every ray becomes a vertical line and every
straight edge stays straight (inverse depth is linear on the screen: Blinn, "W Pleasure, W Fun", IEEE CG&A 18(3), 1998).
"The nearest surface hides what is behind it" is then the upper envelope of straight lines, found exactly between one
corner's slope and the next with + - * / alone, whose last bits no processor changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.values import Floats

Indices = NDArray[np.intp]

#: Nearer to a plane than this counts as lying in it [m]; keeps every quotient finite.
IN_PLANE = 1e-9
#: A gap between two boxes narrower than this slope (about an angle [rad]) lets nothing through: rounding leaves such
#: slits between boxes that touch.
NARROWEST_GAP = 1e-9
#: Relative difference of inverse depths below which two surfaces meet.
SAME_DEPTH = 1e-12

_NO_FACE = np.array([[[np.inf]], [[0.0]]])
_AHEAD = np.array([1.0, 1.0, -1.0, -1.0]).reshape(4, 1, 1)
_LEFT = np.array([1.0, -1.0, 1.0, -1.0]).reshape(4, 1, 1)
_NOTHING = (np.inf,)


class Sector(NamedTuple):
    """A field of view, symmetric about the boresight."""

    range_max: float  #: farthest point seen [m]
    slope_max: float  #: tangent of the half angle, which is below 90 deg


@dataclass(frozen=True, slots=True)
class Boxes:
    """Rectangles in the antenna's frame, one column per box."""

    centre: Floats  #: x and y as two rows [m]
    cos: Floats  #: of the angle from the boresight to the box's long axis
    sin: Floats  #: of the same angle
    half_size: Floats  #: half length, along the long axis, and half width as two rows [m]


class Sight(NamedTuple):
    """The nearest point of a box that is seen."""

    box: int  #: row of the box
    x: float  #: of the seen point [m]
    y: float  #: of the seen point [m]
    sector: int  #: index of the first sector that covers the point


@dataclass(frozen=True, slots=True)
class _Faces:
    """How each box looks from the origin; a column per box, and the faces across and along its axis as two rows."""

    near: Floats  #: nearest point of the box, x and y as two rows [m]
    near_slope: Floats  #: slope of the nearest point; infinite beside or behind the antenna
    lowest: Floats  #: slope of the rightmost corner
    highest: Floats  #: slope of the leftmost corner
    constant: Floats  #: inverse depth of a face's plane is constant + gradient * slope [1/m]; infinite for a face
    gradient: Floats  #: seen from its edge or back, so that the smaller of the two rows is the box's own surface


class _Line(NamedTuple):
    """Inverse depth of one box between two neighbouring critical slopes [1/m]."""

    box: int
    constant: float
    gradient: float

    def at(self, slope: float) -> float:
        return self.constant + self.gradient * slope


def nearest_visible(boxes: Boxes, sectors: Sequence[Sector]) -> list[Sight]:
    """Nearest point of each box that no other box hides and that one of the sectors covers, in the order of the boxes.

    At every direction the nearest surface wins, whether or not boxes overlap; where surfaces fall together either may.
    A box that the antenna is inside of, or touches, is seen at the origin and hides all others. Values must be finite
    and sizes not negative; a box without any extent across the line of sight is not seen.
    """
    if not boxes.cos.size:
        return []
    faces = _faces(boxes)
    (touching,) = np.nonzero(np.minimum(*faces.constant) == np.inf)
    if touching.size:
        return [Sight(int(touching[0]), 0.0, 0.0, 0)]
    pieces = _visible_pieces(faces, sectors)
    return _nearest_of_each(pieces, _nearest_points(faces, *pieces), sectors)


def _faces(boxes: Boxes) -> _Faces:
    rotation = np.array(((boxes.cos, -boxes.sin), (boxes.sin, boxes.cos)))
    along, across = rotation[:, 0], rotation[:, 1]
    local = boxes.centre[0] * rotation[0] + boxes.centre[1] * rotation[1]
    # The nearest point in the box's own axes; both coordinates are also distances to the planes of its faces.
    distance = local - np.minimum(np.maximum(local, -boxes.half_size), boxes.half_size)
    near = distance[0] * along + distance[1] * across
    corners = boxes.centre + (_AHEAD * (boxes.half_size[0] * along) + _LEFT * (boxes.half_size[1] * across))
    slopes = _slopes(np.concatenate((corners, near[None])))
    turned = np.abs(distance) > IN_PLANE
    # On the plane of a face x * along = distance, so that 1 / x is linear in y / x.
    constant, gradient = np.where(turned, rotation / np.where(turned, distance, 1.0), _NO_FACE)
    return _Faces(near, slopes[-1], np.minimum.reduce(slopes), np.maximum.reduce(slopes), constant, gradient)


def _slopes(points: Floats) -> Floats:
    """Slope of each point of each box, of which the last is the nearest to the antenna.

    A box that reaches behind the antenna's own plane does so on the side on which its nearest point lies.
    """
    x, y = points[:, 0], points[:, 1]
    ahead = x > IN_PLANE
    return np.where(ahead, y / np.where(ahead, x, 1.0), np.copysign(np.inf, y[-1]))


def _visible_pieces(faces: _Faces, sectors: Sequence[Sector]) -> tuple[Indices, Floats, Floats]:
    """Box, rightmost and leftmost slope of every stretch in which one face is the nearest."""
    widest = max(sector.slope_max for sector in sectors)
    edges = np.array([sector.slope_max for sector in sectors])
    critical = np.concatenate((faces.lowest, faces.near_slope, faces.highest, edges, -edges))
    slopes = np.sort(np.minimum(np.maximum(critical, -widest), widest))
    left, right = slopes[:-1], slopes[1:]
    spans = (faces.lowest <= left[:, None]) & (faces.highest >= right[:, None])
    lines = faces.constant[:, None] + faces.gradient[:, None] * slopes[:, None]
    surface = np.minimum(lines[0], lines[1])
    first = np.where(spans, surface[:-1], 0.0).argmax(axis=1)
    last = np.where(spans, surface[1:], 0.0).argmax(axis=1)
    wide = right - left > NARROWEST_GAP
    (whole,) = np.nonzero(wide & (first == last) & spans[np.arange(first.size), first])
    pieces = first[whole], left[whole], right[whole]
    (crossed,) = np.nonzero(wide & (first != last))
    return pieces if not crossed.size else _with_crossings(pieces, faces, spans, slopes, crossed)


def _with_crossings(
    pieces: tuple[Indices, Floats, Floats], faces: _Faces, spans: NDArray[np.bool_], slopes: Floats, crossed: Indices
) -> tuple[Indices, Floats, Floats]:
    """Adds the stretches in which faces of overlapping boxes run through each other."""
    box, left, right = (column.tolist() for column in pieces)
    for stretch in crossed.tolist():
        start, end = float(slopes[stretch]), float(slopes[stretch + 1])
        lines = [_line(faces, row, 0.5 * (start + end)) for row in np.flatnonzero(spans[stretch]).tolist()]
        for line, line_left, line_right in _upper_envelope(lines, start, end):
            if line_right - line_left > NARROWEST_GAP:
                box.append(line.box)
                left.append(line_left)
                right.append(line_right)
    return np.array(box, np.intp), np.array(left), np.array(right)


def _line(faces: _Faces, box: int, slope: float) -> _Line:
    lines = [_Line(box, float(faces.constant[face, box]), float(faces.gradient[face, box])) for face in (0, 1)]
    return min(lines, key=lambda line: line.at(slope))


def _upper_envelope(lines: Sequence[_Line], left: float, right: float) -> Iterator[tuple[_Line, float, float]]:
    """The highest line at every slope, left to right: where two meet, either both go on or a third lies above."""
    first = max(lines, key=lambda line: line.at(left))
    last = max(lines, key=lambda line: line.at(right))
    bend = last.gradient - first.gradient
    if first is last or bend <= 0.0:
        yield first, left, right
        return
    cut = min(max((first.constant - last.constant) / bend, left), right)
    top = max(line.at(cut) for line in lines)
    if top <= first.at(cut) * (1.0 + SAME_DEPTH):
        yield first, left, cut
        yield last, cut, right
        return
    yield from _upper_envelope(lines, left, cut)
    yield from _upper_envelope(lines, cut, right)


def _nearest_points(faces: _Faces, box: Indices, left: Floats, right: Floats) -> Floats:
    """Along a convex outline the distance falls towards the nearest point and grows after it: clamp its slope."""
    near = faces.near_slope[box]
    slope = np.minimum(np.maximum(near, left), right)
    lines = faces.constant[:, box] + faces.gradient[:, box] * slope
    x = 1.0 / np.minimum(lines[0], lines[1])
    return np.where(slope == near, faces.near[:, box], np.array((x, slope * x)))


def _nearest_of_each(pieces: tuple[Indices, Floats, Floats], points: Floats, sectors: Sequence[Sector]) -> list[Sight]:
    best: dict[int, tuple[float, ...]] = {}
    x, y = points
    columns = (*pieces, x, y, x * x + y * y)
    for box, left, right, point_x, point_y, squared in zip(*(column.tolist() for column in columns), strict=True):
        known = best.get(box, _NOTHING)
        if squared > known[0]:
            continue
        for index, (range_max, slope_max) in enumerate(sectors):
            if -slope_max <= left and right <= slope_max and squared <= range_max * range_max:
                best[box] = min(known, (squared, index, point_x, point_y))
                break
    return [Sight(box, best[box][2], best[box][3], int(best[box][1])) for box in sorted(best)]
