"""Networks from OpenDRIVE: lanes where the file's own formulae put them, its limits, its place, what is refused."""

from __future__ import annotations

import gzip
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from shapely import MultiLineString, Point

import vve_sumo as vve
from tests.conftest import SHARED_DATA
from tests.isolated import command, isolated
from tests.network_tools.opendrive_oracle import lanes
from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.demand import write_demand
from vve_sumo.network_tools.opendrive import BuiltTown, build_opendrive
from vve_sumo.network_tools.survey import record_path
from vve_sumo.world.network import shape_of

pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")

#: every road beside this checkout; one stands for those that differ in nothing that a network has
FILES = sorted(SHARED_DATA.rglob("*.xodr")) if SHARED_DATA.is_dir() else []
BESIDE = pytest.mark.skipif(not FILES, reason="roads are not beside this checkout (shared folder absent)")
EVERY = pytest.mark.parametrize("file", FILES, ids=[file.stem for file in FILES])
ORIGIN = (40.0, -83.0)
#: of a straight road that the paper's drive takes [m]
STRAIGHT = 200.0


def road(
    *, lanes: str = "", header: str = "", kind: str = "", more: str = "", rule: str = "", name: str = "OpenDRIVE"
) -> str:
    """The text of a file with one straight road of 300 m along 0.3 rad, by default a lane of 3.5 m each way."""
    lane = '<lane id="{}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
    ways = lanes or f"<left>{lane.format(1)}</left><right>{lane.format(-1)}</right>"
    return (
        f'<{name}><header revMajor="1" revMinor="6">{header}</header>'
        f'<road name="" length="300" id="7" junction="-1"{rule}>'
        f'<type s="0" type="town">{kind}</type><planView><geometry s="0" x="0" y="0" hdg="0.3" length="300"><line/>'
        f'</geometry></planView><lanes><laneSection s="0">{ways}</laneSection></lanes>{more}'
        f"</road></{name.split(maxsplit=1)[0]}>"
    )


def built(tmp_path: Path, text: str, origin: tuple[float, float] | None = ORIGIN) -> BuiltTown:
    file = tmp_path / "town.xodr"
    file.write_text(text)
    return build_opendrive(file, tmp_path / "town.net.xml", origin)


def driven_lanes(network: Path) -> dict[str, ET.Element]:
    edges = (edge for edge in ET.parse(network).getroot().iter("edge") if edge.get("function") is None)
    return {lane.attrib["id"]: lane for edge in edges for lane in edge.iter("lane")}


def place_of(file: Path) -> tuple[float, float] | None:
    """An origin for a file that needs one."""
    return None if "<geoReference>" in file.read_text() else ORIGIN


@BESIDE
@EVERY
def test_every_lane_lies_where_the_file_puts_it(file: Path, tmp_path: Path) -> None:
    town = build_opendrive(file, tmp_path / "town.net.xml", place_of(file))
    net = MultiLineString([shape_of(lane.attrib["shape"]) for lane in driven_lanes(town.network.path).values()])
    away, wide = [], 0.0
    for lane in lanes(file):
        if lane.narrowest > 1.5:  # a lane that begins or ends is none yet
            away += [net.distance(Point(point)) for point in lane.points[5:-5] + town.network.offset]
    # A lane has one width in SUMO: of cubetown's, 5.8 to 7 m wide and never twice the same, it takes one.
    allowed = 0.7 if file.stem == "cubetown" else 0.015
    assert max(away, default=wide) < allowed
    assert town.content.lanes > 0


@BESIDE
@EVERY
def test_it_lies_on_earth_where_the_file_says(file: Path, tmp_path: Path) -> None:
    town = build_opendrive(file, tmp_path / "town.net.xml", place_of(file))
    left, low, right, high = town.network.boundary
    if place_of(file) is not None:
        middle = town.network.frame().to_map(*map(math.radians, ORIGIN))
        assert middle == pytest.approx((0.5 * (left + right), 0.5 * (low + high)), abs=0.02)
        return
    text = ET.parse(file).getroot().findtext("header/geoReference") or ""
    kept = " ".join(term for term in text.split() if not term.startswith(("+geoidgrids", "+vunits")))
    longitude, latitude = pyproj.Transformer.from_crs(kept, "EPSG:4326", always_xy=True).transform(0.0, 0.0)
    assert town.network.frame().to_map(math.radians(latitude), math.radians(longitude)) == pytest.approx(
        town.network.offset, abs=0.01
    )


@BESIDE
def test_the_same_file_gives_the_same_bytes(tmp_path: Path) -> None:
    file = SHARED_DATA / "opendrive" / "Town02.xodr"
    first, again = (build_opendrive(file, tmp_path / name).network.path for name in ("a.net.xml", "b.net.xml"))
    assert first.read_bytes() == again.read_bytes()
    assert str(SHARED_DATA) not in first.read_text()


@BESIDE
def test_signals_and_what_is_left_out_are_said(tmp_path: Path) -> None:
    file = SHARED_DATA / "opendrive" / "cubetown.xodr"
    said = command("network", "build", str(file), "--out", "town.net.xml", cwd=tmp_path)
    assert said.returncode == 0
    assert said.stdout.splitlines() == [
        "11 roads with 18 lanes for cars; left out: 2 sidewalk",
        "3 lights at 1 junctions with signals; left out: 3 signs",
        "network written to town.net.xml; it keeps the licence of its map data",
    ]


@pytest.mark.parametrize(
    ("kind", "limit"),
    [
        ('<speed max="25" unit="mph"/>', 25 * 0.44704),
        ('<speed max="30" unit="km/h"/>', 30 / 3.6),
        ('<speed max="17"/>', 17.0),
        ('<speed max="no limit"/>', 13.89),
        ('<speed max="undefined"/>', 13.89),
        ("", 13.89),
    ],
)
def test_lanes_have_the_limits_of_their_road(kind: str, limit: float, tmp_path: Path) -> None:
    speeds = [
        float(lane.attrib["speed"]) for lane in driven_lanes(built(tmp_path, road(kind=kind)).network.path).values()
    ]
    assert speeds == pytest.approx([limit, limit], abs=0.005)


@pytest.mark.parametrize(
    ("own", "limit"),
    [
        ('<speed sOffset="0" max="8"/>', 8.0),
        ('<speed sOffset="0" max="20" unit="mph"/>', 20 * 0.44704),
        ('<speed sOffset="0" max="no limit"/>', 20.0),
        ('<speed sOffset="0" max="0"/>', 20.0),
    ],
)
def test_a_lanes_own_limit_goes_before_its_roads(own: str, limit: float, tmp_path: Path) -> None:
    inner = f'<width sOffset="0" a="3.5" b="0" c="0" d="0"/>{own}'
    right = f'<right><lane id="-1" type="driving">{inner}</lane></right>'
    network = built(tmp_path, road(lanes=right, kind='<speed max="20"/>')).network
    (lane,) = driven_lanes(network.path).values()
    assert float(lane.attrib["speed"]) == pytest.approx(limit, abs=0.005)


def test_cars_drive_on_lanes_for_cars_alone(tmp_path: Path) -> None:
    kinds = ("driving", "slipLane", "connectingRamp", "stop", "parking", "bus", "biking", "sidewalk", "shoulder")
    one = '<lane id="{}" type="{}"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane>'
    right = "".join(one.format(-number, kind) for number, kind in enumerate(kinds, 1))
    town = built(tmp_path, road(lanes=f"<right>{right}</right>"))
    assert len(driven_lanes(town.network.path)) == town.content.lanes == 3
    assert town.content.left_out == dict.fromkeys(sorted(kinds[3:]), 1)


OBJECTS = (
    '<objects><object id="1" type="crosswalk" s="50" t="0"/></objects><signals>'
    '<signal id="a" s="200" t="-5" zOffset="3" dynamic="yes" orientation="+" type="1000001" subtype="-1" value="-1"/>'
    '<signal id="b" s="220" t="-5" zOffset="3" dynamic="no" orientation="+" type="206" subtype="-1" value="-1"/>'
    "</signals>"
)


def test_lights_signs_and_crosswalks_are_counted(tmp_path: Path) -> None:
    elsewhere = '<signalReference id="of another town" s="10" t="0" orientation="+"/></signals>'
    town = built(tmp_path, road(more=OBJECTS.replace("</signals>", elsewhere)))
    assert (town.content.lights, town.content.signs, town.content.crossings, town.signals) == (1, 1, 1, 1)


UTM = "+proj=utm +zone=32 +datum=WGS84"


@pytest.mark.parametrize(
    "reference", [UTM, f"{UTM} +geoidgrids=no_such.gtx +vunits=m", "EPSG:32632", pyproj.CRS(32632).to_wkt()]
)
def test_georeferences_of_every_spelling_are_one_place(reference: str, tmp_path: Path) -> None:
    header = f'<geoReference><![CDATA[ {reference} ]]></geoReference><offset x="690000" y="5330000" z="0" hdg="0"/>'
    network = built(tmp_path, road(header=header), None).network
    frame = network.frame()
    assert not {"geoidgrids", "vunits"} & set(re.findall(r"\w+", network.projection))
    longitude, latitude = pyproj.Proj(UTM)(690000.0, 5330000.0, inverse=True)
    assert frame.to_map(math.radians(latitude), math.radians(longitude)) == pytest.approx((0.0, 0.0), abs=0.01)


def test_an_origin_takes_the_place_of_the_files_georeference(tmp_path: Path) -> None:
    header = f'<geoReference>{UTM}</geoReference><offset x="690000" y="5330000" z="0" hdg="0.5"/>'
    network = built(tmp_path, road(header=header)).network
    left, low, right, high = network.boundary
    latitude, longitude = network.frame().to_geodetic(0.5 * (left + right), 0.5 * (low + high))
    assert (math.degrees(latitude), math.degrees(longitude)) == pytest.approx(ORIGIN, abs=1e-6)


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({}, "it has no georeference; give --origin LAT,LON"),
        ({"header": "<geoReference> </geoReference>"}, "it has no georeference"),
        (
            {"header": "<geoReference>+proj=merc</geoReference>"},
            "expected .proj=tmerc or .proj=utm, got merc.*--origin",
        ),
        ({"header": "<geoReference>nonsense</geoReference>"}, "georeference: .*--origin"),
        (
            {"header": f"<geoReference>{UTM}</geoReference><offset x='9e9' y='0'/>"},
            "outside of what .*--origin",
        ),
        ({"header": f"<geoReference>{UTM}</geoReference><offset x='0' y='0' hdg='0.5'/>"}, "expected hdg 0, got 0.5"),
        ({"kind": '<speed max="50" unit="kmh"/>'}, "road 7: speed: expected m/s, km/h, mph, got 'kmh'"),
        (
            {"lanes": '<right><lane id="-1" type="driving"><border sOffset="0" a="-3"/></lane></right>'},
            "road 7: lane -1: expected its <width>, got its <border> alone",
        ),
        ({"rule": ' rule="LHT"'}, 'road 7: expected right-hand traffic, got rule="LHT"'),
        ({"name": "net"}, "expected the root <OpenDRIVE>, got <net>"),
    ],
)
def test_what_no_network_can_be_made_of_is_one_line_and_nothing_is_written(
    wrong: dict[str, Any], line: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=line) as raised:
        built(tmp_path, road(**wrong), None)
    assert "\n" not in str(raised.value)
    assert str(raised.value).startswith(str(tmp_path / "town.xodr"))
    assert not (tmp_path / "town.net.xml").exists()


@pytest.mark.parametrize(
    ("name", "content", "line"),
    [
        ("town.xodr", b"", "no element found"),
        ("town.xodr", b"<OpenDRIVE><road>", "can't be read"),
        ("town.xodr.gz", b"plain", "can't be read"),
        ("town.xodr", None, "No such file"),
        ("town.xodr", road(lanes='<right><lane id="-1" type="sidewalk"/></right>').encode(), "No edges loaded"),
    ],
)
def test_files_that_hold_no_road_are_refused_in_one_line(
    name: str, content: bytes | None, line: str, tmp_path: Path
) -> None:
    file = tmp_path / name
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=line) as raised:
        build_opendrive(file, tmp_path / "town.net.xml", ORIGIN)
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "town.net.xml").exists()


def test_packed_files_and_files_with_a_namespace_are_read(tmp_path: Path) -> None:
    plain = built(tmp_path, road()).network.path.read_text()
    packed = tmp_path / "town.xodr.gz"
    spaced = road(name='OpenDRIVE xmlns="http://code.asam.net/simulation/standard/opendrive_schema"')
    packed.write_bytes(gzip.compress(spaced.encode()))
    other = build_opendrive(packed, tmp_path / "other.net.xml", ORIGIN).network.path.read_text()
    assert other.replace("town.xodr.gz", "town.xodr") == plain


@pytest.mark.parametrize("option", [("--signals", "1"), ("--speeds", "x.typ.xml"), ("--rules", "eu")])
def test_options_of_street_maps_are_refused(option: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "town.xodr").write_text(road())
    said = command("network", "build", "town.xodr", "--out", "town.net.xml", *option, cwd=tmp_path)
    assert (said.returncode, len(said.stderr.splitlines())) == (2, 1)
    assert option[0] in said.stderr


@BESIDE
@pytest.mark.parametrize("name", ["Town02", "X-Intersection_NCAP"])
def test_traffic_drives_where_no_street_has_a_class(name: str, tmp_path: Path) -> None:
    file = next(one for one in FILES if one.stem == name)
    network = build_opendrive(file, tmp_path / "town.net.xml", place_of(file)).network.path
    drawn = write_demand(network, tmp_path / "town.rou.xml", level="light", seed=1)
    joined = {(one.attrib["from"], one.attrib["to"]) for one in ET.parse(network).getroot().iter("connection")}
    routes = [route.attrib["edges"].split() for route in ET.parse(tmp_path / "town.rou.xml").getroot().iter("route")]
    assert len(routes) == drawn.vehicles > 100
    assert {pair for route in routes for pair in pairwise(route)} <= joined
    assert "OpenStreetMap" not in (tmp_path / "town.rou.xml").read_text()


def straight_of(network: Path) -> tuple[str, float]:
    """Return an edge whose first lane has a straight of 200 m, and where the straight begins along it [m]."""
    for name, lane in driven_lanes(network).items():
        if not name.endswith("_0"):
            continue
        points = shape_of(lane.attrib["shape"])
        steps = np.hypot(*np.diff(points, axis=0).T)
        ways, s = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1])), np.concatenate([[0.0], np.cumsum(steps)])
        for first in range(len(ways)):
            bent = np.abs(ways[first:] - ways[first]) > 0.01
            last = first + int(np.argmax(bent)) if bent.any() else len(ways)
            if s[last] - s[first] >= STRAIGHT:
                return name.removesuffix("_0"), float(s[first])
    raise AssertionError(f"{network} has no straight of {STRAIGHT} m")


#: files with a straight of 200 m; of the others the longest is Town02's, 177 m
LONG = ["straight_500m", "X-Intersection_NCAP", "e6mini", "jolengatan", "curve_r100", "X-Intersection_NCAP_noRoadmarks"]
LONG += [file.stem for file in FILES if file.stem.startswith("StraightRoad_NCAP")]


def papers_drive(network: Path, path: Path) -> Mapping[str, Any]:
    """What the paper's drive takes to go along a path of a network, its car parked near the end of the straight."""
    return {
        "road.network": str(network),
        "road.demand": [],
        "ego.path": str(path),
        "obstacles.parked_car.at_m": STRAIGHT - 20.0,
    }


def _record(network: Path, edge: str, begin: float, out: Path) -> float:
    return record_path(network, edge, edge, out, start_position=begin, end_position=begin + STRAIGHT - 0.5).length


@BESIDE
@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("name", LONG)
def test_the_papers_drive_passes_on_a_straight(name: str, tmp_path: Path) -> None:
    file = next(one for one in FILES if one.stem == name)
    town = build_opendrive(file, tmp_path / "town.net.xml", place_of(file))
    edge, begin = straight_of(town.network.path)
    isolated(_record, town.network.path, edge, begin, tmp_path / "path.csv")
    scenario = vve.Scenario("parked_car").replace(papers_drive(town.network.path, tmp_path / "path.csv"))
    run = vve.drive(scenario, out=tmp_path / "record", progress=False)
    assert run.summary["failed"] == []
