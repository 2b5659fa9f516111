"""Scenes and frames for the street in three dimensions, and a browser page that shows one."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from vve_sumo.view.browser import Browser, BrowserError, find_browser
from vve_sumo.view.pictures import PAGE

SIZE = (640, 360)
EYE = (1.25, 0.37, 1.15)
EGO = {"length": 4.87, "width": 1.85, "height": 1.48, "rear_overhang": 1.0, "wheelbase": 2.85, "eye": list(EYE)}


def straight(length: float = 200.0, **more: Any) -> dict[str, Any]:
    """A street along +x with one lane each way: the ego's about y = 0, the other about y = 3.2."""
    lanes = [
        {"kind": "road", "width": 3.2, "points": [[-50.0, 0.0], [length, 0.0]]},
        {"kind": "road", "width": 3.2, "points": [[length, 3.2], [-50.0, 3.2]]},
    ]
    return {
        "lanes": lanes,
        "network": None,
        "buildings": [],
        "path": [[0, 0], [100, 0]],
        "ego": EGO,
        "actors": {},
    } | more


def frame(x: float = 0.0, y: float = 0.0, heading: float = 0.0, **more: Any) -> dict[str, Any]:
    """A frame with the ego's rear axle there, and nobody else."""
    ego = {"x": x, "y": y, "heading": heading, "speed": 0.0, "yaw_rate": 0.0, "steering": 0.0}
    actors: dict[str, list[Any]] = {"id": [], "x": [], "y": [], "heading": [], "speed": []}
    return {"t": 0.0, "ego": ego, "actors": actors, "gap": None, "signals": None, "state": "engaged"} | more


def standing(*bodies: tuple[str, float, float, float]) -> dict[str, list[Any]]:
    """Actors that stand: name, x, y, heading of each."""
    columns = [list(column) for column in zip(*bodies, strict=True)]
    return dict(zip(("id", "x", "y", "heading"), columns, strict=True)) | {"speed": [0.0] * len(bodies)}


class Space:
    """A page with one world on it."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser

    def make(self, scene: dict[str, Any], view: str = "driver") -> None:
        """Show another scene."""
        self.browser.evaluate(
            "(async () => { const { createWorld } = await import('./world.min.js'); globalThis.world?.dispose();"
            "globalThis.canvas?.remove(); globalThis.canvas = document.createElement('canvas');"
            f"Object.assign(canvas, {{ width: {SIZE[0]}, height: {SIZE[1]} }}); document.body.append(canvas);"
            f"globalThis.world = createWorld(canvas, {json.dumps(scene)}, {{ antialias: false, preserve: true }});"
            f"world.view({json.dumps(view)}); }})()"
        )

    def picture(self, shown: dict[str, Any], time: float = 0.0) -> NDArray[np.uint8]:
        """Show a frame at a display time [s] and return the picture: rows, columns, red green blue."""
        self.browser.evaluate(f"world.show({json.dumps(shown)}, {time!r}); world.draw()")
        coded = self.browser.evaluate("canvas.toDataURL('image/png').split(',')[1]")
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(coded))).convert("RGB"))

    def pose(self) -> dict[str, Any]:
        """Where the camera is, read back from the scene."""
        pose: dict[str, Any] = self.browser.evaluate("world.cameraPose()")
        return pose


@contextmanager
def opened() -> Iterator[Space]:
    """A page in a headless browser; nothing may have been said on its console at the end."""
    try:
        find_browser()
    except BrowserError as missing:
        pytest.skip(str(missing))
    with Browser(*SIZE) as browser:
        browser.open(PAGE)
        yield Space(browser)
        assert browser.complaints == []
