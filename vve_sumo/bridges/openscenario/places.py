"""Positions of OpenSCENARIO as places on the roads of a map, and trajectories as lines of points.

Knows roads and catalogs; it must not know actions or what moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from vve_sumo.bridges.openscenario.document import Document
from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.openscenario.road_map import Pose2, Road, RoadMap, RoadPlace, advanced
from vve_sumo.bridges.openscenario.routes import Route, RoutePlace, Waypoint, route_over
from vve_sumo.bridges.scenario_import.lines import Points
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element

#: between two points of a trajectory [m]
SPACING: Final = 0.5


class Spot(NamedTuple):
    """A place of a scenario."""

    pose: Pose2
    on: RoadPlace | None  #: in road coordinates, None off every road
    lane: int | None  #: that the place was stated in


class Line(NamedTuple):
    """A trajectory."""

    points: Points
    times: tuple[float, ...] | None  #: of its vertices [s], None where it has none
    vertex_s: tuple[float, ...]  #: of the vertices along the points [m]
    anchored: bool  #: whether it says where it begins


class Places:
    """Finds the places of one scenario; entities are placed one after the other."""

    def __init__(self, document: Document, roads: RoadMap) -> None:
        self._document, self.roads = document, roads
        self.entities: dict[str, Spot] = {}  #: where each entity is at the start
        self.moving: set[str] = set()  #: of them, those of which nobody knows where they are later on

    def spot(self, position: Element, scope: Scope) -> Spot:
        """Return the place of a <Position>; raises NotTakenError for a kind that is not known and for no place."""
        if not position.children:
            raise NotTakenError(position, "expected a position in it")
        of = position.children[0]
        reader = {
            "WorldPosition": self._world,
            "LanePosition": self._lane,
            "RoadPosition": self._road,
            "RelativeWorldPosition": self._relative_world,
            "RelativeObjectPosition": self._relative_object,
            "RelativeRoadPosition": self._relative_road,
            "RelativeLanePosition": self._relative_lane,
            "TrajectoryPosition": self._trajectory,
            "RoutePosition": self._on_route,
        }.get(of.tag)
        if reader is None:
            raise NotTakenError(of, "this kind of position is not taken")
        return reader(of, scope)

    def _world(self, of: Element, scope: Scope) -> Spot:
        x, y, heading = scope.number(of, "x"), scope.number(of, "y"), scope.number(of, "h", 0.0)
        return self.at(Pose2(x, y, heading))

    def at(self, pose: Pose2) -> Spot:
        """Return the place of a pose."""
        on = self.roads.locate(pose.x, pose.y)
        lane = None if on is None else self.roads.roads[on.road].lane_at(on.s, on.t)
        return Spot(pose, on, lane)

    def _known(self, of: Element, road: str, s: float) -> Road:
        if road not in self.roads.roads:
            raise NotTakenError(of, f"no road {road!r} in {self.roads.file.name}")
        found = self.roads.roads[road]
        if not -1e-6 <= s <= found.length + 1e-6:
            raise NotTakenError(of, f"s {s:.2f} lies off road {road}, which is {found.length:.2f} m long")
        return found

    def _lane(self, of: Element, scope: Scope) -> Spot:
        road, s = scope.text(of, "roadId"), scope.number(of, "s")
        lane, offset = scope.whole(of, "laneId"), scope.number(of, "offset", 0.0)
        return self.in_lane(of, self._known(of, road, s), lane, s, offset, scope)

    def in_lane(self, of: Element, road: Road, lane: int, s: float, offset: float, scope: Scope) -> Spot:
        """Return a place beside a lane's middle, which faces as the lane's traffic drives."""
        t = road.middle(lane, s)
        if t is None:
            raise NotTakenError(of, f"no lane {lane} on road {road.name} at s {s:.2f}")
        pose = road.at(s, t + offset)
        base = pose.heading + (math.pi if road.traffic(lane) < 0 else 0.0)
        return Spot(pose._replace(heading=_heading(of, base, scope)), RoadPlace(road.name, s, t + offset), lane)

    def _road(self, of: Element, scope: Scope) -> Spot:
        name, s, t = scope.text(of, "roadId"), scope.number(of, "s"), scope.number(of, "t")
        return self._on_road(of, self._known(of, name, s), s, t, scope)

    def _on_road(self, of: Element, road: Road, s: float, t: float, scope: Scope) -> Spot:
        pose = road.at(s, t)
        place = RoadPlace(road.name, s, t)
        return Spot(pose._replace(heading=_heading(of, pose.heading, scope)), place, road.lane_at(s, t))

    def _reference(self, of: Element, scope: Scope) -> Spot:
        name = scope.text(of, "entityRef")
        if name not in self.entities:
            raise NotTakenError(of, f"the entity {name!r} has no place of its own yet")
        if name in self.moving:
            raise NotTakenError(of, f"a place that counts from where {name!r} is by then is not taken")
        return self.entities[name]

    def _relative_world(self, of: Element, scope: Scope) -> Spot:
        pose = self._reference(of, scope).pose
        moved = Pose2(pose.x + scope.number(of, "dx"), pose.y + scope.number(of, "dy"), pose.heading)
        return self.at(moved._replace(heading=_heading(of, pose.heading, scope)))

    def _relative_object(self, of: Element, scope: Scope) -> Spot:
        pose, dx, dy = self._reference(of, scope).pose, scope.number(of, "dx"), scope.number(of, "dy", 0.0)
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        moved = Pose2(pose.x + dx * cos - dy * sin, pose.y + dx * sin + dy * cos, pose.heading)
        return self.at(moved._replace(heading=_heading(of, pose.heading, scope)))

    def _relative_road(self, of: Element, scope: Scope) -> Spot:
        on = self._reference(of, scope).on
        if on is None:
            raise NotTakenError(of, "the other entity is on no road")
        s, t = on.s + scope.number(of, "ds"), on.t + scope.number(of, "dt")
        return self._on_road(of, self._known(of, on.road, s), s, t, scope)

    def _relative_lane(self, of: Element, scope: Scope) -> Spot:
        there = self._reference(of, scope)
        if there.on is None or there.lane is None:
            raise NotTakenError(of, "the other entity is in no lane")
        along = "ds" if "ds" in of.attributes else "dsLane"
        # Both count along the road's reference line; so do the lanes, without the centre.
        s = there.on.s + scope.number(of, along)
        lane = neighbour(there.lane, scope.whole(of, "dLane"))
        road = self._known(of, there.on.road, s)
        spot = self.in_lane(of, road, lane, s, scope.number(of, "offset", 0.0), scope)
        if of.child("Orientation") is None and (lane > 0) == (there.lane > 0):
            ours, theirs = road.at(s, 0.0).heading, road.at(there.on.s, 0.0).heading
            spot = spot._replace(pose=spot.pose._replace(heading=there.pose.heading - theirs + ours))
        return spot

    def _trajectory(self, of: Element, scope: Scope) -> Spot:
        reference = of.child("TrajectoryRef")
        line = self.trajectory(reference or of, scope)
        s, t = scope.number(of, "s"), scope.number(of, "t", 0.0)
        pose = _along(line.points, s)
        moved = Pose2(pose.x - t * math.sin(pose.heading), pose.y + t * math.cos(pose.heading), pose.heading)
        return self.at(moved._replace(heading=_heading(of, pose.heading, scope)))

    def _on_route(self, of: Element, scope: Scope) -> Spot:
        """Return a place that counts along a route, which faces as the route goes."""
        reference, inner = of.child("RouteRef"), of.child("InRoutePosition")
        if reference is None or inner is None or not inner.children:
            raise NotTakenError(of, "expected a RouteRef and an InRoutePosition")
        stated = inner.children[0]
        if stated.tag not in ("FromLaneCoordinates", "FromRoadCoordinates"):
            raise NotTakenError(stated, "this kind of place on a route is not taken")
        route, path_s = self.route(reference, scope), scope.number(stated, "pathS")
        place = route.at(path_s, self.roads)
        if place is None:
            raise NotTakenError(stated, f"pathS {path_s:.2f} lies off the route")
        road = self.roads.roads[place.way.road]
        if stated.tag == "FromRoadCoordinates":
            t = place.way.sense * scope.number(stated, "t")
            lane = road.lane_at(place.s, t)
        else:
            lane, t = self._lane_of_route(stated, road, place, scope)
        pose = road.at(place.s, t)
        base = pose.heading + (math.pi if place.way.sense < 0 else 0.0)
        return Spot(pose._replace(heading=_heading(of, base, scope)), RoadPlace(road.name, place.s, t), lane)

    def _lane_of_route(self, of: Element, road: Road, place: RoutePlace, scope: Scope) -> tuple[int, float]:
        """Return a road's lane and t of a place in lane coordinates of a route.

        On a road that a route goes along against its reference line, some files state the road's own lane, others
        one that counts along the route, as its t does. The lane whose traffic drives along the route is meant in both.
        """
        lane, offset = scope.whole(of, "laneId"), scope.number(of, "laneOffset", 0.0)
        if lane != 0 and place.way.sense < 0 and road.traffic(lane) > 0:
            lane, offset = -lane, -offset
        middle = road.middle(lane, place.s)
        if middle is None:
            raise NotTakenError(of, f"no lane {lane} on road {road.name} at s {place.s:.2f}")
        return lane, middle + offset

    def route(self, holder: Element, scope: Scope) -> Route:
        """Return the route that an element holds or refers to in a catalog."""
        element, inner = self._document.resolved(holder, scope, "Route")
        if inner.flag(element, "closed", False):
            raise NotTakenError(element, "a closed route is not taken")
        waypoints = []
        for one in element.all("Waypoint"):
            if (strategy := inner.text(one, "routeStrategy", "shortest")) != "shortest":
                raise NotTakenError(one, f"routeStrategy: expected shortest, got {strategy!r}")
            spot = self.spot(_position(one), inner)
            if spot.on is None:
                raise NotTakenError(one, "a waypoint off all roads is not taken")
            along = math.cos(spot.pose.heading - self.roads.roads[spot.on.road].at(spot.on.s, 0.0).heading)
            waypoints.append(Waypoint(spot.on, 1 if along >= 0.0 else -1))
        try:
            return route_over(self.roads, waypoints)
        except ValueError as error:
            raise NotTakenError(element, str(error)) from None

    def trajectory(self, holder: Element, scope: Scope) -> Line:
        """Return the trajectory that an element holds or refers to in a catalog."""
        element, inner = self._document.resolved(holder, scope, "Trajectory")
        if inner.flag(element, "closed", False):
            raise NotTakenError(element, "a closed trajectory is not taken")
        shape = element.child("Shape")
        of = None if shape is None or not shape.children else shape.children[0]
        if of is None:
            raise NotTakenError(element, "expected a <Shape>")
        if of.tag == "Polyline":
            return self._polyline(of, inner)
        if of.tag == "Clothoid":
            return self._clothoid(of, inner)
        if of.tag == "ClothoidSpline":
            return self._spline(of, inner)
        if of.tag == "Nurbs":
            return self._nurbs(of, inner)
        raise NotTakenError(of, "this shape of a trajectory is not taken")

    def _polyline(self, of: Element, scope: Scope) -> Line:
        vertices = of.all("Vertex")
        spots = [self.spot(_position(one), scope).pose for one in vertices]
        if len(spots) < 2:
            raise NotTakenError(of, "expected two vertices or more")
        timed = all("time" in one.attributes for one in vertices)
        times = tuple(scope.number(one, "time") for one in vertices) if timed else None
        points: Points = [(spots[0].x, spots[0].y)]
        vertex_s = [0.0]
        for start, end in pairwise(spots):
            way = math.dist(start[:2], end[:2])
            count = max(1, math.ceil(way / SPACING)) if way > 0.0 else 0
            points += [
                (start.x + (end.x - start.x) * n / count, start.y + (end.y - start.y) * n / count)
                for n in range(1, count + 1)
            ]
            vertex_s.append(vertex_s[-1] + way)
        return Line(points, times, tuple(vertex_s), True)

    def _clothoid(self, of: Element, scope: Scope) -> Line:
        start = self.spot(_position(of), scope).pose
        rate = "curvaturePrime" if "curvaturePrime" in of.attributes else "curvatureDot"
        parts = [(scope.number(of, "curvature"), scope.number(of, rate), scope.number(of, "length"))]
        if "stopTime" in of.attributes:
            raise NotTakenError(of, "startTime and stopTime are not taken")
        return _clothoids(start, parts, True)

    def _spline(self, of: Element, scope: Scope) -> Line:
        if "timeEnd" in of.attributes:
            raise NotTakenError(of, "timeEnd is not taken")
        start, parts, anchored = Pose2(0.0, 0.0, 0.0), [], False
        for number, one in enumerate(of.all("ClothoidSplineSegment")):
            placed = one.child("PositionStart")
            if "timeStart" in one.attributes or (placed is not None and number):
                raise NotTakenError(one, "timeStart, and PositionStart of a later segment, are not taken")
            if placed is not None:
                start, anchored = self.spot(placed, scope).pose, True
                if one.attributes.get("hOffset"):
                    start = start._replace(heading=start.heading + scope.number(one, "hOffset"))
            length = scope.number(one, "length")
            first, last = scope.number(one, "curvatureStart"), scope.number(one, "curvatureEnd")
            if length > 0.0:
                parts.append((first, (last - first) / length, length))
        return _clothoids(start, parts, anchored)

    def _nurbs(self, of: Element, scope: Scope) -> Line:
        order = scope.whole(of, "order")
        controls = of.all("ControlPoint")
        knots = [scope.number(one, "value") for one in of.all("Knot")]
        places = [self.spot(_position(one), scope).pose for one in controls]
        weights = [scope.number(one, "weight", 1.0) for one in controls]
        if any("time" in one.attributes for one in controls):
            raise NotTakenError(of, "times of control points are not taken")
        if not 2 <= order <= len(places) or len(knots) != len(places) + order:
            raise NotTakenError(of, f"expected {len(places) + order} knots for {len(places)} points of order {order}")
        rough = sum(math.dist(one[:2], other[:2]) for one, other in pairwise(places))
        count = max(8, math.ceil(rough / SPACING))
        low, high = knots[order - 1], knots[len(places)]
        points = [_of_nurbs(order, knots, places, weights, low + (high - low) * n / count) for n in range(count + 1)]
        return Line(points, None, (0.0, _length(points)), True)


def _of_nurbs(
    order: int, knots: Sequence[float], places: Sequence[Pose2], weights: Sequence[float], u: float
) -> tuple[float, float]:
    """Return a point of a rational B-spline by de Boor's algorithm."""
    degree = order - 1
    last = max(n for n in range(degree, len(places)) if knots[n] <= u)
    found = [(places[n].x * weights[n], places[n].y * weights[n], weights[n]) for n in range(last - degree, last + 1)]
    for level in range(1, degree + 1):
        for j in range(degree, level - 1, -1):
            left, right = knots[j + last - degree], knots[j + 1 + last - level]
            part = (u - left) / (right - left) if right > left else 0.0
            one, other = found[j - 1], found[j]
            found[j] = tuple((1.0 - part) * a + part * b for a, b in zip(one, other, strict=True))  # type: ignore[assignment]
    x, y, weight = found[degree]
    return x / weight, y / weight


def _clothoids(start: Pose2, parts: Sequence[tuple[float, float, float]], anchored: bool) -> Line:
    """Return the line of clothoids after each other: curvature [1/m], its change [1/m2] and length [m] of each."""
    points: Points = [(start.x, start.y)]
    for curvature, rate, length in parts:
        count = max(1, math.ceil(length / SPACING))
        poses = [advanced(start, curvature, rate, length * n / count) for n in range(1, count + 1)]
        points += [(pose.x, pose.y) for pose in poses]
        start = poses[-1]
    return Line(points, None, (0.0, _length(points)), anchored)


def neighbour(lane: int, by: int) -> int:
    """Return the lane so many lanes to the left of another, without a lane 0."""
    found = lane + by
    if (lane < 0 <= found) or (lane > 0 >= found):
        found += 1 if by > 0 else -1
    return found


def _position(holder: Element) -> Element:
    found = holder.child("Position")
    if found is None:
        raise NotTakenError(holder, "expected a <Position>")
    return found


def _heading(of: Element, base: float, scope: Scope) -> float:
    """Return the heading [rad] that an <Orientation> states, by itself or relative to the road's."""
    orientation = of.child("Orientation")
    if orientation is None:
        return base
    stated = scope.number(orientation, "h", 0.0)
    return stated if scope.text(orientation, "type", "absolute") == "absolute" else base + stated


def _length(points: Points) -> float:
    return sum(math.dist(one, other) for one, other in pairwise(points))


def _along(points: Points, way: float) -> Pose2:
    """Return the place so far along a line of points; beyond its end straight on."""
    for start, end in pairwise(points):
        part = math.dist(start, end)
        if way <= part or end is points[-1]:
            heading = math.atan2(end[1] - start[1], end[0] - start[0])
            return Pose2(start[0] + way * math.cos(heading), start[1] + way * math.sin(heading), heading)
        way -= part
    return Pose2(*points[0], 0.0)
