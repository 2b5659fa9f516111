"""Reads from a SUMO network file what a picture of the street needs beyond lanes: junctions, stop lines, signals.

Reads the file as a stream, without a simulation. Knows nothing of how the street is drawn, nor of the signals' states.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from vve_sumo.world.network import LANE_WIDTH, Box, Floats, elements, meets, shape_of

#: of the links of one lane, whose state its signal head shows: straight on first
DIRECTIONS: Final = "slLrRt"
#: states of a link at which drivers stop at a line: SUMO's stop sign and all-way stop
STOPS: Final = frozenset({"s", "w"})
#: signal heads stand behind the junction, so far beyond the end of the way across it [m]
BEHIND: Final = 1.5
#: from the edge of the outermost lane to a signal's mast [m]
ASIDE: Final = 1.0


@dataclass(frozen=True, slots=True)
class StopLine:
    """Where vehicles of a lane stop."""

    x: float  #: middle, at the end of the lane, map [m]
    y: float  #: as x [m]
    heading: float  #: of the lane [rad], counter-clockwise from the map's +x
    width: float  #: of the lane [m]


@dataclass(frozen=True, slots=True)
class SignalHead:
    """A signal's head over the far side of a junction. The place is ours: a network says none."""

    id: str  #: of the signal, SUMO's
    link: int  #: index of the link in the signal's state whose lamps the head shows
    x: float  #: of the head, over the continuation of the lane, map [m]
    y: float  #: as x [m]
    heading: float  #: of the traffic that the head is for [rad], counter-clockwise from the map's +x
    reach: float  #: from the head to the mast on its right [m]


@dataclass(frozen=True, slots=True)
class StreetGeometry:
    """What a network file says about junctions near a box."""

    junctions: tuple[tuple[tuple[float, float], ...], ...]  #: their outlines, map [m]
    stop_lines: tuple[StopLine, ...]
    signals: tuple[SignalHead, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the geometry for JSON: `junctions` [{points}], `stop_lines`, `signals`."""
        return {
            "junctions": [{"points": [list(point) for point in outline]} for outline in self.junctions],
            "stop_lines": [asdict(line) for line in self.stop_lines],
            "signals": [asdict(head) for head in self.signals],
        }


@dataclass(frozen=True, slots=True)
class _Lane:
    shape: Floats
    width: float
    aside: float  #: width of the lanes to the right of it [m]


@dataclass(frozen=True, slots=True)
class _Link:
    lane: str
    via: str
    direction: str
    signal: str
    index: int


def street_geometry(path: Path, box: Box) -> StreetGeometry:
    """Return the junctions, stop lines and signal heads near a box of the map [m], in file order.

    Raises ConfigError when the file is missing or not a network.
    """
    lanes: dict[str, _Lane] = {}
    outlines: list[tuple[tuple[float, float], ...]] = []
    stopping: dict[str, list[_Link]] = {}
    for element in elements(path, "edge", "junction", "connection"):
        if element.tag == "edge":
            lanes |= {name: lane for name, lane in _lanes(element) if meets(lane.shape, lane.width, box)}
        elif element.tag == "junction":
            outlines += _outlines(element, box)
        elif (link := _link(element)) is not None and link.lane in lanes:
            stopping.setdefault(link.lane, []).append(link)
    return StreetGeometry(
        tuple(outlines),
        tuple(_stop_line(lanes[name]) for name in stopping),
        tuple(_heads(lanes, stopping)),
    )


def _lanes(edge: ET.Element) -> Iterator[tuple[str, _Lane]]:
    aside = 0.0
    for lane in edge.iter("lane"):  # from the right to the left
        width = float(lane.get("width", LANE_WIDTH))
        yield lane.attrib["id"], _Lane(shape_of(lane.attrib["shape"]), width, aside)
        aside += width


def _outlines(junction: ET.Element, box: Box) -> Iterable[tuple[tuple[float, float], ...]]:
    text = junction.get("shape", "")
    if junction.get("type") == "internal" or len(text.split()) < 3:
        return
    shape = shape_of(text)
    if meets(shape, 0.0, box):
        yield tuple((float(x), float(y)) for x, y in shape)


def _link(connection: ET.Element) -> _Link | None:
    """Return the link of a connection at which drivers may have to stop at a line; None for any other."""
    signal = connection.get("tl", "")
    if not signal and connection.get("state") not in STOPS:
        return None
    lane = f"{connection.get('from')}_{connection.get('fromLane')}"
    index = int(connection.get("linkIndex", "-1"))
    return _Link(lane, connection.get("via", ""), connection.get("dir", "s"), signal, index)


def _end(lane: _Lane) -> tuple[float, float, float]:
    (x0, y0), (x, y) = lane.shape[-2], lane.shape[-1]
    return float(x), float(y), math.atan2(y - y0, x - x0)


def _stop_line(lane: _Lane) -> StopLine:
    return StopLine(*_end(lane), lane.width)


def _heads(lanes: dict[str, _Lane], stopping: dict[str, list[_Link]]) -> Iterator[SignalHead]:
    """Yield one head for each lane at a signal."""
    for name, links in stopping.items():
        signalled = [link for link in links if link.signal]
        if not signalled:
            continue
        link = min(signalled, key=lambda one: DIRECTIONS.find(one.direction))
        x, y, heading = _end(lanes[name])
        cos, sin = math.cos(heading), math.sin(heading)
        across = max((_ahead(lanes[one.via], x, y, cos, sin) for one in signalled if one.via in lanes), default=0.0)
        across += BEHIND
        reach = lanes[name].width / 2.0 + lanes[name].aside + ASIDE
        yield SignalHead(link.signal, link.index, x + across * cos, y + across * sin, heading, reach)


def _ahead(lane: _Lane, x: float, y: float, cos: float, sin: float) -> float:
    """Return how far the end of a lane lies ahead of a point in a direction [m]."""
    end_x, end_y = lane.shape[-1]
    return float((end_x - x) * cos + (end_y - y) * sin)
