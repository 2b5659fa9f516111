"""CommonRoad's scenario file (format 2020a, https://commonroad.in.tum.de) of a drive.

Lanelets are the lanes of the record's table `roads`. The actors are obstacles. The ego's task, to come from where it
began to where it ended, is the planning problem; a second file has the ego as it drove among the obstacles, too.

The file is written here and not with commonroad-io, CommonRoad's own package: that needs protobuf of exactly one
version, which OSI's and other packages refuse. The tests read the files with commonroad-io.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import count
from typing import Final

import numpy as np

from vve_sumo.analysis.bodies import RecordedBody, bodies, obstacles
from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.export.lanes import ON_FOOT, RecordedLane, lanes_of
from vve_sumo.export.part import ExportPart
from vve_sumo.values import Floats
from vve_sumo.version import __version__

#: of CommonRoad's trajectories [s]
TIME_STEP: Final = 0.1
#: fewest states of an obstacle: the initial one and a trajectory
MIN_STATES: Final = 2
CREDIT: Final = (
    " The lanelets are the lanes of the SUMO network named in source. Where that network was made from OpenStreetMap, "
    "as the shipped ones of streets were, they contain data © OpenStreetMap contributors, Open Database Licence 1.0 "
)
#: what CommonRoad states of a place on Earth that is not known
UNKNOWN_PLACE: Final = {"geoNameId": "-999", "gpsLatitude": "999", "gpsLongitude": "999"}
#: CommonRoad's name of a kind of body, where it is another
OBSTACLE_TYPES: Final = {"van": "car", "child": "pedestrian"}
#: CommonRoad's name of a kind of lane; the record does not tell streets of a town from others
LANELET_TYPES: Final = {"junction": "intersection", "crossing": "crosswalk", "walkway": "sidewalk"}
#: greatest factor by which a bound lies farther out at a corner of its centre line
MAX_MITRE: Final = 2.0


def of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield the scenario without the ego among its obstacles, for planners, and with it (`with_ego`).

    Raises ConfigError for a record without roads.
    """
    lanes = lanes_of(run)
    if not lanes:
        raise ConfigError(
            f"{run.folder}: the record holds no roads, which CommonRoad needs; an earlier vve-sumo wrote it: drive the "
            "scenario again"
        )
    ego, *others = bodies(run)
    time = np.arange(ego.time[0], ego.time[-1] + 1e-9, TIME_STEP)
    if len(time) < MIN_STATES:
        raise ConfigError(f"{run.folder}: a drive of less than {TIME_STEP:g} s has no trajectory in CommonRoad")
    yield ExportPart("", _document(run, lanes, others, ego, time, 1))
    yield ExportPart("with_ego", _document(run, lanes, [ego, *others], ego, time, 2))


def _document(
    run: Run,
    lanes: Sequence[RecordedLane],
    others: Sequence[RecordedBody],
    ego: RecordedBody,
    time: Floats,
    number: int,
) -> bytes:
    """Return the content of a file; `number` tells the scenarios of one drive apart in their names."""
    root = _root(run, number)
    numbers = {lane.name: at for at, lane in enumerate(lanes, 1)}
    before: dict[str, list[str]] = defaultdict(list)
    for lane in lanes:
        for name in lane.successors:
            before[name].append(lane.name)
    for lane in lanes:
        _add_lanelet(root, lane, before[lane.name], numbers)
    free = count(len(lanes) + 1)
    standing = obstacles(run)
    for body in others:
        if body.name in standing:
            _add_static(root, body, next(free))
    moving = (stretch for body in others if body.name not in standing for stretch in body.stretches())
    for sampled in (stretch.sampled(time) for stretch in moving):
        if len(sampled.at) >= MIN_STATES:
            _add_dynamic(root, sampled, next(free))
    _add_problem(root, ego.sampled(time), next(free))
    ET.indent(root)
    content: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"


def _root(run: Run, number: int) -> ET.Element:
    road = run.resolved["settings"].get("road") or {}
    began = "" if run.provenance is None else run.provenance.began_utc
    root = ET.Element(
        "commonRoad",
        {
            "commonRoadVersion": "2020a",
            "benchmarkID": f"ZAM_{_camel(run.name)}-1_{number}_T-1",
            "date": began[:10] if re.match(r"\d{4}-\d\d-\d\d", began) else "1980-01-06",
            "author": "vve_sumo",
            "affiliation": "",
            "source": f"vve_sumo {__version__}, scenario {run.name}, SUMO network {road.get('network', 'unknown')}",
            "timeStepSize": f"{TIME_STEP:g}",
        },
    )
    root.append(ET.Comment(CREDIT))
    place = ET.SubElement(root, "location")
    for name, value in UNKNOWN_PLACE.items():
        ET.SubElement(place, name).text = value
    ET.SubElement(ET.SubElement(root, "scenarioTags"), "simulated")
    return root


def _camel(name: str) -> str:
    """Return a name of letters and digits alone, as CommonRoad's names of scenarios have them."""
    words = re.findall(r"[A-Za-z0-9]+", name)
    return "".join(word[0].upper() + word[1:] for word in words) or "Drive"


def bounds(line: Floats, width: float) -> tuple[Floats, Floats]:
    """Return the left and the right bound of a lane, a point for each of its centre line (n, 2) [m]."""
    along = np.diff(line, axis=0)
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(along[:, 0], along[:, 1])[:, None]
    before, after = np.vstack([normals[:1], normals]), np.vstack([normals, normals[-1:]])
    between = before + after
    size = np.hypot(between[:, 0], between[:, 1])[:, None]
    # The cosine of half the angle between two pieces is half the length of the sum of their normals.
    reach = np.minimum(1.0 / np.maximum(0.5 * size, 1e-9), MAX_MITRE)
    out = 0.5 * width * reach * np.where(size > 1e-9, between / np.maximum(size, 1e-9), before)
    return line + out, line - out


def _add_lanelet(root: ET.Element, lane: RecordedLane, before: Sequence[str], numbers: dict[str, int]) -> None:
    root.append(ET.Comment(f" lane {_commented(lane.name)} "))
    lanelet = ET.SubElement(root, "lanelet", id=str(numbers[lane.name]))
    for name, bound in zip(("leftBound", "rightBound"), bounds(lane.line, lane.width), strict=True):
        element = ET.SubElement(lanelet, name)
        for x, y in bound.tolist():
            _add_point(element, x, y)
    for name, refs in (("predecessor", before), ("successor", lane.successors)):
        for ref in refs:
            if ref in numbers:
                ET.SubElement(lanelet, name, ref=str(numbers[ref]))
    for name, step in (("adjacentLeft", 1), ("adjacentRight", -1)):
        beside = numbers.get(_beside(lane, step))
        if beside is not None:
            ET.SubElement(lanelet, name, ref=str(beside), drivingDir="same")
    ET.SubElement(lanelet, "laneletType").text = LANELET_TYPES.get(lane.kind, "unknown")
    on_foot = lane.kind in ON_FOOT
    user = ET.SubElement(lanelet, "userBidirectional" if on_foot else "userOneWay")
    user.text = "pedestrian" if on_foot else "vehicle"


def _beside(lane: RecordedLane, step: int) -> str:
    """Return the name of the next lane of the same street; SUMO counts an edge's lanes from the right."""
    edge, _, index = lane.name.rpartition("_")
    return f"{edge}_{int(index) + step}" if lane.kind == "lane" and index.isdecimal() else ""


def _add_static(root: ET.Element, body: RecordedBody, number: int) -> None:
    obstacle = _add_obstacle(root, "staticObstacle", "parkedVehicle", body, number)
    _add_state(obstacle, "initialState", body, 0, 0)


def _add_dynamic(root: ET.Element, body: RecordedBody, number: int) -> None:
    """Add an obstacle that moves; the body is sampled at the time steps."""
    obstacle = _add_obstacle(root, "dynamicObstacle", OBSTACLE_TYPES.get(body.kind, body.kind), body, number)
    first, *rest = body.at.tolist()
    _add_state(obstacle, "initialState", body, 0, first)
    trajectory = ET.SubElement(obstacle, "trajectory")
    for row, step in enumerate(rest, 1):
        _add_state(trajectory, "state", body, row, step)


def _add_obstacle(root: ET.Element, name: str, kind: str, body: RecordedBody, number: int) -> ET.Element:
    root.append(ET.Comment(f" {_commented(body.name)} "))
    obstacle = ET.SubElement(root, name, id=str(number))
    ET.SubElement(obstacle, "type").text = kind
    _add_rectangle(ET.SubElement(obstacle, "shape"), body)
    return obstacle


def _add_problem(root: ET.Element, ego: RecordedBody, number: int) -> None:
    """Add the planning problem: from the ego's first state to the rectangle that it covered at its last."""
    problem = ET.SubElement(root, "planningProblem", id=str(number))
    state = _add_state(problem, "initialState", ego, 0, 0)
    turn = float(np.unwrap(ego.heading[:2]) @ (-1.0, 1.0))
    _add_exact(state, "yawRate", turn / TIME_STEP)
    _add_exact(state, "slipAngle", 0.0)
    _add_exact(state, "acceleration", float(ego.speed[1] - ego.speed[0]) / TIME_STEP)
    goal = ET.SubElement(problem, "goalState")
    _add_interval(goal, "time", "0", str(len(ego.at) - 1))
    rectangle = _add_rectangle(ET.SubElement(goal, "position"), ego)
    ET.SubElement(rectangle, "orientation").text = f"{ego.heading[-1]:.6f}"
    _add_point(rectangle, float(ego.x[-1]), float(ego.y[-1]), "center")


def _add_state(parent: ET.Element, name: str, body: RecordedBody, row: int, step: int) -> ET.Element:
    state = ET.SubElement(parent, name)
    _add_point(ET.SubElement(state, "position"), float(body.x[row]), float(body.y[row]))
    _add_exact(state, "orientation", float(body.heading[row]))
    ET.SubElement(ET.SubElement(state, "time"), "exact").text = str(step)
    _add_exact(state, "velocity", float(body.speed[row]))
    return state


def _add_rectangle(parent: ET.Element, body: RecordedBody) -> ET.Element:
    rectangle = ET.SubElement(parent, "rectangle")
    ET.SubElement(rectangle, "length").text = f"{body.length:.3f}"
    ET.SubElement(rectangle, "width").text = f"{body.width:.3f}"
    return rectangle


def _add_point(parent: ET.Element, x: float, y: float, name: str = "point") -> None:
    point = ET.SubElement(parent, name)
    ET.SubElement(point, "x").text = f"{x:.4f}"
    ET.SubElement(point, "y").text = f"{y:.4f}"


def _add_exact(state: ET.Element, name: str, value: float) -> None:
    ET.SubElement(ET.SubElement(state, name), "exact").text = f"{value:.6f}"


def _add_interval(state: ET.Element, name: str, begin: str, end: str) -> None:
    interval = ET.SubElement(state, name)
    ET.SubElement(interval, "intervalStart").text = begin
    ET.SubElement(interval, "intervalEnd").text = end


def _commented(name: str) -> str:
    """Return a name as an XML comment may hold it: without two hyphens in a row."""
    return re.sub(r"-(?=-)|-$", "- ", name)
