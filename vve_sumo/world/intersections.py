"""Reads the intersections with signals from a SUMO network file, as a stream, without a simulation."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Final

from vve_sumo.intersections import Intersection, IntersectionLane, IntersectionLink, LaneUse
from vve_sumo.world.network import LANE_WIDTH, elements, shape_of

#: lanes that only one kind of road user may use, by what the network allows on them
_USES: Final[dict[str | None, LaneUse]] = {"pedestrian": "pedestrian", "bicycle": "bicycle"}


def intersections(path: Path) -> tuple[Intersection, ...]:
    """Return the intersections that have a signal, by rising id of the signal.

    Ways of pedestrians across the road are left out: they begin on no lane. Raises ConfigError when the file is missing
    or not a network.
    """
    lanes: dict[str, IntersectionLane] = {}
    links: dict[str, list[IntersectionLink]] = {}
    for element in elements(path, "edge", "connection"):  # a network lists its connections after all edges
        if element.tag == "edge":
            if element.get("function") is None:
                lanes |= {lane.attrib["id"]: _lane(lane, element.attrib["id"]) for lane in element.iter("lane")}
        elif (signal := element.get("tl")) is not None:
            link = _link(element)
            if link.incoming in lanes and link.outgoing in lanes:
                links.setdefault(signal, []).append(link)
    return tuple(_intersection(signal, links[signal], lanes) for signal in sorted(links))


def _lane(lane: ET.Element, edge: str) -> IntersectionLane:
    points = tuple((float(x), float(y)) for x, y in shape_of(lane.attrib["shape"]))
    use = _USES.get(lane.get("allow"), "vehicle")
    return IntersectionLane(lane.attrib["id"], edge, use, points, float(lane.get("width", LANE_WIDTH)))


def _link(connection: ET.Element) -> IntersectionLink:
    incoming = f"{connection.get('from')}_{connection.get('fromLane')}"
    outgoing = f"{connection.get('to')}_{connection.get('toLane')}"
    return IntersectionLink(int(connection.attrib["linkIndex"]), incoming, outgoing, connection.get("dir", "s"))


def _intersection(signal: str, links: list[IntersectionLink], lanes: dict[str, IntersectionLane]) -> Intersection:
    ordered = tuple(sorted(links, key=lambda link: link.index))
    incoming = dict.fromkeys(link.incoming for link in ordered)
    outgoing = dict.fromkeys(link.outgoing for link in ordered)
    return Intersection(
        signal, tuple(lanes[name] for name in incoming), tuple(lanes[name] for name in outgoing), ordered
    )
