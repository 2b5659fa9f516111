"""Reads buildings from a SUMO polygon file, as polyconvert writes it from map data. Knows nothing of networks."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Final

from vve_sumo.errors import ConfigError
from vve_sumo.sensors.street import Building
from vve_sumo.world.network import Box, meets, shape_of

#: ending of the polygon file that belongs to a network `NAME.net.xml`: `NAME.poly.xml` beside it
ENDING: Final = ".poly.xml"
#: of a storey [m], where the map says how many there are
STOREY: Final = 3.1
#: of a building whose height nobody says [m]: two storeys
HEIGHT: Final = 2 * STOREY


def buildings_file(network: Path) -> Path | None:
    """Return the polygon file beside a network file; None where there is none."""
    file = network.with_name(network.name.removesuffix(".gz").removesuffix(".net.xml") + ENDING)
    return file if file.is_file() else None


def buildings_near(path: Path, box: Box) -> list[Building]:
    """Return the buildings of a polygon file near a box of the map [m], in file order.

    A building is a polygon whose type begins with "building". Raises ConfigError where the file cannot be read.
    """
    try:
        root = ET.parse(path).getroot()
        shapes = [
            (poly, shape_of(poly.get("shape", "")))
            for poly in root.iter("poly")
            if poly.get("type", "").startswith("building") and len(poly.get("shape", "").split()) >= 3
        ]
    except (ET.ParseError, OSError, ValueError) as error:
        raise ConfigError(f"{path}: expected SUMO polygons, it can't be read: {error}") from None
    return [
        Building(tuple((float(x), float(y)) for x, y in shape), _height(poly))
        for poly, shape in shapes
        if meets(shape, 0.0, box)
    ]


def _height(poly: ET.Element) -> float:
    """Return the height that the map says, in metres or in storeys."""
    parameters = {one.get("key"): one.get("value", "") for one in poly.iter("param")}
    for key, unit in (("height", 1.0), ("building:levels", STOREY)):
        try:
            height = float(parameters.get(key, "").removesuffix("m")) * unit
        except ValueError:
            continue
        if math.isfinite(height) and height > 0.0:
            return height
    return HEIGHT
