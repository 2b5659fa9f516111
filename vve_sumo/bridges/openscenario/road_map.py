"""Geometry of an OpenDRIVE file: where a place in road coordinates lies, and the middle of a lane from road to road.

ASAM OpenDRIVE 1.4 to 1.8, flat: heights and banks play no part. Knows nothing of scenarios.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from vve_sumo.bridges.scenario_import.xml_tree import Element, read_xml
from vve_sumo.errors import ConfigError

#: pieces in which a spiral or a parametric curve is integrated [m]
FINE: Final = 0.5
#: between two points of a lane's middle [m]
SPACING: Final = 1.0
#: a place that is looked for is compared with the roads at such distances first [m]
COARSE: Final = 2.0


class Pose2(NamedTuple):
    """A place with a heading."""

    x: float  #: [m]
    y: float  #: [m]
    heading: float  #: [rad], counter-clockwise from +x


class RoadPlace(NamedTuple):
    """A place in a road's coordinates."""

    road: str
    s: float  #: along the reference line [m]
    t: float  #: left of it [m]


class Way(NamedTuple):
    """A road, and in which sense one goes along it."""

    road: str
    sense: int  #: 1 along the reference line, -1 against it


class Entry(NamedTuple):
    """A lane where one comes onto a road."""

    way: Way
    lane: int
    s: float  #: [m]


@dataclass(frozen=True, slots=True)
class _Cubic:
    start: float
    a: float
    b: float
    c: float
    d: float

    def at(self, s: float) -> float:
        ds = s - self.start
        return self.a + ds * (self.b + ds * (self.c + ds * self.d))


@dataclass(frozen=True, slots=True)
class _Piece:
    """One geometry of a reference line."""

    start: float
    length: float
    pose: Pose2
    curvature: tuple[float, float]  #: at its start and its end [1/m]
    polynomial: tuple[tuple[float, ...], tuple[float, ...], float] | None = None  #: u and v, and p for a metre

    def at(self, s: float) -> Pose2:
        ds = min(max(s - self.start, 0.0), self.length)
        if self.polynomial is not None:
            return self._of_polynomial(ds)
        first, last = self.curvature
        rate = (last - first) / self.length if self.length > 0.0 else 0.0
        return advanced(self.pose, first, rate, ds)

    def _of_polynomial(self, ds: float) -> Pose2:
        (us, vs, scale) = self.polynomial or ((), (), 1.0)
        p = ds * scale
        u, v = (sum(c * p**n for n, c in enumerate(cs)) for cs in (us, vs))
        du, dv = (sum(n * c * p ** (n - 1) for n, c in enumerate(cs) if n) for cs in (us, vs))
        cos, sin = math.cos(self.pose.heading), math.sin(self.pose.heading)
        return Pose2(
            self.pose.x + u * cos - v * sin, self.pose.y + u * sin + v * cos, self.pose.heading + math.atan2(dv, du)
        )


def advanced(pose: Pose2, curvature: float, rate: float, way: float) -> Pose2:
    """Return the pose a way [m] farther along a clothoid whose curvature [1/m] changes by `rate` [1/m2]."""
    if curvature == 0.0 and rate == 0.0:
        return Pose2(pose.x + way * math.cos(pose.heading), pose.y + way * math.sin(pose.heading), pose.heading)
    if rate == 0.0:
        turned = pose.heading + curvature * way
        x = pose.x + (math.sin(turned) - math.sin(pose.heading)) / curvature
        return Pose2(x, pose.y - (math.cos(turned) - math.cos(pose.heading)) / curvature, turned)
    # Gauss with two points in each piece: an error of a hundredth of a millimetre where the radius is 5 m.
    count = max(1, math.ceil(way / FINE))
    step, x, y = way / count, pose.x, pose.y
    for n in range(count):
        for part in (0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0)):
            w = (n + part) * step
            heading = pose.heading + w * (curvature + 0.5 * rate * w)
            x, y = x + 0.5 * step * math.cos(heading), y + 0.5 * step * math.sin(heading)
    return Pose2(x, y, pose.heading + way * (curvature + 0.5 * rate * way))


@dataclass(slots=True)
class _Lane:
    kind: str
    widths: list[_Cubic]
    predecessor: int | None
    successor: int | None


@dataclass(slots=True)
class _Section:
    start: float
    lanes: dict[int, _Lane]


@dataclass(slots=True)
class Road:
    """One road."""

    name: str
    length: float
    junction: str
    pieces: list[_Piece]
    offsets: list[_Cubic]
    sections: list[_Section]
    left_hand: bool = False  #: whether traffic keeps to the left
    links: dict[str, tuple[str, str, str]] = field(default_factory=dict)  #: by end: kind, id, contact point

    def traffic(self, lane: int) -> int:
        """Return in which sense a lane's traffic drives: 1 along the reference line, -1 against it."""
        return -1 if (lane > 0) != self.left_hand else 1

    def at(self, s: float, t: float) -> Pose2:
        """Return the place of road coordinates, with the reference line's heading there."""
        starts = [piece.start for piece in self.pieces]
        pose = self.pieces[max(bisect_right(starts, s) - 1, 0)].at(s)
        return Pose2(pose.x - t * math.sin(pose.heading), pose.y + t * math.cos(pose.heading), pose.heading)

    def section(self, s: float) -> _Section:
        """Return the lane section at a place."""
        starts = [section.start for section in self.sections]
        return self.sections[max(bisect_right(starts, s) - 1, 0)]

    def middle(self, lane: int, s: float) -> float | None:
        """Return t of a lane's middle [m], None where the road has no such lane there; lane 0 is the centre."""
        section, side = self.section(s), 1 if lane > 0 else -1
        offset = _value(self.offsets, s)
        if lane == 0:
            return offset
        t = 0.0
        for one in range(side, lane + side, side):
            if one not in section.lanes:
                return None
            width = _value(section.lanes[one].widths, s - section.start)
            t += width if one != lane else 0.5 * width
        return offset + side * t

    def lane_at(self, s: float, t: float) -> int | None:
        """Return the lane that a place lies in."""
        section, offset = self.section(s), _value(self.offsets, s)
        side = 1 if t > offset else -1
        edge, lane = 0.0, side
        while lane in section.lanes:
            edge += _value(section.lanes[lane].widths, s - section.start)
            if abs(t - offset) <= edge:
                return lane
            lane += side
        return None


class RoadMap:
    """All roads of a file."""

    def __init__(self, file: Path) -> None:
        """Read a file; raises ConfigError for what is no OpenDRIVE."""
        self.file, root = file, read_xml(file, "OpenDRIVE")
        if root.tag != "OpenDRIVE":
            raise ConfigError(f"{root.where}: expected the root <OpenDRIVE>")
        self.georeferenced = root.child("header", "geoReference") is not None
        offset = root.child("header", "offset")
        shift = {} if offset is None else offset.attributes
        self.shift = 0.0, 0.0
        try:
            if self.georeferenced:
                self.shift = _number(shift.get("x", "0")), _number(shift.get("y", "0"))
            self.roads = {one.attributes["id"]: _road(one) for one in root.all("road")}
            self._connections = {one.attributes["id"]: list(_connections(one)) for one in root.all("junction")}
        except (KeyError, ValueError, ArithmeticError, StopIteration) as error:
            raise ConfigError(f"{file}: expected OpenDRIVE, a road cannot be read: {error}") from None

    def locate(self, x: float, y: float) -> RoadPlace | None:
        """Return the road coordinates of a place on the nearest road, None where there is no road."""
        best: tuple[float, RoadPlace] | None = None
        for road in self.roads.values():
            count = max(1, math.ceil(road.length / COARSE))
            samples_s = [road.length * n / count for n in range(count + 1)]
            near = min(samples_s, key=lambda s, road=road: _distance(road, s, x, y))  # type: ignore[misc]
            low, high = max(near - COARSE, 0.0), min(near + COARSE, road.length)
            for _ in range(60):
                third = (high - low) / 3.0
                nearer = _distance(road, low + third, x, y) < _distance(road, high - third, x, y)
                low, high = (low, high - third) if nearer else (low + third, high)
            s = 0.5 * (low + high)
            pose = road.at(s, 0.0)
            t = (y - pose.y) * math.cos(pose.heading) - (x - pose.x) * math.sin(pose.heading)
            # A road whose lanes hold the place comes before one that passes near it.
            apart = _distance(road, s, x, y) + (0.0 if road.lane_at(s, t) is not None else 1000.0)
            if best is None or apart < best[0] - 1e-6:
                best = apart, RoadPlace(road.name, s, t)
        return None if best is None else best[1]

    def lane_line(
        self, road: str, lane: int, s: float, sense: int, length: float, route: Mapping[Way, Way]
    ) -> list[tuple[float, float]]:
        """Return points about every SPACING of a lane's middle from a place on, over the roads that follow.

        `sense` is 1 along the reference line and -1 against it. Where several roads follow, the line goes as the
        `route` says, and straight on where that says nothing. It ends after a `length` [m] or where no lane follows.
        Raises ValueError where the lane does not lead on to where the route goes.
        """
        points: list[tuple[float, float]] = []
        gone, seen = 0.0, set[tuple[str, int]]()
        here: Entry | None = Entry(Way(road, sense), lane, s)
        while here is not None and gone < length and (here.way.road, here.lane) not in seen:
            seen.add((here.way.road, here.lane))
            part, lane = _along(self.roads[here.way.road], here.lane, here.s, here.way.sense, length - gone)
            for one in part:
                if not points or math.dist(one, points[-1]) > 0.2:
                    points.append(one)
            gone += len(part) * SPACING
            here = self._next(here.way, lane, route.get(here.way))
        return points

    def _next(self, way: Way, lane: int, wanted: Way | None) -> Entry | None:
        """Return what follows after a road's end: the `wanted` way, or the straightest of several."""
        entries = self.onward(way, lane)
        if wanted is not None:
            entries = [entry for entry in entries if entry.way == wanted]
            if not entries:
                raise ValueError(f"lane {lane} of road {way.road} does not lead to road {wanted.road}")
        return min(entries, key=self._turn, default=None)

    def onward(self, way: Way, lane: int | None = None) -> list[Entry]:
        """Return what follows after a road's end, from one lane or from any."""
        road = self.roads[way.road]
        link = road.links.get("successor" if way.sense > 0 else "predecessor")
        if link is None:
            return []
        kind, target, contact = link
        section = road.sections[-1] if way.sense > 0 else road.sections[0]
        found = []
        for number in section.lanes if lane is None else [lane]:
            if kind == "road":
                own = section.lanes.get(number)
                onward = None if own is None else own.successor if way.sense > 0 else own.predecessor
                found.append(self._entered(target, contact, onward))
                continue
            found += [
                self._entered(connecting, contact, lanes[number])
                for incoming, connecting, contact, lanes in self._connections.get(target, [])
                if incoming == way.road and number in lanes
            ]
        return [entry for entry in found if entry is not None]

    def _entered(self, target: str, contact: str, lane: int | None) -> Entry | None:
        road = self.roads.get(target)
        if road is None or lane is None:
            return None
        sense = -1 if contact == "end" else 1
        return Entry(Way(target, sense), lane, 0.0 if sense > 0 else road.length)

    def _turn(self, entry: Entry) -> float:
        road = self.roads[entry.way.road]
        return abs(math.remainder(road.at(road.length, 0.0).heading - road.at(0.0, 0.0).heading, math.tau))


def _distance(road: Road, s: float, x: float, y: float) -> float:
    pose = road.at(s, 0.0)
    return math.hypot(pose.x - x, pose.y - y)


def _along(road: Road, lane: int, s: float, sense: int, length: float) -> tuple[list[tuple[float, float]], int]:
    """Return a lane's middle on one road, and the lane's number at the end of it."""
    points: list[tuple[float, float]] = []
    step = SPACING * sense
    end = road.length if sense > 0 else 0.0
    section = road.section(s)
    while True:
        t = road.middle(lane, s)
        if t is None:
            return points, lane
        points.append(road.at(s, t)[:2])
        if s == end or len(points) * SPACING >= length:
            return points, lane
        s = min(s + step, end) if sense > 0 else max(s + step, end)
        onward = road.section(s)
        if onward is not section:
            own = section.lanes.get(lane)
            next_lane = None if own is None else own.successor if sense > 0 else own.predecessor
            if next_lane is None:
                return points, lane
            section, lane = onward, next_lane


def _value(cubics: list[_Cubic], s: float) -> float:
    if not cubics:
        return 0.0
    return cubics[max(bisect_right([one.start for one in cubics], s) - 1, 0)].at(s)


def _number(text: str) -> float:
    """Return a number; raises ValueError for what is none, infinity and NaN included."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"expected a number, got {text[:80]!r}")
    return value


def _cubics(elements: list[Element], start: str) -> list[_Cubic]:
    found = [
        _Cubic(_number(one.attributes[start]), *(_number(one.attributes.get(key, "0")) for key in "abcd"))
        for one in elements
    ]
    return sorted(found, key=lambda one: one.start)


def _road(element: Element) -> Road:
    view, lanes = element.child("planView"), element.child("lanes")
    if view is None or lanes is None or not view.all("geometry") or not lanes.all("laneSection"):
        raise ValueError(f"line {element.line}: no planView or lanes")
    road = Road(
        name=element.attributes["id"],
        length=_number(element.attributes["length"]),
        junction=element.attributes.get("junction", "-1"),
        pieces=[_piece(one) for one in view.all("geometry")],
        offsets=_cubics(lanes.all("laneOffset"), "s"),
        sections=[_section(one) for one in lanes.all("laneSection")],
        left_hand=element.attributes.get("rule") == "LHT",
    )
    link = element.child("link")
    for one in [] if link is None else link.children:
        kind, contact = one.attributes.get("elementType", "road"), one.attributes.get("contactPoint", "start")
        road.links[one.tag] = kind, one.attributes.get("elementId", ""), contact
    return road


def _section(element: Element) -> _Section:
    lanes = {}
    for side in ("left", "right"):
        for one in [] if (found := element.child(side)) is None else found.all("lane"):
            links = {tag: one.child("link", tag) for tag in ("predecessor", "successor")}
            numbers = {tag: None if link is None else int(link.attributes["id"]) for tag, link in links.items()}
            if not one.all("width"):
                raise ValueError(f"line {one.line}: a lane without a width; borders are not taken")
            lanes[int(one.attributes["id"])] = _Lane(
                one.attributes.get("type", "none"),
                _cubics(one.all("width"), "sOffset"),
                numbers["predecessor"],
                numbers["successor"],
            )
    return _Section(_number(element.attributes["s"]), lanes)


def _piece(element: Element) -> _Piece:
    numbers = {key: _number(element.attributes[key]) for key in ("s", "x", "y", "hdg", "length")}
    shape = next(iter(element.children))
    pose, length = Pose2(numbers["x"], numbers["y"], numbers["hdg"]), numbers["length"]
    of = shape.attributes
    curvature = 0.0, 0.0
    polynomial: tuple[tuple[float, ...], tuple[float, ...], float] | None = None
    if shape.tag == "arc":
        curvature = _number(of["curvature"]), _number(of["curvature"])
    elif shape.tag == "spiral":
        curvature = _number(of["curvStart"]), _number(of["curvEnd"])
    elif shape.tag == "poly3":
        polynomial = (0.0, 1.0), tuple(_number(of[key]) for key in "abcd"), 1.0
    elif shape.tag == "paramPoly3":
        us, vs = (tuple(_number(of[f"{key}{axis}"]) for key in "abcd") for axis in "UV")
        polynomial = us, vs, 1.0 if of.get("pRange") == "arcLength" else 1.0 / length
    elif shape.tag != "line":
        raise ValueError(f"line {shape.line}: <{shape.tag}>")
    return _Piece(numbers["s"], length, pose, curvature, polynomial)


def _connections(junction: Element) -> Iterator[tuple[str, str, str, dict[int, int]]]:
    """Yield incoming road, connecting road, its contact point and the lanes that lead over."""
    for one in junction.all("connection"):
        lanes = {int(link.attributes["from"]): int(link.attributes["to"]) for link in one.all("laneLink")}
        of = one.attributes
        yield of.get("incomingRoad", ""), of.get("connectingRoad", ""), of.get("contactPoint", "start"), lanes
