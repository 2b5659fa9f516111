"""Builds a SUMO network from an OpenStreetMap extract, with the rules and speeds of a country's cities.

Runs netconvert (from the optional `eclipse-sumo` wheel) and tidies its output, so that the same extract gives the same
bytes anywhere. Knows nothing of drives; `networks/README.md` lists the assumptions about the streets and their reasons.
"""

from __future__ import annotations

import gzip
import importlib.util
import os
import subprocess
import tempfile
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.world.network import Network, read_network

#: source and licence of the map data; written at the top of every file that is built
ATTRIBUTION = (
    "Contains data (c) OpenStreetMap contributors, Open Database Licence 1.0, https://www.openstreetmap.org/copyright"
)

#: bytes of a network's beginning in which it bears the attribution of its map data
HEAD = 1000
#: decimals of the origin [deg]: 1e-5 deg is a metre
ORIGIN_DECIMALS = 5
BOUNDS = ("minlat", "minlon", "maxlat", "maxlon")

OPTIONS = (
    # one connected network of streets that cars may use, without nodes that only cut an edge in two
    *("--keep-edges.by-vclass", "passenger", "--keep-edges.components", "1", "--geometry.remove"),
    # streets that cross an arterial with a lateral jog get one junction
    *("--junctions.join", "--junctions.join-dist", "12"),
    # corners of 25 ft radius; SUMO's 4 m cannot be turned by a car that keeps to its lane
    *("--default.junctions.radius", "7.6"),
    # a car that waits to turn left keeps the oncoming lane free; with SUMO's 1.8 m, cars touched in jogged crossings
    *("--internal-junctions.vehicle-width", "2.8"),
    *("--tls.guess-signals", "--tls.discard-simple", "--tls.join", "--tls.default-type", "actuated"),
    # lets drivers pass a stopped car on the opposite lane
    "--opposites.guess",
    *("--no-turnarounds.except-deadend", "--output.street-names", "--output.original-names"),
)

NO_PRIORITY_TO_THE_RIGHT = ("--junctions.right-before-left.speed-threshold", "0")


class StreetRules(NamedTuple):
    """What of the streets' rules a map does not say."""

    speeds: str  #: file of the speed limits, in `networks/`
    options: tuple[str, ...]  #: of netconvert


#: by the name of the rules
RULES: Final = {
    # The minor road yields to the major one everywhere.
    "us": StreetRules("us_speeds.typ.xml", NO_PRIORITY_TO_THE_RIGHT),
    # Equal streets that meet at up to 50 km/h: who comes from the right goes first (Vienna Convention on Road Traffic,
    # article 18).
    "eu": StreetRules("eu_speeds.typ.xml", ("--junctions.right-before-left.speed-threshold", "13.9")),
    # Traffic keeps to the left. No road user has priority by the side from which he comes.
    "uk": StreetRules("uk_speeds.typ.xml", ("--lefthand", *NO_PRIORITY_TO_THE_RIGHT)),
}


class Built(NamedTuple):
    """A network that was just built."""

    network: Network
    warnings: tuple[str, ...]  #: netconvert's warnings, one line each


def build_network(
    osm: Path,
    out: Path,
    *,
    speeds: Path,
    rules: StreetRules = RULES["us"],
    origin: tuple[float, float] | None = None,
    signals: Sequence[str] = (),
) -> Built:
    """Build the network of an OSM extract (`.osm` or `.osm.xml`, plain or gzipped) and write it to `out`.

    `speeds` is a SUMO type map that overrides the stock one (such as `networks/us_speeds.typ.xml`). `rules` are those
    of the streets. `origin` is the latitude, longitude [deg] of the centre of the transverse Mercator projection, by
    default the middle of the extract's bounds. `signals` are OSM nodes with a traffic signal that the extract lacks.
    Raises ConfigError when a file or netconvert is missing, or netconvert fails.
    """
    for file in (osm, speeds):
        if not file.is_file():
            raise ConfigError(f"{file} does not exist")
    centre = origin if origin is not None else _middle(osm)
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "raw.net.xml"
        warnings = _convert(osm, raw, speeds, projection(centre), rules, signals)
        written = tidy(raw, ATTRIBUTION)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(written)
    return Built(read_network(out), warnings)


def projection(origin: tuple[float, float]) -> str:
    """Return the PROJ string of a projection centred on latitude, longitude [deg]; ConfigError for invalid ones."""
    latitude, longitude = origin
    if not (-80.0 <= latitude <= 84.0 and -180.0 <= longitude <= 180.0):
        raise ConfigError(f"origin {latitude}, {longitude}: expected latitude, longitude in degrees")
    return f"+proj=tmerc +lat_0={latitude} +lon_0={longitude} +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"


def attribution(network: Path) -> tuple[str, ...]:
    """Return the line that what is made of a network (plain or gzipped) has to bear; none where it bears none."""
    with gzip.open(network) if network.suffix == ".gz" else network.open("rb") as file:
        head = file.read(HEAD)
    return (ATTRIBUTION,) if ATTRIBUTION.encode() in head else ()


def _middle(osm: Path) -> tuple[float, float]:
    """Return the middle of the extract's bounds: latitude, longitude [deg]."""
    try:
        with gzip.open(osm) if osm.suffix == ".gz" else osm.open("rb") as file:
            for _event, element in ET.iterparse(file):
                if element.tag == "bounds":
                    low, left, high, right = (float(element.attrib[key]) for key in BOUNDS)
                    return round((low + high) / 2, ORIGIN_DECIMALS), round((left + right) / 2, ORIGIN_DECIMALS)
    except (ET.ParseError, KeyError, ValueError, OSError, EOFError, zlib.error) as error:
        raise ConfigError(f"{osm}: expected an OpenStreetMap extract in XML, it can't be read: {error}") from None
    raise ConfigError(f"{osm}: expected a <bounds> element, found none; say the centre by --origin LAT,LON")


def sumo_home() -> Path:
    """Return where the wheel `eclipse-sumo` has SUMO's programs and tools; raises ConfigError where it is missing."""
    found = importlib.util.find_spec("sumo")  # looked up, not imported: the import changes the environment
    home = Path(found.origin).parent if found is not None and found.origin is not None else None
    if home is None or not (home / "bin" / "netconvert").is_file():
        raise ConfigError("this takes SUMO's tools: pip install 'vve-sumo[network]'")
    return home


def _convert(
    osm: Path, out: Path, speeds: Path, projected: str, rules: StreetRules, signals: Sequence[str]
) -> tuple[str, ...]:
    types = f"{sumo_home() / 'data' / 'typemap' / 'osmNetconvert.typ.xml'},{speeds}"
    options = ["--osm-files", str(osm), "--type-files", types, "--proj", projected, *OPTIONS, *rules.options]
    options += ["--tls.set", ",".join(signals)] if signals else []
    return netconvert(options, osm, out)


def netconvert(options: Sequence[str], source: Path, out: Path) -> tuple[str, ...]:
    """Run netconvert with `options` and return its warnings; error messages name `source`.

    Raises ConfigError where netconvert is missing or fails.
    """
    home = sumo_home()
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
    """Give each pair of neighbouring opposite lanes one length; rounding makes a few differ by 1 cm."""
    lanes = {lane.attrib["id"]: lane for lane in root.iter("lane")}
    for lane in lanes.values():
        for opposite in (lanes[neighbour.attrib["lane"]] for neighbour in lane.iter("neigh")):
            shorter = min(lane.attrib["length"], opposite.attrib["length"], key=float)
            lane.set("length", shorter)
            opposite.set("length", shorter)
