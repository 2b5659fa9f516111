"""Lanes around a drive's path: which lane an actor is in, and how the lane goes on where it forks.

Reads the record's table of roads. Knows actors' boxes and the ways that they drove; neither the ego nor SUMO.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from vve_sumo.geometry import Boxes
from vve_sumo.metrics.lane_matching import Candidates, links, most_likely
from vve_sumo.metrics.predicted_ways import SPACING, Indices, PlacedWays, WayLine, Ways
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
#: so far before its begin and behind its end a vehicle may still be said to be in a lane [m]
BEYOND: Final = 5.0
#: a shorter actor is a pedestrian, who keeps to no lane [m]
LEAST_VEHICLE: Final = 1.2
#: samples of lanes near a place that are looked at, and as many lanes as may lie there upon each other
NEAREST: Final = 48
MAX_LANES: Final = 6


@dataclass(frozen=True, slots=True)
class LaneGraph:
    """Lanes for vehicles, by their numbers."""

    lines: list[WayLine]  #: centre lines, in driving direction
    edges: list[str]  #: of each lane: lanes side by side, or through a junction on one connection, have one edge
    successors: list[list[int]]  #: that each lane leads into
    predecessors: list[list[int]]  #: that lead into each lane

    @classmethod
    def from_table(cls, roads: pa.Table) -> LaneGraph:
        """Take the lanes from a record's table of roads, except those without length, which lead nowhere."""
        rows = [
            row for row in roads.to_pylist()
            if row["kind"] in KINDS and len(set(zip(row["x_m"], row["y_m"], strict=True))) > 1
        ]  # fmt: skip
        number = {row["lane"]: place for place, row in enumerate(rows)}
        lines = [WayLine(np.array(row["x_m"], np.float64), np.array(row["y_m"], np.float64)) for row in rows]
        successors = [[number[name] for name in row["successors"] if name in number] for row in rows]
        predecessors: list[list[int]] = [[] for _ in lines]
        for lane, after in enumerate(successors):
            for follower in after:
                predecessors[follower].append(lane)
        return cls(lines, [row["lane"].rpartition("_")[0] for row in rows], successors, predecessors)

    def along(self, ways: Ways, driven: Indices) -> Indices:
        """Return the lane that a vehicle goes along at every sample of its way; -1 for none.

        driven: how many samples of each way are looked at, from the first one.
        """
        near = self._near(ways.x, ways.y, ways.heading)
        return most_likely(near, ways.first, driven, links(self.edges, self.successors))

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

    def line(
        self, lane: int, earlier: list[str], later: list[str], back: float, distance: float
    ) -> tuple[WayLine, float]:
        """Return the line of a vehicle in a lane, and at which arc length of it the lane begins [m].

        It goes from `back` [m] or more before the lane to `distance` [m] or more behind it, where there are lanes.

        Where the lane forks it takes the branch with an edge among those that it was in later; else the straightest.
        It came from a lane with an edge among those that it was in before, the latest first; else the straightest.
        """
        chain, length = [lane], 0.0
        while length < distance and self.successors[chain[-1]]:
            chain.append(self._branch(chain[-1], later))
            length += _length(self.lines[chain[-1]])
        begin = 0.0
        while begin < back and self.predecessors[chain[0]]:
            chain.insert(0, self._feeder(chain[0], earlier))
            begin += _length(self.lines[chain[0]])
        x, y = (np.concatenate([self.lines[number][axis] for number in chain]) for axis in (0, 1))
        # A lane begins where the one before ends.
        apart = np.append(True, np.hypot(np.diff(x), np.diff(y)) > 1e-6)
        return WayLine(x[apart], y[apart]), begin

    def _feeder(self, lane: int, earlier: list[str]) -> int:
        def rank(feeder: int) -> tuple[int, float]:
            place = earlier.index(self.edges[feeder]) if self.edges[feeder] in earlier else len(earlier)
            return place, self._turn(feeder, lane)

        return min(self.predecessors[lane], key=rank)

    def _turn(self, before: int, after: int) -> float:
        """Return by how much the ends of two lanes turn against each other [rad]."""
        return abs(float(wrapped(np.array(_end(self.lines[after]) - _end(self.lines[before])))))

    def _branch(self, lane: int, later: list[str]) -> int:
        def rank(branch: int) -> tuple[int, float]:
            reached = [self.edges[branch], *(self.edges[number] for number in self.successors[branch])]
            places = [later.index(edge) for edge in reached if edge in later]
            return min(places, default=len(later)), self._turn(lane, branch)

        return min(self.successors[lane], key=rank)


def _length(line: WayLine) -> float:
    return float(np.hypot(np.diff(line.x), np.diff(line.y)).sum())


def _end(line: WayLine) -> float:
    """Return the heading at the end of a line [rad]."""
    return math.atan2(line.y[-1] - line.y[-2], line.x[-1] - line.x[-2])


def fronts(boxes: Boxes) -> Boxes:
    """Return the boxes moved ahead by half their length, so that their middles are where their fronts were."""
    ahead = 0.5 * boxes.length
    return boxes._replace(x=boxes.x + ahead * np.cos(boxes.heading), y=boxes.y + ahead * np.sin(boxes.heading))


def along_lanes(lanes: LaneGraph, middles: PlacedWays, ends: PlacedWays, boxes: Boxes, beyond: float) -> PlacedWays:
    """Return the ways of actors with those that are in a lane put on the lane's way, and where each row then is.

    middles, ends: of the boxes' middles and of their fronts. A vehicle in SUMO is in the lane in which its front is;
    the middle of a long one is beside it in a bend. `beyond` [s] is how far ahead actors are predicted.
    """
    if not lanes.lines or not len(boxes.x):
        return middles
    front = fronts(boxes)
    lines: list[WayLine] = []
    placed = middles.places
    way, along, chord = placed.way.copy(), placed.along.copy(), placed.chord.copy()
    for passage in _passages(lanes, ends, boxes):
        rows, length = passage.rows, boxes.length[passage.rows]
        back = float(length.max())
        reach = beyond * float(np.abs(boxes.speed[rows]).max()) + back
        line, begin = lanes.line(passage.lane, passage.earlier, passage.later, back, reach)
        way[rows], chord[rows] = len(middles.ways.first) + len(lines), length
        along[rows] = begin + _projected(lanes.lines[passage.lane], front.x[rows], front.y[rows]) - 0.5 * length
        lines.append(line)
    if not lines:
        return middles
    ways = middles.ways.with_lines(lines)
    return PlacedWays(ways, ways.place(way, along, chord, boxes))


class _Passage(NamedTuple):
    """A vehicle in a lane."""

    lane: int
    rows: Indices  #: of the table of actors
    earlier: list[str]  #: edges that it was in until then, the latest first
    later: list[str]  #: edges that it was in from then on


def _passages(lanes: LaneGraph, ends: PlacedWays, boxes: Boxes) -> Iterator[_Passage]:
    """Yield each lane that each vehicle's front went along."""
    ways, places = ends
    driven = np.ones(len(ways.first), np.int64)
    np.maximum.at(driven, places.way, 2 + (places.along / SPACING).astype(np.int64))
    # Where a way goes on straight after its vehicle was last seen, it says nothing of lanes.
    driven = np.minimum(driven, ways.count)
    lane_of = lanes.along(ways, driven)
    for number in np.unique(places.way[boxes.length >= LEAST_VEHICLE]).tolist():
        rows = np.flatnonzero(places.way == number)
        lane = lane_of[int(ways.first[number]) :][: int(driven[number])]
        at = np.minimum(np.rint(places.along[rows] / SPACING).astype(np.int64), len(lane) - 1)
        at_lane = np.where((boxes.speed[rows] >= 0.0) & (np.abs(places.turn[rows]) < MAX_TURN), lane[at], -1)
        for one in np.unique(at_lane[at_lane >= 0]).tolist():
            here = np.flatnonzero(at_lane == one)
            earlier, later = (
                list(dict.fromkeys(lanes.edges[number] for number in part.tolist() if number >= 0))
                for part in (lane[int(at[here].min()) :: -1], lane[int(at[here].max()) :])
            )
            yield _Passage(one, rows[here], earlier, later)


def _projected(line: WayLine, x: Floats, y: Floats) -> Floats:
    """Return the arc lengths of the points of a line that are nearest to places [m].

    Straight on by BEYOND at both ends of the line.
    """
    dx, dy = np.diff(line.x), np.diff(line.y)
    size = np.hypot(dx, dy)
    start = np.concatenate(([0.0], np.cumsum(size)))[:-1]
    px, py = x[:, None] - line.x[:-1], y[:, None] - line.y[:-1]
    share = (px * dx + py * dy) / (size * size)
    low, high = np.zeros(len(dx)), np.ones(len(dx))
    low[0], high[-1] = -BEYOND / size[0], 1.0 + BEYOND / size[-1]
    share = np.clip(share, low, high)
    apart = np.hypot(px - share * dx, py - share * dy)
    best = np.argmin(apart, axis=1)
    arc: Floats = (start + share * size)[np.arange(len(x)), best]
    return arc
