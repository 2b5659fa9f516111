"""Gap, time to collision and DRAC of random scenes, with long and oblique bodies, against brute force of their own.

The scenes are on a straight road, where bodies are polygons and shapely clips them. Each tick has one actor, which goes
on along a straight way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
import shapely

from tests.metrics.tables import CAR, actors_of, drive_of, ticks_of
from vve_sumo.metrics.conflict import HORIZON
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.following import MAX_DECELERATION
from vve_sumo.metrics.lead_vehicle import CLOSING_FLOOR
from vve_sumo.path import ReferencePath
from vve_sumo.values import Floats

SCENES = 2000  #: of one batch
EGO_S = 100.0  #: of the rear axle [m]
REAR = EGO_S + CAR.rear_axle_to_bumper - CAR.length
BUMPER = EGO_S + CAR.rear_axle_to_bumper
HALF = CAR.width / 2.0
END = 2000.0  #: of the path [m]


class Scenes(NamedTuple):
    """The ego's speed and an actor: an entry a scene."""

    speed: Floats
    x: Floats
    y: Floats
    heading: Floats
    length: Floats
    width: Floats
    other: Floats


def scenes(seed: int) -> Scenes:
    """Persons, cars, buses and lorries with trailers, at any angle, near the ego and its way."""
    random = np.random.default_rng(seed)

    def between(low: float, high: float) -> Floats:
        return random.uniform(low, high, SCENES)

    length = random.choice([0.5, 4.3, 12.0, 18.75], SCENES)
    width = np.choose(np.searchsorted([0.5, 4.3, 12.0], length), [0.5, 1.8, 2.5, 2.55])
    x, y = EGO_S + between(-10.0, 80.0), between(-25.0, 25.0)
    near = random.random(SCENES) < 0.5
    y = np.where(near, 0.2 * y, y)
    other = np.where(random.random(SCENES) < 0.2, 0.0, between(0.3, 15.0))
    return Scenes(between(0.5, 20.0), x, y, between(-math.pi, math.pi), length, width, other)


def drive(scene: Scenes) -> DriveData:
    ticks = [
        {"time_s": float(i), "true_x_m": EGO_S, "s_m": EGO_S, "true_speed_mps": v}
        for i, v in enumerate(scene.speed.tolist())
    ]
    names = ("x_m", "y_m", "heading_rad", "length_m", "width_m", "speed_mps")
    columns = (scene.x, scene.y, scene.heading, scene.length, scene.width, scene.other)
    actors = [
        {"tick": i, "actor": f"a{i}", **dict(zip(names, row, strict=True))}
        for i, row in enumerate(np.column_stack(columns).tolist())
    ]
    return drive_of(ticks_of(ticks), actors_of(actors), ReferencePath.from_points([0.0, END], [0.0, 0.0]))


def corners(scene: Scenes, time: Floats) -> Floats:
    """The corners of the actors' bodies at times from now [s], (n, 4, 2)."""
    cos, sin = np.cos(scene.heading), np.sin(scene.heading)
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) / 2.0
    along, across = signs[:, 0] * scene.length[:, None], signs[:, 1] * scene.width[:, None]
    x = (scene.x + scene.other * time * cos)[:, None] + along * cos[:, None] - across * sin[:, None]
    y = (scene.y + scene.other * time * sin)[:, None] + along * sin[:, None] + across * cos[:, None]
    return np.stack((x, y), axis=2)


def box(near: float, far: float) -> Floats:
    return np.array([(far, HALF), (near, HALF), (near, -HALF), (far, -HALF)])


def expected_gap(scene: Scenes) -> Floats:
    """Bumper to the body as shapely clips it to the strip, for one whose middle or whole part in it is ahead."""
    bodies = shapely.polygons(corners(scene, np.zeros(SCENES)))
    ego = shapely.Polygon(box(REAR, BUMPER))
    part = shapely.intersection(bodies, shapely.Polygon(box(-1000.0, 1000.0)))
    gap = np.where(shapely.is_empty(part), np.nan, shapely.bounds(part)[:, 0] - BUMPER)
    apart = shapely.distance(bodies, ego)
    middle = 0.5 * (REAR + BUMPER)
    ahead = ((scene.x > middle) | (gap + BUMPER > middle)) & (np.nan_to_num(gap, nan=np.inf) < 150.0)
    overlap = np.maximum(np.minimum(gap, 0.0), -CAR.length)
    return np.where(ahead, np.where(apart > 0.0, np.maximum(gap, apart), overlap), np.nan)


def sweep(points: Floats, moves: Floats, polygon: Floats) -> tuple[Floats, Floats]:
    """First and last time at which points (n, 4, 2) that move steadily are on the sides of polygons (n, 4, 2)."""
    first, last = np.full(len(points), np.inf), np.full(len(points), -np.inf)
    for corner in range(4):
        for side in range(4):
            begin, along = polygon[:, side], polygon[:, (side + 1) % 4] - polygon[:, side]
            from_begin = points[:, corner] - begin
            cross = along[:, 0] * moves[:, 1] - along[:, 1] * moves[:, 0]
            with np.errstate(divide="ignore", invalid="ignore"):
                time = (from_begin[:, 0] * along[:, 1] - from_begin[:, 1] * along[:, 0]) / cross
                place = from_begin + time[:, None] * moves
                share = (place * along).sum(axis=1) / (along * along).sum(axis=1)
            hits = (cross != 0.0) & (share >= 0.0) & (share <= 1.0) & (time >= 0.0)
            first = np.where(hits, np.minimum(first, time), first)
            last = np.where(hits, np.maximum(last, time), last)
    return first, last


def expected_contact(scene: Scenes) -> tuple[Floats, Floats]:
    """First and last touch: some corner of one body then is on a side of the other."""
    theirs, mine = corners(scene, np.zeros(SCENES)), np.broadcast_to(box(REAR, BUMPER), (SCENES, 4, 2))
    direction = np.stack((np.cos(scene.heading), np.sin(scene.heading)), axis=1)
    moves = scene.other[:, None] * direction - np.stack((scene.speed, np.zeros(SCENES)), axis=1)
    one, other = sweep(theirs, moves, mine), sweep(mine, -moves, theirs)
    first, last = np.minimum(one[0], other[0]), np.maximum(one[1], other[1])
    overlap = shapely.intersects(shapely.polygons(theirs), shapely.polygons(mine))
    return np.where(overlap, 0.0, first), last


def nearest_in_band(scene: Scenes, time: Floats) -> Floats:
    """Bumper to the part of the bodies in the band that the ego sweeps, at one time each; inf for none."""
    part = shapely.intersection(shapely.polygons(corners(scene, time)), shapely.Polygon(box(-1000.0, 3000.0)))
    return np.where(shapely.is_empty(part), np.inf, shapely.bounds(part)[:, 0] - BUMPER)


def asked(scene: Scenes, time: Floats) -> Floats:
    """Deceleration with which the bumper just does not reach the body by a time."""
    room, v = nearest_in_band(scene, time), scene.speed
    with np.errstate(divide="ignore", invalid="ignore"):
        stops, arrives = v * v / (2.0 * room), 2.0 * (v * time - room) / time**2
    needed = np.where(2.0 * room / v < time, stops, np.maximum(arrives, 0.0))
    return np.where(np.isinf(room), 0.0, np.where(room <= 0.0, np.inf, needed))


def expected_deceleration(scene: Scenes, met: Floats) -> Floats:
    """The most that is asked at any time while the body is in the band, by a grid that is refined around the worst."""
    reach = 0.5 * np.hypot(scene.length, scene.width) + HALF
    across = np.abs(scene.other * np.sin(scene.heading))
    spell = (2.0 * reach / np.maximum(across, 1e-3)).clip(max=25.0 / scene.other)
    low, high = np.maximum(met - spell, 0.0), met + spell
    most, grid = np.zeros(len(met)), 200
    for _ in range(10):
        times = low + (high - low) * np.linspace(0.0, 1.0, grid)[:, None]
        needed = np.array([asked(scene, time) for time in times])
        worst = np.argmax(needed, axis=0)
        most = np.maximum(most, needed.max(axis=0))
        rows = np.arange(len(met))
        low, high = times[np.maximum(worst - 1, 0), rows], times[np.minimum(worst + 1, grid - 1), rows]
        grid = 12
    return np.minimum(most, MAX_DECELERATION)


def check_gap(seed: int) -> None:
    scene = scenes(seed)
    found, expected = drive(scene).strip_lead, expected_gap(scene)
    np.testing.assert_allclose(found.gap, expected, atol=1e-6, rtol=0.0)
    assert 0.2 < np.isfinite(expected).mean() < 0.8
    # A body apart has a gap, of no less than its distance.
    apart = shapely.distance(shapely.polygons(corners(scene, np.zeros(SCENES))), shapely.Polygon(box(REAR, BUMPER)))
    assert (found.gap[apart > 0.0] >= apart[apart > 0.0] - 1e-9)[np.isfinite(found.gap[apart > 0.0])].all()
    assert (found.gap[apart == 0.0] <= 0.0)[np.isfinite(found.gap[apart == 0.0])].all()
    closing = scene.speed - scene.other * np.cos(scene.heading)
    counts = (expected > 1e-3) & (closing > CLOSING_FLOOR)
    np.testing.assert_allclose(found.time_to_collision[counts], (expected / closing)[counts], rtol=1e-6, atol=1e-6)
    needed = np.minimum(closing[counts] ** 2 / (2.0 * expected[counts]), MAX_DECELERATION)
    np.testing.assert_allclose(found.required_deceleration[counts], needed, rtol=1e-6, atol=1e-6)


def check_contacts(seed: int) -> None:
    scene = scenes(seed)
    found, (first, last) = drive(scene).conflict, expected_contact(scene)
    known, meets = np.isfinite(found.time), (first < HORIZON - 1e-6) & (last - first > 0.06)
    # One that the ego does not meet head on may come from behind, which is left out.
    place = scene.x + first * (scene.other * np.cos(scene.heading) - scene.speed)
    ahead = np.where(np.isfinite(first), place, 0.0) > REAR + 1e-6
    assert known[meets & ahead].all()
    assert not known[np.isinf(first)].any()
    counts = known & meets
    np.testing.assert_allclose(found.time[counts], first[counts], atol=1e-6, rtol=0.0)
    assert counts.mean() > 0.15
    crosses = np.flatnonzero(counts & (first > 0.0) & (scene.other > 0.0) & (np.cos(scene.heading) < 0.5))[:60]
    few = Scenes(*(column[crosses] for column in scene))
    expected = expected_deceleration(few, first[crosses])
    assert len(crosses) == 60
    np.testing.assert_allclose(found.deceleration[crosses], expected, atol=2e-6, rtol=1e-6)


def test_gap_in_the_strip_is_that_of_clipped_polygons() -> None:
    check_gap(1)


@pytest.mark.thorough
def test_contact_and_deceleration_are_those_of_polygons_in_motion() -> None:
    check_contacts(1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 52))
def test_a_hundred_thousand_scenes(seed: int) -> None:
    check_gap(seed)
    check_contacts(seed)
