"""Two egos on one road: each exactly where it was placed, each an actor to the other, whatever their order."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import libsumo
import pytest
from shapely import Polygon, box
from shapely.affinity import rotate, translate

from tests.isolated import isolated
from tests.world.streets import FUSION, PERIOD, demand, grid, pose, street, trips
from tests.world.test_step_time import Scale
from vve_sumo.values import Actors, Pose, Vehicle
from vve_sumo.world.ego_sync import TOLERANCE, Ego
from vve_sumo.world.standoff import MAX_WAIT
from vve_sumo.world.step_time import PROTECTED_RADIUS
from vve_sumo.world.world import World

LONG = replace(FUSION, length=7.0, width=2.2)
CARS = {"a": FUSION, "b": LONG}
TRAFFIC = (
    '<vType id="car" sigma="0.5"/>'
    '<flow id="t" type="car" begin="0" end="60" period="2" departLane="random" departSpeed="12">'
    '<route edges="east"/></flow>'
)


def body(at: Pose, vehicle: Vehicle) -> Polygon:
    """The rectangle behind a front bumper."""
    half = 0.5 * vehicle.width
    return translate(rotate(box(-vehicle.length, -half, 0.0, half), at.heading, (0.0, 0.0), True), at.x, at.y)


def placements(ticks: int) -> Iterator[dict[str, Pose]]:
    """Poses of both: `a` keeps its lane; `b`, at first far ahead, goes from beside the road into `a` and off again."""
    for k in range(ticks):
        time = k * PERIOD
        across = -9.0 + 1.2 * time if time < 8.0 else 0.6 - 1.2 * (time - 8.0)
        turn, ahead = 0.12 * math.cos(0.3 * time), 10.0 * max(4.0 - time, 0.0)
        yield {
            "a": pose(time, 150.0 + 9.0 * time, -1.6, 0.0, 9.0),
            "b": pose(time, 155.0 + 9.0 * time + ahead, across, turn, 9.1),
        }


class Tick(NamedTuple):
    """What both saw at a tick."""

    asked: dict[str, Pose]
    errors: list[float]  #: of places [m], headings [rad], speeds [m/s]
    faults: list[str]
    seen: dict[str, dict[str, tuple[float, ...]]]  #: by ego: x, y, heading, speed, length, width by actor
    touched: dict[str, tuple[str, ...]]


def rows(actors: Actors) -> dict[str, tuple[float, ...]]:
    columns = (actors.x, actors.y, actors.heading, actors.speed, actors.length, actors.width)
    return dict(zip(actors.ids, zip(*(column.tolist() for column in columns), strict=True), strict=True))


def _driven(folder: str, order: str, ticks: int = 700) -> list[Tick]:
    root, reported = Path(folder), []
    egos = [Ego(name, CARS[name]) for name in order]
    # Some of the traffic is near one of them alone.
    with World(
        street(root), demand=[demand(root, TRAFFIC)], seed=7, period=PERIOD, egos=egos, warm_up=20.0,
        range_of_interest=80.0,
    ) as world:  # fmt: skip
        for asked in placements(ticks):
            reports = world.step({name: asked[name] for name in order})
            both = [reports[name] for name in ("a", "b")]
            errors = [error for r in both for error in (r.position_error, r.heading_error, r.speed_error)]
            seen = {name: rows(world.actors(name)) for name in CARS}
            touched = {name: world.contacts(name) for name in CARS}
            reported.append(Tick(asked, errors, [fault for r in both for fault in r.faults], seen, touched))
    return reported


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> list[Tick]:
    return isolated(_driven, str(tmp_path_factory.mktemp("two")), "ab")


def test_each_is_exactly_where_it_was_placed(driven: list[Tick]) -> None:
    assert [tick.faults for tick in driven if tick.faults] == []
    assert max(error for tick in driven for error in tick.errors) <= TOLERANCE


def test_each_is_an_actor_to_the_other_with_its_own_box_and_never_to_itself(driven: list[Tick]) -> None:
    for tick in driven:
        for own, other in (("a", "b"), ("b", "a")):
            assert own not in tick.seen[own]
            x, y, heading, speed, length, width = tick.seen[own][other]
            at, vehicle = tick.asked[other], CARS[other]
            middle = body(at, vehicle).centroid
            assert (x, y) == pytest.approx((middle.x, middle.y), abs=1e-9)
            assert (heading, speed, length, width) == (at.heading, at.speed, vehicle.length, vehicle.width)
            assert not any(name.startswith("ego_ghost") for name in tick.seen[own])
    # `b` begins off the road, where SUMO reports it to nobody.
    assert driven[0].asked["b"].y < -6.4 - 0.5 * LONG.width


def test_both_see_the_same_traffic(driven: list[Tick]) -> None:
    common = 0
    for tick in driven:
        names = (tick.seen["a"].keys() & tick.seen["b"].keys()) - CARS.keys()
        assert all(tick.seen["a"][name] == tick.seen["b"][name] for name in names)
        common += len(names)
    assert common > 1000


def test_contact_between_them_is_overlap_and_both_are_told(driven: list[Tick]) -> None:
    met = 0
    for tick in driven:
        a, b = (body(tick.asked[name], CARS[name]) for name in ("a", "b"))
        if abs(a.distance(b)) < 1e-6 and a.intersection(b).area < 1e-6:
            continue  # too near to call
        assert ("b" in tick.touched["a"]) == ("a" in tick.touched["b"]) == a.intersects(b)
        met += a.intersects(b)
    assert 50 < met < len(driven) - 50


@pytest.mark.thorough
def test_neither_the_order_of_egos_nor_another_run_changes_anything(driven: list[Tick], tmp_path: Path) -> None:
    # As texts, so that the order of rows counts too.
    assert repr(isolated(_driven, str(tmp_path), "ba")) == repr(driven)
    assert repr(isolated(_driven, str(tmp_path), "ab")) == repr(driven)


def _late_and_held(folder: str) -> list[object]:
    """`b` enters a second after `a`, and then is given a pose that SUMO must not see."""
    root, reported = Path(folder), list[object]()
    egos = [Ego(name, vehicle) for name, vehicle in CARS.items()]
    with World(street(root), seed=1, period=PERIOD, egos=egos) as world:
        reported.append((world.actors("a").ids, world.contacts("a")))
        for k in range(50):
            reports = world.step({"a": pose(k * PERIOD, 100.0 + 0.2 * k, -1.6, 0.0, 10.0)})
        reported.append((reports["a"].faults, reports["b"].faults, world.actors("a").ids, world.actors("b").ids))
        here = pose(1.0, 140.0, -4.8, 0.0, 5.0)
        reports = world.step({"a": pose(1.0, 110.0, -1.6, 0.0, 10.0), "b": replace(here, yaw_rate=0.2)})
        seen = world.actors("a")
        reported.append(
            (reports["b"].faults, reports["b"].time, seen.ids, seen.speed.tolist(), seen.lateral_speed.tolist())
        )
        reports = world.step({"a": pose(1.02, 110.2, -1.6, 0.0, 10.0), "b": replace(here, x=math.nan)})
        seen = world.actors("a")
        reported.append((reports["a"].faults, reports["b"].faults, rows(seen), seen.lateral_speed.tolist()))
        libsumo.vehicle.remove("b")
        reports = world.step({"a": pose(1.04, 110.4, -1.6, 0.0, 10.0), "b": here})
        reported.append((reports["a"].faults, "ego_lost" in reports["b"].faults, world.actors("a").ids))
        with pytest.raises(KeyError):
            world.step({"c": here})
    return reported


def test_one_may_enter_later_and_one_that_is_not_placed_stands_for_the_other(tmp_path: Path) -> None:
    before, alone, entered, held, lost = isolated(_late_and_held, str(tmp_path))
    assert before == ((), ())
    assert alone == ((), ("ego_not_placed", "ego_absent"), (), ())
    # Turning left about its rear axle, the middle of the car goes to the left less fast than its front bumper, which
    # here does not at all.
    assert entered == ((), 1.0, ("b",), [5.0], [pytest.approx(-0.2 * 0.5 * LONG.length)])
    assert held == ((), ("pose_not_finite",), {"b": (136.5, -4.8, 0.0, 0.0, LONG.length, LONG.width)}, [0.0])
    assert lost[1:] == (True, ("b",))


def _follower(folder: str, second: bool) -> list[float]:
    """A SUMO car behind `b` in the right lane, while `a` drives in the left lane: how far it comes."""
    root = Path(folder)
    cars = demand(
        root,
        '<vType id="car" sigma="0" speedDev="0" lcStrategic="0" lcSpeedGain="0" lcKeepRight="0" lcCooperative="0"/>'
        '<vehicle id="f" type="car" depart="0" departPos="100" departLane="0" departSpeed="15"><route edges="east"/>'
        "</vehicle>",
    )
    egos = [Ego(name, vehicle) for name, vehicle in CARS.items()]
    with World(street(root), demand=[cars], seed=1, period=PERIOD, egos=egos, warm_up=2 * PERIOD) as world:
        fronts = []
        for k in range(500):
            asked = {"a": pose(k * PERIOD, 150.0 + 15.0 * k * PERIOD, -1.6, 0.0, 15.0)}
            # Across the line between the road's edge and the lane, so that traffic sees it by a proxy alone.
            asked |= {"b": pose(k * PERIOD, 160.0, -7.2, 0.15, 0.0)} if second else {}
            world.step(asked)
            fronts.append(libsumo.vehicle.getPosition("f")[0])
            assert "f" not in world.contacts("b")
    return fronts


@pytest.mark.thorough
def test_traffic_stops_for_the_second_ego_too(tmp_path: Path) -> None:
    free, blocked = isolated(_follower, str(tmp_path), False), isolated(_follower, str(tmp_path), True)
    assert free[-1] > 230.0
    assert 140.0 < blocked[-1] < 160.0


def _faced(folder: str) -> tuple[tuple[str, ...], list[str]]:
    """Both stand side by side before an oncoming car, until its wait for either is over at the same time."""
    root, faults = Path(folder), list[str]()
    cars = demand(root, '<vehicle id="on" depart="0" departPos="100"><route edges="east"/></vehicle>')
    egos = [Ego("a", FUSION), Ego("b", FUSION)]
    with World(street(root, 1), demand=[cars], seed=1, period=PERIOD, egos=egos) as world:
        for k in range(round((MAX_WAIT + 20.0) / PERIOD)):
            asked = {name: pose(k * PERIOD, 150.0, y, math.pi, 0.0) for name, y in (("a", -1.6), ("b", -3.9))}
            faults += [fault for report in world.step(asked).values() for fault in report.faults]
        return world.removed_after_standoff, faults


@pytest.mark.thorough
def test_a_driver_who_waits_for_both_is_taken_off_the_road_once(tmp_path: Path) -> None:
    assert isolated(_faced, str(tmp_path)) == (("on",), [])


def _thinned(folder: str) -> tuple[int, list[float]]:
    """Too much traffic for a live tick between two egos: how many cars were taken off, and how near to an ego."""
    root, removed = Path(folder), list[float]()
    network, places = grid(root, size=8, length=150.0), {"a": (20.0, -1.6), "b": (1030.0, 1051.6)}
    egos = [Ego("a", FUSION), Ego("b", FUSION)]
    cars, clock = trips(root, network, 400, 0.25), Scale(0.0002)
    with World(network, demand=[cars], seed=3, period=PERIOD, egos=egos, warm_up=60.0, clock=clock) as world:
        before: dict[str, tuple[float, float]] = {}
        for k in range(160):
            asked = {name: pose(k * PERIOD, *place, 0.0, 0.0) for name, place in places.items()}
            assert [report.faults for report in world.step(asked).values()] == [(), ()]
            vehicle = libsumo.vehicle
            here = {name: vehicle.getPosition(name) for name in vehicle.getIDList() if name not in CARS}
            gone = [before[name] for name in before.keys() - here.keys() if not name.startswith("ego_ghost")]
            removed += [min(math.dist(at, place) for place in places.values()) for at in gone]
            before = {
                name: at for name, at in here.items()
                if vehicle.getRouteIndex(name) < len(vehicle.getRoute(name)) - 1
            }  # fmt: skip
        assert world.step_time_budget is not None
        return world.step_time_budget.summary["removed"], removed


@pytest.mark.thorough
def test_no_traffic_near_either_is_taken_off_where_a_tick_lacks_time(tmp_path: Path) -> None:
    removed, distances = isolated(_thinned, str(tmp_path))
    assert removed > 20
    assert len(distances) > 20
    assert min(distances) > PROTECTED_RADIUS - 1.0
