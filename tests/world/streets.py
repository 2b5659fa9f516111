"""Small streets, traffic and drives for the tests of this room; built with SUMO's own tools while the tests run."""

from __future__ import annotations

import math
import os
import random
import subprocess
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import sumo

from tests import vehicles
from vve_sumo.values import EGO, Point, Pose
from vve_sumo.world.ego_sync import Ego

PERIOD = 0.02

FUSION = vehicles.FUSION.vehicle

#: the egos of a street with one
ALONE = (Ego(EGO, FUSION),)


def pose(time: float, x: float, y: float, heading: float, speed: float) -> Pose:
    """A pose of the front bumper on level ground, driven straight."""
    return Pose(time, Point.FRONT_BUMPER, x, y, heading, speed, 0.0, 0.0, 0.0, 0.0)


def _tool(name: str, *arguments: str) -> None:
    home = sumo.SUMO_HOME
    subprocess.run(
        [str(Path(home) / "bin" / name), *arguments],
        check=True,
        capture_output=True,
        env={**os.environ, "SUMO_HOME": home},
    )


def _network(folder: Path, name: str, nodes: str, edges: str, *options: str) -> Path:
    (folder / f"{name}.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / f"{name}.edg.xml").write_text(f"<edges>{edges}</edges>")
    target = folder / f"{name}.net.xml"
    _tool(
        "netconvert",
        "--node-files", str(folder / f"{name}.nod.xml"),
        "--edge-files", str(folder / f"{name}.edg.xml"),
        "--no-turnarounds", "true",
        *options,
        "--offset.disable-normalization", "true",
        "--output-file", str(target),
    )  # fmt: skip
    return target


def street(folder: Path, lanes: int = 2, *, opposites: bool = False) -> Path:
    """1 km to the east with so many lanes ("east", lane 0 in the south), one lane back ("west", at y = 1.6).

    With `opposites` the lanes beside the centre line know of each other, as those of an import from OpenStreetMap do.
    """
    return _network(
        folder,
        "street",
        '<node id="a" x="0" y="0"/><node id="b" x="1000" y="0"/>',
        f'<edge id="east" from="a" to="b" numLanes="{lanes}" speed="20"/>'
        '<edge id="west" from="b" to="a" numLanes="1" speed="20"/>',
        *(["--opposites.guess", "true"] if opposites else []),
    )


def crossing(folder: Path) -> Path:
    """A major road west to east ("wc", "ce" at y = -1.6) and a minor one ("sc", "cn" at x = 1.6), 300 m each arm."""
    arms = {"w": (-300, 0, 10), "e": (300, 0, 10), "s": (0, -300, 1), "n": (0, 300, 1)}
    nodes = '<node id="c" x="0" y="0" type="priority"/>'
    nodes += "".join(f'<node id="{arm}" x="{x}" y="{y}"/>' for arm, (x, y, _) in arms.items())
    edges = "".join(
        f'<edge id="{arm}c" from="{arm}" to="c" numLanes="1" speed="14" priority="{priority}"/>'
        f'<edge id="c{arm}" from="c" to="{arm}" numLanes="1" speed="14" priority="{priority}"/>'
        for arm, (_, _, priority) in arms.items()
    )
    return _network(folder, "crossing", nodes, edges)


def grid(folder: Path, size: int = 4, length: float = 120.0, lanes: int = 2) -> Path:
    """Blocks of a town: size x size junctions, named A0 (x = 0, y = 0) to D3."""
    target = folder / "grid.net.xml"
    _tool(
        "netgenerate", "--grid", "true", "--grid.number", str(size), "--grid.length", str(length),
        "--default.lanenumber", str(lanes), "--no-turnarounds", "true", "--output-file", str(target),
    )  # fmt: skip
    return target


def demand(folder: Path, body: str, name: str = "demand") -> Path:
    """A route file."""
    target = folder / f"{name}.rou.xml"
    target.write_text(f"<routes>{body}</routes>")
    return target


def trips(folder: Path, network: Path, count: int, period: float, seed: int = 5) -> Path:
    """So many cars between random edges, one every `period` [s]."""
    edges = [edge.attrib["id"] for edge in ElementTree.parse(network).iter("edge") if "function" not in edge.attrib]
    chance = random.Random(seed)
    lines = []
    for i in range(count):
        start, end = chance.sample(edges, 2)
        lines.append(f'<trip id="t{i}" type="car" depart="{i * period:.2f}" from="{start}" to="{end}"/>')
    return demand(folder, '<vType id="car" sigma="0.5"/>' + "".join(lines), "trips")


def lane_points(network: Path, lanes: Sequence[str]) -> list[tuple[float, float]]:
    """The centre lines of lanes, one after the other."""
    shapes = {lane.attrib["id"]: lane.attrib["shape"] for lane in ElementTree.parse(network).iter("lane")}
    points: list[tuple[float, float]] = []
    for lane in lanes:
        for word in shapes[lane].split():
            x, y = (float(number) for number in word.split(","))
            if not points or math.dist(points[-1], (x, y)) > 0.01:
                points.append((x, y))
    return points


def way(network: Path, edges: Sequence[str], lane: int = 0) -> list[str]:
    """The lanes of a way along edges, with those inside the junctions."""
    root = ElementTree.parse(network)
    inside = {}
    for link in root.iter("connection"):
        if "via" in link.attrib:
            key = (link.attrib["from"], link.attrib["to"])
            inside.setdefault(key, link.attrib["via"])
            if link.attrib["fromLane"] == link.attrib["toLane"] == str(lane):
                inside[key] = link.attrib["via"]
    follow = {link.attrib["from"]: link.attrib.get("via") for link in root.iter("connection")}
    lanes = [f"{edges[0]}_{lane}"]
    for last, edge in pairwise(edges):
        via: str | None = inside[last, edge]
        while via:
            lanes.append(via)
            via = follow.get(via.rpartition("_")[0])
        lanes.append(f"{edge}_{lane}")
    return lanes


def along(
    points: Sequence[tuple[float, float]], step: float, lever: float = 3.84
) -> Iterator[tuple[float, float, float]]:
    """x, y, heading of a front bumper that follows points while the rear axle trails `lever` [m] behind it."""
    heading = math.atan2(points[1][1] - points[0][1], points[1][0] - points[0][0])
    rest = 0.0
    for (x, y), (to_x, to_y) in pairwise(points):
        length = math.dist((x, y), (to_x, to_y))
        direction = math.atan2(to_y - y, to_x - x)
        while rest < length:
            heading += step / lever * math.sin(direction - heading)
            yield x + rest * math.cos(direction), y + rest * math.sin(direction), heading
            rest += step
        rest -= length
