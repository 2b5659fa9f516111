"""Pictures of a camera on the car along a record, and the truth beside each: boxes, owners of pixels, kinds, depths.

Drawn by the page's own modules in a headless browser, as `pictures` draws the views. Knows records and the page
`render.html`; nothing of files that pictures are written to.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.body_kinds import PERSONS
from vve_sumo.view.browser import Browser
from vve_sumo.view.declared_camera import DeclaredCamera
from vve_sumo.view.frames import Frames
from vve_sumo.view.pictures import PAGE
from vve_sumo.view.street import with_network

#: what a pixel may show: its place here is its number in the picture of kinds (`KINDS` of web/src/camera_pictures.js)
PIXEL_KINDS: Final = (
    "nothing", "ground", "walk", "road", "marks", "kerb", "building", "vegetation", "pole", "signal", "vehicle",
    "two_wheeler", "person", "ego",
)  # fmt: skip
TIMES_OF_DAY: Final = ("day", "dusk", "night")
#: a depth's unit in its picture [m]
DEPTH_UNIT: Final = 0.01
#: of a body that was made up: no sensor sees it
DECORATION: Final = "decoration."
#: the plane that a lens looks up has so many more pixels along a side than the picture, so that none gets coarser
OVERSAMPLING: Final = 1.25
#: on each side of the plane, beyond what the lens sees [pixels]
PLANE_MARGIN: Final = 1.0
MAX_PLANE: Final = 8192  #: pixels along a side; browsers draw no more
#: nothing made up stands near a place at which somebody stood or walked: places are listed on a grid so wide [m]
CLEAR_GRID: Final = 3.0
STANDING: Final = 0.1  #: slower bodies stand [m/s]


class Box(NamedTuple):
    """Of a body in the picture: the first column and row, and those after the last [pixels]."""

    left: int
    top: int
    right: int
    bottom: int


@dataclass(frozen=True, slots=True)
class SeenBody:
    """A body of which at least a pixel is seen."""

    number: int  #: by which its pixels are marked
    name: str  #: of the actor, or one that begins with DECORATION
    kind: str  #: how it is drawn
    box: Box  #: of the pixels that are seen of it
    pixels: int  #: that are seen of it
    visible: float  #: share of its own pixels within the picture's edges that nothing nearer hides
    place: tuple[float, float, float]  #: of its middle on the ground, in the camera's frame: right, down, along [m]
    turn: float  #: of its heading from the camera's, counter-clockwise [rad]
    size: tuple[float, float, float]  #: length, width, height [m]

    @property
    def decoration(self) -> bool:
        """Whether it was made up, so that no sensor of the drive sees it."""
        return self.name.startswith(DECORATION)

    @property
    def distance(self) -> float:
        """From the camera to its middle on the ground [m]."""
        return math.hypot(*self.place)

    def to_dict(self) -> dict[str, Any]:
        """Return what the file of a picture's objects says of it."""
        return {
            "number": self.number,
            "name": self.name,
            "kind": self.kind,
            "decoration": self.decoration,
            "box_px": list(self.box),
            "pixels": self.pixels,
            "visible_share": round(self.visible, 4),
            "place_m": [round(value, 3) for value in self.place],
            "turn_rad": round(self.turn, 5),
            "size_m": [round(value, 3) for value in self.size],
        }


class Truth(NamedTuple):
    """What the pixels of a picture show; arrays of rows by columns."""

    kinds: NDArray[np.uint8]  #: places in PIXEL_KINDS
    owners: NDArray[np.uint16]  #: numbers of bodies, 0 of nobody
    depths: NDArray[np.uint16]  #: along the camera's axis, in DEPTH_UNIT; 0 of nothing, 65534 of what is farther
    bodies: list[SeenBody]


@dataclass(frozen=True, slots=True)
class Plane:
    """The plane, a metre before a pinhole, that the street is drawn on before the lens looks it up."""

    columns: int  #: pixels
    rows: int  #: pixels
    left: float  #: slope of its left edge, to the right positive
    right: float
    top: float  #: slope of its upper edge, downwards positive
    bottom: float
    lookup: NDArray[np.float32]  #: where each pixel looks: shares of width and height (rows, columns, 2)


@dataclass(frozen=True, slots=True)
class SceneAppearance:
    """The light and the weather of the street, and whether what no map has is made up beside it."""

    time: str = "day"  #: one of TIMES_OF_DAY
    rain: bool = False
    dressed: bool = True  #: houses, pavements, parked cars by rule


def plane_of(camera: DeclaredCamera) -> Plane:
    """Return the plane for a camera; without distortion it is the picture itself.

    Raises ValueError where a pixel has no ray, or the plane would be too large.
    """
    model = camera.model
    grid = model.grid()
    slope_x, slope_y = 1.0 / model.focal_x, 1.0 / model.focal_y
    (left, top), (right, bottom) = grid.min(axis=(0, 1)), grid.max(axis=(0, 1))
    if model.pinhole:
        columns, rows, margin = model.columns, model.rows, 0.5
    else:
        # As fine as the lens is where it is finest.
        fine_x = OVERSAMPLING / min(np.diff(grid[..., 0], axis=1).min(), slope_x)
        fine_y = OVERSAMPLING / min(np.diff(grid[..., 1], axis=0).min(), slope_y)
        margin = PLANE_MARGIN
        columns = math.ceil((right - left + 2.0 * margin * slope_x) * fine_x)
        rows = math.ceil((bottom - top + 2.0 * margin * slope_y) * fine_y)
        if max(columns, rows) > MAX_PLANE:
            raise ValueError(
                f"the lens sees too wide an angle: a pinhole's picture of it would have {columns}x{rows} pixels, "
                f"expected at most {MAX_PLANE} along a side"
            )
    left, right = left - margin * slope_x, right + margin * slope_x
    top, bottom = top - margin * slope_y, bottom + margin * slope_y
    lookup = (grid - (left, top)) / (right - left, bottom - top)
    left, right, top, bottom = (float(edge) for edge in (left, right, top, bottom))
    return Plane(columns, rows, left, right, top, bottom, lookup.astype(np.float32))


class CameraPictures:
    """Draws what a camera on the car sees at any drive time of a record; a context manager that ends its browser."""

    def __init__(self, run: Run, camera: DeclaredCamera, appearance: SceneAppearance) -> None:
        """Open the record in a browser of its own.

        Raises BrowserError where there is no browser or it fails, and ValueError for a camera that cannot be drawn.
        """
        frames = Frames(run)
        scene = with_network(frames.scene, run.resolved, Path.cwd()) | {"keep_clear": places_of_others(frames)}
        self._open(scene, frames.packed(), camera, appearance)

    @classmethod
    def of_scene(cls, scene: dict[str, Any], camera: DeclaredCamera, appearance: SceneAppearance) -> Self:
        """Return the pictures of a scene without a drive, as `view.scene` describes one: for `drawn` alone."""
        made = cls.__new__(cls)
        made._open(scene, None, camera, appearance)
        return made

    def _open(
        self, scene: dict[str, Any], packed: bytes | None, camera: DeclaredCamera, appearance: SceneAppearance
    ) -> None:
        plane = plane_of(camera)
        self.camera = camera
        described = {
            "columns": camera.model.columns,
            "rows": camera.model.rows,
            "mount": {name: getattr(camera.mount, name) for name in ("x", "y", "z", "yaw", "pitch", "roll")},
            "plane": {
                "columns": plane.columns,
                "rows": plane.rows,
                "slopes": {name: getattr(plane, name) for name in ("left", "right", "top", "bottom")},
            },
            "map": base64.b64encode(np.ascontiguousarray(plane.lookup, "<f4").tobytes()).decode(),
        }
        looks = {"time": appearance.time, "rain": appearance.rain, "dressed": appearance.dressed}
        frames = None if packed is None else base64.b64encode(packed).decode()
        arguments = json.dumps([scene, frames, described, looks], allow_nan=False)
        self._browser = Browser(camera.model.columns, camera.model.rows)
        try:
            self._browser.open(PAGE)
            self._browser.evaluate(f"cameraRoll.open(...{arguments})")
        except BaseException:
            self._browser.close()
            raise

    def at(self, time: float, kind: str = "image/png", quality: float = 1.0) -> bytes:
        """Return the picture at a drive time [s] as a file of a kind that the browser writes: PNG or JPEG."""
        return base64.b64decode(self._browser.evaluate(f"cameraRoll.at({time!r}, {kind!r}, {quality!r})"))

    def drawn(self, frame: dict[str, Any], time: float = 0.0, kind: str = "image/png", quality: float = 1.0) -> bytes:
        """Return the picture of a frame, as `view.frames` has them, at a drive time [s], as a file as `at` does."""
        arguments = f"{json.dumps(frame)}, {time!r}, {kind!r}, {quality!r}"
        return base64.b64decode(self._browser.evaluate(f"cameraRoll.drawn({arguments})"))

    def meet(self, actors: dict[str, Any]) -> None:
        """Have more actors in the scene: the body of each by its name, as `view.scene` describes one."""
        self._browser.evaluate(f"cameraRoll.meet({json.dumps(actors)})")

    def truth(self) -> Truth:
        """Return the truth of the picture that was drawn last."""
        found = self._browser.evaluate("cameraRoll.look()")
        shape = self.camera.model.rows, self.camera.model.columns
        kinds = np.frombuffer(base64.b64decode(found["kinds"]), np.uint8).reshape(shape)
        owners = np.frombuffer(base64.b64decode(found["owners"]), "<u2").reshape(shape)
        depths = np.frombuffer(base64.b64decode(found["depths"]), "<u2").reshape(shape)
        ego = found["ego"]
        return Truth(kinds, owners, depths, list(self._bodies(found["bodies"], owners, ego)))

    def _bodies(
        self, bodies: list[dict[str, Any]], owners: NDArray[np.uint16], ego: dict[str, float]
    ) -> Iterator[SeenBody]:
        """Yield the bodies of which a pixel is seen, of those that the page drew."""
        mount = self.camera.mount
        cos, sin = math.cos(ego["heading"]), math.sin(ego["heading"])
        boxes = boxes_of(owners)
        for number, body in enumerate(bodies, 1):
            if number not in boxes:
                continue
            box, pixels = boxes[number]
            east, north = body["x"] - ego["x"], body["y"] - ego["y"]
            place = mount.camera_points(np.array([[east * cos + north * sin, north * cos - east * sin, 0.0]]))[0]
            turn = math.remainder(body["heading"] - ego["heading"] - mount.yaw, 2.0 * math.pi)
            visible = min(1.0, body["pixels"] / body["alone"]) if body["alone"] else 0.0
            size = body["length"], body["width"], body["height"]
            right, down, along = place.tolist()
            yield SeenBody(number, body["id"], body["kind"], box, pixels, visible, (right, down, along), turn, size)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression on the page; raises BrowserError where it throws."""
        return self._browser.evaluate(expression)

    @property
    def complaints(self) -> list[str]:
        """What the page wrote to its console as an error."""
        return self._browser.complaints

    def close(self) -> None:
        """End the browser."""
        self._browser.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def boxes_of(owners: NDArray[np.uint16]) -> dict[int, tuple[Box, int]]:
    """Return the box and the number of the pixels of each owner but 0."""
    rows, columns = np.nonzero(owners)
    found: dict[int, tuple[Box, int]] = {}
    numbers = owners[rows, columns]
    for number in np.unique(numbers).tolist():
        own = numbers == number
        row, column = rows[own], columns[own]
        box = Box(int(column.min()), int(row.min()), int(column.max()) + 1, int(row.max()) + 1)
        found[number] = box, int(np.count_nonzero(own))
    return found


def places_of_others(frames: Frames) -> list[list[float]]:
    """Return where people and what stands were in a drive, on a grid of CLEAR_GRID: nothing is made up near them."""
    columns, bodies = frames.columns, frames.scene["actors"]
    slow = np.array([bodies[name]["kind"] in (*PERSONS, "bicycle") for name in frames.texts["actor"]], bool)
    kept = slow[columns["actor_code"]] if len(slow) else np.zeros(0, bool)
    kept = kept | (np.abs(columns["actor_speed"]) < STANDING)
    cells = np.column_stack((columns["actor_x"][kept], columns["actor_y"][kept]))
    found: list[list[float]] = (np.unique(np.round(cells / CLEAR_GRID), axis=0) * CLEAR_GRID).tolist()
    return found
