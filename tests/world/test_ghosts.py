"""Traffic of every lane that the ego's body cuts reacts, whichever way the body lies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import pytest
from shapely import Polygon, box

from tests.conftest import REPOSITORY
from tests.isolated import isolated
from tests.world.streets import (
    ALONE,
    FUSION,
    PERIOD,
    along,
    crossing,
    demand,
    grid,
    lane_points,
    pose,
    street,
    trips,
    way,
)
from vve_sumo.geometry import Box, behind_bumper
from vve_sumo.values import EGO, Actors
from vve_sumo.world.ego_sync import Ego
from vve_sumo.world.world import World

CAR = '<vType id="car" sigma="0" lcStrategic="0" lcSpeedGain="0" lcCooperative="0" lcKeepRight="0"/>'
START = 'type="car" begin="0" end="300" period="6" departPos="300" departSpeed="15"'
FLOWS = CAR + (
    f'<flow id="right" {START} departLane="0"><route edges="east"/></flow>'
    f'<flow id="left" {START} departLane="1"><route edges="east"/></flow>'
    f'<flow id="oncoming" {START}><route edges="west"/></flow>'
)


@dataclass
class Seen:
    """What happened around a standing or driving ego."""

    touched: set[str]
    nearest_stop: dict[str, float]
    passed: set[str]
    ghosts_among_actors: set[str]
    lane: str


def _polygon(shape: Box) -> Polygon:
    return Polygon(shape.corners())


def _watch(
    folder: str, x: float, y: float, heading: float, speed: float, seconds: float, opposites: bool = False
) -> Seen:
    """Put the ego on the virtual road (east lanes at y = -4.8 and -1.6, west at 1.6) and look at the traffic."""
    root = Path(folder)
    seen = Seen(set(), {}, set(), set(), "")
    cars = demand(root, FLOWS)
    road = street(root, opposites=opposites)
    with World(road, demand=[cars], seed=1, period=PERIOD, egos=ALONE, range_of_interest=400.0) as world:
        for k in range(int(seconds / PERIOD)):
            at = x + speed * k * PERIOD
            seen.lane = world.step({EGO: pose(k * PERIOD, at, y, heading, speed)})[EGO].lane
            actors = world.actors(EGO)
            touched = set(world.contacts(EGO))
            seen.touched |= touched
            if k % 5 == 0:
                overlapping = _look(
                    seen, actors, at, _polygon(behind_bumper(at, y, heading, FUSION.length, FUSION.width))
                )
                assert overlapping == touched
    return seen


def _look(seen: Seen, actors: Actors, at: float, body: Polygon) -> set[str]:
    """Note who stands, who passed; return who overlaps the ego according to shapely."""
    overlapping = set()
    columns = (actors.x, actors.y, actors.heading, actors.length, actors.width)
    for i, name in enumerate(actors.ids):
        flow = name.partition(".")[0]
        if flow not in LANES:
            seen.ghosts_among_actors.add(name)
            continue
        gap = body.distance(_polygon(Box(*(float(column[i]) for column in columns))))
        if gap == 0.0:
            overlapping.add(name)
        if actors.speed[i] < 0.05:
            seen.nearest_stop[flow] = min(gap, seen.nearest_stop.get(flow, math.inf))
        if (actors.x[i] - at) * (-1.0 if flow == "oncoming" else 1.0) > 20.0:
            seen.passed.add(flow)
    return overlapping


LINE = -3.2  #: between the two eastward lanes
LANES = {"right": (-6.4, LINE), "left": (LINE, 0.0), "oncoming": (0.0, 3.2)}
STANDING = {
    "in its lane": (500.0, -1.6, 0.0),
    "half a metre off the middle": (500.0, -1.1, 0.0),
    "on the line, mapped left": (500.0, LINE + 0.1, 0.0),
    "on the line, mapped right": (500.0, LINE - 0.1, 0.0),
    "a hand's breadth over the line": (500.0, LINE + 0.8, 0.0),
    "over the centre line": (500.0, -0.2, 0.0),
    "45 degrees": (500.0, -1.6, math.pi / 4),
    "45 degrees the other way": (500.0, -1.6, -math.pi / 4),
    "across, nose on the oncoming lane": (500.0, 1.0, math.pi / 2),
    "across, nose off the road": (500.0, 3.6, math.pi / 2),
    "off the road but for a corner": (500.0, -6.9, 0.1),
    "wrong way round": (500.0, LINE, math.pi),
}


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize("case", STANDING)
def test_traffic_of_every_cut_lane_stops_and_nobody_touches(tmp_path, case):
    x, y, heading = STANDING[case]
    body = _polygon(behind_bumper(x, y, heading, FUSION.length, FUSION.width))
    cut = {name for name, (low, high) in LANES.items() if body.intersects(box(0.0, low, 1000.0, high))}
    seen = isolated(_watch, str(tmp_path), x, y, heading, 0.0, 30.0)
    assert seen.touched == set()
    assert seen.ghosts_among_actors == set()
    assert seen.nearest_stop.keys() == cut
    assert all(gap < 9.0 for gap in seen.nearest_stop.values()), seen.nearest_stop
    assert seen.passed == LANES.keys() - cut


@pytest.mark.parametrize("y", [-0.6, 0.1, 0.7])
@pytest.mark.parametrize("turned", [0.0, 0.15, -0.1])
def test_where_lanes_know_of_the_other_way_traffic_of_both_stops_before_who_stands_over_the_line(tmp_path, y, turned):
    """SUMO takes who is mapped to one of them for a leader on the other, too, his body on the wrong side of him."""
    seen = isolated(_watch, str(tmp_path), 500.0, y, turned, 0.0, 22.0, True)
    assert seen.touched == set()
    assert {"left", "oncoming"} <= seen.nearest_stop.keys()
    assert "oncoming" not in seen.passed
    assert "left" not in seen.passed
    assert all(gap < 9.0 for gap in seen.nearest_stop.values()), seen.nearest_stop


@pytest.mark.thorough
@pytest.mark.parametrize(("y", "cut"), [(LINE + 0.1, "right"), (LINE - 0.1, "left")])
def test_a_driving_ego_on_the_line_is_not_driven_through(tmp_path, y, cut):
    seen = isolated(_watch, str(tmp_path), 350.0, y, 0.0, 7.0, 30.0)
    assert seen.touched == set()
    assert cut not in seen.passed


def _weave(folder: str) -> tuple[list[int], list[int]]:
    """Number of ghosts while the ego crosses the line and comes back, and after it left the road for good."""
    root = Path(folder)
    weaving, away = [], []
    with World(street(root), demand=[], seed=1, period=PERIOD, egos=ALONE) as world:
        for k in range(1000):
            y = -1.6 - 1.6 * math.sin(k / 1000 * math.pi)
            assert world.step({EGO: pose(k * PERIOD, 100.0 + 0.2 * k, y, 0.0, 10.0)})[EGO].faults == ()
            weaving.append(len(world.proxy_lanes(EGO)))
        for k in range(100):
            assert world.step({EGO: pose(20.0 + k * PERIOD, 300.0, -30.0, 0.0, 0.0)})[EGO].faults == ()
            away.append(len(world.proxy_lanes(EGO)))
    return weaving, away


@pytest.mark.thorough
def test_ghosts_come_with_the_line_and_go_with_it(tmp_path):
    weaving, away = isolated(_weave, str(tmp_path))
    assert weaving[1:100] == [0] * 99
    assert weaving[400:600] == [2] * 200
    assert weaving[-100:] == [0] * 100
    assert away[1:] == [0] * 99


def _junction(folder: str) -> tuple[set[str], bool, int]:
    """The ego stands across the middle of a junction, then leaves; the crossing traffic waits, then flows."""
    root = Path(folder)
    flows = "".join(
        f'<flow id="{a}{b}" begin="0" end="100" period="7" departPos="150" departSpeed="10">'
        f'<route edges="{a}c c{b}"/></flow>'
        for a, b in ("we", "ew", "ns", "sn")
    )
    touched: set[str] = set()
    went_while_blocked, arrived = False, 0
    with World(crossing(root), demand=[demand(root, flows)], seed=1, period=PERIOD, egos=ALONE) as world:
        for k in range(2000):
            blocked = k < 1000
            place = (2.0, 2.0, math.pi / 4) if blocked else (0.0, 80.0, 0.0)
            world.step({EGO: pose(k * PERIOD, *place, 0.0)})
            actors = world.actors(EGO)
            touched |= set(world.contacts(EGO)) if blocked else set()
            inside = [i for i in range(len(actors.ids)) if abs(actors.x[i]) > 20.0 or abs(actors.y[i]) > 20.0]
            for i in inside:
                out = actors.x[i] * math.cos(actors.heading[i]) + actors.y[i] * math.sin(actors.heading[i]) > 20.0
                went_while_blocked |= blocked and out
                arrived += not blocked and out
    return touched, went_while_blocked, arrived


@pytest.mark.thorough
def test_an_ego_across_a_junction_holds_the_traffic_of_all_arms(tmp_path):
    touched, went, arrived = isolated(_junction, str(tmp_path))
    assert touched == set()
    assert not went
    assert arrived > 0


def _waiting_to_turn(folder: str, farther: float) -> tuple[int, set[str]]:
    """How many go straight on past an ego that waits in a junction to turn left, and whom it touches.

    Its front left corner lies 0.12 m and `farther` [m] inside the edge of the lane that turns left from ahead, which
    ends beside it; the lane of those who go straight on is 0.7 m away.
    """
    root = Path(folder)
    flow = CAR + (
        '<flow id="ahead" type="car" begin="0" end="90" period="4" departSpeed="10">'
        '<route edges="east_to_minor minor_to_signal signal_to_stop stop_to_west"/></flow>'
    )
    network = REPOSITORY / "networks" / "side_streets.net.xml"
    passed: set[str] = set()
    touched: set[str] = set()
    with World(network, demand=[demand(root, flow)], seed=1, period=PERIOD, egos=ALONE) as world:
        for k in range(4500):
            assert world.step({EGO: pose(k * PERIOD, 413.006, 148.587 + farther, 0.071, 0.0)})[EGO].faults == ()
            actors = world.actors(EGO)
            touched |= set(world.contacts(EGO))
            passed |= {name for name, x in zip(actors.ids, actors.x, strict=True) if x < 400.0}
    return len(passed), touched


def test_who_waits_to_turn_left_does_not_hold_up_who_goes_straight_on(tmp_path):
    passed, touched = isolated(_waiting_to_turn, str(tmp_path), 0.0)
    assert passed >= 5
    assert touched == set()


def test_who_waits_farther_over_holds_them_up(tmp_path):
    assert isolated(_waiting_to_turn, str(tmp_path), 0.5) == (0, set())


def _town(folder: str) -> tuple[int, int]:
    """Turns through junctions with traffic all around: how many ticks had ghosts, and how many cars still arrived."""
    import libsumo

    root = Path(folder)
    network = grid(root)
    block = ["B1C1", "C1C2", "C2B2", "B2B1"]
    lap = list(along(lane_points(network, way(network, block * 2 + block[:1])), 6.0 * PERIOD))
    haunted = arrived = 0
    cars = trips(root, network, 60, 2.0)
    with World(network, demand=[cars], seed=1, period=PERIOD, egos=[Ego(EGO, FUSION, tuple(block * 4))]) as world:
        for k in range(3000):
            x, y, heading = lap[k % len(lap)]
            assert world.step({EGO: pose(k * PERIOD, x, y, heading, 6.0)})[EGO].faults == ()
            haunted += bool(world.proxy_lanes(EGO))
            arrived += len(libsumo.simulation.getArrivedIDList())
    return haunted, arrived


@pytest.mark.thorough
def test_ghosts_in_turns_do_not_lock_the_town(tmp_path):
    haunted, arrived = isolated(_town, str(tmp_path))
    assert 0 < haunted < 3000 // 2
    assert arrived > 5
