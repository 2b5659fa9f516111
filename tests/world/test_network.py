"""What is read of a network file agrees with sumolib, libsumo and plain search."""

from __future__ import annotations

import gzip
import heapq
import math
import random
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import sumolib

from tests.isolated import isolated
from vve_sumo.errors import ConfigError
from vve_sumo.world.network import LANE_WIDTH, Roads, lane_shapes, lanes_near, read_network


@pytest.fixture(scope="module")
def roads(linden: Path) -> Roads:
    return Roads(linden)


def test_head_agrees_with_sumolib(linden, reference):
    network = read_network(linden)
    assert network.offset == tuple(reference.getLocationOffset())
    assert network.projection == reference._location["projParameter"]
    (left, low), (right, high) = reference.getBBoxXY()
    assert network.boundary == pytest.approx((left, low, right, high), abs=0.011)


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(40.00034, -82.975692), (39.993697, -82.981701), (40.0179, -82.957)]
)
def test_frame_agrees_with_sumolib(linden, reference, latitude, longitude):
    frame = read_network(linden).frame()
    x, y = frame.to_map(math.radians(latitude), math.radians(longitude))
    assert (x, y) == pytest.approx(reference.convertLonLat2XY(longitude, latitude), abs=1e-6)


def test_gzipped_network_reads_the_same(linden, tmp_path):
    packed = tmp_path / "linden.net.xml.gz"
    packed.write_bytes(gzip.compress(linden.read_bytes(), compresslevel=1))
    plain, zipped = read_network(linden), read_network(packed)
    assert (plain.projection, plain.offset, plain.boundary) == (zipped.projection, zipped.offset, zipped.boundary)
    box = (1000.0, 1000.0, 1100.0, 1100.0)
    assert len(lane_shapes(packed, box)) == len(lane_shapes(linden, box)) > 0


GOOD = 'netOffset="1,2" convBoundary="0,0,5,5" projParameter="+proj=tmerc +lat_0=40 +lon_0=-83 +k=1"'
BAD_FILES = [
    ("<routes/>", r"expected a SUMO network with root <net>, got <routes>"),
    ("<net><edge id='a'/></net>", r"expected a <location> element, found none"),
    ("hello", r"expected a SUMO network \(\.net\.xml\), it can't be read"),
    ("", r"expected a SUMO network \(\.net\.xml\), it can't be read"),
    (
        f"<net><location {GOOD.replace('+proj=tmerc +lat_0=40 +lon_0=-83 +k=1', '!')}/></net>",
        r"projParameter>, got '!'",
    ),
    (f"<net><location {GOOD.replace('1,2', '1,')}/></net>", r"expected 2 numbers in <location netOffset>, got '1,'"),
    (f"<net><location {GOOD.replace('1,2', '1,nan')}/></net>", r"expected 2 numbers in <location netOffset>"),
    (f"<net><location {GOOD.replace('0,0,5,5', '0,0')}/></net>", r"expected 4 numbers in <location convBoundary>"),
]


@pytest.mark.parametrize(("text", "message"), BAD_FILES)
def test_a_bad_file_is_named_with_what_was_expected(tmp_path, text, message):
    file = tmp_path / "street.net.xml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        read_network(file)
    assert str(file) in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.net\.xml does not exist"):
        read_network(tmp_path / "nowhere.net.xml")


def test_a_cut_off_archive_is_no_network(linden, tmp_path):
    file = tmp_path / "cut.net.xml.gz"
    file.write_bytes(gzip.compress(linden.read_bytes()[:100_000])[:2000])
    with pytest.raises(ConfigError, match="can't be read"):
        lane_shapes(file, (0.0, 0.0, 1.0, 1.0))


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    "box", [(1400.0, 1000.0, 1600.0, 1100.0), (0.0, 0.0, 300.0, 300.0), (-500.0, -500.0, -400.0, -400.0)]
)
def test_lane_shapes_are_those_of_sumolib_that_meet_the_box(linden, reference, box):
    expected = []
    for edge in reference.getEdges(withInternal=True):
        for lane in edge.getLanes():
            xs, ys = zip(*((p[0], p[1]) for p in lane.getShape()), strict=True)
            wide = lane.getWidth()
            near = max(xs) + wide >= box[0] and min(xs) - wide <= box[2]
            if near and max(ys) + wide >= box[1] and min(ys) - wide <= box[3]:
                expected.append((tuple(xs), tuple(ys), wide))
    found = [(tuple(shape[:, 0]), tuple(shape[:, 1]), width) for shape, width in lane_shapes(linden, box)]
    assert sorted(found) == sorted(expected)
    assert all(width == LANE_WIDTH for _, _, width in found)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("box", [(1400.0, 1000.0, 1600.0, 1100.0), (0.0, 0.0, 300.0, 300.0)])
def test_lanes_lead_where_sumolib_says(linden, reference, box):
    found = lanes_near(linden, box)
    assert [tuple(map(tuple, lane.shape)) for lane in found] == [
        tuple(map(tuple, shape)) for shape, _ in lane_shapes(linden, box)
    ]
    assert {lane.kind for lane in found} == {"lane", "junction"}
    for lane in found:
        known = reference.getLane(lane.name)
        assert lane.width == known.getWidth()
        assert [tuple(point[:2]) for point in known.getShape()] == [*map(tuple, lane.shape)]
        assert (lane.kind == "junction") == (known.getEdge().getFunction() == "internal")
        ways = {link.getViaLaneID() or link.getToLane().getID() for link in known.getOutgoing()}
        assert set(lane.successors) == ways


def test_lanes_on_foot_are_told_apart(tmp_path):
    sumo = pytest.importorskip("sumo", reason="eclipse-sumo (netgenerate) is not installed")
    file = tmp_path / "grid.net.xml"
    options = ["--grid", "--grid.number", "3", "--sidewalks.guess", "--crossings.guess", "--no-warnings"]
    subprocess.run([f"{sumo.SUMO_HOME}/bin/netgenerate", *options, "-o", str(file)], check=True, capture_output=True)
    found = {lane.name: lane.kind for lane in lanes_near(file, (-1e4, -1e4, 1e4, 1e4))}
    kinds = {"internal": "junction", "crossing": "crossing", "walkingarea": None}
    expected = {
        lane.getID(): kinds.get(edge.getFunction(), "walkway" if {*lane.getPermissions()} == {"pedestrian"} else "lane")
        for edge in sumolib.net.readNet(str(file), withInternal=True).getEdges(withInternal=True)
        for lane in edge.getLanes()
    }
    assert found == {name: kind for name, kind in expected.items() if kind is not None}
    assert {"lane", "junction", "walkway", "crossing"} == {*found.values()}


def _shortest(reference, start, end) -> float:
    """Length of the shortest way, by plain Dijkstra over edges with the lanes inside junctions counted."""
    queue, done = [(start.getLength(), start.getID())], set()
    while queue:
        length, name = heapq.heappop(queue)
        if name == end.getID():
            return length
        if name in done:
            continue
        done.add(name)
        for follower, connections in reference.getEdge(name).getOutgoing().items():
            inner = min(reference.getInternalPath([c])[1] if c.getViaLaneID() else 0.0 for c in connections)
            heapq.heappush(queue, (length + inner + follower.getLength(), follower.getID()))
    return math.inf


def _driven(reference, edges) -> float:
    total = sum(reference.getEdge(edge).getLength() for edge in edges)
    for one, other in pairwise(edges):
        connections = reference.getEdge(one).getOutgoing()[reference.getEdge(other)]
        total += min(reference.getInternalPath([c])[1] for c in connections)
    return total


@pytest.mark.thorough
def test_routes_are_connected_and_no_longer_than_dijkstras(roads, reference):
    drawn = random.Random(5)
    cars = [edge for edge in reference.getEdges(withInternal=False) if "motorway" not in edge.getType()]
    for _ in range(12):
        start, end = drawn.sample(cars, 2)
        edges = roads.route((start.getID(), end.getID()))
        assert (edges[0], edges[-1]) == (start.getID(), end.getID())
        assert _driven(reference, edges) == pytest.approx(_shortest(reference, start, end), abs=0.5)


def test_a_route_visits_its_stops_in_order(roads):
    stops = ("21354771", "30595075#6", "-44632404#4", "-21371933#31", "21354771")
    edges = roads.route(stops)
    remaining = iter(edges)
    assert all(stop in remaining for stop in stops)


@pytest.mark.parametrize(
    ("stops", "message"),
    [
        (("21354771",), "two or more edges, got 1"),
        (("21354771", "nowhere"), "there is no edge 'nowhere'"),
        (("264215382#0", "21351947"), "no way for a car"),
    ],
)
def test_a_route_that_cannot_be_is_refused(roads, stops, message):
    with pytest.raises(ConfigError, match=message):
        roads.route(stops)


def _converted(network: str, places: list[tuple[str, int, float]]) -> list[tuple[float, float]]:
    import libsumo

    libsumo.start(["sumo", "-n", network, "--no-step-log", "true"])
    points = [libsumo.simulation.convert2D(edge, position, lane) for edge, lane, position in places]
    libsumo.close()
    return points


@pytest.mark.thorough
def test_places_on_lanes_are_where_sumo_has_them(linden, roads):
    drawn = random.Random(7)
    lanes = [lane for edge in drawn.sample(roads.edges, 150) for lane in edge.getLanes()]
    places = [(lane.getEdge().getID(), lane.getIndex(), drawn.random() * lane.getLength()) for lane in lanes]
    points = isolated(_converted, str(linden), places)
    mine = [roads.place(f"{edge}_{lane}", position)[:2] for edge, lane, position in places]
    assert np.abs(np.array(points) - np.array(mine)).max() < 0.02


@pytest.mark.parametrize(
    ("lane", "position", "message"),
    [
        ("21354771_0", -1.0, "is not on it"),
        ("21354771_0", 1e9, "is not on it"),
        ("21354771_7", 1.0, "no lane"),
        ("x", 1.0, "no lane"),
    ],
)
def test_a_place_off_its_lane_is_refused(roads, lane, position, message):
    with pytest.raises(ConfigError, match=message):
        roads.place(lane, position)
