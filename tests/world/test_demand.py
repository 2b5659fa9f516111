"""Drawn traffic: as much as asked for from the first second on, no contacts, nobody popping up on the ego's path."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import pytest
import sumolib

from tests.isolated import isolated
from vve_sumo.errors import ConfigError
from vve_sumo.world.demand import LEVELS, TYPES, write_demand

TIMES = (0.0, 30.0, 60.0, 120.0)
PATHS = ("linden_17th", "linden_loop")


@pytest.fixture(scope="module")
def linden(repository: Path) -> Path:
    return repository / "networks" / "linden.net.xml"


@pytest.fixture(scope="module")
def clear(repository: Path) -> set[str]:
    lines = [line for name in PATHS for line in (repository / "routes" / f"{name}.csv").read_text().splitlines()]
    return {edge for line in lines if line.startswith("# edges: ") for edge in line.split()[2:]}


def _run(network: str, routes: str, step: float, until: float, log: str) -> tuple[list[int], int, int, list[str]]:
    """Return vehicles on the streets at TIMES, contacts, teleports, and the log's lines about loading."""
    import libsumo

    rules = ["--time-to-teleport", "-1", "--collision.action", "warn", "--collision.check-junctions", "true"]
    steps = ["--step-length", str(step), "--step-method.ballistic", "true", "--collision.mingap-factor", "0"]
    libsumo.start(["sumo", "-n", network, "-r", routes, "--no-step-log", "true", "--error-log", log, *rules, *steps])
    counts: list[int] = []
    contacts = teleports = 0
    while libsumo.simulation.getTime() < until + step / 2:
        libsumo.simulationStep()
        contacts += len(libsumo.simulation.getCollisions())
        teleports += libsumo.simulation.getStartingTeleportNumber()
        if len(counts) < len(TIMES) and libsumo.simulation.getTime() > TIMES[len(counts)] + step / 2:
            counts.append(libsumo.vehicle.getIDCount())
    libsumo.close()
    warnings = [line for line in Path(log).read_text().splitlines() if "emergency braking" not in line]
    return counts, contacts, teleports, warnings


@pytest.mark.parametrize("level", LEVELS)
def test_the_streets_are_as_busy_as_asked_from_the_start(repository, linden, tmp_path, level):
    routes = repository / "routes" / f"linden_{level}.rou.xml"
    counts, contacts, teleports, warnings = isolated(_run, str(linden), str(routes), 0.1, 120.0, str(tmp_path / "log"))
    assert len(counts) == len(TIMES)
    assert all(0.75 * LEVELS[level] <= count <= 1.25 * LEVELS[level] for count in counts), counts
    assert (contacts, teleports, warnings) == (0, 0, [])


def test_heavy_traffic_touches_nobody_at_the_ticks_step(repository, linden, tmp_path):
    routes = repository / "routes" / "linden_heavy.rou.xml"
    counts, contacts, teleports, warnings = isolated(_run, str(linden), str(routes), 0.02, 120.0, str(tmp_path / "log"))
    assert len(counts) == len(TIMES)
    assert (contacts, teleports, warnings) == (0, 0, [])


@pytest.mark.parametrize("level", ["light", "heavy"])
def test_the_shipped_files_are_what_is_drawn(repository, linden, clear, tmp_path, level):
    written = write_demand(linden, tmp_path / "drawn.rou.xml", level=level, clear=clear)
    shipped = (repository / "routes" / f"linden_{level}.rou.xml").read_text()
    assert (tmp_path / "drawn.rou.xml").read_text() == shipped
    assert written.vehicles == shipped.count("<vehicle ")


@pytest.mark.parametrize("level", LEVELS)
def test_nobody_appears_or_vanishes_on_the_egos_paths(repository, clear, level):
    root = ET.parse(repository / "routes" / f"linden_{level}.rou.xml").getroot()
    ways = [route.attrib["edges"].split() for route in root.iter("route")]
    assert len(clear) > 25
    assert not any(way[0] in clear or way[-1] in clear for way in ways)
    assert any(clear & set(way) for way in ways)  # but they do drive there


def test_ways_are_connected_and_times_run_on_to_the_end(repository, linden):
    net = sumolib.net.readNet(str(linden))
    root = ET.parse(repository / "routes" / "linden_heavy.rou.xml").getroot()
    departures = [float(vehicle.attrib["depart"]) for vehicle in root.iter("vehicle")]
    assert departures == sorted(departures)
    assert 1190.0 < departures[-1] < 1200.0
    for route in root.iter("route"):
        way = [net.getEdge(name) for name in route.attrib["edges"].split()]
        assert all(other in one.getOutgoing() for one, other in pairwise(way))


def test_kinds_are_mixed_as_declared(repository):
    root = ET.parse(repository / "routes" / "linden_heavy.rou.xml").getroot()
    kinds = [vehicle.attrib["type"] for vehicle in root.iter("vehicle")]
    assert sum(kind.share for kind in TYPES.values()) == pytest.approx(1.0)
    for name, kind in TYPES.items():  # four standard deviations of a binomial count
        spread = 4.0 * (len(kinds) * kind.share * (1.0 - kind.share)) ** 0.5
        assert abs(kinds.count(name) - len(kinds) * kind.share) < spread


def test_another_seed_draws_other_traffic(linden, tmp_path):
    for seed in (1, 2):
        write_demand(linden, tmp_path / f"{seed}", level="light", duration=60.0, seed=seed)
    one, other = (ET.parse(tmp_path / f"{seed}").getroot() for seed in (1, 2))
    ways = [[route.attrib["edges"] for route in root.iter("route")] for root in (one, other)]
    assert len(set(ways[0]) & set(ways[1])) < len(ways[0]) / 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"level": "rush"}, "no traffic level 'rush'; known: light, moderate, heavy"),
        ({"level": "light", "duration": 0.0}, "expected a time above zero"),
        ({"level": "light", "duration": float("nan")}, "expected a time above zero"),
    ],
)
def test_traffic_that_cannot_be_drawn_is_refused(linden, tmp_path, options, message):
    with pytest.raises(ConfigError, match=message):
        write_demand(linden, tmp_path / "x.rou.xml", **options)
