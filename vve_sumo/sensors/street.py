"""What stands along the virtual road for the whole drive, as a sensor sees it: buildings as walls.

Declarations and plane geometry; knows no file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from vve_sumo.values import Floats


@dataclass(frozen=True, slots=True)
class Building:
    """A building as a block."""

    outline: tuple[tuple[float, float], ...]  #: corners, map [m]
    height: float  #: [m]

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON, for the record."""
        return {"outline_m": [list(corner) for corner in self.outline], "height_m": self.height}

    @classmethod
    def from_dict(cls, recorded: Mapping[str, Any]) -> Self:
        """Return the building that `to_dict` wrote; raises KeyError, TypeError or ValueError for anything else."""
        outline = tuple((float(x), float(y)) for x, y in recorded["outline_m"])
        return cls(outline, float(recorded["height_m"]))


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
