"""Makes the outline of a lot from a line that was walked or driven once along its edge, and says how sure it is.

Geometry in the lot's map; knows no receiver and no file. Every limit is refused in one line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vve_sumo.errors import ConfigError
from vve_sumo.lot.polygon import Lot, distances_outside, simplified_ring
from vve_sumo.values import Floats

STANDING: Final = 0.05  #: a place nearer than this to the one before it was taken standing [m]
CLOSING: Final = 2.0  #: an end that stays farther than this from the begin leaves the outline open [m]
MAX_GAP: Final = 5.0  #: largest distance between two places, or nobody knows what is between them [m]
MAX_SIGMA: Final = 0.5  #: of a place that is used [m]: 1.2 m with 95 %, half a car's width
MIN_TOLERANCE: Final = 0.15  #: by which the outline's corners may cut a line that was walked by hand [m]
#: a radius that holds a place with 95 %, over the standard deviation of either of its coordinates: sqrt(-2 ln 0.05)
RADIUS_95: Final = 2.448
BODY_MARGIN: Final = 1.0  #: for mirrors and errors of stopping, a rig's own default [m]
CUT_CORNER: Final = 2.0  #: length of the short sides between two long ones that still are one corner [m]
CUT_REACH: Final = 0.5  #: from such a side's ends to the corner that its neighbours make, at most [m]
AROUND_CORNER: Final = 1.0  #: places nearer to a corner than this say nothing of a side's line [m]
MIN_SIDE_PLACES: Final = 8  #: fewer leave a side as its corners have it
MIN_TURN: Final = math.radians(15.0)  #: between two sides whose lines make a corner


@dataclass(frozen=True, slots=True)
class SurveyedOutline:
    """An outline and how well the line that was walked says where it is."""

    corners: Floats  #: (n, 2) [m], in the direction that was walked
    area: float  #: [m2]
    places: int  #: that it was made from
    overlap: float  #: distance between begin and end of the line, where it was closed [m]
    rms: float  #: of the places' distances to the outline [m]
    worst: float  #: greatest of these [m]
    beyond: float  #: by which the outline lies outside of the line that was walked, at most [m]
    radius: float  #: that holds each place with 95 %, of the least accurate one [m]

    @property
    def margin(self) -> float:
        """Margin [m] for the outline's errors: BODY_MARGIN, the places' radius, and how far it lies beyond them."""
        return math.ceil(20.0 * (BODY_MARGIN + self.radius + self.beyond) - 1e-9) / 20.0


def survey(x: Floats, y: Floats, sigma: Floats) -> SurveyedOutline:
    """Return the outline along which places (n,) in driving order lie [m], of standard deviation `sigma` (n,) [m].

    The line is cut where it comes back to its begin. Sides are straight lines by least squares of perpendicular
    distances, corners are where they meet; a bend becomes several short sides. Raises ConfigError for a line that does
    not come back, has a gap, crosses itself, encloses no lot, or is less accurate than MAX_SIGMA.
    """
    points = _moved(np.column_stack((x, y)))
    worst_sigma = float(sigma.max()) if len(sigma) else math.nan
    if not worst_sigma <= MAX_SIGMA:
        raise ConfigError(f"a place has a standard deviation of {worst_sigma:.2f} m, expected at most {MAX_SIGMA:g} m")
    ring, overlap = _closed(points)
    tolerance = max(MIN_TOLERANCE, 3.0 * worst_sigma)
    rough = _needed(ring, simplified_ring(ring, tolerance), 2.0 * tolerance)
    Lot([(px, py) for px, py in rough.tolist()], margin=0.0)  # raises where it crosses itself
    corners = _refined(ring, rough, tolerance)
    lot = Lot([(px, py) for px, py in corners.tolist()], margin=0.0)
    outside = distances_outside(corners, ring)
    return SurveyedOutline(
        corners=corners,
        area=lot.area,
        places=len(ring),
        overlap=overlap,
        rms=math.sqrt(float((outside * outside).mean())),
        worst=float(np.abs(outside).max()),
        beyond=max(0.0, float(-outside.min())),
        radius=RADIUS_95 * worst_sigma,
    )


def _moved(points: Floats) -> Floats:
    """Leave out places that were taken standing; raises ConfigError for a gap."""
    kept = [0] if len(points) else []
    for number in range(1, len(points)):
        gap = math.dist(points[number], points[kept[-1]])
        if gap > MAX_GAP:
            raise ConfigError(
                f"{gap:.1f} m without a place after {_walked(points[kept]):.0f} m; expected at most {MAX_GAP:g} m"
            )
        if gap > STANDING:
            kept.append(number)
    return points[kept]


def _walked(points: Floats) -> float:
    return float(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)).sum())


def _closed(points: Floats) -> tuple[Floats, float]:
    """Return the line as far as where it comes back to its begin, and how near it does [m]."""
    if len(points) < 4:
        raise ConfigError(f"expected a line along the lot's edge, got {len(points)} places that differ")
    from_begin = np.sqrt(((points - points[0]) ** 2).sum(axis=1))
    half = len(points) // 2
    end = half + int(np.argmin(from_begin[half:]))
    if from_begin[end] > CLOSING:
        raise ConfigError(
            f"the outline is open: after {_walked(points):.0f} m its end is {from_begin[end]:.1f} m from its begin; "
            f"expected at most {CLOSING:g} m, walk on until you are back"
        )
    ring = points[:end] if from_begin[end] < STANDING else points[: end + 1]
    return ring, float(from_begin[end])


def _needed(ring: Floats, corners: Floats, tolerance: float) -> Floats:
    """Leave out corners without which every place between their neighbours is within `tolerance` [m] of the line.

    The first place is a corner of every simplified line, and where both ends of a side miss its corners, so is a place
    in its middle.
    """
    at = [int(np.argmin(((ring - corner) ** 2).sum(axis=1))) for corner in corners]
    number = 0
    while number < len(at) and len(at) > 3:
        before, after = at[number - 1], at[(number + 1) % len(at)]
        between = np.arange(before, after + 1 if after > before else after + 1 + len(ring)) % len(ring)
        if _off(ring[between]) <= tolerance:
            at.pop(number)
            number = max(number - 1, 0)
        else:
            number += 1
    return ring[at]


def _off(places: Floats) -> float:
    """Return the greatest distance of places from the line through the first and the last [m]."""
    along = places[-1] - places[0]
    long = math.hypot(*along.tolist())
    if long < STANDING:
        return math.inf
    apart = places - places[0]
    return float(np.abs(along[0] * apart[:, 1] - along[1] * apart[:, 0]).max()) / long


def _refined(ring: Floats, rough: Floats, tolerance: float) -> Floats:
    """Return the corners where two sides' lines meet, where that is near the rough ones; others stay.

    Rough corners that lie within CUT_CORNER of each other along the line, such as where the places miss the corner
    itself, become one.
    """
    count = len(rough)
    lines = [_line(ring, rough[number], rough[(number + 1) % count], tolerance) for number in range(count)]
    sides = [number for number in range(count) if lines[number] is not None]
    if len(sides) < 3:
        return rough
    corners: list[tuple[float, float]] = []
    for before, after in zip(sides, [*sides[1:], sides[0] + count], strict=True):
        between = [rough[number % count] for number in range(before + 1, after + 1)]
        one, other = lines[before], lines[after % count]
        assert one is not None  # of a side with a line
        assert other is not None
        met = _met(one, other) if _walked(np.array(between)) <= CUT_CORNER else None
        if met is not None and min(math.dist(met, corner) for corner in between) <= max(3.0 * tolerance, CUT_REACH):
            corners.append(met)
        else:
            corners += [(float(corner[0]), float(corner[1])) for corner in between]
    return np.array(corners)


_Line = tuple[Floats, Floats]  #: a place on it, and its direction, of length one


def _line(ring: Floats, begin: Floats, end: Floats, tolerance: float) -> _Line | None:
    """Return the line of a side by the places along it; None where too few lie there."""
    long = math.dist(begin, end)
    along = (end - begin) / long
    s, d = (ring - begin) @ along, (ring - begin) @ np.array((-along[1], along[0]))
    on_it = ring[(s > AROUND_CORNER) & (s < long - AROUND_CORNER) & (np.abs(d) <= 1.5 * tolerance)]
    if len(on_it) < MIN_SIDE_PLACES:
        return None
    middle = on_it.mean(axis=0)
    apart = on_it - middle
    (xx, xy), (_, yy) = (apart.T @ apart).tolist()
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    direction = np.array((math.cos(angle), math.sin(angle)))
    return middle, direction if float(direction @ along) > 0.0 else -direction


def _met(one: _Line, other: _Line) -> tuple[float, float] | None:
    """Return where two lines meet; None where they turn too little."""
    (p, a), (q, b) = one, other
    turn = float(a[0] * b[1] - a[1] * b[0])
    if abs(turn) < math.sin(MIN_TURN):
        return None
    t = float((q[0] - p[0]) * b[1] - (q[1] - p[1]) * b[0]) / turn
    return float(p[0] + t * a[0]), float(p[1] + t * a[1])
