"""What is read of junctions and signals agrees with sumolib; buildings are those that polyconvert writes."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

import pytest

from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.buildings import HEIGHT, STOREY, buildings_file, buildings_near
from vve_sumo.world.network import read_network
from vve_sumo.world.street_geometry import BEHIND, StreetGeometry, street_geometry

HOUSE = """<osm version="0.6">
  <node id="1" version="1" lat="40.0040" lon="-82.9710"/><node id="2" version="1" lat="40.0040" lon="-82.9708"/>
  <node id="3" version="1" lat="40.0041" lon="-82.9708"/><node id="4" version="1" lat="40.0041" lon="-82.9710"/>
  <way id="9" version="1"><nd ref="1"/><nd ref="2"/><nd ref="3"/><nd ref="4"/><nd ref="1"/>
    <tag k="building" v="house"/><tag k="building:levels" v="3"/></way>
</osm>"""


@pytest.fixture(scope="module")
def whole(linden: Path) -> StreetGeometry:
    return street_geometry(linden, read_network(linden).boundary)


def test_junctions_are_those_of_sumolib(whole, reference):
    shapes = [[point[:2] for point in node.getShape()] for node in reference.getNodes() if node.getType() != "internal"]
    assert [list(outline) for outline in whole.junctions] == [shape for shape in shapes if len(shape) > 2]


def test_every_lane_at_a_signal_has_a_stop_line_and_one_head(whole, reference):
    lanes = {link[0].getID(): link[0] for signal in reference.getTrafficLights() for link in signal.getConnections()}
    ends = sorted(tuple(lane.getShape()[-1][:2]) for lane in lanes.values())
    assert sorted((line.x, line.y) for line in whole.stop_lines) == ends
    assert len(whole.signals) == len(lanes)


def test_a_head_shows_a_link_of_its_lane_and_hangs_behind_the_junction(whole, reference):
    links = {
        (signal.getID(), index): (lane, leads)
        for signal in reference.getTrafficLights()
        for lane, leads, index in signal.getConnections()
    }
    for head in whole.signals:
        lane, _leads = links[head.id, head.link]
        (x0, y0), (x1, y1) = (point[:2] for point in lane.getShape()[-2:])
        assert head.heading == pytest.approx(math.atan2(y1 - y0, x1 - x0))
        ahead = (head.x - x1) * math.cos(head.heading) + (head.y - y1) * math.sin(head.heading)
        aside = (head.y - y1) * math.cos(head.heading) - (head.x - x1) * math.sin(head.heading)
        assert BEHIND < ahead < 60.0
        assert aside == pytest.approx(0.0, abs=1e-9)
        right = sum(one.getWidth() for one in lane.getEdge().getLanes()[: lane.getIndex()])
        assert head.reach == pytest.approx(lane.getWidth() / 2.0 + right + 1.0)


def test_only_what_is_near_is_read(linden, whole):
    near = street_geometry(linden, (800.0, 900.0, 1100.0, 1200.0))
    assert {*near.junctions} < {*whole.junctions}
    assert {head.id for head in near.signals} == {"229685447"}


def test_buildings_are_read_as_polyconvert_writes_them(linden, tmp_path):
    (tmp_path / "houses.osm.xml").write_text(HOUSE)
    kinds = tmp_path / "kinds.typ.xml"
    kinds.write_text('<polygonTypes><polygonType id="building" name="building"/></polygonTypes>')
    out = tmp_path / "linden.poly.xml"
    command = ["polyconvert", "--net-file", linden, "--osm-files", tmp_path / "houses.osm.xml", "--type-file", kinds]
    subprocess.run([*map(str, command), "--all-attributes", "--output-file", str(out)], check=True, capture_output=True)
    boundary = read_network(linden).boundary
    (house,) = buildings_near(out, boundary)
    assert house.height == pytest.approx(3 * STOREY)
    x, y = read_network(linden).frame().to_map(math.radians(40.0040), math.radians(-82.9710))
    assert min(math.dist((x, y), corner) for corner in house.outline) < 0.02
    assert buildings_near(out, (0.0, 0.0, 10.0, 10.0)) == []
    assert buildings_file(tmp_path / "linden.net.xml.gz") == out
    assert buildings_file(linden) is None


@pytest.mark.parametrize(
    ("said", "height"), [("7.5", 7.5), ("8 m", 8.0), ("tall", HEIGHT), ("-3", HEIGHT), ("nan", HEIGHT)]
)
def test_a_height_is_a_number_of_metres_or_assumed(tmp_path, said, height):
    file = tmp_path / "a.poly.xml"
    file.write_text(
        '<additional><poly id="a" type="building" shape="0,0 5,0 5,5">'
        f'<param key="height" value="{said}"/></poly></additional>'
    )
    assert buildings_near(file, (0.0, 0.0, 9.0, 9.0))[0].height == height


def test_a_file_that_is_none_is_named(tmp_path):
    file = tmp_path / "a.poly.xml"
    file.write_text("<additional><poly")
    with pytest.raises(ConfigError, match=r"a\.poly\.xml: expected SUMO polygons"):
        buildings_near(file, (0.0, 0.0, 9.0, 9.0))
