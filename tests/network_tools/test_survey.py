"""Recorded paths follow their lanes, can be driven, close where they shall, and come out the same again."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import sumolib
from scipy.interpolate import CubicSpline
from shapely.geometry import LineString, Point
from shapely.ops import unary_union

from tests.isolated import isolated
from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.build import ATTRIBUTION
from vve_sumo.network_tools.survey import Survey, record_path
from vve_sumo.world.network import read_network

MAIN = ("-21405924#2", "21354771")
BLOCK = ("21354787#13", "21371933#0", "-21405924#3", "-21405924#2", "-21371616#6")  # once around, left turns


def _points(network: Path, file: Path) -> np.ndarray:
    frame = read_network(network).frame()
    rows = [line.split(",") for line in file.read_text().splitlines() if line[0].isdigit()]
    return np.array([frame.to_map(math.radians(float(lat)), math.radians(float(lon))) for lat, lon in rows])


def _edges(file: Path) -> list[str]:
    return next(line for line in file.read_text().splitlines() if line.startswith("# edges: ")).split()[2:]


def _centre(network: Path, edges: list[str]):
    """Centre lines of the rightmost lanes of the edges and of the ways through the junctions between them."""
    net = sumolib.net.readNet(str(network), withInternal=True)
    lanes = [net.getEdge(edge).getLanes()[0] for edge in edges]
    lines = [LineString([p[:2] for p in lane.getShape()]) for lane in lanes]
    for one, other in pairwise(edges):
        for connection in net.getEdge(one).getOutgoing()[net.getEdge(other)]:
            names = net.getInternalPath([connection])[0]
            lines += [LineString([p[:2] for p in lane.getShape()]) for inner in names for lane in inner.getLanes()]
            via = connection.getViaLaneID()
            while via:
                lane = net.getLane(via)
                lines.append(LineString([p[:2] for p in lane.getShape()]))
                via = lane.getOutgoing()[0].getViaLaneID()
    return unary_union(lines)


def _curvature(points: np.ndarray) -> np.ndarray:
    """Curvature of the cubic spline over chord length [1/m], every 0.1 m: scipy's own, not the package's path."""
    chord = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    spline = CubicSpline(chord, points)
    at = np.arange(0.0, chord[-1], 0.1)
    (dx, dy), (ddx, ddy) = spline(at, 1).T, spline(at, 2).T
    return (dx * ddy - dy * ddx) / np.hypot(dx, dy) ** 3


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "tolerance", "length"), [("linden_17th", 0.3, (600.0, 900.0)), ("linden_loop", 0.75, (3000.0, 5000.0))]
)
def test_the_shipped_paths_follow_their_lanes_and_can_be_driven(repository, linden, name, tolerance, length):
    file = repository / "routes" / f"{name}.csv"
    points = _points(linden, file)
    curvature = _curvature(points)
    spans = np.hypot(*np.diff(points, axis=0).T)
    assert ATTRIBUTION in file.read_text()
    assert length[0] < spans.sum() < length[1]
    assert 0.85 < spans.min() <= spans.max() < 1.05
    assert np.abs(curvature).max() < 0.12
    assert np.abs(np.diff(curvature) / 0.1).max() < 0.015  # full lock to lock would take some 10 m
    centre = _centre(linden, _edges(file))
    assert max(centre.distance(Point(point)) for point in points) <= tolerance + 0.01


def test_the_shipped_path_ends_with_a_long_straight(repository, linden):
    points = _points(linden, repository / "routes" / "linden_17th.csv")
    curvature = _curvature(points)
    bend = np.flatnonzero(np.abs(curvature) > 0.01).max() / 10.0
    assert len(points) - bend > 450.0
    assert np.abs(curvature[int(bend * 10) + 50 :]).max() < 0.003


def test_the_shipped_loop_closes_smoothly(repository, linden):
    points = _points(linden, repository / "routes" / "linden_loop.csv")
    assert (points[0] == points[-1]).all()
    twice = np.concatenate([points[-50:-1], points[:50]])
    assert np.abs(_curvature(twice)).max() < 0.005  # the seam lies on a straight stretch


def _record(*arguments, **options) -> tuple[Survey, str]:
    survey = record_path(*arguments, **options)
    return survey, arguments[3].read_text()


def _record_main(network: Path, out: Path) -> tuple[Survey, str]:
    return _record(network, *MAIN, out, start_position=30.0, end_position=310.0)


def _record_block(network: Path, out: Path) -> tuple[Survey, str]:
    return _record(
        network, BLOCK[0], BLOCK[0], out, via=(*BLOCK[1:],), start_position=100.0, end_position=100.0, tolerance=0.5
    )


@pytest.mark.thorough
def test_the_shipped_path_is_what_the_recorder_gives(repository, linden, tmp_path):
    survey, _text = isolated(_record_main, linden, tmp_path / "path.csv")
    again, shipped = _points(linden, tmp_path / "path.csv"), _points(linden, repository / "routes" / "linden_17th.csv")
    assert again.shape == shipped.shape
    assert np.abs(again - shipped).max() < 1e-3
    assert survey.points == len(shipped)
    assert survey.length == pytest.approx(np.hypot(*np.diff(shipped, axis=0).T).sum(), abs=0.01)
    assert survey.deviation == pytest.approx(0.3, abs=1e-4)
    assert survey.curvature == pytest.approx(np.abs(_curvature(shipped)).max(), rel=0.02)
    assert survey.edges[0] == MAIN[0]
    assert survey.edges[-1] == MAIN[1]


@pytest.mark.slow
def test_a_drive_back_to_its_start_is_closed_and_smooth_across_the_seam(linden, tmp_path):
    survey, first = isolated(_record_block, linden, tmp_path / "block.csv")
    points = _points(linden, tmp_path / "block.csv")
    assert survey.edges == (*BLOCK, BLOCK[0])
    assert (points[0] == points[-1]).all()
    twice = np.concatenate([points[:-1], points])
    assert np.abs(_curvature(twice)).max() < 1.05 * survey.curvature
    _survey, second = isolated(_record_block, linden, tmp_path / "again.csv")
    assert first == second


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("start", "end", "options", "message"),
    [
        ("nowhere", "21354771", {}, "no edge 'nowhere'"),
        ("264215382#0", "21351947", {}, "no way for a car"),
        ("21354787#13", "21354771", {"start_position": 1e4}, "is not on it"),
        ("21354787#13", "21354771", {"end_position": -1.0}, "is not on it"),
        ("21354787#13", "21354771", {"tolerance": 0.0}, "expected a length above zero"),
        ("21354787#13", "21354771", {"tolerance": math.nan}, "expected a length above zero"),
    ],
)
def test_a_way_that_cannot_be_recorded_is_refused(linden, tmp_path, start, end, options, message):
    with pytest.raises(ConfigError, match=message):
        record_path(linden, start, end, tmp_path / "path.csv", **options)
    assert not (tmp_path / "path.csv").exists()


@pytest.mark.thorough
def test_a_path_that_the_car_cannot_follow_is_not_written(repository: Path, tmp_path: Path) -> None:
    out = tmp_path / "way.csv"
    network = repository / "networks" / "linden.net.xml"
    assert isolated(_refused_for, network, out, 1.0 / 30.0).startswith(f"{network}: from {MAIN[0]} to {MAIN[1]}: at ")
    assert not out.exists()
    assert isolated(_refused_for, network, out, 1.0 / 5.0) == ""
    assert out.exists()


def _refused_for(network: Path, out: Path, tightest: float) -> str:
    try:
        record_path(network, *MAIN, out, tightest=tightest)
    except ConfigError as error:
        return str(error)
    return ""
