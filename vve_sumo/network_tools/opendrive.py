"""Builds a SUMO network from an OpenDRIVE file: its lanes for cars, its speed limits and its signals.

What netconvert would take wrongly without a word is put right before (types of lanes, speed limits, the georeference)
or refused. Knows nothing of drives. ASAM OpenDRIVE 1.4 to 1.8.
"""

from __future__ import annotations

import gzip
import math
import re
import tempfile
import warnings
import xml.etree.ElementTree as ET
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import pyproj
from pyproj.exceptions import ProjError

from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.network_tools.build import netconvert, projection, tidy
from vve_sumo.world.network import Network, read_network, signals

#: endings of a file's name that make it an OpenDRIVE file
ENDINGS: Final = (".xodr", ".xodr.gz")
#: types of lanes that a car may drive along
DRIVEN: Final = frozenset({"driving", "entry", "exit", "onRamp", "offRamp", "mwyEntry", "mwyExit", "roadWorks"})
#: types that netconvert does not know, and those that stand for them
SAME_AS: Final = {"connectingRamp": "onRamp", "slipLane": "driving"}
#: a type that netconvert leaves out. It would let cars drive on hard shoulders ("stop") and in parking bays
LEFT_OUT: Final = "none"
#: metres a second in the units of speed limits
UNITS: Final = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}
#: terms of a PROJ string about heights, which play no part in a network, and whose grids are seldom installed
OF_HEIGHTS: Final = ("+geoidgrids", "+vunits", "+vto_meter", "+geoid_crs")
#: a place of the network that is projected back and forth comes out within this [m]
ROUND_TRIP: Final = 1e-3
ADVICE: Final = "give --origin LAT,LON to lay the middle of the road network somewhere else"

OPTIONS: Final = (
    *("--keep-edges.by-vclass", "passenger"),
    # lanes inside junctions run as the file draws them
    "--opendrive.internal-shapes",
    # a car that waits to turn left keeps the oncoming lane free; with SUMO's 1.8 m, cars touch in jogged crossings
    *("--internal-junctions.vehicle-width", "2.8"),
    *("--tls.default-type", "actuated"),
    # lets drivers pass a stopped car on the opposite lane
    "--opposites.guess",
    *("--no-turnarounds.except-deadend", "--output.street-names", "--output.original-names"),
)


class Content(NamedTuple):
    """What an OpenDRIVE file holds, as far as a network may have it."""

    roads: int
    lanes: int  #: for cars, one for each lane section
    left_out: Mapping[str, int]  #: other lanes, by their type
    lights: int  #: signals that change
    signs: int  #: signals that do not
    crossings: int  #: crosswalks


class BuiltTown(NamedTuple):
    """A network that was just built from an OpenDRIVE file."""

    network: Network
    warnings: tuple[str, ...]  #: netconvert's warnings, one line each
    content: Content
    signals: int  #: junctions of the network with a signal


def is_opendrive(file: Path) -> bool:
    """Return whether a file's name says that it is OpenDRIVE."""
    return file.name.lower().endswith(ENDINGS)


def build_opendrive(file: Path, out: Path, origin: tuple[float, float] | None = None) -> BuiltTown:
    """Build the network of an OpenDRIVE file (`.xodr`, plain or gzipped) and write it to `out`.

    Where the file has no georeference, `origin` is the latitude, longitude [deg] of the middle of the road network;
    where it has one, the origin takes its place. Raises ConfigError, and writes nothing, where the file is no
    OpenDRIVE, has left-hand traffic or a georeference that no network here can have, and where netconvert is missing or
    fails.
    """
    root = _read(file)
    _refuse(root, file)
    reference = _georeference(root, file) if origin is None else None
    if origin is not None:
        projection(origin)  # raises for an invalid one before anything is converted
    content = _content(root)
    _prepare(root, reference)
    with tempfile.TemporaryDirectory() as folder:
        plain, raw = Path(folder) / "plain.xodr", Path(folder) / "raw.net.xml"
        ET.ElementTree(root).write(plain, encoding="utf-8", xml_declaration=True)
        found = netconvert(["--opendrive-files", str(plain), *OPTIONS], file, raw)
        _locate(raw, reference, origin)
        _require_place(read_network(raw), file)
        written = tidy(raw, _note(root, file))
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(written)
    return BuiltTown(read_network(out), found, content, len(signals(out)))


def _read(file: Path) -> ET.Element:
    """Return the file's root element, its tags without namespaces."""
    try:
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as opened:
            root = ET.parse(opened).getroot()
    except (ET.ParseError, OSError, EOFError, zlib.error) as error:
        reason = f"{error.strerror}" if isinstance(error, OSError) and error.strerror else str(error)
        raise ConfigError(f"{file}: expected OpenDRIVE, it can't be read: {reason}") from None
    for element in root.iter():
        if isinstance(element.tag, str):
            element.tag = element.tag.rpartition("}")[2]
    if root.tag != "OpenDRIVE":
        raise ConfigError(f"{file}: expected the root <OpenDRIVE>, got <{root.tag}>")
    return root


def _refuse(root: ET.Element, file: Path) -> None:
    """Raise ConfigError for what netconvert would take wrongly without a word, and nothing here puts right."""
    for road in root.iter("road"):
        where = f"{file}: road {road.get('id')}"
        if road.get("rule", "RHT").upper() == "LHT":
            raise ConfigError(f'{where}: expected right-hand traffic, got rule="LHT"')
        for speed in road.iter("speed"):
            if (unit := speed.get("unit", "m/s")) not in UNITS:
                raise ConfigError(f"{where}: speed: expected {', '.join(UNITS)}, got {unit!r}")
    for road, _start, lane in _lanes(root):
        if lane.find("border") is not None and lane.find("width") is None:
            where = f"{file}: road {road.get('id')}: lane {lane.get('id')}"
            raise ConfigError(f"{where}: expected its <width>, got its <border> alone")


def _georeference(root: ET.Element, file: Path) -> str:
    """Return the PROJ string of a file's georeference, without what it says of heights; raises ConfigError."""
    text = " ".join((root.findtext("header/geoReference") or "").split())
    if not text:
        raise ConfigError(f"{file}: it has no georeference; {ADVICE}")
    shift = root.find("header/offset")
    turned = "0" if shift is None else shift.get("hdg", "0")
    if _number(turned) != 0.0:
        raise ConfigError(f"{file}: header offset: expected hdg 0, got {turned}; {ADVICE}")
    try:
        planar = " ".join(term for term in _proj_string(text).split() if not term.startswith(OF_HEIGHTS))
        MapFrame(planar)
    except (ConfigError, ProjError) as error:
        reason = " ".join(str(error).split()).removeprefix("projection ")
        raise ConfigError(f"{file}: georeference: {reason}; {ADVICE}") from None
    return planar


def _proj_string(text: str) -> str:
    """Return a PROJ string as it is, and that of a code or well-known text; raises ProjError."""
    if text.startswith("+proj"):
        return text
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the string says less than the text: names, areas of use
        return pyproj.CRS.from_user_input(text).to_proj4()


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _lanes(root: ET.Element) -> Iterator[tuple[ET.Element, float, ET.Element]]:
    """Yield road, start of the lane section [m] and lane, for every lane beside a road's middle."""
    for road in root.iter("road"):
        for section in road.iterfind("lanes/laneSection"):
            for side in ("left", "right"):
                for lane in section.iterfind(f"{side}/lane"):
                    yield road, _number(section.get("s", "0")), lane


def _content(root: ET.Element) -> Content:
    kinds = Counter(lane.get("type", LEFT_OUT) for _road, _start, lane in _lanes(root))
    driven = DRIVEN | SAME_AS.keys()
    changing = [signal.get("dynamic", "no").lower() == "yes" for signal in root.iterfind("road/signals/signal")]
    return Content(
        roads=len(root.findall("road")),
        lanes=sum(count for kind, count in kinds.items() if kind in driven),
        left_out={kind: count for kind, count in sorted(kinds.items()) if kind not in driven},
        lights=sum(changing),
        signs=len(changing) - sum(changing),
        crossings=sum(thing.get("type", "").lower() == "crosswalk" for thing in root.iterfind("road/objects/object")),
    )


def _prepare(root: ET.Element, reference: str | None) -> None:
    """Make a file say what netconvert takes: types of lanes, a speed limit for each lane, where it lies on Earth.

    Without a `reference` it lies nowhere, and its coordinates are left as they are.
    """
    for road, start, lane in _lanes(root):
        kind = lane.get("type", LEFT_OUT)
        kind = SAME_AS.get(kind, kind)
        lane.set("type", kind if kind in DRIVEN else LEFT_OUT)
        if kind in DRIVEN:
            lane.extend(_stated(lane) or _limits(road.findall("type"), start))
    known = {signal.get("id") for signal in root.iterfind("road/signals/signal")}
    for signals_of in root.iterfind("road/signals"):
        for reference_to in signals_of.findall("signalReference"):
            if reference_to.get("id") not in known:  # as in a part that was cut out of a town
                signals_of.remove(reference_to)
    header = root.find("header")
    if header is None:
        return
    for tag in ("geoReference", *(("offset",) if reference is None else ())):
        for element in header.findall(tag):
            header.remove(element)
    for shift in header.iter("offset"):
        shift.attrib |= {axis: shift.get(axis, "0") for axis in ("x", "y", "z", "hdg")}
    if reference is not None:
        ET.SubElement(header, "geoReference").text = reference


def _stated(lane: ET.Element) -> list[ET.Element]:
    """Take a lane's own speed limits out of it, and return those that are numbers, in m/s."""
    found = []
    for speed in lane.findall("speed"):
        lane.remove(speed)
        if (limit := _metres_a_second(speed)) is not None:
            found.append(ET.Element("speed", {"sOffset": speed.get("sOffset", "0"), "max": f"{limit:.4f}"}))
    return found


def _limits(types: Iterable[ET.Element], start: float) -> Iterator[ET.Element]:
    """Yield the speed limits of a road as netconvert reads them: a lane's, whose section begins at `start` [m]."""
    known = sorted((_number(one.get("s", "0")), limit) for one in types if (limit := _limit(one)) is not None)
    before = [limit for s, limit in known if s <= start]
    here = [(0.0, before[-1])] if before else []
    for s, limit in here + [(s - start, limit) for s, limit in known if s > start]:
        yield ET.Element("speed", {"sOffset": f"{s:.6f}", "max": f"{limit:.4f}"})


def _limit(kind: ET.Element) -> float | None:
    """Return the speed limit of a piece of road [m/s]; None where it states no number."""
    speed = kind.find("speed")
    return None if speed is None else _metres_a_second(speed)


def _metres_a_second(speed: ET.Element) -> float | None:
    """Return a speed limit [m/s]; None where it is no number, as "no limit", or not above 0."""
    limit = _number(speed.get("max", "")) * UNITS.get(speed.get("unit", "m/s"), math.nan)
    return limit if math.isfinite(limit) and limit > 0.0 else None


def _locate(raw: Path, reference: str | None, origin: tuple[float, float] | None) -> None:
    """Write into a network where it lies on Earth: by a reference, or with its middle at an origin [deg]."""
    tree = ET.parse(raw)
    location = tree.getroot().find("location")
    assert location is not None  # netconvert always writes one
    if origin is not None:
        (x, y), (left, low, right, high) = (
            [float(number) for number in location.attrib[key].split(",")] for key in ("netOffset", "convBoundary")
        )
        middle = f"+x_0={0.5 * (left + right) - x:.2f} +y_0={0.5 * (low + high) - y:.2f}"
        reference = projection(origin).replace("+x_0=0 +y_0=0", middle)
    assert reference is not None
    location.set("projParameter", reference)
    tree.write(raw, encoding="utf-8", xml_declaration=True)


def _require_place(network: Network, file: Path) -> None:
    """Raise ConfigError where the network lies outside of what its projection is good for."""
    frame, (left, low, right, high) = network.frame(), network.boundary
    for x, y in ((left, low), (left, high), (right, low), (right, high)):
        latitude, longitude = frame.to_geodetic(x, y)
        again = frame.to_map(latitude, longitude)
        if not (math.dist((x, y), again) <= ROUND_TRIP and abs(frame.convergence(latitude, longitude)) < 1.0):
            where = f"its coordinates lie outside of what {network.projection!r} is good for"
            raise ConfigError(f"{file}: georeference: {where}; {ADVICE}")


def _note(root: ET.Element, file: Path) -> str:
    """Return the line at the top of the network's file."""
    header = root.find("header")
    said = {} if header is None else header.attrib
    by = f" by {said['vendor']}" if said.get("vendor") else ""
    text = f"Built from {file.name}, OpenDRIVE {said.get('revMajor', '?')}.{said.get('revMinor', '?')}{by}"
    return re.sub(r"[^ -~]|-(?=-)|-$", "", text)
