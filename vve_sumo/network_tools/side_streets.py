"""Builds a straight street of our own making, on which others go first: a stop sign, a signal and a minor road.

The place is invented, so that no map data is used. Knows nothing of cars or of paths.
Usage: python -m vve_sumo.network_tools.side_streets NETWORK.net.xml
"""

from __future__ import annotations

import math
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Final

from vve_sumo.frames import MapFrame
from vve_sumo.network_tools.build import netconvert, projection, tidy
from vve_sumo.network_tools.proving_ground import DECIMALS, ORIGIN
from vve_sumo.world.network import Network, read_network

NOTE: Final = "A street of our own making: it stands for no place on Earth and holds nobody's map data"
SPEED_LIMIT: Final = 11.176  #: 25 mph [m/s]
LANE_WIDTH: Final = 3.5  #: [m]
WEST, EAST, SIDE = -420.0, 420.0, 150.0  #: ends of the street and length of the side streets [m]
#: where streets cross it [m], and SUMO's type of the junction
CROSSINGS: Final = {"stop": (-200.0, "priority_stop"), "signal": (0.0, "traffic_light"), "minor": (200.0, "priority")}
CORNER: Final = 7.6  #: radius of a corner: 25 ft [m]
#: of the signal, which shows green to both directions of a street at a time [s]
GREEN, YELLOW, ALL_RED = 30, 4, 1


def build_side_streets(network: Path) -> Network:
    """Write the street to `network`; raises ConfigError as `netconvert` does."""
    with tempfile.TemporaryDirectory() as folder:
        nodes, edges, raw = (Path(folder) / name for name in ("street.nod.xml", "street.edg.xml", "raw.net.xml"))
        nodes.write_text(_nodes(), encoding="utf-8")
        edges.write_text(_edges(), encoding="utf-8")
        files = ["--node-files", str(nodes), "--edge-files", str(edges), "--no-turnarounds"]
        program = ["--tls.default-type", "static", "--tls.left-green.time", "0", "--tls.green.time", str(GREEN)]
        program += ["--tls.yellow.time", str(YELLOW), "--tls.allred.time", str(ALL_RED)]
        shape = ["--proj", projection(ORIGIN), "--default.junctions.radius", str(CORNER)]
        netconvert([*files, *shape, *program], nodes, raw)
        network.write_bytes(tidy(raw, NOTE))
    return read_network(network)


def _nodes() -> str:
    frame, rows = MapFrame(projection(ORIGIN)), []
    places = {"west": (WEST, 0.0, "dead_end"), "east": (EAST, 0.0, "dead_end")}
    for name, (x, kind) in CROSSINGS.items():
        places |= {
            name: (x, 0.0, kind),
            f"{name}_north": (x, SIDE, "dead_end"),
            f"{name}_south": (x, -SIDE, "dead_end"),
        }
    for name, (x, y, kind) in places.items():
        latitude, longitude = (f"{math.degrees(angle):.{DECIMALS}f}" for angle in frame.to_geodetic(x, y))
        rows.append(f'<node id="{name}" x="{longitude}" y="{latitude}" type="{kind}"/>')
    return f"<nodes>{''.join(rows)}</nodes>"


def _edges() -> str:
    rows = []
    for start, end in pairwise(("west", *CROSSINGS, "east")):
        rows += [_edge(start, end, 2), _edge(end, start, 2)]
    for name in CROSSINGS:
        for side in (f"{name}_north", f"{name}_south"):
            rows += [_edge(side, name, 1), _edge(name, side, 1)]
    return f"<edges>{''.join(rows)}</edges>"


def _edge(start: str, end: str, priority: int) -> str:
    shape = f'numLanes="1" width="{LANE_WIDTH}" speed="{SPEED_LIMIT}" priority="{priority}"'
    return f'<edge id="{start}_to_{end}" from="{start}" to="{end}" {shape}/>'


def main() -> None:
    """Build the file at the place given on the command line."""
    (network,) = sys.argv[1:]
    build_side_streets(Path(network))


if __name__ == "__main__":
    main()
