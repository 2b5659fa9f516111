"""Lanes around a drive's path: which lane an actor is in, and how the lane goes on where it forks.

Reads the record's table of roads. Knows actors' boxes and the ways that they drove; neither the ego nor SUMO.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from vve_sumo.geometry import Boxes
from vve_sumo.metrics.lane_matching import Candidates, links, most_likely
from vve_sumo.metrics.predicted_ways import SPACING, Indices, Line, Places, Ways
from vve_sumo.metrics.tracking import wrapped
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pyarrow as pa

#: kinds of lanes that vehicles drive in
KINDS: Final = ("lane", "junction")
#: an actor whose centre is farther from a lane's centre line is not in the lane [m]
MAX_BESIDE: Final = 1.8
#: an actor whose heading differs by more from the lane's does not go along it [rad]
MAX_TURN: Final = math.pi / 4.0
#: a shorter actor is a pedestrian, who keeps to no lane [m]
LEAST_VEHICLE: Final = 1.2
#: samples of lanes near a place that are looked at, and as many lanes as may lie there upon each other
NEAREST: Final = 48
MAX_LANES: Final = 6


@dataclass(frozen=True, slots=True)
class Lanes:
    """Lanes for vehicles, by their numbers."""

    lines: list[Line]  #: centre lines, in driving direction
    edges: list[str]  #: of each lane: lanes side by side, or through a junction on one connection, have one edge
    successors: list[list[int]]  #: that each lane leads into

    @classmethod
    def from_table(cls, roads: pa.Table) -> Lanes:
        """Take the lanes from a record's table of roads, except those without length, which lead nowhere."""
        rows = [
            row for row in roads.to_pylist()
            if row["kind"] in KINDS and len(set(zip(row["x_m"], row["y_m"], strict=True))) > 1
        ]  # fmt: skip
        number = {row["lane"]: place for place, row in enumerate(rows)}
        lines = [Line(np.array(row["x_m"], np.float64), np.array(row["y_m"], np.float64)) for row in rows]
        successors = [[number[name] for name in row["successors"] if name in number] for row in rows]
        return cls(lines, [row["lane"].rpartition("_")[0] for row in rows], successors)

    def along(self, ways: Ways) -> Indices:
        """Return the lane that a vehicle goes along at every sample of its way; -1 for none."""
        near = self._near(ways.x, ways.y, ways.heading)
        return most_likely(near, ways.first, ways.count, links(self.edges, self.successors))

    def _near(self, x: Floats, y: Floats, heading: Floats) -> Candidates:
        """Return the lanes near places that go their heading [rad], the nearest first."""
        from scipy.spatial import KDTree

        samples = Ways.from_lines(self.lines)
        tree, near = KDTree(np.column_stack((samples.x, samples.y))), np.arange(1, NEAREST + 1)
        found = tree.query(np.column_stack((x, y)), k=near, distance_upper_bound=MAX_BESIDE + SPACING)
        distance, row = np.asarray(found[0]), np.minimum(np.asarray(found[1], np.int64), len(samples.x) - 1)
        turn = np.abs(wrapped(heading[:, None] - samples.heading[row]))
        dx, dy = x[:, None] - samples.x[row], y[:, None] - samples.y[row]
        beside = np.abs(dy * np.cos(samples.heading[row]) - dx * np.sin(samples.heading[row]))
        fits = np.isfinite(distance) & (turn < MAX_TURN) & (beside < MAX_BESIDE)
        lane = np.searchsorted(samples.first, row, "right") - 1
        fit = (beside / MAX_BESIDE) ** 2 + (turn / MAX_TURN) ** 2
        places = np.arange(len(x))
        candidates = Candidates(np.full((len(x), MAX_LANES), -1), np.full((len(x), MAX_LANES), np.inf))
        for number in range(MAX_LANES):
            nearest = np.argmax(fits, axis=1)
            there = fits[places, nearest]
            candidates.lane[there, number] = lane[there, nearest[there]]
            candidates.cost[there, number] = fit[there, nearest[there]]
            fits &= lane != lane[places, nearest][:, None]
        return candidates

    def onward(self, lane: int, later: list[str], distance: float) -> Line:
        """Return the line that a vehicle in a lane goes along for a distance [m], from the lane's begin.

        Where the lane forks it takes the branch with an edge among those that it was in later; else the straightest.
        """
        chain, length = [lane], _length(self.lines[lane])
        while length < distance + _length(self.lines[lane]) and self.successors[chain[-1]]:
            chain.append(self._branch(chain[-1], later))
            length += _length(self.lines[chain[-1]])
        x, y = (np.concatenate([self.lines[number][axis] for number in chain]) for axis in (0, 1))
        # A lane begins where the one before ends.
        apart = np.append(True, np.hypot(np.diff(x), np.diff(y)) > 1e-6)
        return Line(x[apart], y[apart])

    def _branch(self, lane: int, later: list[str]) -> int:
        def rank(branch: int) -> tuple[int, float]:
            reached = [self.edges[branch], *(self.edges[number] for number in self.successors[branch])]
            places = [later.index(edge) for edge in reached if edge in later]
            turned = abs(float(wrapped(np.array(_end(self.lines[branch]) - _end(self.lines[lane])))))
            return min(places, default=len(later)), turned

        return min(self.successors[lane], key=rank)


def _length(line: Line) -> float:
    return float(np.hypot(np.diff(line.x), np.diff(line.y)).sum())


def _end(line: Line) -> float:
    """Return the heading at the end of a line [rad]."""
    return math.atan2(line.y[-1] - line.y[-2], line.x[-1] - line.x[-2])


def along_lanes(lanes: Lanes, driven: Ways, places: Places, boxes: Boxes, beyond: float) -> tuple[Ways, Places]:
    """Return the ways of actors with those that are in a lane put on the lane's way, and where each row then is.

    driven, places: the ways that actors drove in the record. `beyond` [s] is how far ahead actors are predicted.
    """
    if not lanes.lines or not len(places.way):
        return driven, places
    lane_of = lanes.along(driven)
    lines: list[Line] = []
    way, along = places.way.copy(), places.along.copy()
    for number in np.unique(places.way[boxes.length >= LEAST_VEHICLE]).tolist():
        rows = np.flatnonzero(places.way == number)
        last = int(places.along[rows].max() / SPACING) + 1
        lane = lane_of[int(driven.first[number]) :][: min(last + 1, int(driven.count[number]))]
        at = np.minimum(np.rint(places.along[rows] / SPACING).astype(np.int64), len(lane) - 1)
        at_lane = np.where((boxes.speed[rows] >= 0.0) & (np.abs(places.turn[rows]) < MAX_TURN), lane[at], -1)
        reach = beyond * float(np.abs(boxes.speed[rows]).max())
        for one in np.unique(at_lane[at_lane >= 0]).tolist():
            here = np.flatnonzero(at_lane == one)
            later = [lanes.edges[number] for number in lane[int(at[here].max()) :].tolist() if number >= 0]
            line = lanes.onward(one, list(dict.fromkeys(later)), reach)
            way[rows[here]] = len(driven.first) + len(lines)
            along[rows[here]] = _projected(line, boxes.x[rows[here]], boxes.y[rows[here]])
            lines.append(line)
    if not lines:
        return driven, places
    ways = driven.with_lines(lines)
    return ways, ways.place(way, along, boxes)


def _projected(line: Line, x: Floats, y: Floats) -> Floats:
    """Return the arc lengths of the points of a line that are nearest to places [m]; straight on beyond its ends."""
    dx, dy = np.diff(line.x), np.diff(line.y)
    size = np.hypot(dx, dy)
    start = np.concatenate(([0.0], np.cumsum(size)))[:-1]
    px, py = x[:, None] - line.x[:-1], y[:, None] - line.y[:-1]
    share = (px * dx + py * dy) / (size * size)
    low, high = np.zeros(len(dx)), np.ones(len(dx))
    low[0], high[-1] = -np.inf, np.inf
    share = np.clip(share, low, high)
    apart = np.hypot(px - share * dx, py - share * dy)
    best = np.argmin(apart, axis=1)
    arc: Floats = (start + share * size)[np.arange(len(x)), best]
    return arc
