"""Writes the pictures of a camera with their truth into a folder: a file a picture in each of five folders.

Knows the folder's form; nothing of how pictures are drawn.
"""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.view.camera_pictures import DEPTH_UNIT, PIXEL_KINDS, SceneAppearance, Truth
from vve_sumo.view.declared_camera import DeclaredCamera

#: of a picture and its truth: folder and ending
FOLDERS: Final = {
    "pictures": ".png",  #: as the camera sees it
    "objects": ".json",  #: bodies of which something is seen
    "owners": ".png",  #: 16 bit: number of the body that a pixel shows, 0 for none
    "kinds": ".png",  #: 8 bit: what a pixel shows
    "depths": ".png",  #: 16 bit: along the camera's axis, in centimetres, 0 for nothing
}
#: form of the folder
VERSION: Final = 1


class TruthFolder:
    """A folder that is being written; it is made with the first picture."""

    def __init__(self, folder: Path, camera: DeclaredCamera, appearance: SceneAppearance) -> None:
        """Take an absent or empty folder."""
        self._folder, self._count = folder, 0
        self._described = {
            "version": VERSION,
            "camera": camera.to_dict(),
            "time_of_day": appearance.time,
            "rain": appearance.rain,
            "made_up_beside_the_road": appearance.dressed,
            "pixel_kinds": list(PIXEL_KINDS),
            "depth_unit_m": DEPTH_UNIT,
        }

    def add(self, time: float, picture: bytes, truth: Truth) -> None:
        """Write the picture of a drive time [s] and its truth."""
        if not self._count:
            for name in FOLDERS:
                (self._folder / name).mkdir(parents=True)
            _write_json(self._folder / "camera.json", self._described)
        name = f"{self._count:06d}"
        self._file("pictures", name).write_bytes(picture)
        for folder, values in (("owners", truth.owners), ("kinds", truth.kinds), ("depths", truth.depths)):
            self._file(folder, name).write_bytes(_png(values))
        objects = {"time_s": round(time, 6), "objects": [body.to_dict() for body in truth.bodies]}
        _write_json(self._file("objects", name), objects)
        self._count += 1

    def _file(self, folder: str, name: str) -> Path:
        return self._folder / folder / f"{name}{FOLDERS[folder]}"


def _png(values: NDArray[Any]) -> bytes:
    from PIL import Image

    picture = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(values, values.dtype.newbyteorder("="))).save(picture, "PNG")
    return picture.getvalue()


def _write_json(file: Path, content: dict[str, Any]) -> None:
    file.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
