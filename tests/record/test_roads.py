"""The lanes around a path, in the record: those of the network, read back as they were; none in an older record."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import sumolib

from tests.analysis.made import moving, write
from vve_sumo.analysis.run import Run
from vve_sumo.drive.path_in_network import MAX_DISTANCE_FROM_PATH, read_path
from vve_sumo.record.layout import ROADS_SCHEMA
from vve_sumo.record.roads import write_roads
from vve_sumo.world.network import read_network


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    time = np.arange(0.0, 1.0, 0.02)
    return write(tmp_path / "drive", moving(time, 5.0 * time, np.full(len(time), 5.0)))


def _distance(line: np.ndarray, path: np.ndarray) -> float:
    """Least distance of two polylines' points, half a metre apart on either."""

    def dense(points: np.ndarray) -> np.ndarray:
        way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
        at = np.linspace(0.0, way[-1], 2 + int(2.0 * way[-1]))
        return np.column_stack([np.interp(at, way, column) for column in points.T])

    a, b = dense(line), dense(path)
    return float(min(np.hypot(a[:, 0] - x, a[:, 1] - y).min() for x, y in b[::4]))


@pytest.mark.thorough
@pytest.mark.parametrize("route", ["linden_cleveland", "linden_17th"])
def test_the_lanes_are_those_of_the_network_near_the_path(repository: Path, drive: Path, route: str) -> None:
    network = read_network(repository / "networks" / "linden.net.xml")
    laid = read_path(repository / "routes" / f"{route}.csv", network.frame(), network)
    write_roads(drive, laid.lanes)
    rows = {row["lane"]: row for row in Run(drive).arrow("roads").to_pylist()}
    path = np.array(laid.path.points)
    near = 0
    for edge in sumolib.net.readNet(str(network.path), withInternal=True).getEdges(withInternal=True):
        for lane in edge.getLanes():
            line, row = np.array([point[:2] for point in lane.getShape()]), rows.pop(lane.getID(), None)
            if row is not None:
                assert [*zip(row["x_m"], row["y_m"], strict=True)] == [*map(tuple, line)]
                assert row["width_m"] == lane.getWidth()
                ways = {link.getViaLaneID() or link.getToLane().getID() for link in lane.getOutgoing()}
                assert set(row["successors"]) == ways
            box = np.vstack((line.min(axis=0) - path.max(axis=0), path.min(axis=0) - line.max(axis=0)))
            if box.max() < 160.0:
                distance = _distance(line, path)
                near += distance < MAX_DISTANCE_FROM_PATH - 1.0
                assert row is not None or distance > MAX_DISTANCE_FROM_PATH - 1.0
                assert row is None or distance < MAX_DISTANCE_FROM_PATH + 1.0
            else:
                assert row is None
    assert not rows
    assert near > 50
    assert (drive / "roads.parquet").stat().st_size < 50_000


def test_a_record_of_the_layout_before_has_no_lanes(drive: Path) -> None:
    file = drive / "scenario.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"layout": 7}), encoding="utf-8")
    run = Run(drive)
    assert run.arrow("roads").equals(ROADS_SCHEMA.empty_table())
    assert run.table("roads").attrs["meanings"]["width_m"] == "of the lane"
