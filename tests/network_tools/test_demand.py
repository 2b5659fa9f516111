"""Drawn traffic: as much as asked for from the first second on, no contacts, nobody popping up on the ego's path."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import pytest
import sumolib

from tests.exhaustive import with_slow
from tests.isolated import isolated
from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.demand import DRIVERS, LEVELS, TYPES, _type, write_demand

TIMES = (0.0, 30.0, 60.0, 120.0)
PATHS = ("linden_17th", "linden_loop")
LEVEL = {**{f"linden_{level}": level for level in LEVELS}, "linden_17th_light": "light"}  #: of each shipped file


def _route(repository: Path, path: str) -> list[str]:
    lines = (repository / "routes" / f"{path}.csv").read_text().splitlines()
    return next(line.split()[2:] for line in lines if line.startswith("# edges: "))


@pytest.fixture(scope="module")
def clear(repository: Path) -> set[str]:
    return {edge for name in PATHS for edge in _route(repository, name)}


def _ways(repository: Path, name: str) -> list[list[str]]:
    root = ET.parse(repository / "routes" / f"{name}.rou.xml").getroot()
    return [route.attrib["edges"].split() for route in root.iter("route")]


def _prior(network: Path, route: list[str]) -> set[tuple[str, str]]:
    """Ways through junctions that a route must give way to, from the file's own table: link i answers to link j."""
    root = ET.parse(network).getroot()
    links = {link.attrib["via"]: link for link in root.iter("connection") if "via" in link.attrib}
    found = set()
    for junction in root.iter("junction"):
        inside = [links[lane] for lane in junction.attrib["intLanes"].split() if lane in links]
        ways = [(link.attrib["from"], link.attrib["to"]) for link in inside]
        for request in junction.iter("request"):
            index, response = int(request.attrib["index"]), request.attrib["response"][::-1]
            if index < len(ways) and ways[index] in pairwise(route):
                found |= {way for way, before in zip(ways, response, strict=False) if before == "1"}
    return found


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


@pytest.mark.thorough
@pytest.mark.parametrize("name", LEVEL)
def test_the_streets_are_as_busy_as_asked_from_the_start(repository, linden, tmp_path, name):
    routes, level = repository / "routes" / f"{name}.rou.xml", LEVEL[name]
    counts, contacts, teleports, warnings = isolated(_run, str(linden), str(routes), 0.1, 120.0, str(tmp_path / "log"))
    assert len(counts) == len(TIMES)
    assert all(0.75 * LEVELS[level] <= count <= 1.25 * LEVELS[level] for count in counts), counts
    assert (contacts, teleports, warnings) == (0, 0, [])


@pytest.mark.thorough
def test_heavy_traffic_touches_nobody_at_the_ticks_step(repository, linden, tmp_path):
    routes = repository / "routes" / "linden_heavy.rou.xml"
    counts, contacts, teleports, warnings = isolated(_run, str(linden), str(routes), 0.02, 120.0, str(tmp_path / "log"))
    assert len(counts) == len(TIMES)
    assert (contacts, teleports, warnings) == (0, 0, [])


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", with_slow(["linden_light", "linden_heavy", "linden_17th_light"], lambda name: name == "linden_17th_light")
)
def test_the_shipped_files_are_what_is_drawn(repository, linden, clear, tmp_path, name):
    unhindered = _route(repository, "linden_17th") if name == "linden_17th_light" else ()
    drawn = tmp_path / "drawn.rou.xml"
    written = write_demand(linden, drawn, level=LEVEL[name], clear=clear, unhindered=unhindered)
    shipped = (repository / "routes" / f"{name}.rou.xml").read_text()
    assert drawn.read_text() == shipped
    assert written.vehicles == shipped.count("<vehicle ")


@pytest.mark.parametrize("name", LEVEL)
def test_nobody_appears_or_vanishes_on_the_egos_paths(repository, clear, name):
    ways = _ways(repository, name)
    assert len(clear) > 25
    assert not any(way[0] in clear or way[-1] in clear for way in ways)
    assert any(clear & set(way) for way in ways)  # but they do drive there


@pytest.mark.thorough
def test_nobody_has_the_right_of_way_over_the_demonstration(repository, linden):
    """The ego gives way to nobody; yet somebody comes towards it, and somebody drives on its street."""
    route = _route(repository, "linden_17th")
    prior, (_, _, there, beyond) = _prior(linden, route), route
    assert len({end for _, end in prior}) > 4
    for name, hinders in (("linden_17th_light", False), ("linden_light", True)):
        assert any(prior & set(pairwise(way)) for way in _ways(repository, name)) is hinders
    ways = _ways(repository, "linden_17th_light")
    assert sum(f"-{beyond}" in way for way in ways) > 5
    assert any(beyond in way and there not in way for way in ways)


@pytest.mark.thorough
def test_who_would_have_the_right_of_way_goes_around(linden, repository, tmp_path):
    """A route over a signal: there everybody who crosses it has the right of way at times."""
    route = _route(repository, "linden_cleveland")
    write_demand(linden, tmp_path / "x.rou.xml", level="light", duration=120.0, unhindered=route)
    ways = [way.attrib["edges"].split() for way in ET.parse(tmp_path / "x.rou.xml").getroot().iter("route")]
    net = sumolib.net.readNet(str(linden))
    signals = {net.getEdge(edge).getToNode() for edge in route[:-1]}
    signals = {node for node in signals if node.getType() == "traffic_light"}
    ends = {edge.getID() for node in signals for edge in node.getIncoming()} - set(route) - {f"-{e}" for e in route}
    crossing = [pair for way in ways for pair in pairwise(way) if pair[0] in ends]
    assert signals
    assert ends
    # Off a side street only into the street's other half, which the route does not touch.
    assert not any(pair[1] in route for pair in crossing)


@pytest.mark.thorough
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


@pytest.mark.slow
def test_another_seed_draws_other_traffic(linden, tmp_path):
    for seed in (1, 2):
        write_demand(linden, tmp_path / f"{seed}", level="light", duration=60.0, seed=seed)
    one, other = (ET.parse(tmp_path / f"{seed}").getroot() for seed in (1, 2))
    ways = [[route.attrib["edges"] for route in root.iter("route")] for root in (one, other)]
    assert len(set(ways[0]) & set(ways[1])) < len(ways[0]) / 2


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"level": "rush"}, "no traffic level 'rush'; known: light, moderate, heavy"),
        ({"level": "light", "drivers": "calm"}, "no drivers 'calm'; known: comfortable, brisk"),
        ({"level": "light", "duration": 0.0}, "expected a time above zero"),
        ({"level": "light", "duration": float("nan")}, "expected a time above zero"),
        ({"level": "light", "unhindered": ("21354771", "nowhere")}, "there is no edge 'nowhere'"),
        ({"level": "light", "unhindered": ("21354771", "-21405924#2")}, "does not lead to edge '-21405924#2'"),
    ],
)
def test_traffic_that_cannot_be_drawn_is_refused(linden, tmp_path, options, message):
    with pytest.raises(ConfigError, match=message):
        write_demand(linden, tmp_path / "x.rou.xml", **options)


@pytest.mark.slow
def test_comfortable_drivers_make_the_same_trips_and_brake_more_gently(linden, tmp_path):
    roots = []
    for drivers in DRIVERS:
        write_demand(linden, tmp_path / f"{drivers}.xml", level="light", duration=60.0, drivers=drivers)
        roots.append(ET.parse(tmp_path / f"{drivers}.xml").getroot())
    comfortable, brisk = ({one.attrib["id"]: one.attrib for one in root.iter("vType")} for root in roots)
    assert [ET.tostring(one) for one in roots[0].iter("vehicle")] == [
        ET.tostring(one) for one in roots[1].iter("vehicle")
    ]
    for name, was in brisk.items():
        now = comfortable[name]
        assert float(now["decel"]) < float(was["decel"])
        assert float(now["decel"]) < float(now["emergencyDecel"]) <= 8.0
        assert {**now, "decel": was["decel"]} == {**was, "emergencyDecel": now["emergencyDecel"]}


def _stops(drivers: str, folder: str) -> tuple[float, float, int]:
    """Return the hardest braking over a second of a stop from 8 m/s [m/s2], the least speed, and contacts."""
    import libsumo

    from benchmarks.strings import start, street

    network = street(Path(folder), 8.0)
    types = " ".join(ET.tostring(_type("sedan", drivers), encoding="unicode").split())
    stop = '<stop lane="ab_0" endPos="400" duration="30"/>'
    cars = f'<vehicle id="a" type="sedan" depart="0" departSpeed="max"><route edges="ab"/>{stop}</vehicle>'
    start(network, f"<routes>{types}{cars}</routes>", 1)
    hardest, speeds = 0.0, []
    for _ in range(round(90.0 / 0.02)):
        libsumo.simulationStep()
        if "a" in libsumo.vehicle.getIDList():
            speeds.append(libsumo.vehicle.getSpeed("a"))
    contacts = len(libsumo.simulation.getCollisions())
    libsumo.close()
    window = 50  # a second, so that the steps of 0.1 s in which drivers act do not count
    for early, late in zip(speeds, speeds[window:], strict=False):
        hardest = max(hardest, early - late)
    return hardest, min(speeds), contacts


@pytest.mark.parametrize(("drivers", "most"), [("brisk", 4.5), ("comfortable", 3.0)])
def test_a_free_stop_is_as_hard_as_the_drivers_are(tmp_path, drivers, most):
    hardest, slowest, contacts = isolated(_stops, drivers, str(tmp_path))
    assert 0.8 * most < hardest < 1.05 * most
    assert (slowest, contacts) == (0.0, 0)
