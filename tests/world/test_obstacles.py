"""Standing cars: exactly where declared, anticipated by traffic, refused where they cannot be."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from shapely import Polygon

from tests.isolated import isolated
from tests.world.streets import ALONE, PERIOD, crossing, demand, pose, street
from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.errors import ConfigError
from vve_sumo.geometry import Box
from vve_sumo.values import EGO
from vve_sumo.world.obstacles import LaneSpot, MapSpot, Obstacle
from vve_sumo.world.world import World

CAR = '<vType id="car" sigma="0" speedDev="0" maxSpeed="15"/>'


def _traffic(folder: str, lanes: int, obstacle: Obstacle, seconds: float) -> dict[str, list[tuple[float, ...]]]:
    """Tracks (x, y, speed, gap to the obstacle's body) of cars that start on lane 0, every 0.1 s."""
    root = Path(folder)
    flow = '<flow id="f" type="car" begin="1" end="200" period="8" departLane="0" departSpeed="15">'
    flow += '<route edges="east"/></flow>'
    tracks: dict[str, list[tuple[float, ...]]] = {}
    cars = demand(root, CAR + flow)
    with World(
        street(root, lanes), demand=[cars], seed=1, period=PERIOD, egos=ALONE, obstacles=[obstacle],
        range_of_interest=2000.0,
    ) as world:  # fmt: skip
        for k in range(int(seconds / PERIOD)):
            assert world.step({EGO: pose(k * PERIOD, 0.0, 500.0, 0.0, 0.0)})[EGO].faults == ()
            if k % 5:
                continue
            actors = world.actors(EGO)
            boxes = [
                Polygon(Box(*map(float, row)).corners())
                for row in zip(actors.x, actors.y, actors.heading, actors.length, actors.width, strict=True)
            ]
            assert actors.ids[-1] == obstacle.id
            for i, name in enumerate(actors.ids):
                row = (actors.x[i], actors.y[i], actors.speed[i], boxes[i].distance(boxes[-1]), actors.heading[i])
                tracks.setdefault(name, []).append(tuple(map(float, row)))
    return tracks


@pytest.mark.thorough
def test_traffic_changes_lane_early_and_passes_at_speed(tmp_path):
    tracks = isolated(_traffic, str(tmp_path), 2, Obstacle("wreck", LaneSpot("east_0", 600.0)), 60.0)
    passed = [track for name, track in tracks.items() if name != "wreck" and track[-1][0] > 620.0]
    assert len(passed) >= 2
    for track in passed:
        changed = next(x for x, y, *_ in track if y > -3.0)
        assert changed < 550.0
        assert min(speed for _, _, speed, _, _ in track) > 13.0
        assert min(gap for *_, gap, _ in track) > 0.5


@pytest.mark.thorough
@pytest.mark.parametrize("offset", [0.0, 0.9])
def test_traffic_queues_at_its_usual_gap_where_there_is_no_way_round(tmp_path, offset):
    tracks = isolated(_traffic, str(tmp_path), 1, Obstacle("wreck", LaneSpot("east_0", 300.0, offset)), 60.0)
    x, _, speed, gap, _ = tracks["f.0"][-1]
    assert speed == pytest.approx(0.0, abs=1e-3)
    assert gap == pytest.approx(2.5, abs=0.1)
    assert tracks["f.1"][-1][0] < x
    assert tracks["f.1"][-1][2] < 0.1


@pytest.mark.thorough
def test_the_body_is_exactly_the_declared_one_at_every_tick(tmp_path):
    spot = MapSpot(400.0, -2.0, 0.3)
    tracks = isolated(_traffic, str(tmp_path), 1, Obstacle("wreck", spot), 20.0)
    places = {(x, y, speed, heading) for x, y, speed, _, heading in tracks["wreck"]}
    assert places == {(spot.x, spot.y, 0.0, spot.heading)}
    assert len(tracks["wreck"]) > 150


@pytest.mark.thorough
def test_an_obstacle_beside_the_road_disturbs_nobody(tmp_path):
    tracks = isolated(_traffic, str(tmp_path), 1, Obstacle("parked", MapSpot(300.0, -5.0, 0.0)), 40.0)
    assert tracks["f.0"][-1][0] > 500.0
    assert min(speed for _, _, speed, _, _ in tracks["f.0"]) > 14.9


def _in_a_junction(folder: str) -> tuple[float, float]:
    root = Path(folder)
    flow = CAR + '<flow id="f" type="car" begin="1" end="50" period="5" departSpeed="10"><route edges="wc ce"/></flow>'
    inside = Obstacle("wreck", MapSpot(3.0, -1.6, 0.0))
    furthest, touched = -300.0, math.inf
    with World(
        crossing(root), demand=[demand(root, flow)], seed=1, period=PERIOD, egos=ALONE, obstacles=[inside],
        range_of_interest=900.0,
    ) as world:  # fmt: skip
        for k in range(2500):
            world.step({EGO: pose(k * PERIOD, 0.0, 500.0, 0.0, 0.0)})
            actors = world.actors(EGO)
            fronts = actors.x[:-1] + actors.length[:-1] / 2
            furthest = max(furthest, float(np.max(fronts, initial=-300.0)))
            touched = min(touched, 0.75 - furthest)
    return furthest, touched


@pytest.mark.thorough
def test_an_obstacle_inside_a_junction_is_stopped_for(tmp_path):
    furthest, room = isolated(_in_a_junction, str(tmp_path))
    assert furthest > -30.0
    assert room > 0.5


def _seen(folder: str, kind: str) -> tuple[float, float, str]:
    obstacle = Obstacle("first", MapSpot(300.0, -1.6, 0.0), 7.1, 2.4, kind)
    with World(
        street(Path(folder)), seed=1, period=PERIOD, egos=ALONE, obstacles=[obstacle], range_of_interest=900.0
    ) as world:
        world.step({EGO: pose(0.0, 100.0, -1.6, 0.0, 0.0)})
        seen = world.actors(EGO)
        return float(seen.height[0]), float(seen.radar_cross_section[0]), BODY_KINDS[seen.kind[0]]


@pytest.mark.parametrize(
    ("kind", "height", "cross_section"), [("car", 1.5, 10.0), ("truck", 3.5, 100.0), ("van", 2.3, 30.0)]
)
def test_an_obstacle_is_of_its_kind_for_every_sensor(tmp_path, kind, height, cross_section):
    assert isolated(_seen, str(tmp_path), kind) == (height, cross_section, kind)


def _refused(folder: str, obstacles: list[Obstacle]) -> str:
    try:
        with World(street(Path(folder)), seed=1, period=PERIOD, egos=ALONE, obstacles=obstacles) as world:
            world.step({EGO: pose(0.0, 100.0, -1.6, 0.0, 0.0)})
    except ConfigError as error:
        return str(error)
    return ""


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("obstacles", "words"),
    [
        ([Obstacle("a", MapSpot(500.0, 200.0, 0.0))], ["a", "off the network", "200.0"]),
        ([Obstacle("a", MapSpot(math.nan, 0.0, 0.0))], ["a", "finite"]),
        ([Obstacle("a", MapSpot(500.0, 0.0, 0.0), length=-1.0)], ["a", "positive size"]),
        ([Obstacle("a", LaneSpot("nowhere_0", 10.0))], ["a", "nowhere_0"]),
        ([Obstacle("a", LaneSpot("east_0", 1000.5))], ["a", "east_0", "1000.0", "1000.5"]),
        ([Obstacle("a", LaneSpot("east_0", 10.0)), Obstacle("a", LaneSpot("east_0", 50.0))], ["a", "name of its own"]),
        ([Obstacle("a", LaneSpot("east_1", 102.0))], ["a", "where the ego starts"]),
        ([Obstacle("a", LaneSpot("east_1", 50.0))], []),
    ],
)
def test_impossible_obstacles_are_refused_in_one_clear_line(tmp_path, obstacles, words):
    message = isolated(_refused, str(tmp_path), obstacles)
    assert all(word in message for word in words)
    assert "\n" not in message
    assert bool(message) == bool(words)
