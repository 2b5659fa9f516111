"""The lanes around a drive's path, and which of them a body is on. Knows a run; nothing of any format."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.values import Floats

#: kinds of lanes for people on foot alone
ON_FOOT: Final = frozenset({"crossing", "walkway"})
#: Of lanes that overlap, as in a junction, a body is on the one that it is nearest to; a radian between the body and
#: the lane counts as so much [m].
LENGTH_PER_TURN: Final = 3.0
#: how far before its first and after its last point a lane still holds a body [m]
MAX_BEYOND: Final = 0.05


class RecordedLane(NamedTuple):
    """A row of the record's table of roads."""

    name: str
    kind: str
    width: float  #: [m]
    line: Floats  #: centre line (n, 2) in driving direction, map [m]; no point stands twice
    successors: tuple[str, ...]


class LanePlaces(NamedTuple):
    """Where points are among lanes; an entry a point."""

    lane: NDArray[np.int64]  #: index of the lane; -1 for none
    position: Floats  #: along the lane's centre line [m]; NaN for none


def lanes_of(run: Run) -> list[RecordedLane]:
    """Return the lanes of a record, except those of a single point; none of a record of an earlier layout."""
    return lanes_in(run.arrow("roads"))


def lanes_in(roads: pa.Table) -> list[RecordedLane]:
    """Return the lanes in a record's table of roads, except those of a single point."""
    found = []
    for row in roads.to_pylist():
        line = np.array([row["x_m"], row["y_m"]], np.float64).T
        line = line[np.append(True, np.any(np.diff(line, axis=0) != 0.0, axis=1))] if len(line) else line
        if len(line) > 1:
            found.append(RecordedLane(row["lane"], row["kind"], row["width_m"], line, tuple(row["successors"])))
    return found


def places(lanes: Sequence[RecordedLane], x: Floats, y: Floats, heading: Floats) -> LanePlaces:
    """Return the lane that each point [m] with its heading [rad] is on."""
    on, position = np.full(len(x), -1), np.full(len(x), np.nan)
    least = np.full(len(x), np.inf)
    for number, lane in enumerate(lanes):
        reach = 0.5 * lane.width
        low, high = lane.line.min(axis=0) - reach, lane.line.max(axis=0) + reach
        near = np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))
        if len(near):
            distance, along, turn = _beside(lane.line, x[near], y[near], heading[near])
            if lane.kind in ON_FOOT:  # people walk it both ways
                turn = np.minimum(turn, np.pi - turn)
            cost = distance + LENGTH_PER_TURN * turn
            better = (distance <= reach) & (cost < least[near])
            rows = near[better]
            on[rows], position[rows], least[rows] = number, along[better], cost[better]
    return LanePlaces(on, position)


def _beside(line: Floats, x: Floats, y: Floats, heading: Floats) -> tuple[Floats, Floats, Floats]:
    """Return distance from a line [m], position along it [m] and size of the turn from its direction [rad] of points.

    The distance is inf of a point before its first or after its last point.
    """
    pieces = np.diff(line, axis=0)
    lengths = np.hypot(pieces[:, 0], pieces[:, 1])
    ways = pieces / lengths[:, None]
    dx, dy = x[:, None] - line[:-1, 0], y[:, None] - line[:-1, 1]
    along = dx * ways[:, 0] + dy * ways[:, 1]
    held = np.clip(along, 0.0, lengths)
    apart = np.hypot(dx - held * ways[:, 0], dy - held * ways[:, 1])
    nearest = np.argmin(apart, axis=1)
    rows = np.arange(len(x))
    beyond = (along[:, 0] < -MAX_BEYOND) & (nearest == 0) | (
        (along[:, -1] > lengths[-1] + MAX_BEYOND) & (nearest == len(lengths) - 1)
    )
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    directions = np.arctan2(ways[:, 1], ways[:, 0])[nearest]
    turn = np.abs(np.remainder(heading - directions + np.pi, 2.0 * np.pi) - np.pi)
    return np.where(beyond, np.inf, apart[rows, nearest]), starts[nearest] + held[rows, nearest], turn
