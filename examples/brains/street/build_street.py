"""Builds the virtual road that certificates are driven on: straight, a wide bend to the left, straight again.

    python build_street.py     writes bend.net.xml and bend.csv beside this file

The bend is what shows on which side of its way a brain takes a target to be. The place is invented: no map data is in
it.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

from vve_sumo.frames import MapFrame
from vve_sumo.network_tools.build import netconvert, projection, tidy
from vve_sumo.world.network import read_network

ORIGIN = (40.0, -83.0)  # latitude, longitude: round numbers, not a place that was looked at [deg]
RADIUS, TURN = 70.0, math.radians(80.0)  # of the bend: 9.2 m/s take 1.2 m/s2 sideways
BEFORE, AFTER = 110.0, 150.0  # straight street before and behind the bend [m]
RUN_IN, RUN_OUT = 60.0, 20.0  # street before the path begins and behind its end [m]
SPACING = 1.0  # between two points of the path [m]
SHAPE_SPACING = 2.0  # between two points of the virtual road [m]
NOTE = "A street of our own making: it stands for no place on Earth and holds nobody's map data"
HERE = Path(__file__).parent


def place(s: float) -> tuple[float, float]:
    """Return x, y of the middle of the virtual road at a distance from its beginning [m]."""
    bend = RADIUS * TURN
    turned = min(max(s - BEFORE, 0.0), bend) / RADIUS
    straight = min(s, BEFORE)
    x, y = straight + RADIUS * math.sin(turned), RADIUS * (1.0 - math.cos(turned))
    rest = max(s - BEFORE - bend, 0.0)
    return x + rest * math.cos(TURN), y + rest * math.sin(TURN)


def main() -> None:
    """Write the virtual road and its path."""
    length, frame = BEFORE + RADIUS * TURN + AFTER, MapFrame(projection(ORIGIN))
    shape = [place(length * n / round(length / SHAPE_SPACING)) for n in range(round(length / SHAPE_SPACING) + 1)]

    def degrees(x: float, y: float) -> tuple[str, str]:
        latitude, longitude = (f"{math.degrees(angle):.10f}" for angle in frame.to_geodetic(x, y))
        return latitude, longitude

    lon_lat = [",".join(reversed(degrees(*point))) for point in shape]
    ends = dict(zip(("begin", "end"), (lon_lat[0].split(","), lon_lat[-1].split(",")), strict=True))
    nodes = "".join(f'<node id="{name}" x="{x}" y="{y}" type="dead_end"/>' for name, (x, y) in ends.items())
    lanes = 'numLanes="3" width="4.0" speed="14.0" spreadType="center"'
    edge = f'<edge id="bend" from="begin" to="end" {lanes} shape="{" ".join(lon_lat)}"/>'
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / name for name in ("nodes.nod.xml", "edges.edg.xml", "raw.net.xml")]
        files[0].write_text(f"<nodes>{nodes}</nodes>", encoding="utf-8")
        files[1].write_text(f"<edges>{edge}</edges>", encoding="utf-8")
        given = ["--node-files", str(files[0]), "--edge-files", str(files[1])]
        netconvert([*given, "--proj", projection(ORIGIN), "--no-turnarounds"], files[0], files[2])
        (HERE / "bend.net.xml").write_bytes(tidy(files[2], NOTE))
    read_network(HERE / "bend.net.xml")
    points = round((length - RUN_IN - RUN_OUT) / SPACING) + 1
    rows = [",".join(degrees(*place(RUN_IN + n * SPACING))) for n in range(points)]
    head = ["# Path for the middle of the ego's rear axle, WGS84, along the middle of bend.net.xml.", f"# {NOTE}."]
    text = "\n".join([*head, "# edges: bend", "latitude_deg,longitude_deg", *rows]) + "\n"
    (HERE / "bend.csv").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
