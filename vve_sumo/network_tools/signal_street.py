"""Builds a straight street of our own making with three signals of fixed time, and a path along it.

The place is invented, so that no map data is used. Knows nothing of cars.
Usage: python -m vve_sumo.network_tools.signal_street NETWORK.net.xml PATH.csv
"""

from __future__ import annotations

import math
import sys
import tempfile
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path
from typing import Final

from vve_sumo.frames import MapFrame
from vve_sumo.network_tools.build import netconvert, projection, tidy
from vve_sumo.network_tools.proving_ground import DECIMALS, NOTE, ORIGIN, SPACING
from vve_sumo.world.network import Network, lane_shapes, read_network

SPEED_LIMIT: Final = 13.9  #: [m/s]
LANE_WIDTH: Final = 3.5  #: [m]
WEST, EAST, SIDE = -600.0, 600.0, 120.0  #: ends of the street and length of the side streets [m]
CROSSINGS: Final = (-250.0, 50.0, 350.0)  #: where streets cross it [m]
OFFSETS: Final = (0, 47, 21)  #: of the signals' programs [s]: no green wave
#: of each program, along the street and across it [s]. Yellow: 1 s of reaction and a stop from the limit by 10 ft/s2
#: (ITE 2020) are 3.3 s, and 0.7 s more
GREEN_ALONG, GREEN_ACROSS, YELLOW, ALL_RED = 26, 24, 4, 1
RUN_IN: Final = 60.0  #: length of street before the path begins and after it ends [m]


def build_signal_street(network: Path, path: Path) -> Network:
    """Write the street to `network` and its path to `path`; raises ConfigError as `netconvert` does."""
    with tempfile.TemporaryDirectory() as folder:
        nodes, edges, raw = (Path(folder) / name for name in ("street.nod.xml", "street.edg.xml", "raw.net.xml"))
        nodes.write_text(_nodes(), encoding="utf-8")
        edges.write_text(_edges(), encoding="utf-8")
        files = ["--node-files", str(nodes), "--edge-files", str(edges)]
        netconvert(
            [*files, "--proj", projection(ORIGIN), "--no-turnarounds", "--tls.default-type", "static"], nodes, raw
        )
        _set_programs(raw)
        network.write_bytes(tidy(raw, NOTE))
    built = read_network(network)
    path.write_text(_path(built), encoding="utf-8")
    return built


def _nodes() -> str:
    frame, rows = MapFrame(projection(ORIGIN)), []
    places = {"west": (WEST, 0.0), "east": (EAST, 0.0)}
    for number, x in enumerate(CROSSINGS, 1):
        places |= {f"signal{number}": (x, 0.0), f"north{number}": (x, SIDE), f"south{number}": (x, -SIDE)}
    for name, place in places.items():
        latitude, longitude = (f"{math.degrees(angle):.{DECIMALS}f}" for angle in frame.to_geodetic(*place))
        kind = "traffic_light" if name.startswith("signal") else "dead_end"
        rows.append(f'<node id="{name}" x="{longitude}" y="{latitude}" type="{kind}"/>')
    return f"<nodes>{''.join(rows)}</nodes>"


def _edges() -> str:
    shape = f'numLanes="1" width="{LANE_WIDTH}" speed="{SPEED_LIMIT}"'
    along = ["west", *(f"signal{number}" for number in range(1, len(CROSSINGS) + 1)), "east"]
    ways = list(pairwise(along))
    for number in range(1, len(CROSSINGS) + 1):
        ways += [(f"north{number}", f"signal{number}"), (f"signal{number}", f"south{number}")]
    both = [pair for start, end in ways for pair in ((start, end), (end, start))]
    rows = [f'<edge id="{start}_{end}" from="{start}" to="{end}" {shape}/>' for start, end in both]
    return f"<edges>{''.join(rows)}</edges>"


def _set_programs(network: Path) -> None:
    """Give every signal the same two phases, one after the other, with an offset of its own."""
    tree = ET.parse(network)
    along = {
        int(link.attrib["linkIndex"]): link.attrib["from"].split("_")[0] in ("west", "east")
        or link.attrib["from"].startswith("signal")
        for link in tree.iter("connection")
        if link.get("tl") == "signal1"
    }
    for logic in tree.iter("tlLogic"):
        for phase in list(logic):
            logic.remove(phase)
        logic.set("offset", str(OFFSETS[int(logic.attrib["id"].removeprefix("signal")) - 1]))
        for main, green in ((True, GREEN_ALONG), (False, GREEN_ACROSS)):
            for letter, lasts in (("g", green), ("y", YELLOW), ("r", ALL_RED)):
                state = "".join(letter if along[at] is main else "r" for at in sorted(along))
                ET.SubElement(logic, "phase", duration=str(lasts), state=state)
    tree.write(network)


def _path(network: Network) -> str:
    frame = network.frame()
    left, low, right, high = network.boundary
    lanes = [shape for shape, _width in lane_shapes(network.path, (left - 1.0, low - 9.0, right + 1.0, high + 9.0))]
    eastward = [shape for shape in lanes if shape[-1, 0] - shape[0, 0] > 100.0]
    y = float(eastward[0][0, 1])
    edges = ["west_signal1", "signal1_signal2", "signal2_signal3", "signal3_east"]
    lines = [
        "# Path for the middle of the ego's rear axle, WGS84, straight along signal_street.net.xml, eastward.",
        f"# {NOTE}.",
        f"# edges: {' '.join(edges)}",
        "latitude_deg,longitude_deg",
    ]
    length = EAST - WEST - 2.0 * RUN_IN
    for number in range(round(length / SPACING) + 1):
        place = frame.to_geodetic(left + RUN_IN + number * SPACING, y)
        lines.append(",".join(f"{math.degrees(angle):.{DECIMALS}f}" for angle in place))
    return "\n".join(lines) + "\n"


def main() -> None:
    """Build the files at the places given on the command line."""
    network, path = sys.argv[1:]
    build_signal_street(Path(network), Path(path))


if __name__ == "__main__":
    main()
