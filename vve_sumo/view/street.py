"""What the network's file adds to a scene, where it is at hand: junctions, stop lines, signal heads, buildings.

A record holds the lanes around its path and no more. Knows files and the scene's form; nothing of how it is drawn.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.buildings import buildings_file, buildings_near
from vve_sumo.workspace import find
from vve_sumo.world.network import Box
from vve_sumo.world.street_geometry import street_geometry

#: what lies so far beyond the lanes' own points is read from the network [m]
MARGIN: Final = 30.0
#: buildings are read from so far around the lanes [m]
BUILDINGS_MARGIN: Final = 120.0


def with_network(scene: dict[str, Any], resolved: Mapping[str, Any], working: Path) -> dict[str, Any]:
    """Return the scene with `network` and `buildings`, where the network that was driven on is still there.

    `resolved` is the content of `scenario.json`; names are looked up from `working`. A network file of the same name
    with another hash is another street and left out; so is one that cannot be read.
    """
    box = _box(scene)
    try:
        file = find("network", resolved["settings"]["road"]["network"], working)
        if box is None or hashlib.sha256(file.read_bytes()).hexdigest() != resolved["files_sha256"].get("network"):
            return scene
        network = street_geometry(file, _wider(box, MARGIN)).to_dict()
        polygons = buildings_file(file)
        near = [] if polygons is None else buildings_near(polygons, _wider(box, BUILDINGS_MARGIN))
    except (ConfigError, OSError, KeyError):
        return scene
    buildings = [{"points": [list(point) for point in one.outline], "height": one.height} for one in near]
    return scene | {"network": network, "buildings": buildings}


def _box(scene: Mapping[str, Any]) -> Box | None:
    """Return the box around the scene's lanes; None of a scene without any."""
    points = [point for lane in scene["lanes"] for point in lane["points"]]
    if not points:
        return None
    x, y = zip(*points, strict=True)
    return min(x), min(y), max(x), max(y)


def _wider(box: Box, margin: float) -> Box:
    return box[0] - margin, box[1] - margin, box[2] + margin, box[3] + margin
