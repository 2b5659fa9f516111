"""Outlines that a lidar's turns give, against the bodies that were looked at (shapely), and how those move."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import LineString, MultiPoint, Polygon
from shapely.geometry import Point as Place

from controllers.outlines import Body, Outlines
from controllers.sightings import Sighting
from controllers.tracks import Track
from tests.controllers.avoid_bench import LIDAR
from tests.controllers.bench import ROAD
from tests.sensors.scenes import FUSION, Row, actors, car, rear_axle
from vve_sumo.body_kinds import TYPICAL
from vve_sumo.geometry import Box
from vve_sumo.path import ReferencePath
from vve_sumo.sensors.lidar import Lidar
from vve_sumo.sensors.street import Building, Walls, walls_of
from vve_sumo.values import Observation


def followed(rows: list[Row], *, speed: float = 0.0, seconds: float = 1.2, kind: str = "car", start: float = 20.0,
             vx: float = 0.0, vy: float = 0.0) -> tuple[list[Body], float]:  # fmt: skip
    """Bodies that all move by vx, vy [m/s] from a car at x = `start`; and how long they have."""
    lidar, outlines = Lidar(replace(LIDAR), np.random.default_rng(3), walls_of(())), Outlines(FUSION, "roof", 1.4, 1.9)
    time = 0.0
    for tick in range(round(seconds / 0.02) + 1):
        time = 0.02 * tick
        pose = replace(rear_axle(start + speed * time, speed=speed), time=time)
        moved = [(x + vx * time, y + vy * time, *rest) for x, y, *rest in rows]
        cloud = lidar.output
        seen = Observation(tick, time, pose, ROAD, 10.0, {"roof": cloud}, 0.0)
        outlines.step(seen, ROAD.project(pose.x, pose.y))
        lidar.step(time, pose, actors(moved, kind=kind))  # type: ignore[arg-type]
        lidar.prepare()
    return outlines.bodies(time, []), time


def polygon(row: Row, dx: float = 0.0, dy: float = 0.0) -> Polygon:
    x, y, heading, _speed, length, width, _ = row
    return Polygon(Box(x + dx, y + dy, heading, length, width).corners())


@pytest.mark.parametrize("seed", range(12))
def test_outlines_lie_on_the_near_sides_of_bodies(seed: int) -> None:
    draw = np.random.default_rng(seed)
    rows: list[Row] = []
    for x, y in ((45.0, -4.0), (38.0, 5.0), (62.0, 0.5), (14.0, 4.5)):
        rows.append((x, y, float(draw.uniform(-0.5, 0.5)), 0.0, 4.5, 1.8, 10.0))
    found, _ = followed(rows, speed=6.0)
    assert len(found) == len(rows)
    for row in rows:
        body = min(found, key=lambda one: math.hypot(one.s.mean() - row[0], one.d.mean() - row[1]))
        points = MultiPoint(np.stack((body.s, body.d), axis=-1))
        assert max(polygon(row).boundary.distance(one) for one in points.geoms) < 0.15
        # What is turned to the car is there as a whole.
        assert max(points.bounds[2] - points.bounds[0], points.bounds[3] - points.bounds[1]) > 1.3
        assert (body.along, body.across) == (0.0, 0.0)


def test_a_bus_beside_the_way_is_one_body() -> None:
    found, _ = followed([(42.0, 3.2, 0.0, 0.0, 12.0, 2.5, 10.0)], kind="bus", speed=5.0)
    assert len(found) == 1
    assert float(np.ptp(found[0].s)) > 10.0
    assert found[0].along == 0.0


@pytest.mark.parametrize("across", [-3.0, -1.4, 1.4, 2.5])
def test_one_who_crosses_is_told_from_one_who_stands(across: float) -> None:
    row = (45.0, -2.0 * across, math.pi / 2.0, abs(across), 0.5, 0.6, 1.0)
    found, time = followed([row], vy=across, kind="pedestrian", speed=5.0)
    assert len(found) == 1
    assert found[0].small
    assert found[0].across == pytest.approx(across, abs=0.3)
    assert abs(found[0].along) < 0.5
    where = polygon(row, 0.0, across * time)
    assert where.distance(Place(float(found[0].s.mean()), float(found[0].d.mean()))) < 0.2


@pytest.mark.parametrize("along", [-8.0, 4.5])
def test_one_who_goes_along_has_the_speed_that_it_has(along: float) -> None:
    row = (75.0, 3.2, 0.0, abs(along), 4.5, 1.8, 10.0)
    found, _ = followed([row], vx=along, speed=6.0)
    assert len(found) == 1
    assert found[0].along == pytest.approx(along, abs=0.8)
    assert abs(found[0].across) < 0.4


def test_a_body_that_is_seen_no_more_is_forgotten() -> None:
    outlines, lidar = Outlines(FUSION, "roof", 1.4, 1.9), Lidar(LIDAR, np.random.default_rng(1), walls_of(()))
    scene = actors([(45.0, 0.0, 0.0, 0.0, 4.5, 1.8, 10.0)])
    counts = {}
    for tick in range(100):
        time = 0.02 * tick
        pose = replace(rear_axle(20.0), time=time)
        outlines.step(Observation(tick, time, pose, ROAD, 10.0, {"roof": lidar.output}, 0.0), ROAD.project(20.0, 0.0))
        lidar.step(time, pose, scene if time < 1.0 else actors([(300.0, 0.0, 0.0, 0.0, 4.5, 1.8, 10.0)]))
        lidar.prepare()
        counts[round(time, 2)] = len(outlines.bodies(time, []))
    assert (counts[0.9], counts[1.98]) == (1, 0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("d", "sigma"), [(2.2, 0.5), (2.2, 0.05), (0.3, 0.2)])
def test_who_comes_beyond_the_lidars_sight_lies_beyond_the_point_that_a_radar_sees(
    side: float, d: float, sigma: float
) -> None:
    """Seen from the path; and by a standard deviation farther off, so that he who keeps to his lane is in it."""
    seen = Sighting(120.0, side * d, sigma * sigma, -9.0)
    track = Track(3.0, seen)
    (body,) = Outlines(FUSION, "roof", 1.4, 1.9).bodies(3.2, [track])
    low, high = sorted((side * (d + sigma), side * (d + sigma + 2.0)))
    assert (float(body.d.min()), float(body.d.max())) == pytest.approx((low, high))
    assert (float(body.s.min()), float(body.s.max())) == pytest.approx((120.0 - 1.8, 125.0 - 1.8))
    assert (body.along, body.across) == (-9.0, 0.0)


def bend(radius: float, straight: float = 40.0, ramp: float = 20.0) -> ReferencePath:
    """A path that is straight first, and then bends by a radius [m], left positive."""
    curvature = np.clip((np.arange(250.0) - straight) / ramp, 0.0, 1.0) / radius
    heading = np.concatenate(([0.0], np.cumsum(curvature)))
    return ReferencePath.from_points(np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading)))


def looked(path: ReferencePath, ego_s: float, row: Row, kind: str, walls: Walls) -> Outlines:
    """What is known of a body by a car that has been at rest at `ego_s` for half a second, once it has seen it."""
    at, lidar = path.at(ego_s), Lidar(LIDAR, np.random.default_rng(3), walls)
    outlines = Outlines(FUSION, "roof", 1.4, 1.9)
    for tick in range(26):
        pose = replace(rear_axle(at.x, at.y, at.heading), time=0.02 * tick)
        seen = Observation(tick, 0.02 * tick, pose, path, 8.0, {"roof": lidar.output}, 0.0)
        outlines.step(seen, path.project(pose.x, pose.y))
        lidar.step(0.02 * tick, pose, actors([row], kind=kind))  # type: ignore[arg-type]
        lidar.prepare()
    return outlines


def beside(path: ReferencePath, s: float, d: float, kind: str = "car") -> Row:
    at, size = path.at(s), TYPICAL[kind]
    x, y = at.x - d * math.sin(at.heading), at.y + d * math.cos(at.heading)
    return x, y, at.heading, 0.0, size.length, size.width, 10.0


@pytest.mark.parametrize("radius", [40.0, -40.0, 60.0, -60.0, 100.0, -100.0])
def test_in_a_bend_it_sees_along_the_path_and_not_along_the_cars_axis(radius: float) -> None:
    """A car 70 m ahead on the other lane is up to 40 m beside the axis."""
    path = bend(radius)
    row = beside(path, 110.0, 3.3)
    found = looked(path, 40.0, row, "car", walls_of(())).bodies(0.5, [])
    assert found
    assert all(math.hypot(body.s.mean() - 110.0, body.d.mean() - 3.3) < 3.0 for body in found)


@pytest.mark.parametrize(("radius", "house"), [(-40.0, False), (-80.0, False), (40.0, True), (60.0, True)])
def test_the_road_beside_is_in_sight_where_the_straight_line_to_it_is_free(radius: float, house: bool) -> None:
    """Between the eye and a place beside the path: a van in the way, and a house on the inner side of the bend."""
    path, ego_s = bend(radius), 30.0
    van, at = beside(path, 55.0, 0.0, "van"), path.at(70.0)
    inner = math.copysign(7.0, radius)
    corners = Box(
        at.x - inner * math.sin(at.heading), at.y + inner * math.cos(at.heading), at.heading, 9.0, 6.0
    ).corners()
    stands = [polygon(van)] + [Polygon(corners)] * house
    walls = walls_of((Building(tuple(map(tuple, corners)), 8.0),) if house else ())
    outlines, here = looked(path, ego_s, van, "van", walls), path.at(ego_s)
    eye = here.x + 1.4 * math.cos(here.heading), here.y + 1.4 * math.sin(here.heading)
    agreed, free = [], []
    for s in np.arange(36.0, 105.0, 3.0).tolist():
        x, y, *_ = beside(path, s, 3.3)
        line = LineString([eye, (x, y)])
        away = min(body.distance(line) for body in stands)
        if (0.0 < away < 0.8) or any(0.0 < body.intersection(line).length < 1.5 for body in stands):
            continue  # partly hidden
        if line.length > 80.0:
            continue
        free.append(away > 0.0)
        agreed.append(outlines.in_sight(path, [s], 3.3) == free[-1])
    assert all(agreed)
    assert any(free)
    assert not all(free)


def test_one_who_steps_out_between_two_cars_is_neither_a_part_of_one_nor_stands_while_he_is_hidden() -> None:
    """Each car goes on in the direction that he is seen in: he was taken for a part of it, or lost, or stood."""
    lidar, outlines = Lidar(LIDAR, np.random.default_rng(0), walls_of(())), Outlines(FUSION, "roof", 1.4, 1.9)
    cars, size = [car(60.0, -0.4), car(67.0, -0.4)], TYPICAL["pedestrian"]
    rates = []
    for tick in range(86):
        time = 0.02 * tick
        pose = replace(rear_axle(38.0 + 8.0 * time, 2.4, 0.0, 8.0), time=time)
        d = -1.0 + 1.2 * max(time - 0.6, 0.0)
        person = (63.6, d, math.pi / 2.0, 1.2, size.length, size.width, 0.5)
        outlines.step(
            Observation(tick, time, pose, ROAD, 8.0, {"roof": lidar.output}, 0.0), ROAD.project(pose.x, pose.y)
        )
        scene = actors([*cars, person])
        scene.height[2] = TYPICAL["pedestrian"].height
        lidar.step(time, pose, scene)
        lidar.prepare()
        if time > 1.3:
            places = [(math.hypot(body.s.mean() - 63.6, body.d.mean() - d), body) for body in outlines.bodies(time, [])]
            rates.append(max((body.across for away, body in places if away < 0.4), default=0.0))
    assert min(rates) > 0.8
