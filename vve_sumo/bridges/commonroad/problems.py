"""The planning problem of a CommonRoad file: where the ego begins, and the goals as triggers that end the drive."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final, NamedTuple

from vve_sumo.bridges.commonroad.lanelets import Lanelet, holds
from vve_sumo.bridges.commonroad.numbers import exact, interval, needed, number, point, points
from vve_sumo.bridges.commonroad.obstacles import State, state_of
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element
from vve_sumo.path import ReferencePath

#: steps along the path in which a goal's region is looked for [m]
STEP: Final = 0.1

Holds = Callable[[float, float], bool]


class Problem(NamedTuple):
    """What the ego has to do."""

    initial: State
    speed: float  #: at the start [m/s]
    goals: list[Element]
    element: Element


def read_problem(root: Element, step: float, wanted: str | None) -> Problem:
    """Return the planning problem with a number, the first without; raises NotTakenError where there is none."""
    found = [one for one in root.all("planningProblem") if wanted is None or one.attributes.get("id") == wanted]
    if not found:
        which = "a <planningProblem>" if wanted is None else f"a <planningProblem> with the id {wanted}"
        raise NotTakenError(root, f"expected {which}")
    initial = needed(found[0], "initialState")
    return Problem(state_of(initial, step), exact(initial, "velocity"), found[0].all("goalState"), found[0])


def goal_lanelets(goal: Element, lanelets: Mapping[str, Lanelet]) -> set[str]:
    """Return the numbers of the lanelets that a goal's region is on: those named, and those under a shape's middle."""
    position = goal.child("position")
    if position is None:
        return set()
    found = {one.attributes.get("ref", "") for one in position.all("lanelet")}
    for one in position.children:
        if (middle := _middle(one)) is not None:
            found |= {lanelet.name for lanelet in lanelets.values() if holds(lanelet, *middle)}
    return found


def _middle(shape: Element) -> tuple[float, float] | None:
    if (centre := shape.child("center")) is not None:
        return point(centre)
    corners = points(shape)
    if not corners:
        return None
    return sum(x for x, _ in corners) / len(corners), sum(y for _, y in corners) / len(corners)


def ends(
    goal: Element, step: float, path: ReferencePath, begin: float, ahead: float, lanelets: Mapping[str, Lanelet]
) -> list[dict[str, Any]]:
    """Return the conditions that all hold where the ego has reached a goal.

    `begin` [m] is where the rear axle begins on its path, `ahead` [m] from there forward to the centre of the car.
    Raises NotTakenError for a goal that a trigger cannot say.
    """
    found: list[dict[str, Any]] = []
    for one in goal.children:
        if one.tag == "time":
            found += _between("time_s", [value * step for value in interval(one)])
        elif one.tag == "velocity":
            found += _between("speed_mps", interval(one))
        elif one.tag == "position":
            low, high = _goal_stretch(one, path, begin, ahead, lanelets)
            found += _between("travelled_m", (low - begin, high - begin))
        elif one.tag != "orientation":
            raise NotTakenError(one, "this part of a goal is not taken")
    return found


def _between(quantity: str, limits: Collection[float]) -> list[dict[str, Any]]:
    low, high = limits
    return [{quantity: round(low, 4), "rule": ">="}, {quantity: round(high, 4), "rule": "<="}]


def _goal_stretch(
    position: Element, path: ReferencePath, begin: float, ahead: float, lanelets: Mapping[str, Lanelet]
) -> tuple[float, float]:
    """Return where the rear axle is on the path [m] while the car's centre is in a region: the first such stretch."""
    region = _region(position, lanelets)
    inside: list[float] = []
    count = math.floor((path.length - begin) / STEP)
    for n in range(count + 1):
        at = path.at(begin + n * STEP)
        if region(at.x + ahead * math.cos(at.heading), at.y + ahead * math.sin(at.heading)):
            inside.append(begin + n * STEP)
        elif inside:
            break
    if not inside:
        raise NotTakenError(position, "the ego's path does not come there; it keeps to its lane")
    return inside[0], inside[-1]


def _region(position: Element, lanelets: Mapping[str, Lanelet]) -> Holds:
    parts = [_part(one, lanelets) for one in position.children]
    return lambda x, y: any(part(x, y) for part in parts)


def _part(one: Element, lanelets: Mapping[str, Lanelet]) -> Holds:
    if one.tag == "lanelet":
        lanelet = lanelets.get(one.attributes.get("ref", ""))
        if lanelet is None:
            raise NotTakenError(one, "no such lanelet")
        return lambda x, y: holds(lanelet, x, y)
    if one.tag == "rectangle":
        x0, y0 = point(needed(one, "center")) if one.child("center") is not None else (0.0, 0.0)
        turned = number(one, "orientation") if one.child("orientation") is not None else 0.0
        length, width = number(one, "length"), number(one, "width")
        cos, sin = math.cos(turned), math.sin(turned)

        def in_rectangle(x: float, y: float) -> bool:
            along, across = cos * (x - x0) + sin * (y - y0), cos * (y - y0) - sin * (x - x0)
            return abs(along) <= 0.5 * length and abs(across) <= 0.5 * width

        return in_rectangle
    if one.tag == "circle":
        middle, radius = point(needed(one, "center")), number(one, "radius")
        return lambda x, y: math.dist((x, y), middle) <= radius
    if one.tag == "polygon":
        corners = points(one)
        return lambda x, y: _in_polygon(x, y, corners)
    raise NotTakenError(one, "expected lanelets, a rectangle, a circle or a polygon")


def _in_polygon(x: float, y: float, corners: list[tuple[float, float]]) -> bool:
    """Return whether a place is in a polygon: the number of sides right of it is odd."""
    inside = False
    for (x1, y1), (x2, y2) in zip(corners, corners[1:] + corners[:1], strict=True):
        if (y1 > y) != (y2 > y) and x < x1 + (y - y1) / (y2 - y1) * (x2 - x1):
            inside = not inside
    return inside
