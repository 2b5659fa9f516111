"""The shipped proving ground: it is what its builder writes, straight and wide, and its path lies in its middle."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from vve_sumo.path import Path as Line
from vve_sumo.world.network import lane_shapes, read_network
from vve_sumo.world.proving_ground import LANE_WIDTH, LANES, LENGTH, NOTE, PATH_LENGTH, build_proving_ground


@pytest.fixture(scope="module")
def shipped(repository: Path) -> tuple[Path, Path]:
    return repository / "networks" / "proving_ground.net.xml", repository / "routes" / "proving_ground.csv"


def test_the_shipped_files_are_what_the_builder_writes(shipped, tmp_path):
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    network, path = tmp_path / "ground.net.xml", tmp_path / "ground.csv"
    build_proving_ground(network, path)
    assert (network.read_bytes(), path.read_bytes()) == tuple(file.read_bytes() for file in shipped)


def test_it_says_that_it_is_made_up_and_names_no_machine(shipped):
    for file in shipped:
        text = file.read_text()
        assert NOTE in text
        assert not any(word in text for word in ("/tmp", "/home", "/work", "generated on"))


def test_the_path_is_straight_in_the_middle_of_a_wide_street(shipped):
    network, path = shipped
    frame = read_network(network).frame()
    rows = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")][1:]
    placed = [frame.to_map(*(math.radians(float(cell)) for cell in row)) for row in rows]
    line = Line.from_points([x for x, _y in placed], [y for _x, y in placed])
    assert line.length == pytest.approx(PATH_LENGTH, abs=0.01)
    # A parallel of latitude is no straight line: over half the street it leaves one by less than a millimetre.
    assert np.abs(line.samples.curvature).max() < 1e-5
    lanes = lane_shapes(network, (-10.0, -50.0, LENGTH + 10.0, 50.0))
    assert [width for _shape, width in lanes] == [LANE_WIDTH] * LANES
    middles = sorted(float(shape[:, 1].mean()) for shape, _width in lanes)
    for x, y in placed:
        assert 0.0 < x < LENGTH
        assert y == pytest.approx(middles[LANES // 2], abs=0.01)
