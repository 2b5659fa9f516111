"""The shipped network: what it was built from, what it claims, and that traffic flows in it."""

from __future__ import annotations

import csv
import math
import random
import re
import sys
from pathlib import Path

import pyproj
import pytest
import sumolib

from tests.isolated import isolated
from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.build import ATTRIBUTION, RULES, build_network
from vve_sumo.world.network import read_network

SIGNALS = ("229685447", "229810925")  # Cleveland x 17th and Cleveland x Hudson
MPH = 0.44704

#: two residential streets crossing a tertiary one
TOWN = """<osm version="0.6"><bounds minlat="40.0" minlon="-83.0" maxlat="40.004" maxlon="-82.996"/>
{nodes}
<way id="10" version="1"><nd ref="1"/><nd ref="2"/><nd ref="3"/>
  <tag k="highway" v="tertiary"/><tag k="name" v="Main Street"/></way>
<way id="11" version="1"><nd ref="4"/><nd ref="2"/><nd ref="5"/>
  <tag k="highway" v="residential"/><tag k="name" v="Side Street"/></way></osm>"""
NODES = {1: (40.002, -82.999), 2: (40.002, -82.998), 3: (40.002, -82.997), 4: (40.001, -82.998), 5: (40.003, -82.998)}


@pytest.fixture(scope="module")
def speeds(repository: Path) -> Path:
    return repository / "networks" / "us_speeds.typ.xml"


@pytest.fixture(scope="module")
def net(linden: Path):
    return sumolib.net.readNet(str(linden))


@pytest.fixture
def town(tmp_path: Path) -> Path:
    file = tmp_path / "town.osm"
    nodes = "".join(f'<node id="{i}" lat="{lat}" lon="{lon}" version="1"/>' for i, (lat, lon) in NODES.items())
    file.write_text(TOWN.format(nodes=nodes))
    return file


@pytest.mark.thorough
def test_the_shipped_network_is_what_the_extract_gives(shared_data, linden, speeds, tmp_path):
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    extract = shared_data / "linden" / "linden_core.osm.xml.gz"
    built = build_network(extract, tmp_path / "linden.net.xml", speeds=speeds, signals=SIGNALS)
    assert built.network.path.read_bytes() == linden.read_bytes()


def test_no_date_and_no_path_of_a_machine_is_left(linden):
    text = linden.read_text()
    assert ATTRIBUTION in text[:300]
    assert not re.search(r"generated on|[\"' ]/(tmp|home|work|usr)/|netconvertConfiguration", text)


def test_north_and_scale_are_true_everywhere(linden):
    network = read_network(linden)
    left, low, right, high = network.boundary
    factors = pyproj.Proj(network.projection)
    for x in (left, (left + right) / 2, right):
        for y in (low, (low + high) / 2, high):
            latitude, longitude = (math.degrees(angle) for angle in network.frame().to_geodetic(x, y))
            found = factors.get_factors(longitude, latitude)
            assert abs(found.meridian_convergence) < 0.02
            assert abs(found.meridional_scale - 1.0) < 1e-6
            assert abs(found.parallel_scale - 1.0) < 1e-6


@pytest.mark.thorough
def test_rules_and_speeds_are_american(net):
    kinds = {node.getType() for node in net.getNodes()}
    assert kinds == {"priority", "traffic_light", "dead_end"}
    limits = {edge.getType(): round(edge.getSpeed() / MPH) for edge in net.getEdges()}
    assert limits["highway.residential"] == 25
    assert limits["highway.primary"] == limits["highway.secondary"] == limits["highway.tertiary"] == 35
    assert limits["highway.motorway"] == 65
    assert sum(node.getType() == "traffic_light" for node in net.getNodes()) == 6
    assert {edge.getName() for edge in net.getEdges()} >= {"Cleveland Avenue", "Seventeenth Avenue", "Hudson Street"}


#: how the landmarks' table abbreviates what the map spells out
NAMES = {"17th": "Seventeenth", "11th": "Eleventh"}


def _crossings(file: Path):
    with file.open() as table:
        for row in csv.DictReader(table):
            if " x " in row["name"] and row["quality"] != "INFERRED":
                words = [re.sub(r"^E ", "", name).split()[0] for name in row["name"].split(" x ")]
                yield [NAMES.get(word, word) for word in words], float(row["lat"]), float(row["lon"])


def test_crossings_lie_where_the_landmarks_say(shared_data, linden, net):
    frame = read_network(linden).frame()
    crossings = list(_crossings(shared_data / "linden" / "landmarks.csv"))
    assert len(crossings) == 10
    for streets, latitude, longitude in crossings:
        x, y = frame.to_map(math.radians(latitude), math.radians(longitude))
        meeting = [
            node.getCoord()
            for node in net.getNodes()
            if all(any(edge.getName().startswith(street) for edge in node.getIncoming()) for street in streets)
        ]
        assert min(math.dist((x, y), at) for at in meeting) < 10.0, streets


def _flow(network: str, seed: int, log: str) -> tuple[int, int, int, int, int, str]:
    """Send a car a second for 900 s between random streets; return loaded, inserted, arrived, teleported, collided."""
    import libsumo

    edges = [edge.getID() for edge in sumolib.net.readNet(network).getEdges() if edge.allows("passenger")]
    drawn = random.Random(seed)
    rules = ["--time-to-teleport", "-1", "--collision.action", "warn", "--collision.check-junctions", "true"]
    steps = ["--step-length", "0.5", "--no-step-log", "true", "--collision.mingap-factor", "0", "--seed", "1"]
    libsumo.start(["sumo", "-n", network, "--error-log", log, *rules, *steps])
    start_warnings = Path(log).read_text()
    loaded = inserted = arrived = teleported = 0
    collided: set[tuple[str, str]] = set()
    while loaded < 900 or libsumo.simulation.getMinExpectedNumber() > 0:
        while loaded < 900 and libsumo.simulation.getTime() >= loaded:
            route: tuple[str, ...] = ()
            while not route:
                route = libsumo.simulation.findRoute(*drawn.sample(edges, 2)).edges
            libsumo.route.add(f"r{loaded}", route)
            libsumo.vehicle.add(f"v{loaded}", f"r{loaded}", departLane="best")
            # as the shipped traffic: SUMO's own eagerness of 1 makes cars overtake into crossings
            libsumo.vehicle.setParameter(f"v{loaded}", "laneChangeModel.lcOpposite", "0.2")
            loaded += 1
        libsumo.simulationStep()
        inserted += libsumo.simulation.getDepartedNumber()
        arrived += libsumo.simulation.getArrivedNumber()
        teleported += libsumo.simulation.getStartingTeleportNumber()
        collided |= {(hit.collider, hit.victim) for hit in libsumo.simulation.getCollisions()}
        if libsumo.simulation.getTime() > 5000.0:
            break
    libsumo.close()
    return loaded, inserted, arrived, teleported, len(collided), start_warnings


@pytest.mark.slow
def test_nine_hundred_cars_drive_in_and_all_arrive(linden, tmp_path):
    found = isolated(_flow, str(linden), 1, str(tmp_path / "log.txt"))
    assert found == (900, 900, 900, 0, 0, "")


def test_a_town_of_ones_own_is_built(town, speeds, tmp_path):
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    built = build_network(town, tmp_path / "made" / "town.net.xml", speeds=speeds)
    net = sumolib.net.readNet(str(built.network.path))
    assert "+lat_0=40.002 +lon_0=-82.998 " in built.network.projection  # the middle of the bounds
    middle = net.getNode("2")
    assert middle.getType() == "priority"
    assert built.network.frame().to_map(*map(math.radians, NODES[2])) == pytest.approx(middle.getCoord(), abs=0.02)
    assert {(edge.getName(), round(edge.getSpeed() / MPH)) for edge in net.getEdges()} == {
        ("Main Street", 35),
        ("Side Street", 25),
    }


#: whether two equal streets cross by priority to the right, and the limit [km/h] of both, by the rules
RULES_OF = {"us": (False, 25.0 * 1.609344), "eu": (True, 50.0), "uk": (False, 30.0 * 1.609344)}


@pytest.mark.parametrize("name", RULES_OF)
def test_the_rules_of_a_country_are_built(town, repository, tmp_path, name):
    """Who goes first where two equal streets cross, how fast one may be there, and on which side traffic keeps."""
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    town.write_text(town.read_text().replace('v="tertiary"', 'v="residential"'))
    rules = RULES[name]
    speeds = repository / "networks" / rules.speeds
    file = build_network(town, tmp_path / "town.net.xml", speeds=speeds, rules=rules).network.path
    net = sumolib.net.readNet(str(file))
    to_the_right, limit = RULES_OF[name]
    assert (net.getNode("2").getType() == "right_before_left") is to_the_right
    eastward = next(edge for edge in net.getEdges() if edge.getName() == "Main Street" and "-" not in edge.getID())
    assert eastward.getSpeed() * 3.6 == pytest.approx(limit, abs=0.02)
    (_, lane_y), (_, node_y) = eastward.getLane(0).getShape()[0], eastward.getFromNode().getCoord()
    assert (lane_y > node_y + 1.0) is (name == "uk")
    assert (lane_y < node_y - 1.0) is (name != "uk")


def test_a_node_is_given_a_signal_on_request(town, speeds, tmp_path):
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    built = build_network(town, tmp_path / "t.net.xml", speeds=speeds, origin=(40.0, -83.0), signals=("2",))
    assert "+lat_0=40.0 +lon_0=-83.0 " in built.network.projection
    assert sumolib.net.readNet(str(built.network.path)).getNode("2").getType() == "traffic_light"


def test_without_netconvert_the_missing_extra_is_named(town, speeds, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "sumo", None)  # what Python itself does for a package that is known to be absent
    with pytest.raises(ConfigError, match=re.escape("pip install 'vve-sumo[network]'")):
        build_network(town, tmp_path / "t.net.xml", speeds=speeds)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<osm version='0.6'/>", "expected a <bounds> element"),
        ("plain words", "expected an OpenStreetMap extract in XML"),
        ("<osm><bounds minlat='a' minlon='0' maxlat='1' maxlon='1'/></osm>", "expected an OpenStreetMap extract"),
        ("<osm version='0.6'><bounds minlat='1' minlon='1' maxlat='2' maxlon='2'/></osm>", "netconvert refused it"),
    ],
)
def test_an_extract_that_is_none_is_refused(tmp_path, speeds, text, message):
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    file = tmp_path / "extract.osm"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        build_network(file, tmp_path / "out.net.xml", speeds=speeds)
    assert str(file) in str(caught.value)
    assert not (tmp_path / "out.net.xml").exists()


def test_missing_files_and_impossible_origins_are_refused(town, speeds, tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.osm does not exist"):
        build_network(tmp_path / "nowhere.osm", tmp_path / "t.net.xml", speeds=speeds)
    with pytest.raises(ConfigError, match="expected latitude, longitude in degrees"):
        build_network(town, tmp_path / "t.net.xml", speeds=speeds, origin=(-83.0, 40.0))
