"""Outlines that a lidar's turns give, against the bodies that were looked at (shapely), and how those move."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import MultiPoint, Polygon
from shapely.geometry import Point as Place

from controllers.outlines import Body, Outlines
from controllers.sightings import Sighting
from controllers.tracks import Track
from tests.controllers.avoid_bench import LIDAR
from tests.controllers.bench import ROAD
from tests.sensors.scenes import FUSION, Row, actors, rear_axle
from vve_sumo.geometry import Box
from vve_sumo.sensors.lidar import Lidar
from vve_sumo.sensors.street import walls_of
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
