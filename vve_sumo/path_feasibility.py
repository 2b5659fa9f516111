"""Says where a path asks for more than a car can travel: where its points turn back, and where it bends too tightly.

Knows a path and the curvature of a car's tightest circle; it must not know files, roads or how a car is steered.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.errors import ConfigError
from vve_sumo.path import Floats, ReferencePath

#: how far a car that steers too late may leave a path that bends tighter than its tightest circle [m]: a corner of 45
#: degrees for a circle of 5 m. A car that sees this corner coming and cuts it is off by R (1 / cos 22.5 deg - 1), which
#: is 0.4 m. Recorded drives of other cars, with the noise of their receivers, cost up to 1.2 m.
MAX_DEPARTURE: Final = 1.5
#: parts of a piece of the path between two points that are looked at one by one: across a corner the curvature of a
#: cubic piece changes by a multiple
PARTS: Final = 8
MIN_PATH_LENGTH: Final = 5.0  #: a path cut shorter than this is refused [m]
#: a path that turns by more than this at a point goes back [rad]
MAX_TURN: Final = 0.5 * math.pi


class Bend(NamedTuple):
    """A bend that is tighter than a car's tightest circle."""

    s: float  #: where it begins, along the path [m]
    radius: float  #: of the path, the least inside the bend [m]
    departure: float  #: how far a car on its tightest circle is off the path at its end [m]


def find_reversal(points: Floats) -> int | None:
    """Return the index of the first of the points (n, 2) at which their line turns by more than MAX_TURN, or None."""
    steps = np.diff(points, axis=0)
    along = (steps[1:] * steps[:-1]).sum(axis=1)
    back = np.flatnonzero(along < math.cos(MAX_TURN))
    return int(back[0]) + 1 if back.size else None


def find_tight_bend(path: ReferencePath, tightest: float) -> Bend | None:
    """Return the bend in which a car leaves the path the farthest, where that is more than MAX_DEPARTURE, or None.

    `tightest` is the curvature of the car's tightest circle [1/m]. The car is taken to follow the path until that bends
    more than the circle, and to keep to the circle until it heads along the path again. Its heading falls behind the
    path's by the excess of the path's turn over the circle's, and its departure is the sine of that, integrated over
    the path.
    """
    length, heading, curvature = _parts(path)
    found: Bend | None = None
    for side in (1.0, -1.0):
        turned = np.cumsum(side * heading - tightest * length)
        behind = turned - np.minimum.accumulate(np.minimum(turned, 0.0))
        moved = np.cumsum(np.sin(np.minimum(behind, 0.5 * math.pi)) * length)
        begun = np.maximum.accumulate(np.where(behind > 0.0, 0.0, moved))
        worst = int(np.argmax(moved - begun))
        departure = float(moved[worst] - begun[worst])
        if departure > MAX_DEPARTURE and (found is None or departure > found.departure):
            free = np.flatnonzero(behind[:worst] <= 0.0)
            first = int(free[-1]) + 1 if free.size else 0
            radius = 1.0 / float(np.max(side * curvature[first : worst + 1]))
            found = Bend(float(length[:first].sum()), radius, departure)
    return found


def refuse_tight_bend(path: ReferencePath, tightest: float, name: str) -> None:
    """Raise ConfigError where a path, in messages `name`, has a bend of `find_tight_bend`, with its place."""
    bend = find_tight_bend(path, tightest)
    if bend is None:
        return
    at = path.at(bend.s)
    raise ConfigError(
        f"{name}: at {bend.s:.1f} m along the path, ({at.x:.1f}, {at.y:.1f}) m on the map, it bends to a radius of "
        f"{bend.radius:.2f} m; expected no bend tighter than the car's tightest circle, a radius of "
        f"{1.0 / tightest:.2f} m: the car would leave the path by {bend.departure:.1f} m"
    )


def _parts(path: ReferencePath) -> tuple[Floats, Floats, Floats]:
    """Return of each part of the path its length [m], its change of heading [rad] and its mean curvature [1/m]."""
    pieces = np.array(path.segments)
    lengths = np.diff(np.append(pieces[:, 0], path.length))
    _, _, x1, x2, x3, _, y1, y2, y3 = (column[:, None] for column in pieces.T)
    u = lengths[:, None] * np.linspace(0.0, 1.0, PARTS + 1)
    headings = np.arctan2(y1 + u * (2.0 * y2 + 3.0 * u * y3), x1 + u * (2.0 * x2 + 3.0 * u * x3))
    turned = (np.diff(headings, axis=1) + math.pi) % math.tau - math.pi
    length = np.repeat(lengths / PARTS, PARTS)
    return length, turned.ravel(), turned.ravel() / length
