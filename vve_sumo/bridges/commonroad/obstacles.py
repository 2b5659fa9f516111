"""Obstacles of a CommonRoad file as actors: one that moves follows its recorded states, one that stands stays.

A position is the centre of a box, as CommonRoad has it. Knows nothing of lanelets and problems.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Final, NamedTuple

from vve_sumo.bridges.commonroad.numbers import exact, needed, number, point
from vve_sumo.bridges.scenario_import.lines import LineFiles, Points, extended, reference, straight
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element

#: kinds of bodies by CommonRoad's types
KINDS: Final = {
    "car": "car",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
    "priorityVehicle": "car",
    "parkedVehicle": "car",
    "taxi": "car",
}
#: those that are drawn as cars because a scenario here has no such body
AS_CARS: Final = frozenset(
    {"unknown", "constructionZone", "pillar", "building", "train", "roadBoundary", "medianStrip"}
)
#: line of a body that stands [m]
STANDING: Final = 30.0
#: a body is nowhere farther from its recorded states than this [m]
TOLERANCE: Final = 0.2
#: between the way a vehicle faces and the way it goes, at most [rad]: it cannot drive sideways or backwards here
MAX_SLIP: Final = math.radians(60.0)
#: pieces shorter than this have no direction [m]
MIN_PIECE: Final = 0.3
#: kinds that may go any way they like, whichever way they face
ON_FOOT: Final = frozenset({"pedestrian", "child"})

Note = Callable[[str], None]


class State(NamedTuple):
    """A recorded state."""

    time: float  #: [s]
    x: float  #: centre of the box [m]
    y: float  #: [m]
    heading: float  #: [rad]
    element: Element


def state_of(element: Element, step: float) -> State:
    """Return a state whose values are exact; `step` is the file's [s]."""
    position = needed(element, "position")
    if position.child("point") is None:
        raise NotTakenError(position, "expected a <point>: a region in place of a position is not taken")
    return State(
        exact(element, "time") * step, *point(needed(position, "point")), exact(element, "orientation"), element
    )


def is_dynamic(obstacle: Element) -> bool:
    """Whether an obstacle moves, by the element of format 2020a or the role of 2018b."""
    role = obstacle.child("role")
    return obstacle.tag == "dynamicObstacle" or (role is not None and role.text.strip() == "dynamic")


def actor_of(obstacle: Element, step: float, files: LineFiles, note: Note) -> dict[str, Any]:
    """Return an obstacle as the table of an actor with a story; raises NotTakenError for what that cannot be."""
    kind = _kind(obstacle, note)
    length, width = _size(obstacle, note)
    name = f"obstacle_{obstacle.attributes.get('id', '')}"
    initial = state_of(needed(obstacle, "initialState"), step)
    table: dict[str, Any] = {"id": name, "kind": kind, "length_m": length, "width_m": width}
    if not is_dynamic(obstacle):
        return table | _standing(name, initial, files)
    if obstacle.child("occupancySet") is not None:
        raise NotTakenError(
            needed(obstacle, "occupancySet"), "a set of occupancies in place of a trajectory is not taken"
        )
    holder = obstacle.child("trajectory")
    states = [initial, *(state_of(one, step) for one in ([] if holder is None else holder.all("state")))]
    if initial.time != 0.0:
        raise NotTakenError(initial.element, "an obstacle that comes after the start is not taken")
    if any(later.time <= one.time for one, later in pairwise(states)):
        raise NotTakenError(obstacle, "expected states in the order of their times")
    return table | _moving(name, kind, states, files, obstacle)


def _kind(obstacle: Element, note: Note) -> str:
    element = needed(obstacle, "type")
    said = element.text.strip()
    if said in AS_CARS:
        note(f"{element.where}: {said}: the body is a car of that size")
        return "car"
    if said not in KINDS:
        raise NotTakenError(element, f"expected one of {', '.join(KINDS)}, got {said[:40]!r}")
    return KINDS[said]


def _size(obstacle: Element, note: Note) -> tuple[float, float]:
    shape = needed(obstacle, "shape")
    (one, *more) = shape.children or [shape]
    if more or one.tag not in ("rectangle", "circle"):
        raise NotTakenError(one, "expected one rectangle or circle")
    turned = number(one, "orientation") if one.child("orientation") is not None else 0.0
    centre = point(needed(one, "center")) if one.child("center") is not None else (0.0, 0.0)
    if (turned, *centre) != (0.0, 0.0, 0.0):
        raise NotTakenError(one, "a shape that is not about the obstacle's position is not taken")
    if one.tag == "circle":
        note(f"{one.where}: the body is a square that holds the circle")
        return 2.0 * number(one, "radius"), 2.0 * number(one, "radius")
    return number(one, "length"), number(one, "width")


def _standing(name: str, state: State, files: LineFiles) -> dict[str, Any]:
    line = straight(state.x, state.y, state.heading, STANDING)
    return {"path": files.named(name, line), "at_m": 0.0, "story": {"reference_m": 0.0, "actions": []}}


def _moving(name: str, kind: str, states: list[State], files: LineFiles, obstacle: Element) -> dict[str, Any]:
    """Return the line and the story of a body that is at each state's place at its time, and leaves after the last."""
    end = states[-1].time
    leaves = {"name": "end", "when": [[{"time_s": end, "rule": ">"}]], "leaves": True}
    points: Points = [(one.x, one.y) for one in states]
    line = extended(points)
    if len(line) < 2 or max(math.dist(points[0], one) for one in points) < TOLERANCE:
        table = _standing(name, states[0], files)
        return table | {"story": {"reference_m": 0.0, "actions": [leaves]}} if end > 0.0 else table
    if kind not in ON_FOOT:
        _refuse_sideways(states)
    path = reference(line, obstacle)
    timing, s = [], 0.0
    for one in states:
        s = max(s, path.project(one.x, one.y, s).s)
        there = path.at(s)
        if math.dist((there.x, there.y), (one.x, one.y)) > TOLERANCE:
            raise NotTakenError(one.element, f"no body can follow it: it would be more than {TOLERANCE:g} m off")
        timing.append({"time_s": round(one.time, 6), "at_m": round(s, 4)})
    file = files.named(name, line)
    follow = {"path": file, "at_m": timing[0]["at_m"], "until_m": timing[-1]["at_m"], "timing": timing}
    speed = (timing[1]["at_m"] - timing[0]["at_m"]) / (timing[1]["time_s"] - timing[0]["time_s"])
    return {
        "path": file,
        "at_m": timing[0]["at_m"],
        "speed_mps": round(speed, 4),
        "story": {"reference_m": 0.0, "actions": [{"name": "follow", "line": follow}, leaves]},
    }


def _refuse_sideways(states: list[State]) -> None:
    begin = states[0]
    for one in states[1:]:
        if math.dist((begin.x, begin.y), (one.x, one.y)) < MIN_PIECE:
            continue
        way = math.atan2(one.y - begin.y, one.x - begin.x)
        if abs(math.remainder(way - begin.heading, math.tau)) > MAX_SLIP:
            raise NotTakenError(begin.element, "a vehicle that goes backwards or sideways is not taken")
        begin = one
