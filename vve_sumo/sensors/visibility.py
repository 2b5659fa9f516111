"""Computes which boxes a point antenna sees past each other, and the nearest visible point of each.

Plane geometry in the antenna's frame: the antenna at the origin, its boresight along +x, +y to the left. Must not
know radar, noise, time or the virtual road. Plain numbers, because arrays do not pay for the few boxes in view.

The method: (x, y) -> (y/x, 1/x) maps what lies ahead of the antenna so that every ray becomes a vertical line and every
straight edge stays straight (inverse depth is linear on the screen: Blinn, "W Pleasure, W Fun", IEEE CG&A 18(3), 1998).
Boxes are taken in the order of their depth x and close the openings of the view behind them. Only two boxes whose
depths overlap are compared surface by surface: which hides which is then the order of straight lines, found exactly
with + - * / alone, whose last bits no processor changes.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter
from typing import Final, NamedTuple

#: Nearer to a plane than this counts as lying in it [m]; keeps every quotient finite.
IN_PLANE: Final = 1e-9
#: A gap between two boxes narrower than this slope (about an angle [rad]) lets nothing through: rounding leaves such
#: slits between boxes that touch.
NARROWEST_GAP: Final = 1e-9

#: Ends of stretches of slope that do not meet, ascending: rightmost and leftmost of each in turn. A slope lies within a
#: stretch where an odd number of ends lies before it.
Ends = list[float]


class Sector(NamedTuple):
    """A field of view, symmetric about the boresight."""

    range_max: float  #: farthest point seen [m]
    slope_max: float  #: tangent of the half angle, which is below 90 deg


class AntennaBox(NamedTuple):
    """A rectangle in the antenna's frame."""

    x: float  #: of the centre [m]
    y: float  #: of the centre [m]
    cos: float  #: of the angle from the boresight to the long axis
    sin: float  #: of the same angle
    half_length: float  #: along the long axis [m]
    half_width: float  #: across it [m]


class Sight(NamedTuple):
    """The nearest point of a box that is seen."""

    box: int  #: row of the box
    x: float  #: of the seen point [m]
    y: float  #: of the seen point [m]
    sector: int  #: index of the first sector that covers the point


@dataclass(slots=True)
class _Outline:
    """How a box looks from the origin."""

    row: int  #: of the box
    box: AntennaBox
    front: float  #: least x of the box [m]
    back: float  #: greatest x [m]
    low: float  #: slope of the rightmost corner, or of the edge of the view
    high: float  #: slope of the leftmost corner, or of the edge of the view
    near: float  #: slope of the nearest point; infinite beside or behind the antenna
    x: float  #: of the nearest point [m]
    y: float  #: of the nearest point [m]
    squared: float  #: distance of the nearest point [m2]
    ahead: float  #: signed distance to the plane of the face across the axis [m]; 0 where that face is not seen
    aside: float  #: signed distance to the plane of the face along the axis [m]; 0 where that face is not seen
    seen: Ends  #: what other boxes leave of it


_FRONT = attrgetter("front")


def nearest_visible(boxes: Sequence[AntennaBox], sectors: Sequence[Sector]) -> list[Sight]:
    """Nearest point of each box that no other box hides and that one of the sectors covers, in the order of the boxes.

    At every direction the nearest surface wins, whether or not boxes overlap; where surfaces fall together either may.
    A box that the antenna is inside of, or touches, is seen at the origin and hides all others. Values must be finite
    and sizes not negative; a box without any extent across the line of sight is not seen.
    """
    widest = max(sector.slope_max for sector in sectors)
    farthest = max(sector.range_max for sector in sectors)
    outlines = []
    for row, box in enumerate(boxes):
        outline = _outline(row, box, widest)
        if not outline.ahead and not outline.aside:
            return [Sight(row, 0.0, 0.0, 0)]
        # What lies out of range hides nothing that is in range.
        if outline.high - outline.low > NARROWEST_GAP and outline.squared <= farthest * farthest:
            outlines.append(outline)
    _hide(outlines, widest)
    return [sight for outline in outlines if outline.seen and (sight := _sight(outline, sectors))]


def _outline(row: int, box: AntennaBox, widest: float) -> _Outline:
    x, y, cos, sin, half_length, half_width = box
    ahead = _beyond(x * cos + y * sin, half_length)
    aside = _beyond(y * cos - x * sin, half_width)
    near_x, near_y = ahead * cos - aside * sin, ahead * sin + aside * cos
    # From the centre to the corners at the head of the box; those at its tail lie opposite.
    left_x, left_y = half_length * cos - half_width * sin, half_length * sin + half_width * cos
    right_x, right_y = half_length * cos + half_width * sin, half_length * sin - half_width * cos
    reach, squared = max(abs(left_x), abs(right_x)), near_x * near_x + near_y * near_y
    front, back = x - reach, x + reach
    # A box that reaches behind the antenna does so on the side on which its nearest point lies.
    beside = math.copysign(math.inf, near_y)
    near = near_y / near_x if near_x > IN_PLANE else beside
    if front > IN_PLANE:
        head_left, tail_right = (y + left_y) / (x + left_x), (y - left_y) / (x - left_x)
        head_right, tail_left = (y + right_y) / (x + right_x), (y - right_y) / (x - right_x)
    else:
        head_left, tail_right = _slope(x + left_x, y + left_y, beside), _slope(x - left_x, y - left_y, beside)
        head_right, tail_left = _slope(x + right_x, y + right_y, beside), _slope(x - right_x, y - right_y, beside)
    low = min(head_left, head_right, tail_left, tail_right)
    high = max(head_left, head_right, tail_left, tail_right)
    if not -widest <= low <= high <= widest:
        low, high = max(low, -widest), min(high, widest)
    if -IN_PLANE <= ahead <= IN_PLANE:
        ahead = 0.0
    if -IN_PLANE <= aside <= IN_PLANE:
        aside = 0.0
    return _Outline(row, box, front, back, low, high, near, near_x, near_y, squared, ahead, aside, [])


def _beyond(centre: float, half: float) -> float:
    """From the antenna to the nearest point of a box along one of the box's axes."""
    if centre > half:
        return centre - half
    return centre + half if centre < -half else 0.0


def _slope(x: float, y: float, beside: float) -> float:
    return y / x if x > IN_PLANE else beside


def _hide(outlines: Sequence[_Outline], widest: float) -> None:
    """Reduce each outline to what is visible of it past the others.

    A box whose depths end before another's begin stands before it wherever they meet in view; all of those share the
    openings that they leave. The few boxes whose depths overlap are rivals.
    """
    openings = [-widest, widest]
    rivals: list[_Outline] = []
    for outline in sorted(outlines, key=_FRONT):
        front, low, high = outline.front, outline.low, outline.high
        waiting = []
        for rival in rivals:
            if rival.back <= front:
                _cut_away(openings, rival.low, rival.high)
            else:
                waiting.append(rival)
        rivals = waiting
        outline.seen = _between(openings, low, high)
        if outline.seen:
            for rival in rivals:
                if rival.low < high and low < rival.high:
                    _contend(rival, outline)
            rivals.append(outline)


def _between(ends: Ends, low: float, high: float) -> Ends:
    """The parts of the stretches that lie between two slopes."""
    first, last = bisect_right(ends, low), bisect_left(ends, high)
    inner = ends[first:last]
    if first % 2:
        inner.insert(0, low)
    if last % 2:
        inner.append(high)
    return inner


def _cut_away(ends: Ends, low: float, high: float) -> None:
    """Take what lies between two slopes out of the stretches."""
    first, last = bisect_left(ends, low), bisect_right(ends, high)
    if low < high:
        ends[first:last] = [low] * (first % 2) + [high] * (last % 2)


def _contend(one: _Outline, other: _Outline) -> None:
    """Take from two outlines what each hides of the other; a surface bends nowhere but at its nearest point."""
    left, right = max(one.low, other.low), min(one.high, other.high)
    bends = sorted(slope for slope in (one.near, other.near) if left < slope < right)
    for start, end in pairwise((left, *bends, right)):
        middle = 0.5 * (start + end)
        (constant, gradient), (other_constant, other_gradient) = _surface(one, middle), _surface(other, middle)
        # `one` is the nearer where lead > turn * slope.
        lead, turn = constant - other_constant, other_gradient - gradient
        crossing = lead / turn if turn else math.copysign(math.inf, lead)
        cut = min(max(crossing, start), end)
        hidden_before, hidden_after = (other, one) if turn >= 0.0 else (one, other)
        _cut_away(hidden_before.seen, start, cut)
        _cut_away(hidden_after.seen, cut, end)


def _surface(outline: _Outline, slope: float) -> tuple[float, float]:
    """Constant and gradient of the inverse depth [1/m] of the face that is seen at a slope.

    On the plane of a face x * cos + y * sin = distance, so that 1 / x is linear in y / x.
    """
    cos, sin, ahead, aside = outline.box.cos, outline.box.sin, outline.ahead, outline.aside
    if not ahead:
        return -sin / aside, cos / aside
    # Each plane cuts off what lies before it, so that the farther of the two is the box's own surface.
    if aside and -sin / aside + cos / aside * slope < cos / ahead + sin / ahead * slope:
        return -sin / aside, cos / aside
    return cos / ahead, sin / ahead


def _sight(outline: _Outline, sectors: Sequence[Sector]) -> Sight | None:
    """The nearest point of what is seen of a box, in the first sector that covers it."""
    seen, squared = outline.seen, outline.squared
    nearest, best, covering = math.inf, None, 0
    for sector, (range_max, slope_max) in enumerate(sectors):
        if squared > range_max * range_max:
            continue
        whole = -slope_max <= seen[0] and seen[-1] <= slope_max
        for point in _nearest(outline, seen if whole else _between(seen, -slope_max, slope_max)):
            distance = point[0] * point[0] + point[1] * point[1]
            if distance < nearest and distance <= range_max * range_max:
                nearest, best, covering = distance, point, sector
        if whole and best is not None:
            break
    return Sight(outline.row, best[0], best[1], covering) if best is not None else None


def _nearest(outline: _Outline, ends: Ends) -> list[tuple[float, float]]:
    """The nearest point within the stretches, or those at both sides of the gap that the box's nearest point is in.

    Along a convex outline the distance falls towards the nearest point and grows after it.
    """
    place = bisect_left(ends, outline.near)
    if place % 2 and ends[place] - ends[place - 1] > NARROWEST_GAP:
        return [(outline.x, outline.y)]
    right, left = place - place % 2, place + place % 2
    while right and ends[right - 1] - ends[right - 2] <= NARROWEST_GAP:
        right -= 2
    while left < len(ends) and ends[left + 1] - ends[left] <= NARROWEST_GAP:
        left += 2
    points = [_point(outline, ends[right - 1])] if right else []
    return [*points, _point(outline, ends[left])] if left < len(ends) else points


def _point(outline: _Outline, slope: float) -> tuple[float, float]:
    """The point of the outline at a slope."""
    if slope == outline.near:
        return outline.x, outline.y
    constant, gradient = _surface(outline, slope)
    inverse_depth = constant + gradient * slope
    # Rounding may leave nothing of a face that is seen from its edge; then it is out of every range.
    x = 1.0 / inverse_depth if inverse_depth > 0.0 else math.inf
    return x, slope * x
