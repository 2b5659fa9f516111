"""The shipped grounds: they are what their builder writes, straight and wide, their paths lie in a lane's middle."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from vve_sumo.network_tools.proving_ground import GROUNDS, LANE_WIDTH, LANES, NOTE, Ground, build_proving_ground
from vve_sumo.path import ReferencePath
from vve_sumo.world.network import lane_shapes, read_network


class Shipped(NamedTuple):
    ground: Ground
    network: Path
    path: Path


@pytest.fixture(scope="module", params=sorted(GROUNDS))
def shipped(request: pytest.FixtureRequest, repository: Path) -> Shipped:
    name = request.param
    return Shipped(GROUNDS[name], repository / "networks" / f"{name}.net.xml", repository / "routes" / f"{name}.csv")


def test_the_shipped_files_are_what_the_builder_writes(shipped, tmp_path):
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    network, path = tmp_path / "ground.net.xml", tmp_path / "ground.csv"
    build_proving_ground(network, path, shipped.ground)
    assert network.read_bytes() == shipped.network.read_bytes()
    assert path.read_bytes() == shipped.path.read_bytes()


def test_it_says_that_it_is_made_up_and_names_no_machine(shipped):
    for file in (shipped.network, shipped.path):
        text = file.read_text()
        assert NOTE in text
        assert not any(word in text for word in ("/tmp", "/home", "/work", "generated on"))


def test_the_path_is_straight_in_the_middle_of_a_wide_street(shipped):
    ground, network, path = shipped
    frame = read_network(network).frame()
    rows = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")][1:]
    placed = [frame.to_map(*(math.radians(float(cell)) for cell in row)) for row in rows]
    line = ReferencePath.from_points([x for x, _y in placed], [y for _x, y in placed])
    assert line.length == pytest.approx(ground.path_length, abs=0.01)
    assert np.abs(line.samples.curvature).max() < 1e-5
    lanes = lane_shapes(network, (-10.0, -50.0, ground.length + 10.0, 50.0))
    assert [width for _shape, width in lanes] == [LANE_WIDTH] * LANES * (2 if ground.two_way else 1)
    middles = sorted(float(shape[:, 1].mean()) for shape, _width in lanes if shape[0, 0] < shape[-1, 0])
    assert len(middles) == LANES
    for x, y in placed:
        assert 0.0 < x < ground.length
        assert y == pytest.approx(middles[LANES // 2], abs=0.01)
