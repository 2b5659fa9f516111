"""The corridor that a scenario declares beside its path: how far the ego may go, and the parallel lines that fill it.

Pure geometry of a path; knows no lot, no brakes and no controller.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.path import SAMPLE_SPACING, ReferencePath
from vve_sumo.values import FallbackPath, Floats

#: from one parallel line to the next [m], well below any car's width: two neighbours leave no ground between them
LINE_SPACING: Final = 1.0


class CorridorStretch(NamedTuple):
    """How far the rear axle may go beside a stretch of the path."""

    begin: float  #: along the path [m]
    end: float  #: along the path [m]; inf for the path's end
    left: float  #: of the path [m], not negative
    right: float  #: of the path [m], not negative


#: where stretches overlap, the wider one counts; outside all of them the ego keeps to its path
DeclaredCorridor = tuple[CorridorStretch, ...]


def half_widths(corridor: DeclaredCorridor, s: float) -> tuple[float, float]:
    """Return how far left and right the rear axle may go at one of the path's samples [m]; 0 where none is declared.

    A sample stands for the path up to its neighbours, so that a stretch between two samples counts at both.
    """
    here = [one for one in corridor if one.begin - SAMPLE_SPACING < s < one.end + SAMPLE_SPACING]
    return max((one.left for one in here), default=0.0), max((one.right for one in here), default=0.0)


def line_offsets(corridor: DeclaredCorridor, s: float) -> list[float]:
    """Return the d of the lines that fill the corridor at a sample [m], left positive, without the path's 0."""
    left, right = half_widths(corridor, s)
    return _shares(left) + [-d for d in _shares(right)]


def _shares(reach: float) -> list[float]:
    """Return distances up to a reach [m], no more than LINE_SPACING apart; none for 0."""
    count = math.ceil(reach / LINE_SPACING)
    return [reach * number / count for number in range(1, count + 1)]


class ParallelLine:
    """The line at a constant lateral offset d beside a path, as a rear axle can follow it.

    A path of curvature k has a parallel line at d of curvature k / (1 - k d), which is 1 - k d times as long
    as the path. Where that is tighter than the car's tightest circle, or d lies beyond the centre of the bend, the car
    is taken to be on its tightest circle there.
    """

    __slots__ = ("_along", "bend", "x", "y")

    def __init__(self, path: ReferencePath, d: float, tightest: float) -> None:
        """`d` is left positive [m], `tightest` the curvature of the tightest circle [1/m]."""
        table = path.samples
        stretch = np.maximum(1.0 - table.curvature * d, np.abs(table.curvature) / tightest)
        self.x: Floats = table.x - d * table.tangent_y  #: places beside the path's samples, map [m]
        self.y: Floats = table.y + d * table.tangent_x
        self.bend: Floats = table.curvature / stretch  #: there [1/m], left positive
        steps = 0.5 * SAMPLE_SPACING * (stretch[:-1] + stretch[1:])
        self._along: Floats = np.concatenate(([0.0], np.cumsum(steps)))

    def ahead(self, row: int, distance: float) -> FallbackPath:
        """Return the line from a sample on, for a distance [m] and a little more, as a fallback path."""
        wanted = self._along[row] + SAMPLE_SPACING * np.arange(math.ceil(distance / SAMPLE_SPACING) + 2)
        return FallbackPath(SAMPLE_SPACING, tuple(np.interp(wanted, self._along, self.bend).tolist()))
