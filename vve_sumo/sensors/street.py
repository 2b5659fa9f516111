"""What lies along the virtual road for the whole drive, as a sensor sees it: buildings as walls, and lanes.

Declarations and plane geometry; knows no file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from vve_sumo.intersections import Intersection
from vve_sumo.junctions import Junction
from vve_sumo.values import Floats

if TYPE_CHECKING:
    from vve_sumo.frames import MapFrame

#: cosine of the greatest angle between a heading and a lane that leads in it
LEADS: Final = math.cos(math.radians(45.0))
#: so far beyond its ends a piece of a lane still counts [m]: in a bend there is a gap between two
JOINT: Final = 0.2


@dataclass(frozen=True, slots=True)
class Building:
    """A building as a block."""

    outline: tuple[tuple[float, float], ...]  #: corners, map [m]
    height: float  #: [m]


class LaneStrip(NamedTuple):
    """A lane for vehicles."""

    x: Floats  #: centre line in driving direction, map [m]
    y: Floats  #: map [m]
    width: float  #: [m]


class Street(NamedTuple):
    """What a sensor may see of the street."""

    buildings: Sequence[Building] = ()
    lanes: Sequence[LaneStrip] = ()
    map_frame: MapFrame | None = None  #: where on Earth the map lies; None: nobody says
    intersections: Sequence[Intersection] = ()  #: those with signals, where a sensor sees signals
    #: those at which somebody has to give way, near the path, where a sensor knows of right of way
    junctions: Sequence[Junction] = ()


class LaneBorders(NamedTuple):
    """The borders of the lane that somebody is in."""

    left: float  #: distance to the left border, across the lane [m]
    right: float  #: distance to the right border, across the lane [m]


class Lanes:
    """Lanes, looked up by place and direction."""

    def __init__(self, lanes: Sequence[LaneStrip]) -> None:
        pieces = [
            np.stack((lane.x[:-1], lane.y[:-1], np.diff(lane.x), np.diff(lane.y), np.full(len(lane.x) - 1, lane.width)))
            for lane in lanes
        ]
        table: Floats = np.concatenate(pieces, axis=1) if pieces else np.zeros((5, 0))
        self._x, self._y, self._along_x, self._along_y, self._width = (table[row] for row in range(5))
        self._length = np.maximum(np.hypot(self._along_x, self._along_y), 1e-9)

    def borders(self, x: float, y: float, heading: float) -> LaneBorders | None:
        """Return the borders of the lane at a place, map [m], that leads in a heading [rad]; None outside of all."""
        east, north = x - self._x, y - self._y
        along = (east * self._along_x + north * self._along_y) / self._length
        across = (north * self._along_x - east * self._along_y) / self._length
        leads = (self._along_x * math.cos(heading) + self._along_y * math.sin(heading)) / self._length > LEADS
        here = leads & (along >= -JOINT) & (along <= self._length + JOINT) & (np.abs(across) <= 0.5 * self._width)
        found = np.flatnonzero(here)
        if not len(found):
            return None
        one = found[np.argmin(np.abs(across[found]))]
        half, aside = 0.5 * float(self._width[one]), float(across[one])
        return LaneBorders(half - aside, half + aside)


class Walls(NamedTuple):
    """Upright walls on the ground; arrays have an entry a wall."""

    x: Floats  #: of one end, map [m]
    y: Floats  #: of one end, map [m]
    along_x: Floats  #: from that end to the other, map [m]
    along_y: Floats  #: from that end to the other, map [m]
    top: Floats  #: above the ground [m]

    def near(self, x: float, y: float, reach: float) -> Walls:
        """Return the walls that come within a reach of a place, map [m]."""
        east, north = x - self.x, y - self.y
        squared = np.maximum(self.along_x**2 + self.along_y**2, 1e-12)
        share = np.clip((east * self.along_x + north * self.along_y) / squared, 0.0, 1.0)
        away = np.hypot(east - share * self.along_x, north - share * self.along_y)
        return Walls(*(column[away <= reach] for column in self))


def walls_of(buildings: Sequence[Building]) -> Walls:
    """Return the outer walls of buildings."""
    ends = [
        (*corner, *following, building.height)
        for building in buildings
        for corner, following in zip(building.outline, (*building.outline[1:], building.outline[0]), strict=True)
        if corner != following
    ]
    x, y, to_x, to_y, top = np.array(ends, np.float64).reshape(-1, 5).T.copy()
    return Walls(x, y, to_x - x, to_y - y, top)
