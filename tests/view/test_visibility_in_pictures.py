"""How much is seen of bodies: the object list's mask of blocks against the pixels of the drawn street.

Both see a bus as a block, so that their shares agree. A car is a block to the object list's camera, and is drawn with a
bonnet and a boot that one sees over: to the list it hides more, and is never more in sight than it is drawn.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.sensors.scenes import FUSION, actors, rear_axle
from tests.view.spaces import frame, straight
from vve_sumo.body_kinds import TYPICAL
from vve_sumo.sensors.camera import Camera, CameraConfig
from vve_sumo.sensors.image_mask import Pinhole
from vve_sumo.sensors.street import Lanes, walls_of
from vve_sumo.view.browser import BrowserError, find_browser
from vve_sumo.view.camera_pictures import CameraPictures, SceneAppearance
from vve_sumo.view.declared_camera import CameraFile

#: of the pictures [pixels]
COLUMNS, ROWS, FOCAL = 800, 300, 820.0
BODIES = 6
#: by kind: length and width [m]
SIZES = {"bus": (6.0, 2.5), "car": (4.5, 1.8)}
#: nothing is missed for being small, or for being hidden
EVERYTHING = replace(
    CameraConfig().ideal(), view=Pinhole(COLUMNS, ROWS, FOCAL), min_rows=0.0, min_rows_small=0.0, min_visible=0.0
)


class Compared(NamedTuple):
    listed: float  #: share by the mask of the object list
    drawn: float  #: share by the pixels of the street


def places(generator: np.random.Generator) -> list[tuple[float, float, float]]:
    """Where cars stand, none in another: ahead, to the left, heading."""
    found: list[tuple[float, float, float]] = []
    while len(found) < BODIES:
        x, y, heading = generator.uniform((9.0, -9.0, -3.1), (50.0, 9.0, 3.1)).tolist()
        if all(math.dist((x, y), other[:2]) > 7.0 for other in found):
            found.append((x, y, heading))
    return found


def compared(pictures: CameraPictures, kind: str, generator: np.random.Generator) -> list[Compared]:
    """Both shares of every body of a random scene that the picture's edge does not cut off."""
    rows = [(*place, 0.0, *SIZES[kind], 10.0) for place in places(generator)]
    scene = actors(rows, kind=kind)
    camera = Camera(EVERYTHING, FUSION, generator, walls_of(()), Lanes(()))
    camera.step(0.0, rear_axle(), scene)
    camera.prepare()
    seen = camera.step(0.1, rear_axle(), scene)
    assert seen is not None
    listed = dict(zip(seen.names, seen.visible, strict=True))
    shown: dict[str, Any] = {"id": list(scene.ids), "speed": [0.0] * BODIES}
    shown |= {name: getattr(scene, name).tolist() for name in ("x", "y", "heading")}
    pictures.drawn(frame(actors=shown))
    found = []
    for body in pictures.truth().bodies:
        cut_off = body.box.left == 0 or body.box.right == COLUMNS or body.box.bottom == ROWS
        if not cut_off and body.pixels > 60:
            found.append(Compared(listed.get(body.name, 0.0), body.visible))
    return found


def shares(kind: str, scenes: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shares by the list and as drawn of the bodies of some scenes."""
    try:
        find_browser()
    except BrowserError as missing:
        pytest.skip(str(missing))
    length, width = SIZES[kind]
    size = {"kind": kind, "length": length, "width": width, "height": TYPICAL[kind].height}
    street = straight(actors={f"car{k}": size for k in range(BODIES)})
    settings = CameraFile(columns_px=COLUMNS, rows_px=ROWS, focal_x_px=FOCAL)
    generator, found = np.random.default_rng(4), []
    with CameraPictures.of_scene(street, settings.camera("front"), SceneAppearance(dressed=False)) as pictures:
        for _ in range(scenes):
            found += compared(pictures, kind, generator)
    listed, drawn = np.array(found).T
    assert len(listed) > 2 * scenes
    print(f"{kind}: {len(listed)} in {scenes} scenes, mean difference {np.abs(listed - drawn).mean():.3f}")
    return listed, drawn


@pytest.mark.thorough
@pytest.mark.parametrize("scenes", [8, pytest.param(500, marks=pytest.mark.slow)])
def test_shares_of_what_is_a_block_agree_with_the_pixels_of_the_street(scenes: int) -> None:
    listed, drawn = shares("bus", scenes)
    assert np.abs(listed - drawn).mean() < 0.05
    limit = CameraConfig().min_visible
    clear = np.abs(listed - limit) > 0.1
    assert ((listed >= limit) == (drawn >= limit))[clear].mean() > 0.97


@pytest.mark.thorough
@pytest.mark.parametrize("scenes", [8, pytest.param(500, marks=pytest.mark.slow)])
def test_a_car_is_never_more_in_sight_to_the_list_than_it_is_drawn(scenes: int) -> None:
    listed, drawn = shares("car", scenes)
    assert (listed < drawn + 0.1).mean() > 0.95
