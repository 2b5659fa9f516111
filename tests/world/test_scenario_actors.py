"""Actors that the scenario moves: exactly where they are put, and seen by the traffic of every lane they cut."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path

import libsumo
import pytest
from shapely import Polygon

from tests.isolated import isolated
from tests.world.streets import ALONE, PERIOD, crossing, demand, grid, pose, street
from vve_sumo.geometry import Box
from vve_sumo.values import EGO, Actors, ActorState
from vve_sumo.world.lanes import Lanes, cuts, read_lanes
from vve_sumo.world.world import World

CAR = (
    '<vType id="car" sigma="0" speedDev="0" maxSpeed="15"'
    ' lcStrategic="0" lcSpeedGain="0" lcCooperative="0" lcKeepRight="0"/>'
)
Track = Callable[[float], tuple[ActorState, ...]]


def _boxes(actors: Actors) -> dict[str, Polygon]:
    rows = zip(actors.x, actors.y, actors.heading, actors.length, actors.width, strict=True)
    boxes = (Polygon(Box(*map(float, row)).corners()) for row in rows)
    return dict(zip(actors.ids, boxes, strict=True))


def _row(actors: Actors, name: str) -> tuple[float, ...]:
    i = actors.ids.index(name)
    columns = (actors.x, actors.y, actors.heading, actors.speed, actors.length, actors.width)
    return tuple(float(column[i]) for column in columns)


class Seen:
    """What a run showed: who overlapped, how near it came, how fast each went at the end and how hard it braked."""

    def __init__(self) -> None:
        self.touched: set[tuple[str, str]] = set()
        self.nearest: dict[str, float] = {}
        self.speed: dict[str, float] = {}
        self.slowest: dict[str, float] = {}
        self.braked: dict[str, float] = {}
        self.x: dict[str, float] = {}
        self.ids: set[str] = set()
        self.removed_at_entry: tuple[str, ...] = ()
        self.inexact: list[str] = []
        self.warnings: tuple[str, ...] = ()


def _run(world: World, track: Track, seconds: float) -> Seen:
    seen = Seen()
    for k in range(round(seconds / PERIOD)):
        states = track(k * PERIOD)
        world.set_actors(states)
        assert world.step({EGO: pose(k * PERIOD, 100.0, 500.0, 0.0, 0.0)})[EGO].faults == ()
        actors, boxes = world.actors(EGO), _boxes(world.actors(EGO))
        seen.ids |= set(actors.ids)
        mine = {state.id: state for state in states}
        seen.inexact += [name for name, state in mine.items() if _row(actors, name) != tuple(state[2:8])]
        for i, name in enumerate(actors.ids):
            if name in mine:
                continue
            speed = float(actors.speed[i])
            braking = (seen.speed.get(name, speed) - speed) / PERIOD
            seen.braked[name] = max(seen.braked.get(name, 0.0), braking)
            seen.slowest[name] = min(seen.slowest.get(name, math.inf), speed)
            seen.speed[name], seen.x[name] = speed, float(actors.x[i])
            for other in mine:
                gap = boxes[name].distance(boxes[other])
                seen.nearest[name] = min(seen.nearest.get(name, math.inf), gap)
                if gap == 0.0:
                    seen.touched.add((name, other))
    seen.removed_at_entry, seen.warnings = world.removed_at_entry, world.warnings
    return seen


def _open(root: Path, network: Path, cars: str, warm_up: float = 0.0) -> World:
    return World(
        network, demand=[demand(root, CAR + cars)], seed=1, period=PERIOD, egos=ALONE, warm_up=warm_up,
        range_of_interest=2000.0,
    )  # fmt: skip


def _car(name: str, at: float, speed: float, lane: int = 0, edge: str = "east") -> str:
    place = f'departPos="{at}" departLane="{lane}" departSpeed="{speed}"'
    return f'<vehicle id="{name}" type="car" depart="0" {place}><route edges="{edge}"/></vehicle>'


def car(x: float, y: float, speed: float, heading: float = 0.0) -> ActorState:
    return ActorState("lead", "car", x, y, heading, speed, 4.5, 1.8)


def _followed(folder: str, deceleration: float) -> Seen:
    """A car at 15 m/s, 25 m behind an actor at 15 m/s that brakes to a stand after 2 s; east_0 is at y = -4.8."""
    root = Path(folder)

    def track(time: float) -> tuple[ActorState, ...]:
        braking = min(max(time - 2.0, 0.0), 15.0 / deceleration)
        x = 200.0 + 15.0 * min(time, 2.0) + 15.0 * braking - 0.5 * deceleration * braking * braking
        return (car(x, -4.8, 15.0 - deceleration * braking),)

    with _open(root, street(root), _car("follower", 200.0 - 2.25 - 25.0, 15.0)) as world:
        return _run(world, track, 12.0)


@pytest.mark.thorough
def test_traffic_brakes_behind_a_scenario_actor_that_brakes(tmp_path):
    seen = isolated(_followed, str(tmp_path), 6.0)
    assert seen.touched == set()
    assert seen.inexact == []
    assert seen.ids == {"follower", "lead"}
    assert seen.speed["follower"] == pytest.approx(0.0, abs=1e-3)
    assert seen.nearest["follower"] == pytest.approx(2.5, abs=0.3)
    assert seen.braked["follower"] < 9.0
    assert seen.warnings == ()


CROSSERS = {
    "pedestrian": (0.6, 0.5, 1.4),
    "bicycle": (1.9, 0.6, 4.0),
    "car": (4.5, 1.8, 3.0),
}


def _crossed(folder: str, kind: str, until: float) -> Seen:
    """Someone crosses at x = 300 from the south up to y = `until`, coming onto the first lane after 5 s.

    Cars at 15 m/s are then 30 m away on that lane, 70 m on the next and 100 m on the oncoming one.
    """
    root = Path(folder)
    length, width, speed = CROSSERS[kind]

    def track(time: float) -> tuple[ActorState, ...]:
        y = -6.4 - 0.5 * length + speed * (time - 5.0)
        return (ActorState("someone", kind, 300.0, min(y, until), 0.5 * math.pi, speed * (y < until), length, width),)

    cars = _car("right", 195.0, 15.0, 0) + _car("left", 155.0, 15.0, 1) + _car("oncoming", 525.0, 15.0, 0, "west")
    with _open(root, street(root), cars) as world:
        return _run(world, track, 20.0)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", CROSSERS)
def test_traffic_of_every_lane_waits_for_whoever_crosses_it_and_then_drives_on(tmp_path, kind):
    seen = isolated(_crossed, str(tmp_path), kind, 60.0)
    assert seen.touched == set()
    assert seen.inexact == []
    assert seen.slowest["right"] < 14.0
    assert seen.x["right"] > 310.0
    assert seen.x["left"] > 310.0
    assert seen.x["oncoming"] < 290.0


@pytest.mark.thorough
@pytest.mark.parametrize(("until", "waiting"), [(-4.8, {"right"}), (-3.2, {"right", "left"}), (-7.0, set())])
def test_a_pedestrian_who_stands_on_a_lane_is_not_driven_over(tmp_path, until, waiting):
    """On a lane, on the line between two, and beside the road, where nobody minds."""
    seen = isolated(_crossed, str(tmp_path), "pedestrian", until)
    assert seen.touched == set()
    assert {name for name, speed in seen.speed.items() if speed < 0.1} == waiting
    assert all(seen.nearest[name] < 6.0 for name in waiting)


def _grown(folder: str, until: float) -> Seen:
    """Someone stands 6 m south of the road; their box grows with the uncertainty of their place, by 2 m a second."""
    root = Path(folder)

    def track(time: float) -> tuple[ActorState, ...]:
        size = 0.5 + 2.0 * min(max(2.0 * (time - 1.0), 0.0), until)
        return (ActorState("someone", "pedestrian", 300.0, -12.4, 0.0, 0.0, size, size),)

    cars = _car("right", 120.0, 15.0, 0) + _car("left", 120.0, 15.0, 1)
    with _open(root, street(root), cars) as world:
        return _run(world, track, 20.0)


@pytest.mark.thorough
@pytest.mark.parametrize(("until", "waiting"), [(5.0, set()), (7.0, {"right"}), (10.0, {"right", "left"})])
def test_traffic_waits_on_every_lane_that_a_body_has_grown_onto(tmp_path, until, waiting):
    seen = isolated(_grown, str(tmp_path), until)
    assert seen.touched == set()
    assert seen.inexact == []
    assert {name for name, speed in seen.speed.items() if speed < 0.1} == waiting


def _entered(folder: str, x: float, speed: float) -> Seen:
    """An actor appears after 2 s on a lane with a car under way at 15 m/s, then at 120 + 2 * 15 = 150 m."""
    root = Path(folder)

    def track(time: float) -> tuple[ActorState, ...]:
        return () if time < 2.0 else (car(x + speed * (time - 2.0), -4.8, speed),)

    with _open(root, street(root), _car("driver", 120.0, 15.0)) as world:
        return _run(world, track, 8.0)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("x", "speed", "removed_at_entry"),
    [(150.0, 15.0, ("driver",)), (165.0, 0.0, ("driver",)), (165.0, 15.0, ()), (220.0, 0.0, ())],
)
def test_traffic_that_could_not_avoid_a_scenario_actor_is_taken_away_when_it_enters(
    tmp_path, x, speed, removed_at_entry
):
    seen = isolated(_entered, str(tmp_path), x, speed)
    assert seen.removed_at_entry == removed_at_entry
    assert seen.touched == set()


def _yielded(folder: str, arrives: float) -> tuple[set[tuple[str, str]], float]:
    """An actor drives along the major road of a crossing at 10 m/s while a car comes from the minor one."""
    root = Path(folder)

    def track(time: float) -> tuple[ActorState, ...]:
        return (car(-10.0 * arrives + 10.0 * time, -1.6, 10.0),)

    with _open(root, crossing(root), _car("minor", 200.0, 10.0, 0, "sc cn")) as world:
        seen = _run(world, track, 20.0)
    return seen.touched, seen.slowest["minor"]


@pytest.mark.thorough
def test_traffic_yields_to_a_scenario_actor_on_the_major_road(tmp_path):
    touched, slowest = isolated(_yielded, str(tmp_path), 10.0)
    assert touched == set()
    assert slowest < 3.0


def _spoilt(folder: str) -> tuple[list[tuple[str, ...]], list[str]]:
    root = Path(folder)
    good = car(300.0, -4.8, 10.0)
    states = [
        (good,),
        (good._replace(x=math.nan),),
        (good._replace(heading=math.inf),),
        (good._replace(speed=math.nan),),
        (good._replace(speed=1e6),),
        (good._replace(y=-7.0, heading=1e18),),
        (good._replace(x=1e300),),
        (),
        (good,),
    ]
    ids, left = [], []
    with World(street(root), seed=1, period=PERIOD, egos=ALONE, range_of_interest=1000.0) as world:
        for k, playing in enumerate(states):
            world.set_actors(playing)
            assert world.step({EGO: pose(k * PERIOD, 100.0, -1.6, 0.0, 0.0)})[EGO].faults == ()
            ids.append(world.actors(EGO).ids)
            for name in libsumo.vehicle.getIDList():
                assert all(map(math.isfinite, (*libsumo.vehicle.getPosition(name), libsumo.vehicle.getSpeed(name))))
        world.set_actors(())
        world.step({EGO: pose(1.0, 100.0, -1.6, 0.0, 0.0)})
        left += libsumo.vehicle.getIDList()
    return ids, left


def test_what_is_no_number_never_reaches_sumo_and_who_left_leaves_nothing_behind(tmp_path):
    ids, left = isolated(_spoilt, str(tmp_path))
    assert ids == [("lead",), (), (), (), ("lead",), ("lead",), (), (), ("lead",)]
    assert left == ["ego"]


def _touching(folder: str) -> list[tuple[str, ...]]:
    root = Path(folder)
    contacts = []
    with World(street(root), seed=1, period=PERIOD, egos=ALONE) as world:
        for y in (-2.6, -2.5):
            # The ego's left side is at -1.6 - 0.926; the actor's, turned across, reaches from its centre 2.25 m.
            world.set_actors((car(98.0, y - 2.25, 0.0, 0.5 * math.pi),))
            world.step({EGO: pose(0.0, 100.0, -1.6, 0.0, 0.0)})
            contacts.append(world.contacts(EGO))
    return contacts


def test_contact_with_the_ego_is_that_of_the_boxes(tmp_path):
    assert isolated(_touching, str(tmp_path)) == [(), ("lead",)]


def _wandered(folder: str) -> tuple[int, int]:
    """Number of boxes of a body that wanders about a town, and of those whose cuts were not the whole network's."""
    chance, wrong, boxes = random.Random(7), 0, 0
    with World(grid(Path(folder), 3), seed=1, period=PERIOD, egos=ALONE):
        lanes = Lanes(read_lanes(), 3.0)
        everything = [lanes.piece(i) for i in range(sum(len(lane.bands) for lane in lanes.by_id.values()))]
        for length, width, speed in ((0.5, 0.35, 0.05), (4.5, 1.8, 0.3), (12.0, 2.5, 1.5)):
            near, x, y, heading = lanes.nearby(0.5 * math.hypot(length, width)), 120.0, 120.0, 0.0
            for _ in range(700):
                heading += chance.uniform(-0.2, 0.2) + 0.02 * math.sin(heading - math.atan2(120.0 - y, 120.0 - x))
                x, y = x + speed * math.cos(heading), y + speed * math.sin(heading)
                box = Box(x, y, heading, length, width)
                boxes += 1
                wrong += cuts(box, near.close(box)) != cuts(box, everything)
    return boxes, wrong


@pytest.mark.thorough
def test_the_lanes_close_to_a_body_are_those_of_the_whole_network(tmp_path):
    assert isolated(_wandered, str(tmp_path)) == (2100, 0)
