"""Builds synthetic, straight, wide, empty roads, each with a path along the middle of its middle lane.

The places are invented, so that no map data is used. Knows nothing of cars or of what is measured there.
Usage: python -m vve_sumo.network_tools.proving_ground [proving_ground | test_track] NETWORK.net.xml PATH.csv
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.network_tools.build import netconvert, projection, tidy
from vve_sumo.world.network import Network, lane_shapes, read_network

ORIGIN = (40.0, -83.0)  #: latitude, longitude of the projection and of the middle of every road, round numbers [deg]
LANES, LANE_WIDTH = 3, 4.0  #: each way, and their width [m]
RUN_IN = 60.0  #: length of road before the path begins [m]
SPACING = 5.0  #: between two points of the path [m]
DECIMALS = 10  #: of a degree: a hundredth of a millimetre

NOTE = "A proving ground of our own making: it stands for no place on Earth and holds nobody's map data"


class Ground(NamedTuple):
    """A road that runs due east."""

    name: str  #: of its network, its path and its edge
    length: float  #: [m]
    path_length: float  #: [m]
    speed_limit: float  #: [m/s]
    two_way: bool  #: whether as many lanes beside it run back


PROVING_GROUND = Ground("proving_ground", length=460.0, path_length=300.0, speed_limit=20.0, two_way=False)
TEST_TRACK = Ground("test_track", length=1660.0, path_length=1500.0, speed_limit=45.0, two_way=True)
GROUNDS = {ground.name: ground for ground in (PROVING_GROUND, TEST_TRACK)}


def build_proving_ground(network: Path, path: Path, ground: Ground = PROVING_GROUND) -> Network:
    """Write the road to `network` and its path to `path`; raises ConfigError as `netconvert` does."""
    with tempfile.TemporaryDirectory() as folder:
        nodes, edges, raw = (Path(folder) / name for name in ("ground.nod.xml", "ground.edg.xml", "raw.net.xml"))
        nodes.write_text(_nodes(ground), encoding="utf-8")
        edges.write_text(_edges(ground), encoding="utf-8")
        files = ["--node-files", str(nodes), "--edge-files", str(edges)]
        netconvert([*files, "--proj", projection(ORIGIN), "--no-turnarounds"], nodes, raw)
        network.write_bytes(tidy(raw, NOTE))
    built = read_network(network)
    path.write_text(_path(built, ground), encoding="utf-8")
    return built


def _nodes(ground: Ground) -> str:
    """Return netconvert's nodes file with the road's two ends, in degrees."""
    frame = MapFrame(projection(ORIGIN))
    rows = []
    for name, x in (("west", -0.5 * ground.length), ("east", 0.5 * ground.length)):
        latitude, longitude = (f"{math.degrees(angle):.{DECIMALS}f}" for angle in frame.to_geodetic(x, 0.0))
        rows.append(f'<node id="{name}" x="{longitude}" y="{latitude}" type="dead_end"/>')
    return f"<nodes>{''.join(rows)}</nodes>"


def _edges(ground: Ground) -> str:
    spread = "right" if ground.two_way else "center"
    shape = f'numLanes="{LANES}" width="{LANE_WIDTH}" speed="{ground.speed_limit}" spreadType="{spread}"'
    there = f'<edge id="{ground.name}" from="west" to="east" {shape}/>'
    back = f'<edge id="{ground.name}_back" from="east" to="west" {shape}/>' if ground.two_way else ""
    return f"<edges>{there}{back}</edges>"


def _path(network: Network, ground: Ground) -> str:
    """Return the path as CSV, along the middle one of the eastward lanes."""
    frame = network.frame()
    left, low, right, high = network.boundary
    lanes = lane_shapes(network.path, (left - 1.0, low - 50.0, right + 1.0, high + 50.0))
    eastward = sorted(float(shape[0, 1]) for shape, _width in lanes if shape[0, 0] < shape[-1, 0])
    lines = [
        f"# Path for the middle of the ego's rear axle, WGS84, straight along the middle of {ground.name}.net.xml.",
        f"# {NOTE}.",
        f"# edges: {ground.name}",
        "latitude_deg,longitude_deg",
    ]
    for number in range(round(ground.path_length / SPACING) + 1):
        place = frame.to_geodetic(left + RUN_IN + number * SPACING, eastward[LANES // 2])
        lines.append(",".join(f"{math.degrees(angle):.{DECIMALS}f}" for angle in place))
    return "\n".join(lines) + "\n"


def main() -> None:
    """Build the files of one road at the places given on the command line."""
    name, network, path = sys.argv[1:] if len(sys.argv) == 4 else (PROVING_GROUND.name, *sys.argv[1:])
    if name not in GROUNDS:
        raise ConfigError(f"no street named {name!r}; known: {', '.join(GROUNDS)}")
    build_proving_ground(Path(network), Path(path), GROUNDS[name])


if __name__ == "__main__":
    main()
