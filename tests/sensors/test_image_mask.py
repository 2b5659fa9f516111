"""The mask of a pinhole camera: against the ray of every pixel, cast by itself, and by another library."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.sensors.scenes import actors, car
from tests.sensors.test_ray_casting import all_blocks, crowd, mesh_of, street
from vve_sumo.sensors.body_shapes import Blocks
from vve_sumo.sensors.image_mask import NOBODY, WALL, CameraPlace, Mask, Pinhole, mask_of
from vve_sumo.sensors.street import Walls, walls_of
from vve_sumo.values import Floats

SMALL = Pinhole(96, 48, 90.0)
NO_WALLS = walls_of(())
REACH = 90.0


def rays(view: Pinhole, at: CameraPlace) -> Floats:
    """The direction of each pixel's middle, for a metre along the axis (rows, columns, 3)."""
    right = (np.arange(view.columns) + 0.5 - 0.5 * view.columns) / view.focal
    down = (np.arange(view.rows) + 0.5 - 0.5 * view.rows) / view.focal
    cos, sin = math.cos(at.heading), math.sin(at.heading)
    east, north = cos + right * sin, sin - right * cos
    ways = np.empty((view.rows, view.columns, 3))
    ways[..., 0], ways[..., 1], ways[..., 2] = east, north, -down[:, None]
    return ways


def nearest_by_mesh(view: Pinhole, at: CameraPlace, blocks: Blocks, walls: Walls) -> Floats:
    """Depth of the first triangle behind each pixel, bodies and walls alone; infinite for none."""
    mesh = mesh_of(blocks, walls)
    mesh.update_faces(np.arange(len(mesh.faces)) < len(mesh.faces) - 2)  # the ground is in no mask
    ways = rays(view, at).reshape(-1, 3)
    begins = np.broadcast_to([at.x, at.y, at.z], ways.shape)
    place, ray, _ = mesh.ray.intersects_location(begins, ways, multiple_hits=False)
    depth = np.full(len(ways), math.inf)
    depth[ray] = np.linalg.norm(place - begins[ray], axis=1) / np.linalg.norm(ways[ray], axis=1)
    return depth.reshape(view.rows, view.columns)


def who_by_pixel(view: Pinhole, at: CameraPlace, blocks: Blocks, walls: Walls) -> np.ndarray:
    """The row of the nearest block behind each pixel, each looked at by itself; WALL and NOBODY likewise."""
    ways, found = rays(view, at), np.full((view.rows, view.columns), NOBODY)
    depth = np.full(found.shape, math.inf)
    for row in range(len(blocks.x)):
        cos, sin = blocks.cos[row], blocks.sin[row]
        axes = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        middle = np.array([blocks.x[row], blocks.y[row], 0.5 * (blocks.top[row] + blocks.bottom[row])])
        half = np.array([blocks.half_length[row], blocks.half_width[row], 0.5 * (blocks.top[row] - blocks.bottom[row])])
        begin, own = axes @ (np.array([at.x, at.y, at.z]) - middle), ways @ axes.T
        own = np.where(own == 0.0, 1e-300, own)
        planes = np.stack(((-half - begin) / own, (half - begin) / own))
        entry, leave = planes.min(axis=0).max(axis=-1), planes.max(axis=0).min(axis=-1)
        nearer = (entry <= leave) & (entry > 0.1) & (entry <= REACH) & (entry < depth)
        found[nearer], depth[nearer] = row, entry[nearer]
    for x, y, along_x, along_y, top in zip(*walls, strict=True):
        cross = ways[..., 0] * along_y - ways[..., 1] * along_x
        cross = np.where(cross == 0.0, 1e-300, cross)
        entry = ((x - at.x) * along_y - (y - at.y) * along_x) / cross
        share = ((x - at.x) * ways[..., 1] - (y - at.y) * ways[..., 0]) / cross
        height = at.z + entry * ways[..., 2]
        meets = (share >= 0.0) & (share <= 1.0) & (height >= 0.0) & (height <= top)
        nearer = meets & (entry > 0.1) & (entry <= REACH) & (entry < depth)
        found[nearer], depth[nearer] = WALL, entry[nearer]
    return found


def picture_of(view: Pinhole, at: CameraPlace, blocks: Blocks, walls: Walls, reach: float) -> Mask:
    """A mask of the whole picture, with the rows above and below the mask that show nobody."""
    mask = mask_of(view, at, blocks, walls, reach)
    above = mask.first_row
    around = ((above, view.rows - above - len(mask.block)), (0, 0))
    drawn = {
        row: one._replace(rows=slice(one.rows.start + above, one.rows.stop + above)) for row, one in mask.drawn.items()
    }
    block, depth = (
        np.pad(values, around, constant_values=nobody)
        for values, nobody in ((mask.block, NOBODY), (mask.depth, math.inf))
    )
    return Mask(0, block, depth, drawn, mask.alone)


def shares(mask: Mask, blocks: Blocks) -> dict[int, float]:
    return {row: float(mask.visible_pixels(row).sum()) / mask.drawn[row].pixels for row in mask.drawn}


def bodies(blocks: Blocks, shown: np.ndarray) -> np.ndarray:
    """The actor that each pixel shows in place of its block."""
    return np.where(shown >= 0, blocks.actor[np.maximum(shown, 0)], shown)


def compare(seed: int, view: Pinhole) -> None:
    chance = np.random.default_rng(seed)
    at = CameraPlace(0.0, 0.0, chance.uniform(0.8, 2.5), chance.uniform(-math.pi, math.pi))
    blocks, walls = all_blocks(crowd(14, seed)), street(seed)
    mask, who = picture_of(view, at, blocks, walls, REACH), who_by_pixel(view, at, blocks, walls)
    # A roof is drawn at the depth of its near edge, and so may cover what stands in it: the crowd stands in itself.
    assert (bodies(blocks, mask.block) != bodies(blocks, who)).mean() < 0.002, seed
    for row, drawn in mask.drawn.items():
        alone = Blocks(*(column[row : row + 1] for column in blocks))
        assert drawn.pixels == (who_by_pixel(view, at, alone, NO_WALLS) == 0).sum(), (seed, row)
    for actor in {int(blocks.actor[row]) for row in mask.drawn}:
        own = np.flatnonzero(blocks.actor == actor)
        alone = Blocks(*(column[own] for column in blocks))
        assert mask.alone[actor] == (who_by_pixel(view, at, alone, NO_WALLS) >= 0).sum(), (seed, actor)
        seen = np.isin(mask.block, own).sum()
        wanted = np.isin(who, own).sum()
        assert seen == pytest.approx(wanted, abs=max(6, 0.03 * mask.alone[actor])), (seed, actor)
    assert set(np.unique(bodies(blocks, who)).tolist()) - {NOBODY, WALL} <= mask.alone.keys()


@pytest.mark.thorough(witnesses=9)
@pytest.mark.parametrize("seed", range(25))
def test_every_pixel_shows_what_its_ray_meets(seed: int) -> None:
    compare(seed, SMALL)


@pytest.mark.slow
def test_every_pixel_of_five_hundred_scenes_shows_what_its_ray_meets() -> None:
    for seed in range(100, 600):
        compare(seed, SMALL)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_drawn_is_what_another_library_meets(seed: int) -> None:
    at = CameraPlace(0.0, 0.0, 1.3, 0.4 * seed)
    blocks, walls = all_blocks(crowd(14, seed)), street(seed)
    mask, depth = picture_of(SMALL, at, blocks, walls, REACH), nearest_by_mesh(SMALL, at, blocks, walls)
    assert ((mask.block == NOBODY) == (depth > REACH)).mean() > 0.998
    both = np.isfinite(mask.depth) & np.isfinite(depth)
    # The mask holds the depth of the near side for a roof, too.
    assert np.isclose(mask.depth[both], depth[both], rtol=1e-5).mean() > 0.97
    assert (mask.depth[both] <= depth[both] * (1.0 + 1e-5)).mean() > 0.999


def test_a_camera_knows_the_size_of_a_car_at_a_distance() -> None:
    """1.8 m by 1.5 m at 30 m, with 1312 pixels of focal length: 79 by 66 pixels, the bottom row on the ground."""
    view = Pinhole(1280, 480, 1312.0)
    at = CameraPlace(0.0, 0.0, 1.3, 0.0)
    mask = picture_of(view, at, all_blocks(actors([car(32.25, 0.0)])), NO_WALLS, REACH)
    drawn = mask.drawn[0]
    assert drawn.columns.stop - drawn.columns.start == pytest.approx(1.8 * 1312.0 / 30.0, abs=1.5)
    assert drawn.rows.stop - drawn.rows.start == pytest.approx(1.5 * 1312.0 / 30.0, abs=1.5)
    assert drawn.rows.stop - 240 == pytest.approx(1.3 * 1312.0 / 30.0, abs=1.0)
    assert shares(mask, all_blocks(actors([car(32.25, 0.0)]))) == {0: 1.0}


def test_what_is_behind_or_beside_the_camera_is_not_drawn() -> None:
    away = [car(-20.0, 0.0), car(3.0, 30.0), car(200.0, 0.0)]
    assert picture_of(SMALL, CameraPlace(0.0, 0.0, 1.3, 0.0), all_blocks(actors(away)), NO_WALLS, REACH).drawn == {}


def test_a_car_hides_the_half_of_another_that_it_stands_before() -> None:
    """Seen from far away, the near one's right edge lies on the far one's middle."""
    at = CameraPlace(-400.0, 0.0, 1.3, 0.0)
    blocks = all_blocks(actors([car(0.0, 0.9), car(20.0, 0.0)]))
    seen = shares(picture_of(Pinhole(640, 64, 20_000.0), at, blocks, NO_WALLS, 1000.0), blocks)
    assert seen[0] == 1.0
    assert seen[1] == pytest.approx(0.5, abs=0.06)
