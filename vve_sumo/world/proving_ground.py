"""Builds the proving ground: a street of our own making, straight, wide and empty, and a path along its middle.

The place is made up, so nothing here is anybody's map data. Knows nothing of cars or of what is measured there.
Usage: python -m vve_sumo.world.proving_ground NETWORK.net.xml PATH.csv
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path

from vve_sumo.frames import MapFrame
from vve_sumo.world.build import netconvert, projection, tidy
from vve_sumo.world.network import Network, read_network

ORIGIN = (40.0, -83.0)  #: of the projection, and the middle of the street: round numbers, not a place [deg]
LENGTH = 460.0  #: of the street, which runs due east [m]
LANES, LANE_WIDTH = 3, 4.0  #: one way, and their width [m]
SPEED_LIMIT = 20.0  #: [m/s]
RUN_IN = 60.0  #: of street before the path begins [m]
PATH_LENGTH = 300.0  #: [m]
SPACING = 5.0  #: between two points of the path [m]
DECIMALS = 10  #: of a degree: a hundredth of a millimetre
EDGE = "proving_ground"

NOTE = "A proving ground of our own making: it stands for no place on Earth and holds nobody's map data"


def build_proving_ground(network: Path, path: Path) -> Network:
    """Write the street to `network`, the path along its middle lane to `path`; raises ConfigError as `netconvert`."""
    with tempfile.TemporaryDirectory() as folder:
        nodes, edges, raw = (Path(folder) / name for name in ("ground.nod.xml", "ground.edg.xml", "raw.net.xml"))
        nodes.write_text(_nodes(), encoding="utf-8")
        edges.write_text(_edges(), encoding="utf-8")
        files = ["--node-files", str(nodes), "--edge-files", str(edges)]
        netconvert([*files, "--proj", projection(ORIGIN)], nodes, raw)
        network.write_bytes(tidy(raw, NOTE))
    built = read_network(network)
    path.write_text(_path(built), encoding="utf-8")
    return built


def _nodes() -> str:
    """The street's ends, in degrees, as netconvert wants them of what it is to project."""
    frame = MapFrame(projection(ORIGIN))
    rows = []
    for name, x in (("west", -0.5 * LENGTH), ("east", 0.5 * LENGTH)):
        latitude, longitude = (f"{math.degrees(angle):.{DECIMALS}f}" for angle in frame.to_geodetic(x, 0.0))
        rows.append(f'<node id="{name}" x="{longitude}" y="{latitude}" type="dead_end"/>')
    return f"<nodes>{''.join(rows)}</nodes>"


def _edges() -> str:
    shape = f'numLanes="{LANES}" width="{LANE_WIDTH}" speed="{SPEED_LIMIT}" spreadType="center"'
    return f'<edges><edge id="{EDGE}" from="west" to="east" {shape}/></edges>'


def _path(network: Network) -> str:
    """The path as CSV: along the middle of the network, eastwards."""
    frame = network.frame()
    left, low, _right, high = network.boundary
    lines = [
        "# Path for the middle of the ego's rear axle, WGS84, straight along the middle of proving_ground.net.xml.",
        f"# {NOTE}.",
        f"# edges: {EDGE}",
        "latitude_deg,longitude_deg",
    ]
    for number in range(round(PATH_LENGTH / SPACING) + 1):
        place = frame.to_geodetic(left + RUN_IN + number * SPACING, 0.5 * (low + high))
        lines.append(",".join(f"{math.degrees(angle):.{DECIMALS}f}" for angle in place))
    return "\n".join(lines) + "\n"


def main() -> None:
    """Build both files where the command line says."""
    network, path = (Path(argument) for argument in sys.argv[1:])
    build_proving_ground(network, path)


if __name__ == "__main__":
    main()
