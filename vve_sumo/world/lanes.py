"""Holds geometry and links of the running network's lanes: which lanes a box cuts, which edges follow an edge.

Reads the lanes from SUMO once at start (links on demand); the rest is plain geometry. Must not know any vehicle.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import libsumo
import numpy as np
from numpy.typing import NDArray

from vve_sumo.frozen import fast_frozen
from vve_sumo.geometry import Box, Corners
from vve_sumo.values import Floats
from vve_sumo.world.coverage import RoadStrip, covered

#: SUMO's link directions in the order in which the onward route prefers them: straight on first, a U-turn last.
TURN_PREFERENCE: Final = "sRLrlt"

#: A route onward ends after so many edges or so far ahead [m]. Traffic yields to an ego whose route goes on past the
#: next junction, but not to one whose route ends there.
ONWARD_EDGES: Final = 6
ONWARD_DISTANCE: Final = 400.0

#: The pieces of lanes near a box are searched again after the box moved so far [m].
NEARBY_REFRESH_DISTANCE: Final = 10.0

#: The few pieces close to a body are selected again after a corner of the body may have moved so far [m].
CLOSE_REFRESH_DISTANCE: Final = 2.0

#: A corner may lie so far before or past a piece [m] and still count as in its lane, because the drawn lanes of one
#: road have small gaps.
END_PLAY: Final = 0.3


@dataclass(frozen=True, slots=True)
class Lane:
    """One lane: its centre line in straight pieces."""

    id: str  #: of SUMO
    edge: str  #: the edge it belongs to
    index: int  #: 0 is the rightmost of its edge
    length: float  #: SUMO's length, on which its positions count [m]; not always the drawn length
    bands: tuple[RoadStrip, ...]  #: its pieces, first to last
    starts: tuple[float, ...]  #: drawn distance at which each piece starts [m]

    @property
    def drawn_length(self) -> float:
        """Length of the centre line as drawn [m]."""
        return self.starts[-1] + self.bands[-1].length

    def at(self, distance: float) -> tuple[float, float, float]:
        """Return x [m], y [m] and heading [rad] of the centre line at a drawn distance [m] from its start."""
        i = max(bisect_right(self.starts, distance) - 1, 0)
        band, along = self.bands[i], distance - self.starts[i]
        return band.x + along * band.cos, band.y + along * band.sin, math.atan2(band.sin, band.cos)

    def nearest(self, x: float, y: float) -> float:
        """Return the drawn distance [m] of the place on the centre line that is nearest to a point."""

        def away(piece: tuple[RoadStrip, float]) -> tuple[float, float]:
            band, start = piece
            dx, dy = x - band.x, y - band.y
            along = min(max(dx * band.cos + dy * band.sin, 0.0), band.length)
            return math.hypot(dx - along * band.cos, dy - along * band.sin), start + along

        return min(map(away, zip(self.bands, self.starts, strict=True)))[1]


@fast_frozen
@dataclass(frozen=True, slots=True)
class Cut:
    """The part of a lane that a box covers."""

    lane: Lane
    start: float  #: drawn distance where the covered part starts [m]
    end: float  #: drawn distance where it ends [m]


def read_lanes() -> list[Lane]:
    """Return the lanes of the running simulation, without those for pedestrians alone."""
    names = libsumo.lane.getIDList()
    return [_read(name) for name in names if libsumo.lane.getAllowed(name) != ("pedestrian",)]


def _read(name: str) -> Lane:
    half_width = 0.5 * libsumo.lane.getWidth(name)
    points = libsumo.lane.getShape(name)
    bands, starts, total = [], [], 0.0
    for (x, y), (next_x, next_y) in pairwise(points):
        length = math.hypot(next_x - x, next_y - y)
        if length > 0.0:
            bands.append(RoadStrip(x, y, (next_x - x) / length, (next_y - y) / length, length, half_width))
            starts.append(total)
            total += length
    edge, _, index = name.rpartition("_")
    return Lane(name, edge, int(index), libsumo.lane.getLength(name), tuple(bands), tuple(starts))


def holds(bands: Sequence[RoadStrip], x: float, y: float) -> bool:
    """Return whether a point lies on one of the pieces."""
    for band in bands:
        dx, dy = x - band.x, y - band.y
        along = dx * band.cos + dy * band.sin
        if -END_PLAY <= along <= band.length + END_PLAY and abs(dy * band.cos - dx * band.sin) <= band.half_width:
            return True
    return False


class Lanes:
    """All lanes of a network, indexed by place and by link."""

    def __init__(self, lanes: Iterable[Lane], reach: float) -> None:
        """Index the lanes for boxes of a radius up to `reach` [m]."""
        self.by_id = {lane.id: lane for lane in lanes if lane.bands}
        self._lane_of: dict[str, str] = {}
        for lane in self.by_id.values():
            self._lane_of.setdefault(lane.edge, lane.id)
        self._pieces = [(lane, i) for lane in self.by_id.values() for i in range(len(lane.bands))]
        bands = [band for lane in self.by_id.values() for band in lane.bands]
        self._table: Floats = np.array(bands, dtype=np.float64).T.copy()
        self._widest = float(self._table[5].max())
        self._nearby = Nearby(self, reach)
        self._links: dict[str, tuple[tuple[str, str, str], ...]] = {}
        self._onward: dict[str, tuple[str, ...]] = {}
        self._routes: set[str] = set()
        self._entries = {
            inside: lane for lane in self.by_id if not lane.startswith(":") for _, inside, _ in self._links_of(lane)
        }

    def reaching(self, reach: float) -> Lanes:
        """Return the same lanes for boxes of a radius up to `reach` [m]."""
        other = copy(self)
        other._nearby = Nearby(other, reach)
        return other

    def cut(self, box: Box) -> dict[str, Cut]:
        """Return the covered part of every lane that a box cuts, by lane id."""
        return cuts(box, self._nearby.touched(box))

    def nearby(self, reach: float) -> Nearby:
        """Return a search for the lanes around one more body, whose box has a radius up to `reach` [m]."""
        return Nearby(self, reach + 2.0 * CLOSE_REFRESH_DISTANCE)

    def around(self, x: float, y: float, distance: float) -> NDArray[np.intp]:
        """Return the numbers of the pieces that may reach within `distance` [m] of a point, in the network's order."""
        return np.flatnonzero(self._distances(x, y) < distance + self._widest)

    def rows(self, pieces: NDArray[np.intp]) -> Floats:
        """Return x, y [m], cosine, sine, length and half width [m] of pieces, a row per quantity."""
        return self._table[:, pieces].copy()

    def piece(self, number: int) -> tuple[Lane, int]:
        """Return the lane of a piece, and the index of the piece in the lane."""
        return self._pieces[number]

    def nearest(self, x: float, y: float) -> tuple[Lane, float]:
        """Return the lane, outside junctions, whose centre line is nearest to a point, and its distance [m]."""
        for piece in np.argsort(self._distances(x, y), kind="stable"):
            lane = self._pieces[piece][0]
            if not lane.id.startswith(":"):
                return lane, float(self._distances(x, y)[piece])
        raise ValueError("the network has no lane outside junctions")

    def follows(self, lane: str, next_lane: str) -> bool:
        """Return whether a link leads from `lane` into `next_lane`, inside the junction or beyond it."""
        return any(next_lane in (inside, beyond) for beyond, inside, _ in self._links_of(lane))

    def exit_edge(self, lane: str) -> str:
        """Return the edge that a lane inside a junction leads to; for another lane its own edge."""
        while lane.startswith(":"):
            links = self._links_of(lane)
            if not links:
                break
            lane = links[0][0]
        return lane.rpartition("_")[0]

    def onward(self, lane: str) -> tuple[str, ...]:
        """Return the edges of a plausible route onward from a lane outside junctions, its own edge first."""
        if lane not in self._onward:
            edges, here, distance = [lane.rpartition("_")[0]], lane, 0.0
            while len(edges) < ONWARD_EDGES and distance < ONWARD_DISTANCE and (links := self._links_of(here)):
                here = min(links, key=lambda link: TURN_PREFERENCE.find(link[2]) % len(TURN_PREFERENCE))[0]
                edges.append(here.rpartition("_")[0])
                distance += self.by_id[here].length if here in self.by_id else 0.0
            self._onward[lane] = tuple(edges)
        return self._onward[lane]

    def gap(self, route: Sequence[str]) -> str:
        """Return what is wrong with a route (unknown edge, missing connection), "" for a good one."""
        unknown = [edge for edge in route if edge not in self._lane_of]
        if unknown:
            return f"route: edge of the network expected, got {unknown[0]!r}"
        joined = {
            (lane.edge, beyond.rpartition("_")[0])
            for lane in self.by_id.values()
            if lane.edge in route
            for beyond, _, _ in self._links_of(lane.id)
        }
        for pair in pairwise(route):
            if pair not in joined:
                return f"route: no connection leads from edge {pair[0]!r} to {pair[1]!r}"
        return ""

    def onward_from(self, edge: str) -> tuple[str, ...]:
        """Return the edges of a plausible route onward from an edge, itself first."""
        return self.onward(self._lane_of[edge]) if edge in self._lane_of else (edge,)

    def route(self, lane: str) -> str:
        """Return the name of a SUMO route that contains the lane and goes on from it; it is created at first use."""
        name = f"onward.{lane}"
        if name not in self._routes:
            edges = self.onward(lane) if not lane.startswith(":") else self._through(lane)
            libsumo.route.add(name, edges)
            self._routes.add(name)
        return name

    def _through(self, lane: str) -> tuple[str, ...]:
        """Return the edges of a route through a junction on the given lane inside the junction."""
        if lane not in self._entries:
            # Only lanes of this junction: reading the links of every junction from SUMO takes longer than a tick.
            junction = f"{lane.rsplit('_', 2)[0]}_"
            before = [other for other in self.by_id if other.startswith(junction) and self.follows(other, lane)]
            return self._through(before[0]) if before else (self.exit_edge(lane),)
        links = self._links_of(self._entries[lane])
        beyond = next(beyond for beyond, inside, _ in links if inside == lane)
        return (self._entries[lane].rpartition("_")[0], *self.onward(beyond))

    def _links_of(self, lane: str) -> tuple[tuple[str, str, str], ...]:
        if lane not in self._links:
            links = libsumo.lane.getLinks(lane)
            self._links[lane] = tuple((link[0], link[4], link[6]) for link in links)
        return self._links[lane]

    def _distances(self, x: float, y: float) -> Floats:
        px, py, cos, sin, length, _ = self._table
        dx, dy = x - px, y - py
        along = np.clip(dx * cos + dy * sin, 0.0, length)
        ex, ey = dx - along * cos, dy - along * sin
        distances: Floats = np.sqrt(ex * ex + ey * ey)
        return distances


class Nearby:
    """The pieces of lanes around one body, searched again only after the body moved; each body needs its own."""

    def __init__(self, lanes: Lanes, reach: float) -> None:
        self._lanes, self._reach = lanes, reach
        self._centre = (math.inf, math.inf)
        self._near: NDArray[np.intp] = np.empty(0, dtype=np.intp)
        self._table: Floats = np.empty((6, 0))
        self._box: Box | None = None
        self._close: list[tuple[Lane, int]] = []

    def touched(self, box: Box) -> list[tuple[Lane, int]]:
        """Return the pieces that a box overlaps."""
        self._look_around(box.x, box.y)
        return self._touched(box)

    def close(self, box: Box) -> list[tuple[Lane, int]]:
        """Return the pieces that a box may overlap; far cheaper than `touched` for a box that moves slowly."""
        last = self._box
        if last is not None:
            turned = abs(math.remainder(box.heading - last.heading, math.tau)) * self._reach
            if abs(box.x - last.x) + abs(box.y - last.y) + turned < CLOSE_REFRESH_DISTANCE:
                return self._close
        self._box, self._close = box, self.touched(box.grown(CLOSE_REFRESH_DISTANCE))
        return self._close

    def _look_around(self, x: float, y: float) -> None:
        if not abs(x - self._centre[0]) + abs(y - self._centre[1]) <= NEARBY_REFRESH_DISTANCE:
            self._centre = (x, y)
            self._near = self._lanes.around(x, y, NEARBY_REFRESH_DISTANCE + self._reach)
            self._table = self._lanes.rows(self._near)

    def _touched(self, box: Box) -> list[tuple[Lane, int]]:
        """Test a box against all pieces nearby at once, by separating axes; the result is in the network's order."""
        px, py, cos, sin, length, half_width = self._table
        ahead, across = 0.5 * box.length, 0.5 * box.width
        box_cos, box_sin = math.cos(box.heading), math.sin(box.heading)
        dx, dy = box.x - px, box.y - py
        half = 0.5 * length
        along, skew = np.abs(cos * box_cos + sin * box_sin), np.abs(cos * box_sin - sin * box_cos)
        mid_x, mid_y = dx - half * cos, dy - half * sin
        apart = (
            (np.abs(mid_x * cos + mid_y * sin) >= half + ahead * along + across * skew)
            | (np.abs(mid_y * cos - mid_x * sin) >= half_width + ahead * skew + across * along)
            | (np.abs(mid_x * box_cos + mid_y * box_sin) >= ahead + half * along + half_width * skew)
            | (np.abs(mid_y * box_cos - mid_x * box_sin) >= across + half * skew + half_width * along)
        )
        return [self._lanes.piece(number) for number in self._near[~apart].tolist()]


def cuts(box: Box, pieces: Iterable[tuple[Lane, int]]) -> dict[str, Cut]:
    """Return the covered part of every lane of which a box cuts one of `pieces`, by lane id."""
    corners, cos, sin = box.corners(), math.cos(box.heading), math.sin(box.heading)
    found: dict[str, Cut] = {}
    for lane, i in pieces:
        part = _part(box, corners, cos, sin, lane.bands[i])
        if part is None:
            continue
        start, end = lane.starts[i] + part[0], lane.starts[i] + part[1]
        if lane.id in found:
            start, end = min(start, found[lane.id].start), max(end, found[lane.id].end)
        found[lane.id] = Cut(lane, start, end)
    return found


def _part(box: Box, corners: Corners, cos: float, sin: float, band: RoadStrip) -> tuple[float, float] | None:
    """Return what `covered` returns; faster where the box lies wholly on the band or clear of it along its axes."""
    dx, dy = box.x - band.x, box.y - band.y
    middle, across = dx * band.cos + dy * band.sin, abs(dy * band.cos - dx * band.sin)
    along, skew = abs(cos * band.cos + sin * band.sin), abs(sin * band.cos - cos * band.sin)
    reach = 0.5 * (box.length * along + box.width * skew)
    breadth = 0.5 * (box.length * skew + box.width * along)
    start, end = middle - reach, middle + reach
    if end <= 0.0 or start >= band.length or across - breadth >= band.half_width:
        return None
    if start >= 0.0 and end <= band.length and across + breadth <= band.half_width:
        return start, end
    return covered(corners, band)
