"""What the rays of a lidar meet: against another library's ray casting, and against every ray by itself."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sensors.scenes import Row, actors
from vve_sumo.body_kinds import BODY_KINDS, TYPICAL
from vve_sumo.sensors.body_shapes import PARTS, Blocks, Part, blocks_of, finite_rows
from vve_sumo.sensors.ray_casting import GROUND, NOTHING, WALL, Channels, Hits, Stretch, cast
from vve_sumo.sensors.street import Building, Walls, walls_of
from vve_sumo.values import Actors, Floats

REACH = 100.0
ELEVATIONS = np.radians(np.arange(-15.0, 16.0, 2.0))
#: neither rising nor falling, as a VLP-16's are, and steeper
STEEP = np.radians([-70.0, 5.0, -30.0, 40.0, -1.0, 0.0, -50.0, 20.0])
NO_WALLS = walls_of(())


class Firings(NamedTuple):
    """Firings without what they may meet."""

    channels: Channels
    x: Floats
    y: Floats
    age: Floats
    azimuth: Floats
    step: float


def hits_of(fired: Firings, blocks: Blocks, walls: Walls) -> Hits:
    return cast(fired.channels, [Stretch(*fired[1:], blocks, walls)])


def firings(
    count: int,
    *,
    turn: float = -math.tau,
    height: float = 1.9,
    moves: float = 0.0,
    begin: float = 0.0,
    elevations: Floats = ELEVATIONS,
) -> Firings:
    """A turn, or a part of one, of a lidar that moves so far along +x [m] in the 0.1 s that it takes."""
    share = np.arange(count) / count
    azimuth = begin + turn * share
    channels = Channels.of(elevations, np.arange(len(elevations)) / (1.5 * len(elevations)), height, REACH)
    return Firings(channels, moves * share, np.zeros(count), 0.1 * (1.0 - share), azimuth, turn / count)


def crowd(count: int, seed: int, *, speed: float = 0.0) -> Actors:
    """Bodies of all kinds around the origin, none of which holds it."""
    chance = np.random.default_rng(seed)
    rows: list[Row] = []
    while len(rows) < count:
        x, y, heading = chance.uniform(-70, 70), chance.uniform(-40, 40), chance.uniform(-math.pi, math.pi)
        length, width = chance.uniform(0.4, 14.0), chance.uniform(0.4, 2.6)
        if math.hypot(x, y) > 9.0:
            rows.append((x, y, heading, speed, length, width, 10.0))
    kinds = chance.integers(0, len(BODY_KINDS), count).astype(np.int8)
    heights = np.array([TYPICAL[BODY_KINDS[kind]].height for kind in kinds.tolist()])
    return replace(actors(rows), kind=kinds, height=heights)


def street(seed: int) -> Walls:
    chance = np.random.default_rng(seed)
    buildings = []
    for _ in range(12):
        x, y = chance.uniform(-90, 90), chance.choice([-1, 1]) * chance.uniform(15, 60)
        outline = ((x, y), (x + 12, y + 2), (x + 10, y + 11), (x - 1, y + 9))
        buildings.append(Building(outline, float(chance.uniform(2.0, 9.0))))
    return walls_of(buildings)


def all_blocks(seen: Actors) -> Blocks:
    return blocks_of(seen, np.arange(len(seen.ids)))


# --- against another library ------------------------------------------------------------------------------------------


def mesh_of(blocks: Blocks, walls: Walls) -> trimesh.Trimesh:
    """Blocks, walls and the ground as triangles."""
    parts = []
    for row in range(len(blocks.x)):
        height = blocks.top[row] - blocks.bottom[row]
        sides = 2.0 * blocks.half_length[row], 2.0 * blocks.half_width[row], height
        place = trimesh.transformations.rotation_matrix(math.atan2(blocks.sin[row], blocks.cos[row]), [0.0, 0.0, 1.0])
        place[:3, 3] = blocks.x[row], blocks.y[row], blocks.bottom[row] + 0.5 * height
        parts.append(trimesh.creation.box(sides, place))
    for x, y, along_x, along_y, top in zip(*walls, strict=True):
        corners = [(x, y, 0.0), (x + along_x, y + along_y, 0.0), (x + along_x, y + along_y, top), (x, y, top)]
        parts.append(trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False))
    ground = [(-500.0, -500.0, 0.0), (500.0, -500.0, 0.0), (500.0, 500.0, 0.0), (-500.0, 500.0, 0.0)]
    parts.append(trimesh.Trimesh(ground, [(0, 1, 2), (0, 2, 3)], process=False))
    return trimesh.util.concatenate(parts)


def by_mesh(fired: Firings, mesh: trimesh.Trimesh) -> Floats:
    channels = fired.channels
    azimuth = fired.azimuth[:, None] + channels.spread * fired.step
    level, steep = np.cos(channels.elevation), np.sin(channels.elevation)
    ways = np.stack((np.cos(azimuth) * level, np.sin(azimuth) * level, np.broadcast_to(steep, azimuth.shape)), -1)
    begins = np.empty_like(ways)
    begins[..., 0], begins[..., 1], begins[..., 2] = fired.x[:, None], fired.y[:, None], channels.height
    flat = begins.reshape(-1, 3)
    at, ray, _triangle = mesh.ray.intersects_location(flat, ways.reshape(-1, 3), multiple_hits=False)
    far = np.full(len(flat), math.inf)
    far[ray] = np.linalg.norm(at - flat[ray], axis=1)
    far[far > REACH] = math.inf
    return far.reshape(azimuth.shape)


def compare_with_mesh(count: int, seed: int) -> None:
    blocks, walls, fired = all_blocks(crowd(30, seed)), street(seed), firings(count)
    hits, far = hits_of(fired, blocks, walls), by_mesh(fired, mesh_of(blocks, walls))
    # A ray along an edge may pass it on either side.
    assert 1.0 - np.isclose(hits.range, far, rtol=0.0, atol=1e-6).mean() < 1e-4
    assert {GROUND, WALL, NOTHING} < set(hits.what.ravel().tolist())
    assert len(set(hits.what[hits.what >= 0].tolist())) > 20


@pytest.mark.thorough
def test_a_turn_meets_what_another_library_says() -> None:
    compare_with_mesh(300, 1)


@pytest.mark.slow
def test_many_turns_meet_what_another_library_says() -> None:
    for seed in range(4):
        compare_with_mesh(1800, seed)


# --- every ray by itself ----------------------------------------------------------------------------------------------


def alone(fired: Firings, firing: int, blocks: Blocks, walls: Walls) -> tuple[Floats, list[int]]:
    """What a firing's rays meet, each block and wall looked at where it is at that moment, none left out."""
    channels = len(fired.channels.elevation)
    far, what = np.full(channels, math.inf), [NOTHING] * channels
    at, age = np.array([fired.x[firing], fired.y[firing], fired.channels.height]), fired.age[firing]
    for channel, elevation in enumerate(fired.channels.elevation.tolist()):
        azimuth = fired.azimuth[firing] + fired.channels.spread[channel] * fired.step
        way = np.array(
            [math.cos(azimuth) * math.cos(elevation), math.sin(azimuth) * math.cos(elevation), math.sin(elevation)]
        )
        found = [(at[2] / -way[2], GROUND)] if way[2] < 0.0 else []
        for row in range(len(blocks.x)):
            cos, sin = blocks.cos[row], blocks.sin[row]
            axes = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
            height = 0.5 * (blocks.top[row] + blocks.bottom[row])
            middle = np.array(
                [blocks.x[row] - blocks.speed_x[row] * age, blocks.y[row] - blocks.speed_y[row] * age, height]
            )
            half = np.array(
                [blocks.half_length[row], blocks.half_width[row], 0.5 * (blocks.top[row] - blocks.bottom[row])]
            )
            begin, own = axes @ (at - middle), axes @ way
            own = np.where(own == 0.0, 1e-300, own)
            planes = np.stack(((-half - begin) / own, (half - begin) / own))
            entry, leave = planes.min(axis=0).max(), planes.max(axis=0).min()
            if 0.0 < entry <= leave:
                found.append((float(entry), row))
        for x, y, along_x, along_y, top in zip(*walls, strict=True):
            matrix = np.array([[way[0], -along_x], [way[1], -along_y]])
            distance, share = np.linalg.solve(matrix, [x - at[0], y - at[1]])
            if distance > 0.0 and 0.0 <= share <= 1.0 and 0.0 <= at[2] + distance * way[2] <= top:
                found.append((float(distance), WALL))
        nearest = min(found, default=(math.inf, NOTHING))
        if nearest[0] <= REACH:
            far[channel], what[channel] = nearest
    return far, what


@pytest.mark.thorough
@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 10**6),
    st.floats(-15.0, 15.0),
    st.floats(-4.0, 4.0),
    st.sampled_from([-math.tau, -0.2 * math.tau, 0.3 * math.tau]),
    st.floats(-10.0, 10.0),
)
def test_while_everything_moves_each_ray_meets_what_is_there_at_its_moment(
    seed: int, speed: float, moves: float, turn: float, begin: float
) -> None:
    blocks, walls = all_blocks(crowd(8, seed, speed=speed)), street(seed)
    fired = firings(90, turn=turn, moves=moves, begin=begin)
    hits = hits_of(fired, blocks, walls)
    for firing in np.random.default_rng(seed).integers(0, 90, 12).tolist():
        far, what = alone(fired, firing, blocks, walls)
        assert hits.range[firing] == pytest.approx(far, abs=1e-6, rel=0.0)
        assert what == hits.what[firing].tolist()


@pytest.mark.thorough
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.3, 4.0), st.floats(-8.0, 8.0), st.floats(-10.0, 10.0))
def test_among_bodies_that_stand_around_and_over_it_each_ray_meets_what_is_there(
    seed: int, height: float, moves: float, begin: float
) -> None:
    """Rays that are steep, and a lidar above roofs, between bodies, under them and on its way into them."""
    chance = np.random.default_rng(seed)
    rows = [
        (*chance.uniform(-6.0, 6.0, 2), *chance.uniform(-4.0, 4.0, 2), *chance.uniform(0.5, 8.0, 2), 10.0)
        for _ in range(6)
    ]
    seen = replace(actors(rows), height=chance.uniform(0.3, 4.0, len(rows)), kind=np.arange(2, 8).astype(np.int8))
    blocks, fired = all_blocks(seen), firings(60, moves=moves, begin=begin, height=height, elevations=STEEP)
    hits = hits_of(fired, blocks, NO_WALLS)
    for firing in chance.integers(0, 60, 12).tolist():
        far, what = alone(fired, firing, blocks, NO_WALLS)
        assert hits.range[firing] == pytest.approx(far, abs=1e-6, rel=0.0)
        assert what == hits.what[firing].tolist()


@pytest.mark.parametrize(
    ("body", "moves", "what"),
    [
        ((0.0, 0.0, 0.4, 0.0, 6.0, 6.0, 10.0), 0.0, "a wide roof under the lidar"),
        ((4.0, 1.2, 0.0, 0.0, 0.6, 0.6, 10.0), 8.0, "a post that is passed closely, and far away before and after"),
    ],
)
def test_steep_rays_meet_what_is_nearer_than_its_corners(body: Row, moves: float, what: str) -> None:
    fired = firings(60, moves=moves, begin=1.5 * math.pi, elevations=STEEP)
    blocks = all_blocks(actors([body]))
    hits = hits_of(fired, blocks, NO_WALLS)
    for firing in range(60):
        far, row = alone(fired, firing, blocks, NO_WALLS)
        assert hits.range[firing] == pytest.approx(far, abs=1e-6, rel=0.0), what
        assert row == hits.what[firing].tolist(), what
    assert (hits.what[:, STEEP < -0.8] == 0).any(), what


@pytest.mark.parametrize("begin", [0.0, 1.7, 2.9, 3.1, 3.3])
def test_where_two_roofs_of_the_same_height_are_one_it_is_the_later_body_s(begin: float) -> None:
    """Wherever in the turn they are met; bodies touch where a drive ends in a contact."""
    rows = [(8.0, 0.0, 0.0, 0.0, 9.0, 2.0, 10.0), (9.0, 0.4, 0.0, 0.0, 9.0, 2.0, 10.0)]
    fired = firings(1800, begin=begin)
    hits = hits_of(fired, all_blocks(actors(rows)), NO_WALLS)
    down = np.abs(hits.cosine - np.abs(np.sin(ELEVATIONS))) < 1e-12
    roofs = down & (hits.what >= 0)
    firing, channel = np.nonzero(roofs)
    azimuth = fired.azimuth[firing] + fired.channels.spread[channel] * fired.step
    level = hits.range[roofs] * np.cos(ELEVATIONS[channel])
    x, y = level * np.cos(azimuth), level * np.sin(azimuth)
    later = (np.abs(x - 9.0) < 4.5 - 1e-9) & (np.abs(y - 0.4) < 1.0 - 1e-9)
    assert (hits.what[roofs][later] == 1).all()
    assert (later & (np.abs(x - 8.0) < 4.5) & (np.abs(y) < 1.0)).sum() > 20, "met in both"
    assert (hits.what[roofs] == 0).any()


def test_stretches_that_are_cast_together_meet_what_each_meets_alone() -> None:
    """Bodies, walls, lengths, ways and steps of their own, one of a single firing and one with nothing around it."""
    given_ = [
        (firings(90, turn=-1.5, moves=3.0), crowd(30, 1, speed=6.0), street(1)),
        (firings(1, turn=-0.01, begin=1.0), crowd(20, 2), street(2)),
        (firings(70, turn=-1.2, begin=0.5), actors([]), NO_WALLS),
        (firings(120, turn=-math.tau, begin=2.0, moves=-2.0), crowd(40, 3, speed=-9.0), street(3)),
    ]
    stretches = [Stretch(*fired[1:], all_blocks(seen), walls) for fired, seen, walls in given_]
    together = cast(given_[0][0].channels, stretches)
    first, row = 0, 0
    for (fired, _, _), stretch in zip(given_, stretches, strict=True):
        own, rows = hits_of(fired, stretch.blocks, stretch.walls), slice(first, first + len(fired.x))
        assert np.array_equal(together.range[rows], own.range)
        assert np.array_equal(together.cosine[rows], own.cosine)
        assert np.array_equal(together.what[rows], np.where(own.what >= 0, own.what + row, own.what))
        first, row = rows.stop, row + len(stretch.blocks.x)
    assert first == len(together.range)


@pytest.mark.parametrize("heading", [0.0, 0.7, 1.5707963])
def test_a_body_beside_the_lidar_is_met_all_along_its_side(heading: float) -> None:
    fired = firings(720)
    blocks = all_blocks(actors([(0.0, 1.4, heading, 0.0, 4.5, 1.0, 10.0)]))
    hits = hits_of(fired, blocks, NO_WALLS)
    for firing in range(0, 720, 7):
        assert hits.what[firing].tolist() == alone(fired, firing, blocks, NO_WALLS)[1]


def test_a_lidar_inside_a_body_does_not_see_it() -> None:
    inside = all_blocks(actors([(0.0, 0.0, 0.3, 0.0, 4.5, 1.8, 10.0)]))
    assert set(hits_of(firings(720, height=1.0), inside, NO_WALLS).what.ravel().tolist()) == {GROUND, NOTHING}
    assert hits_of(firings(720), inside, NO_WALLS).what[0, 0] == 0, "from above it sees the roof"


def test_nothing_but_the_ground() -> None:
    hits = hits_of(firings(10), all_blocks(actors([])), NO_WALLS)
    down = ELEVATIONS < 0.0
    expected = 1.9 / np.sin(-ELEVATIONS[down])
    expected[expected > REACH] = math.inf
    assert hits.range[:, down] == pytest.approx(np.broadcast_to(expected, (10, 8)), rel=1e-12)
    assert (hits.what[:, ~down] == NOTHING).all()
    assert hits.cosine[:, 0] == pytest.approx(math.sin(math.radians(15.0)))


def test_what_is_farther_along_the_ray_than_the_reach_is_not_met() -> None:
    """A tower ahead and a block behind, 99.5 m away: rays of 15 degrees would need 103 m to them."""
    tower = walls_of([Building(((99.5, -10.0), (99.5, 10.0), (150.0, 0.0)), 50.0)])
    block = replace(actors([(-101.75, 0.0, 0.0, 0.0, 4.5, 20.0, 10.0)]), height=np.array([50.0]))
    hits = hits_of(firings(1800), all_blocks(block), tower)
    for firing, what in ((0, WALL), (900, 0)):
        far = np.where(ELEVATIONS > 0.0, 99.5 / np.cos(ELEVATIONS), math.inf)
        far[far > REACH] = math.inf
        up = ELEVATIONS > 0.0
        assert hits.range[firing, up] == pytest.approx(far[up], abs=0.01)
        assert hits.what[firing, up].tolist() == np.where(np.isfinite(far[up]), what, NOTHING).tolist()
    assert np.isfinite(hits.range[0]).sum() < len(ELEVATIONS)


def test_the_cosine_is_that_of_the_surface() -> None:
    """A car ahead, met squarely at the rear; the roof of a low one, met at the elevation's own angle."""
    ahead = hits_of(firings(1800), all_blocks(actors([(22.25, 0.0, 0.0, 0.0, 4.5, 1.8, 10.0)])), NO_WALLS)
    assert ahead.what[0, 8] == NOTHING, "a degree up"
    assert ahead.cosine[0, 7] == pytest.approx(math.sin(math.radians(1.0))), "passes the rear, and meets the roof"
    assert (ahead.what[0, 6], ahead.range[0, 6]) == (0, pytest.approx(20.0 / math.cos(math.radians(3.0)), rel=1e-3))
    assert ahead.cosine[0, 6] == pytest.approx(math.cos(math.radians(3.0)), abs=1e-3)
    roof = hits_of(firings(1800), all_blocks(actors([(12.0, 0.0, 0.0, 0.0, 10.0, 3.0, 10.0)])), NO_WALLS)
    down = 4  # seven degrees: from 1.9 m it meets a roof of 1.5 m after 3.3 m, before the car begins at 7 m
    assert roof.what[0, down] == 0
    shallow = 6  # three degrees: it meets the roof after 7.6 m
    assert roof.range[0, shallow] == pytest.approx(0.4 / math.sin(math.radians(3.0)))
    assert roof.cosine[0, shallow] == pytest.approx(math.sin(math.radians(3.0)))


# --- shapes -----------------------------------------------------------------------------------------------------------


def test_a_body_s_blocks_are_the_parts_of_its_kind() -> None:
    """Body by body, from the proportions of its kind."""
    seen = crowd(40, 3, speed=3.0)
    seen = replace(seen, lateral_speed=np.linspace(-1.0, 1.0, 40))
    rows = np.array([7, 3, *range(12, 40)])
    expected = []
    for row in rows.tolist():
        cos, sin = math.cos(seen.heading[row]), math.sin(seen.heading[row])
        length, width, height = seen.length[row], seen.width[row], seen.height[row]
        for part in PARTS.get(BODY_KINDS[seen.kind[row]], (Part(0.0, 0.0, 1.0, 1.0, 0.0, 1.0),)):
            ahead, left = part.ahead * length, part.left * width
            expected.append((
                row, seen.x[row] + ahead * cos - left * sin, seen.y[row] + ahead * sin + left * cos, cos, sin,
                0.5 * part.length * length, 0.5 * part.width * width, part.bottom * height, part.top * height,
                seen.speed[row] * cos - seen.lateral_speed[row] * sin,
                seen.speed[row] * sin + seen.lateral_speed[row] * cos,
            ))  # fmt: skip
    assert len(expected) > len(rows)
    assert np.stack(blocks_of(seen, rows), -1) == pytest.approx(np.array(expected), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("column", ["x", "y", "heading", "speed", "lateral_speed", "length", "width", "height"])
def test_rows_with_a_number_that_is_none_are_left_out(column: str) -> None:
    seen = crowd(6, 1)
    values = getattr(seen, column).copy()
    values[[1, 4]] = math.nan, -math.inf
    assert finite_rows(seen).tolist() == [0, 1, 2, 3, 4, 5]
    assert finite_rows(replace(seen, **{column: values})).tolist() == [0, 2, 3, 5]
    assert finite_rows(actors([])).tolist() == []


@given(st.integers(0, 10**6))
def test_no_block_sticks_out_of_its_body(seed: int) -> None:
    seen = crowd(10, seed, speed=3.0)
    blocks = all_blocks(seen)
    for row, actor in enumerate(blocks.actor.tolist()):
        east, north = blocks.x[row] - seen.x[actor], blocks.y[row] - seen.y[actor]
        cos, sin = math.cos(seen.heading[actor]), math.sin(seen.heading[actor])
        ahead, left = east * cos + north * sin, north * cos - east * sin
        assert abs(ahead) + blocks.half_length[row] <= 0.5 * seen.length[actor] + 1e-9
        assert abs(left) + blocks.half_width[row] <= 0.5 * seen.width[actor] + 1e-9
        assert 0.0 <= blocks.bottom[row] < blocks.top[row] <= seen.height[actor] + 1e-9
        assert math.hypot(blocks.speed_x[row], blocks.speed_y[row]) == pytest.approx(3.0)
    assert set(blocks.actor.tolist()) == set(range(10))


def test_walls_near_a_place_are_those_that_come_near() -> None:
    walls = walls_of([Building(((10.0, -50.0), (10.0, 50.0), (90.0, 50.0), (90.0, -50.0)), 6.0)])
    near = walls.near(0.0, 0.0, 20.0)
    assert (near.x.tolist(), near.along_y.tolist()) == ([10.0], [100.0])
    assert len(walls.near(50.0, 0.0, 41.0).x) == 2
    assert len(walls.near(0.0, 0.0, 5.0).x) == 0
