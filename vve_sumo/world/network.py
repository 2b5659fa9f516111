"""Reads a SUMO network file without a simulation: its place on Earth, its lanes, edges and routes.

Head and lane shapes are read as a stream, because every drive needs them; only `Roads` lets sumolib read the whole
file, which takes about a second. Knows nothing of traffic or of the ego.
"""

from __future__ import annotations

import gzip
import math
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]  #: least x, least y, greatest x, greatest y, map [m]
Movement = tuple[str, str]  #: a way through a junction: the edge before it and the edge after it

LANE_WIDTH = 3.2  #: SUMO's default, for a lane without a stated width [m]
#: kind of a lane, by its edge's function; a walking area has an outline and no centre line
KINDS: Final = {"normal": "lane", "connector": "lane", "internal": "junction", "crossing": "crossing"}
GZIP_MAGIC = b"\x1f\x8b"


@dataclass(frozen=True, slots=True)
class Network:
    """Where a network file lies on Earth."""

    path: Path  #: the file
    projection: str  #: PROJ string from geodetic to projected coordinates
    offset: tuple[float, float]  #: added to projected x, y to get map x, y [m]
    boundary: Box  #: of everything in it, map [m]

    def frame(self) -> MapFrame:
        """Return the transformation between geodetic coordinates and this network's map coordinates."""
        return MapFrame(self.projection, self.offset)


@dataclass(frozen=True, slots=True)
class NetworkLane:
    """A lane as it lies on the map, and where it leads."""

    name: str  #: SUMO's
    kind: str  #: "lane", "junction" (inside a junction), "crossing", or "walkway" (for pedestrians alone)
    width: float  #: [m]
    shape: Floats  #: centre line in driving direction (n, 2), map [m]
    successors: tuple[str, ...]  #: names of the lanes that it leads into, those inside junctions included


class LanePoint(NamedTuple):
    """A place on a lane's centre line."""

    x: float  #: map [m]
    y: float  #: map [m]
    heading: float  #: of the lane there [rad], counter-clockwise from map +x


def read_network(path: Path) -> Network:
    """Read where a network (`.net.xml`, plain or gzipped) lies on Earth, from its head alone.

    Raises ConfigError when the file is missing, not a network, or without a projection.
    """
    for element in elements(path, "location"):
        return _located(path, element.attrib)
    raise ConfigError(f"{path}: expected a <location> element, found none")


def lane_shapes(path: Path, box: Box) -> list[tuple[Floats, float]]:
    """Return (centre line of shape (n, 2), width), both [m], of each lane near the box, in file order.

    A lane is near when its own bounding box, widened by its width, meets `box`. Lanes inside junctions are
    included. Raises ConfigError as read_network does.
    """
    shapes = ((shape_of(lane.attrib["shape"]), float(lane.get("width", LANE_WIDTH))) for lane in elements(path, "lane"))
    return [(shape, width) for shape, width in shapes if meets(shape, width, box)]


def lanes_near(path: Path, box: Box) -> list[NetworkLane]:
    """Return the lanes near the box, as `lane_shapes` does, with their names, kinds and successors.

    Pedestrian crossings are included, walking areas are not. Raises ConfigError as read_network does.
    """
    found: dict[str, tuple[str, float, Floats]] = {}
    leads: dict[str, list[str]] = {}
    for element in elements(path, "edge", "connection"):
        if element.tag == "edge":
            found |= {name: drawn for name, drawn in _lanes(element) if meets(drawn[2], drawn[1], box)}
        elif (start := f"{element.get('from')}_{element.get('fromLane')}") in found:
            # A network lists its connections after all edges.
            leads.setdefault(start, []).append(element.get("via") or f"{element.get('to')}_{element.get('toLane')}")
    return [
        NetworkLane(name, kind, width, shape, tuple(dict.fromkeys(leads.get(name, ()))))
        for name, (kind, width, shape) in found.items()
    ]


def _lanes(edge: ET.Element) -> Iterator[tuple[str, tuple[str, float, Floats]]]:
    """Yield name, kind, width [m] and centre line of each lane of an edge that has a centre line."""
    kind = KINDS.get(edge.get("function", "normal"))
    if kind is None:
        return
    for lane in edge.iter("lane"):
        on_foot = kind == "lane" and lane.get("allow") == "pedestrian"
        width = float(lane.get("width", LANE_WIDTH))
        yield lane.attrib["id"], ("walkway" if on_foot else kind, width, shape_of(lane.attrib["shape"]))


def signals(path: Path) -> dict[str, tuple[float, float]]:
    """Return the place [m] of every junction with a signal by its name; raises ConfigError as read_network does."""
    junctions = (one.attrib for one in elements(path, "junction"))
    return {
        one["id"]: (float(one["x"]), float(one["y"]))
        for one in junctions
        if one.get("type", "").startswith("traffic_light")
    }


def _located(path: Path, attributes: dict[str, str]) -> Network:
    projection = attributes.get("projParameter", "!")
    if projection in {"!", "-", "."}:
        raise ConfigError(
            f"{path}: expected a geographic projection in <location projParameter>, got {projection!r}; "
            "build the network from map data"
        )
    offset, boundary = (_numbers(path, attributes, key, n) for key, n in (("netOffset", 2), ("convBoundary", 4)))
    return Network(path, projection, (offset[0], offset[1]), (boundary[0], boundary[1], boundary[2], boundary[3]))


def _numbers(path: Path, attributes: dict[str, str], key: str, count: int) -> list[float]:
    text = attributes.get(key, "")
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        raise ConfigError(f"{path}: expected {count} numbers in <location {key}>, got {text!r}")
    return numbers


def shape_of(text: str) -> Floats:
    return np.array([[float(number) for number in point.split(",")[:2]] for point in text.split()])


def meets(shape: Floats, width: float, box: Box) -> bool:
    least, greatest = shape.min(axis=0) - width, shape.max(axis=0) + width
    return bool(least[0] <= box[2] and greatest[0] >= box[0] and least[1] <= box[3] and greatest[1] >= box[1])


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO | gzip.GzipFile]:
    with path.open("rb") as plain:
        zipped = plain.read(len(GZIP_MAGIC)) == GZIP_MAGIC
        plain.seek(0)
        if zipped:
            with gzip.open(plain) as unpacked:
                yield unpacked
        else:
            yield plain


def elements(path: Path, *tags: str) -> Iterator[ET.Element]:
    """Stream the elements of some tags; each is cleared after use, so that memory stays small."""
    try:
        with _opened(path) as file:
            events = ET.iterparse(file, events=("start", "end"))
            _event, root = next(events)
            if root.tag != "net":
                raise ConfigError(f"{path}: expected a SUMO network with root <net>, got <{root.tag}>")
            for event, element in events:
                if event == "end":
                    if element.tag in tags:
                        yield element
                    if element.tag in {"edge", "junction", "connection", "tlLogic"}:
                        root.clear()
    except FileNotFoundError:
        raise ConfigError(f"network file {path} does not exist") from None
    except (ET.ParseError, EOFError, OSError, zlib.error) as error:
        raise ConfigError(f"{path}: expected a SUMO network (.net.xml), it can't be read: {error}") from None


class Roads:
    """A network read in full by sumolib: edges, lanes and routes. Edge and lane names are SUMO's."""

    def __init__(self, path: Path) -> None:
        import sumolib

        self.network = read_network(path)
        try:
            self._net: Any = sumolib.net.readNet(str(path), withInternal=True)
        except Exception as error:  # sumolib has no error of its own: what it stumbles over is what it raises
            raise ConfigError(
                f"{path}: expected a SUMO network, sumolib cannot read it ({type(error).__name__}: {error})"
            ) from error

    @property
    def edges(self) -> tuple[Any, ...]:
        """Every edge outside junctions, as sumolib's objects, in file order."""
        return tuple(self._net.getEdges(withInternal=False))

    def shapes(self) -> Iterator[tuple[Any, Floats]]:
        """Yield every edge outside junctions, as sumolib's object, with the middle of its lanes (n, 2), map [m]."""
        for edge in self.edges:
            lanes = edge.getLanes()
            shape = np.array([point[:2] for point in lanes[len(lanes) // 2].getShape()], dtype=np.float64)
            other = np.array([point[:2] for point in lanes[(len(lanes) - 1) // 2].getShape()], dtype=np.float64)
            yield edge, 0.5 * (shape + other) if shape.shape == other.shape else shape

    def edge(self, name: str) -> Any:
        """Return sumolib's edge of a name; raises ConfigError when there is none."""
        if not self._net.hasEdge(name):
            raise ConfigError(f"{self.network.path}: there is no edge {name!r}")
        return self._net.getEdge(name)

    def route(self, stops: Sequence[str]) -> tuple[str, ...]:
        """Return the shortest route for a car along two or more edges, in this order, as edge names.

        Raises ConfigError when an edge is unknown or cannot be reached from the one before it.
        """
        if len(stops) < 2:
            raise ConfigError(f"{self.network.path}: a route takes two or more edges, got {len(stops)}")
        names = [stops[0]]
        for start, end in pairwise(stops):
            names += self._leg(start, end)
        return tuple(names)

    def _leg(self, start: str, end: str) -> list[str]:
        found, _cost = self._net.getShortestPath(self.edge(start), self.edge(end), vClass="passenger")
        if found is None:
            raise ConfigError(f"{self.network.path}: no way for a car from edge {start!r} to edge {end!r}")
        return [edge.getID() for edge in found[1:]]

    def prior(self, route: Sequence[str]) -> frozenset[Movement]:
        """Return the movements through junctions to which a car on a route, edge by edge, must give way.

        These cross the route or merge with it, and have the right of way over it; at a signal, in some phase at least.
        Raises ConfigError when an edge is unknown or does not lead to the next one.
        """
        found: set[Movement] = set()
        for start, end in pairwise(route):
            node, own = self.edge(start).getToNode(), self.edge(start).getConnections(self.edge(end))
            if not own:
                raise ConfigError(f"{self.network.path}: edge {start!r} does not lead to edge {end!r}")
            for other in node.getConnections():
                if any(_goes_first(node, other, mine) for mine in own):
                    found.add((other.getFrom().getID(), other.getTo().getID()))
        return frozenset(found)

    def close(self, movements: Iterable[Movement]) -> None:
        """Exclude these movements through junctions from all routes that are searched from now on."""
        for start, end in movements:
            self.edge(start).getOutgoing().pop(self.edge(end), None)

    def fastest(self, start: Any, end: Any) -> tuple[Any, ...]:
        """Return the fastest route for a car between two of sumolib's edges, empty when there is none."""
        found, _cost = self._net.getFastestPath(start, end, vClass="passenger")
        return tuple(found or ())

    def place(self, lane: str, position: float) -> LanePoint:
        """Return the point of a lane's centre line at SUMO's `position` [m] from the lane's start.

        Raises ConfigError when there is no such lane or the position lies outside it.
        """
        found = self._lane(lane)
        if not 0.0 <= position <= found.getLength():
            length = f"{found.getLength():.2f} m long"
            raise ConfigError(f"{self.network.path}: lane {lane!r} is {length}, position {position} is not on it")
        shape = np.array([point[:2] for point in found.getShape()])
        steps = np.diff(shape, axis=0)
        spans = np.sqrt(steps[:, 0] ** 2 + steps[:, 1] ** 2)
        ends = np.cumsum(spans)
        drawn = position / found.getLength() * ends[-1]  # SUMO's length may differ from the drawn one
        piece = min(int(np.searchsorted(ends, drawn)), len(spans) - 1)
        x, y = shape[piece] + steps[piece] * ((drawn - ends[piece] + spans[piece]) / spans[piece])
        return LanePoint(float(x), float(y), math.atan2(steps[piece][1], steps[piece][0]))

    def _lane(self, name: str) -> Any:
        edge, _, index = name.rpartition("_")
        lanes = self._net.getEdge(edge).getLanes() if self._net.hasEdge(edge) else []
        if not index.isdigit() or int(index) >= len(lanes):
            raise ConfigError(f"{self.network.path}: there is no lane {name!r}")
        return lanes[int(index)]


def _goes_first(node: Any, other: Any, own: Any) -> bool:
    """Return whether traffic of the connection `other` of a junction may have the right of way over `own`."""
    links = node.getLinkIndex(other), node.getLinkIndex(own)
    if min(links) < 0 or links[0] == links[1]:
        return False
    signal = node.getType().startswith("traffic_light")
    return bool(node.forbids(other, own) or (signal and node.areFoes(*links)))
