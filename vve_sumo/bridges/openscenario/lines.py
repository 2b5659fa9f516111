"""The lines that entities of a scenario move along: which lane, which way, and the files of points that say so.

Knows roads and places; it must not know triggers or speeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vve_sumo.bridges.openscenario.places import Line, Spot
from vve_sumo.bridges.openscenario.road_map import RoadMap, Way
from vve_sumo.bridges.openscenario.routes import Route
from vve_sumo.bridges.scenario_import.lines import LineFiles, Points, extended, reference, straight
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element

#: an entity that faces farther from its lane than this goes straight on instead [rad]
ALONG_LANE: Final = math.radians(40.0)
#: line of an entity that faces across the road [m]: it has to stay near the lanes
ACROSS: Final = 30.0
#: line along lanes at most [m]
LONGEST: Final = 4000.0


@dataclass(frozen=True, slots=True)
class Track:
    """Where an entity moves at a stage of the story."""

    path: str  #: name of the file of its line
    points: Points
    path_s: float  #: where it is along the line at the start [m]
    path_d: float  #: left of it [m]
    road: str | None  #: of the lane, None off lanes
    lane: int | None
    s: float  #: on that road [m]
    sense: int  #: 1 along the road's reference line, -1 against it


def track_of(
    roads: RoadMap, files: LineFiles, name: str, spot: Spot, element: Element, route: Route | None = None
) -> Track:
    """Return where an entity moves that is only placed: along its lane, or straight on where it faces across.

    With a route it moves along that, whatever way it faces. Raises NotTakenError where its place is not on the route.
    """
    pose, on = spot.pose, spot.on
    if route is not None:
        way = None if on is None else route.way(on.road)
        if on is None or way is None:
            raise NotTakenError(element, "an entity that is not on its route at first is not taken")
        lane = spot.lane if spot.lane is not None else 0
        return lane_track(roads, files, name, on.road, lane, on.s, on.t, way.sense, element, route)
    if on is not None:
        road = roads.roads[on.road]
        turned = math.remainder(pose.heading - road.at(on.s, 0.0).heading, math.tau)
        sense = 1 if abs(turned) <= 0.5 * math.pi else -1
        if abs(math.remainder(turned - (0.0 if sense > 0 else math.pi), math.tau)) <= ALONG_LANE:
            lane = spot.lane if spot.lane is not None else 0
            return lane_track(roads, files, name, on.road, lane, on.s, on.t, sense, element)
    points = straight(pose.x, pose.y, pose.heading, ACROSS)
    return Track(files.named(f"{name}_straight", points), points, 0.0, 0.0, None, None, 0.0, 1)


def lane_track(
    roads: RoadMap,
    files: LineFiles,
    name: str,
    road_name: str,
    lane: int,
    s: float,
    t: float,
    sense: int,
    element: Element,
    route: Route | None = None,
) -> Track:
    """Return the track along a lane from where the road begins, with the place of road coordinates s, t on it."""
    road = roads.roads[road_name]
    begin = 0.0 if sense > 0 else road.length
    if road.middle(lane, begin) is None or road.section(begin) is not road.section(s):
        begin = road.section(s).start if sense > 0 else s
    if road.middle(lane, s) is None:
        raise NotTakenError(element, f"no lane {lane} on road {road_name} at s {s:.2f}")
    turns: dict[Way, Way] = {} if route is None else route.turns
    try:
        points = roads.lane_line(road_name, lane, begin, sense, LONGEST, turns)
    except ValueError as error:
        raise NotTakenError(element, str(error)) from None
    if len(points) < 2:
        raise NotTakenError(element, f"lane {lane} of road {road_name} leads nowhere from s {s:.2f} on")
    path = reference(points, element)
    here = road.at(s, t)
    foot = path.project(here.x, here.y, abs(s - begin))
    path_s = _rounded(foot.s)
    return Track(
        files.named(f"{name}_lane_{'' if lane >= 0 else 'm'}{abs(lane)}", points),
        points,
        max(path_s, 0.0),
        _rounded(foot.d),
        road_name,
        lane,
        s,
        sense,
    )


def trajectory_track(files: LineFiles, name: str, line: Line, path_s: float) -> Track:
    """Return the track along a trajectory, which goes straight on at its end."""
    points = extended(line.points)
    return Track(files.named(f"{name}_trajectory", points), points, path_s, 0.0, None, None, 0.0, 1)


def _rounded(value: float) -> float:
    """Return a length to a tenth of a millimetre: what is written reads as it was stated."""
    return round(value, 4) + 0.0
