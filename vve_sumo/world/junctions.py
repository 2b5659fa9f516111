"""Reads who gives way to whom at the junctions of a SUMO network file, as a stream, without a simulation."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

from vve_sumo.junctions import Control, Junction, JunctionWay
from vve_sumo.world.network import LANE_WIDTH, Box, elements, shape_of

#: so far before a junction the way to it is followed, and so far beyond it [m]
BEFORE, BEYOND = 200.0, 40.0
#: what SUMO's state of a link says of a way to which others are prior
_CONTROLS: Final = {"s": Control.STOP, "w": Control.ALL_WAY_STOP, "=": Control.EQUAL}
GREEN: Final = "gG"

Points = list[tuple[float, float]]


class _Lane(NamedTuple):
    points: tuple[tuple[float, float], ...]
    width: float
    speed: float
    on_foot: bool


class _Link(NamedTuple):
    """A connection of the file."""

    incoming: str  #: lane
    outgoing: str  #: lane
    via: str  #: first lane inside the junction; empty for none
    direction: str
    state: str
    signal: str
    letter: int  #: of the signal's state


@dataclass(slots=True)
class _File:
    """What of the file is needed."""

    lanes: dict[str, _Lane] = field(default_factory=dict)
    inside: set[str] = field(default_factory=set)  #: the lanes inside junctions
    links: dict[str, list[_Link]] = field(default_factory=dict)  #: by the lane before them, in the order of the file
    into: dict[str, list[_Link]] = field(default_factory=dict)  #: by the lane after them, those from outside junctions
    phases: dict[str, list[str]] = field(default_factory=dict)  #: of the signals
    junctions: list[tuple[str, list[str], list[str]]] = field(default_factory=list)  #: id, lanes into it, responses


def junctions(path: Path, box: Box) -> tuple[Junction, ...]:
    """Return the junctions with their middle in `box` at which a vehicle has to give way, in the order of the file.

    Ways of pedestrians are left out. At a signal a way has to give way to those that may be shown green at the same
    time and go first then. Raises ConfigError when the file is missing or not a network.
    """
    file = _read(path, box)
    found = (_junction(file, name, lanes, responses) for name, lanes, responses in file.junctions)
    return tuple(one for one in found if any(way.prior for way in one.ways))


def _read(path: Path, box: Box) -> _File:
    file = _File()
    for element in elements(path, "edge", "tlLogic", "junction", "connection"):
        if element.tag == "edge":
            _take_edge(file, element)
        elif element.tag == "tlLogic":
            states = [phase.attrib["state"] for phase in element.iter("phase")]
            file.phases.setdefault(element.attrib["id"], []).extend(states)
        elif element.tag == "junction":
            x, y = float(element.attrib["x"]), float(element.attrib["y"])
            responses = [one.attrib["response"] for one in element.iter("request")]
            if responses and box[0] <= x <= box[2] and box[1] <= y <= box[3]:
                file.junctions.append((element.attrib["id"], element.get("incLanes", "").split(), responses))
        else:
            _take_link(file, element)
    return file


def _take_edge(file: _File, edge: ET.Element) -> None:
    function = edge.get("function", "normal")
    if function in ("crossing", "walkingarea"):
        return
    for lane in edge.iter("lane"):
        points = tuple((float(x), float(y)) for x, y in shape_of(lane.attrib["shape"]))
        width, speed = float(lane.get("width", LANE_WIDTH)), float(lane.attrib["speed"])
        file.lanes[lane.attrib["id"]] = _Lane(points, width, speed, lane.get("allow") == "pedestrian")
        if function == "internal":
            file.inside.add(lane.attrib["id"])


def _take_link(file: _File, element: ET.Element) -> None:
    incoming = f"{element.get('from')}_{element.get('fromLane')}"
    outgoing = f"{element.get('to')}_{element.get('toLane')}"
    if incoming not in file.lanes or outgoing not in file.lanes:
        return
    letter = int(element.get("linkIndex", "-1"))
    state, signal = element.get("state", "M"), element.get("tl", "")
    link = _Link(incoming, outgoing, element.get("via", ""), element.get("dir", "s"), state, signal, letter)
    file.links.setdefault(incoming, []).append(link)
    if incoming not in file.inside:
        file.into.setdefault(outgoing, []).append(link)


def _junction(file: _File, name: str, incoming: Sequence[str], responses: Sequence[str]) -> Junction:
    # The rows of a junction's matrix are its links by their lanes, and by their order in the file.
    links = [link for lane in incoming for link in file.links.get(lane, ())]
    rows = [row for row, link in enumerate(links) if row < len(responses) and _is_for_vehicles(file, link)]
    place = {row: number for number, row in enumerate(rows)}
    ways = []
    for row in rows:
        response = responses[row]
        prior = tuple(
            place[other]
            for other in rows
            if other < len(response) and response[-1 - other] == "1" and _may_meet(file, links[row], links[other])
        )
        ways.append(_way(file, links[row], prior))
    return Junction(name, tuple(ways))


def _is_for_vehicles(file: _File, link: _Link) -> bool:
    return not (file.lanes[link.incoming].on_foot or file.lanes[link.outgoing].on_foot)


def _may_meet(file: _File, own: _Link, other: _Link) -> bool:
    """Tell whether one who has to give way to another link may be shown green while the other is."""
    if not own.signal:
        return True
    states = file.phases.get(own.signal, ()) if own.signal == other.signal else ()
    letters = [
        (state[own.letter], state[other.letter]) for state in states if max(own.letter, other.letter) < len(state)
    ]
    return any(mine == "g" and theirs in GREEN for mine, theirs in letters)


def _way(file: _File, link: _Link, prior: tuple[int, ...]) -> JunctionWay:
    before, speed_limit, ends = _before(file, link.incoming)
    inside = _inside(file, link)
    across = [point for lane in inside for point in lane.points]
    speed_across = min([speed_limit, *(lane.speed for lane in inside)])
    beyond = _cut(file.lanes[link.outgoing].points, BEYOND)
    line = _length(before)
    exit_ = line + _length([before[-1], *across, beyond[0]])
    control = Control.NONE
    if prior:
        control = Control.SIGNAL if link.signal else _CONTROLS.get(link.state, Control.YIELD)
    points = tuple(before + across + beyond)
    width = file.lanes[link.incoming].width
    speeds = speed_limit, speed_across
    return JunctionWay(link.incoming, link.outgoing, control, points, line, exit_, width, *speeds, ends, prior)


def _inside(file: _File, link: _Link) -> list[_Lane]:
    """Return the lanes of a link inside its junction, one after the other."""
    found, inside = [], link.via
    while inside:
        found.append(file.lanes[inside])
        inside = next((one.via for one in file.links.get(inside, ())), "")
    return found


def _before(file: _File, lane: str) -> tuple[Points, float, bool]:
    """Return the last BEFORE metres to the end of a lane, the greatest limit on them [m/s], and whether it dead-ends.

    Through the junctions before, the way goes back straight on; where nobody comes straight on, it begins there.
    """
    points, seen = list(file.lanes[lane].points), {lane}
    limit = file.lanes[lane].speed
    while _length(points) < BEFORE:
        links = file.into.get(lane, [])
        link = next((one for one in links if one.direction == "s" and one.incoming not in seen), None)
        if link is None:
            return points, limit, not links
        across = [point for inside in _inside(file, link) for point in inside.points]
        lane = link.incoming
        seen.add(lane)
        limit = max(limit, file.lanes[lane].speed)
        points = [*file.lanes[lane].points, *across, *points]
    return _cut(points[::-1], BEFORE)[::-1], limit, False


def _length(points: Sequence[tuple[float, float]]) -> float:
    return sum(math.hypot(x - x0, y - y0) for (x0, y0), (x, y) in pairwise(points))


def _cut(points: Sequence[tuple[float, float]], length: float) -> Points:
    """Return the first metres of a line."""
    kept, left = [points[0]], length
    for (x0, y0), (x, y) in pairwise(points):
        piece = math.hypot(x - x0, y - y0)
        if piece >= left:
            share = left / piece
            return [*kept, (x0 + share * (x - x0), y0 + share * (y - y0))]
        kept.append((x, y))
        left -= piece
    return kept
