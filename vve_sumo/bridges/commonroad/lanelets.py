"""Lanelets of a CommonRoad file: their middles and widths, the way from one to a goal, and netconvert's plain network.

A lanelet becomes an edge of one lane. Knows nothing of obstacles and problems.
"""

from __future__ import annotations

import math
import tempfile
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from vve_sumo.bridges.commonroad.numbers import points
from vve_sumo.bridges.scenario_import.lines import Points
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element
from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.network_tools.build import netconvert, projection, tidy
from vve_sumo.values import Floats

#: a lanelet is sampled at so many shares of its bounds, at least
MIN_SAMPLES: Final = 2
#: speed limit of the network's lanes [m/s]: the file's signs are not taken, and nobody but the ego obeys limits
SPEED_LIMIT: Final = 50.0
#: of a degree: a hundredth of a millimetre
DECIMALS: Final = 10
#: kinds of lanelets that nobody drives on
ON_FOOT: Final = frozenset({"sidewalk", "crosswalk"})
#: lanelets of a network, at most
MAX_LANELETS: Final = 5000


@dataclass(frozen=True, slots=True)
class Lanelet:
    """One lanelet."""

    name: str  #: its number in the file
    middle: Floats  #: points (n, 2) in driving order [m]
    width: float  #: mean [m]
    successors: tuple[str, ...]
    kinds: frozenset[str]
    element: Element

    def heading(self, at: int) -> float:
        """Return the direction of a piece of the middle [rad]."""
        dx, dy = self.middle[at + 1] - self.middle[at]
        return math.atan2(dy, dx)


def read_lanelets(root: Element) -> dict[str, Lanelet]:
    """Return the lanelets by their numbers; raises NotTakenError for one that has no bounds to drive between."""
    found = root.all("lanelet")
    if not found:
        raise NotTakenError(root, "expected lanelets, found none")
    if len(found) > MAX_LANELETS:
        raise NotTakenError(root, f"expected at most {MAX_LANELETS} lanelets, got {len(found)}")
    lanelets = {}
    for one in found:
        left, right = (_bound(one, side) for side in ("leftBound", "rightBound"))
        shares = np.unique(np.concatenate([_shares(left), _shares(right)]))
        left, right = _at(left, shares), _at(right, shares)
        middle = 0.5 * (left + right)
        kept = np.append(True, np.hypot(*np.diff(middle, axis=0).T) > 1e-6)
        if kept.sum() < MIN_SAMPLES:
            raise NotTakenError(one, "a lanelet without length")
        name = one.attributes.get("id", "")
        lanelets[name] = Lanelet(
            name,
            middle[kept],
            float(np.mean(np.hypot(*(left - right).T))),
            tuple(each.attributes.get("ref", "") for each in one.all("successor")),
            frozenset(each.text.strip() for each in one.all("laneletType")),
            one,
        )
    return lanelets


def _bound(of: Element, tag: str) -> Floats:
    side = of.child(tag)
    found = [] if side is None else points(side)
    if len(found) < MIN_SAMPLES or not _length(np.array(found)) > 0.0:
        raise NotTakenError(of, f"expected a <{tag}> of two points at least")
    return np.array(found)


def _length(line: Floats) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _shares(line: Floats) -> Floats:
    ways = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    shares: Floats = np.round(ways / ways[-1], 9)
    return shares


def _at(line: Floats, shares: Floats) -> Floats:
    own = _shares(line)
    return np.column_stack([np.interp(shares, own, line[:, axis]) for axis in (0, 1)])


def nearest(lanelets: Mapping[str, Lanelet], x: float, y: float, heading: float) -> Lanelet | None:
    """Return the lanelet to drive on that a place [m] is on and whose direction is nearest to a heading [rad]."""
    best, found = math.inf, None
    for one in lanelets.values():
        if one.kinds & ON_FOOT:
            continue
        piece, distance = _foot(one, x, y)
        turned = abs(math.remainder(one.heading(piece) - heading, math.tau))
        if distance <= 0.5 * one.width + 0.5 and turned < best:
            best, found = turned, one
    return found if best < 0.5 * math.pi else None


def _foot(lanelet: Lanelet, x: float, y: float) -> tuple[int, float]:
    """Return the piece of a lanelet's middle that a place is nearest to, and its distance [m]."""
    begin, piece = lanelet.middle[:-1], np.diff(lanelet.middle, axis=0)
    along = np.clip(((np.array([x, y]) - begin) * piece).sum(axis=1) / (piece**2).sum(axis=1), 0.0, 1.0)
    away = np.hypot(*(begin + along[:, None] * piece - (x, y)).T)
    nearest_piece = int(np.argmin(away))
    return nearest_piece, float(away[nearest_piece])


def holds(lanelet: Lanelet, x: float, y: float) -> bool:
    """Return whether a place is on a lanelet."""
    return _foot(lanelet, x, y)[1] <= 0.5 * lanelet.width


def way(lanelets: Mapping[str, Lanelet], start: Lanelet, goals: Collection[str]) -> list[Lanelet]:
    """Return the lanelets from one on: the fewest to one of the goals, and from there, or without, straight on."""
    before: dict[str, str | None] = {start.name: None}
    waiting, reached = deque([start.name]), None
    while waiting and reached is None:
        here = waiting.popleft()
        if here in goals:
            reached = here
        for name in lanelets[here].successors:
            if name in lanelets and name not in before:
                before[name] = here
                waiting.append(name)
    found: list[str] = []
    at: str | None = reached if reached is not None else start.name
    while at is not None:
        found.append(at)
        at = before[at]
    return [lanelets[name] for name in _straight_on(lanelets, found[::-1])]


def _straight_on(lanelets: Mapping[str, Lanelet], found: list[str]) -> list[str]:
    while True:
        last = lanelets[found[-1]]
        following = [name for name in last.successors if name in lanelets and name not in found]
        if not following:
            return found
        end = last.heading(-2)
        found.append(min(following, key=lambda name: abs(math.remainder(lanelets[name].heading(-2) - end, math.tau))))


def line_of(lanelets: Sequence[Lanelet]) -> Points:
    """Return the middle of lanelets that follow each other, without points that repeat another."""
    found: Points = []
    for one in lanelets:
        for x, y in one.middle.tolist():
            if not found or math.dist(found[-1], (x, y)) > 0.05:
                found.append((x, y))
    return found


def build(
    lanelets: Mapping[str, Lanelet], middle: tuple[float, float], origin: tuple[float, float], out: Path
) -> tuple[str, ...]:
    """Build the network of lanelets and write it to `out`; return netconvert's warnings.

    `middle` [m] of the file's coordinates lies at `origin` [deg]. Raises ConfigError as `netconvert` does.
    """
    frame = MapFrame(projection(origin))
    ends = _ends(lanelets)
    nodes, edges = ET.Element("nodes"), ET.Element("edges")
    places: dict[int, list[Floats]] = {}
    for one in lanelets.values():
        for number_, at in zip(ends[one.name], (0, -1), strict=True):
            places.setdefault(number_, []).append(one.middle[at])
    for number_, found in places.items():
        x, y = _degrees(frame, np.mean(found, axis=0) - middle)
        ET.SubElement(nodes, "node", {"id": f"n{number_}", "x": x, "y": y, "type": "priority"})
    for one in lanelets.values():
        first, last = ends[one.name]
        shape = " ".join(",".join(_degrees(frame, place - middle)) for place in one.middle)
        kind = {"allow": "pedestrian"} if one.kinds & ON_FOOT else {}
        edge = {"id": f"l{one.name}", "from": f"n{first}", "to": f"n{last}", "numLanes": "1", "spreadType": "center"}
        edge |= {"width": f"{one.width:.3f}", "speed": f"{SPEED_LIMIT:g}", "shape": shape} | kind
        ET.SubElement(edges, "edge", edge)
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / name for name in ("lanelets.nod.xml", "lanelets.edg.xml", "raw.net.xml")]
        for file, root in zip(files, (nodes, edges), strict=False):
            ET.ElementTree(root).write(file, encoding="utf-8")
        options = ["--node-files", str(files[0]), "--edge-files", str(files[1]), "--proj", projection(origin)]
        options += ["--no-turnarounds", "--junctions.limit-turn-speed=-1"]
        source = next(iter(lanelets.values())).element.file
        warnings = netconvert(options, source, files[2])
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(tidy(files[2], f"Built from {source.name}, CommonRoad".replace("--", "-")))
    return warnings


def _degrees(frame: MapFrame, place: Floats) -> tuple[str, str]:
    latitude, longitude = frame.to_geodetic(float(place[0]), float(place[1]))
    return f"{math.degrees(longitude):.{DECIMALS}f}", f"{math.degrees(latitude):.{DECIMALS}f}"


def _ends(lanelets: Mapping[str, Lanelet]) -> dict[str, tuple[int, int]]:
    """Return the numbers of the nodes at each lanelet's start and end: who follows begins where who leads ends."""
    parent = list(range(2 * len(lanelets)))
    numbers = {name: 2 * at for at, name in enumerate(lanelets)}

    def top(one: int) -> int:
        while parent[one] != one:
            one = parent[one]
        return one

    for one in lanelets.values():
        for name in one.successors:
            if name in numbers:
                parent[top(numbers[name])] = top(numbers[one.name] + 1)
    found = {name: (top(at), top(at + 1)) for name, at in numbers.items()}
    for name, (first, last) in found.items():
        if first == last:
            raise ConfigError(f"{lanelets[name].element.where}: a lanelet that begins where it ends is not taken")
    return found
