"""Builds a SUMO network from an OpenStreetMap extract, with the rules and speeds of a US city.

Runs netconvert (from the optional `eclipse-sumo` wheel) and tidies what it wrote, so that the same extract gives the
same bytes anywhere. Knows nothing of drives; `networks/README.md` tells what is assumed of the streets and why.
"""

from __future__ import annotations

import gzip
import importlib.util
import os
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.world.network import Network, read_network

#: what the network is made of and under which licence; stands at the top of every file that is built
ATTRIBUTION = (
    "Contains data (c) OpenStreetMap contributors, Open Database Licence 1.0, https://www.openstreetmap.org/copyright"
)

#: decimals of the origin [deg]: 1e-5 deg is a metre
ORIGIN_DECIMALS = 5
BOUNDS = ("minlat", "minlon", "maxlat", "maxlon")

OPTIONS = (
    # streets that cars may use, in one piece, without the points that carry no shape
    *("--keep-edges.by-vclass", "passenger", "--keep-edges.components", "1", "--geometry.remove"),
    # streets that jog across an arterial meet it in one junction
    *("--junctions.join", "--junctions.join-dist", "12"),
    # no right-before-left anywhere: a US minor road yields to the major one
    *("--junctions.right-before-left.speed-threshold", "0"),
    # corners of 25 ft radius; SUMO's 4 m cannot be turned by a car that keeps to its lane
    *("--default.junctions.radius", "7.6"),
    # where a left turn waits, the oncoming lane stays free; with SUMO's 1.8 m cars touched in jogged crossings
    *("--internal-junctions.vehicle-width", "2.8"),
    *("--tls.guess-signals", "--tls.discard-simple", "--tls.join", "--tls.default-type", "actuated"),
    # a stopped car can be passed through the opposite lane
    "--opposites.guess",
    *("--no-turnarounds.except-deadend", "--output.street-names", "--output.original-names"),
)


class Built(NamedTuple):
    """A network that was just built."""

    network: Network
    warnings: tuple[str, ...]  #: what netconvert was not sure about, a line each


def build_network(
    osm: Path, out: Path, *, speeds: Path, origin: tuple[float, float] | None = None, signals: Sequence[str] = ()
) -> Built:
    """Build the network of an OSM extract (`.osm` or `.osm.xml`, plain or gzipped) and write it to `out`.

    `speeds` is a SUMO type map laid over the stock one (`networks/us_speeds.typ.xml`). `origin` is the
    latitude, longitude [deg] that the transverse Mercator projection is centred on; by default the middle of the
    extract's bounds. `signals` are OSM nodes that carry a traffic signal although the extract does not say so.
    Raises ConfigError when a file or netconvert is missing or netconvert refuses.
    """
    for file in (osm, speeds):
        if not file.is_file():
            raise ConfigError(f"{file} does not exist")
    centre = origin if origin is not None else _middle(osm)
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "raw.net.xml"
        warnings = _convert(osm, raw, speeds, projection(centre), signals)
        written = tidy(raw, ATTRIBUTION)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(written)
    return Built(read_network(out), warnings)


def projection(origin: tuple[float, float]) -> str:
    """Return the PROJ string of a projection centred on latitude, longitude [deg]; raises ConfigError for no place."""
    latitude, longitude = origin
    if not (-80.0 <= latitude <= 84.0 and -180.0 <= longitude <= 180.0):
        raise ConfigError(f"origin {latitude}, {longitude}: expected latitude, longitude in degrees")
    return f"+proj=tmerc +lat_0={latitude} +lon_0={longitude} +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"


def _middle(osm: Path) -> tuple[float, float]:
    """Middle of the extract's bounds: latitude, longitude [deg]."""
    try:
        with gzip.open(osm) if osm.suffix == ".gz" else osm.open("rb") as file:
            for _event, element in ET.iterparse(file):
                if element.tag == "bounds":
                    low, left, high, right = (float(element.attrib[key]) for key in BOUNDS)
                    return round((low + high) / 2, ORIGIN_DECIMALS), round((left + right) / 2, ORIGIN_DECIMALS)
    except (ET.ParseError, KeyError, ValueError, OSError, EOFError) as error:
        raise ConfigError(f"{osm}: expected an OpenStreetMap extract in XML, it can't be read: {error}") from None
    raise ConfigError(f"{osm}: expected a <bounds> element, found none; give an origin")


def _sumo_home() -> Path:
    found = importlib.util.find_spec("sumo")  # looked up, not imported: the import changes the environment
    home = Path(found.origin).parent if found is not None and found.origin is not None else None
    if home is None or not (home / "bin" / "netconvert").is_file():
        raise ConfigError("building a network takes netconvert: pip install eclipse-sumo==1.28.0")
    return home


def _convert(osm: Path, out: Path, speeds: Path, projected: str, signals: Sequence[str]) -> tuple[str, ...]:
    types = f"{_sumo_home() / 'data' / 'typemap' / 'osmNetconvert.typ.xml'},{speeds}"
    options = ["--osm-files", str(osm), "--type-files", types, "--proj", projected, *OPTIONS]
    options += ["--tls.set", ",".join(signals)] if signals else []
    return netconvert(options, osm, out)


def netconvert(options: Sequence[str], source: Path, out: Path) -> tuple[str, ...]:
    """Run netconvert with `options` and return its warnings; `source` is what a ConfigError of it names.

    Raises ConfigError where netconvert is missing or refuses.
    """
    home = _sumo_home()
    command = [str(home / "bin" / "netconvert"), *options, "--output-file", str(out)]
    environment = os.environ | {"SUMO_HOME": str(home), "PROJ_LIB": str(home / "data" / "proj")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    lines = done.stderr.splitlines()
    if done.returncode != 0 or not out.is_file():
        errors = [line for line in lines if line.startswith("Error")] or lines or ["no message"]
        raise ConfigError(f"{source}: netconvert refused it: {errors[0]}")
    return tuple(line.removeprefix("Warning: ") for line in lines if line.startswith("Warning"))


def tidy(raw: Path, note: str) -> bytes:
    """Return a network under a `note`, without netconvert's header (date, paths), opposite lanes equally long."""
    root = ET.parse(raw).getroot()
    _equal_opposites(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<!-- {note} -->\n'.encode() + ET.tostring(root) + b"\n"


def _equal_opposites(root: ET.Element) -> None:
    """Give lanes that lie side by side in opposite directions one length; rounding leaves a few 1 cm apart."""
    lanes = {lane.attrib["id"]: lane for lane in root.iter("lane")}
    for lane in lanes.values():
        for opposite in (lanes[neighbour.attrib["lane"]] for neighbour in lane.iter("neigh")):
            shorter = min(lane.attrib["length"], opposite.attrib["length"], key=float)
            lane.set("length", shorter)
            opposite.set("length", shorter)
