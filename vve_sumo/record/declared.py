"""What a record's `scenario.json` says of the drive: its layout, the path in the virtual road's map and the car.

Knows nothing of the tables beside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from vve_sumo.config_file import read_json
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.record.layout import check_layout
from vve_sumo.values import Floats, Vehicle


def read_resolved(folder: Path, *keys: str) -> dict[str, Any]:
    """Return the content of a record's `scenario.json`.

    Raises ConfigError where it is missing, is of another layout or lacks one of `keys`.
    """
    file = folder / "scenario.json"
    resolved = read_json(file, "a drive", *keys)
    check_layout(resolved, file)
    return resolved


def recorded_points(resolved: Mapping[str, Any]) -> Floats:
    """Return the points that the path was laid through, map [m], shape (n, 2)."""
    return np.array([point.split() for point in resolved["path_m"]], np.float64)


def recorded_path(resolved: Mapping[str, Any]) -> ReferencePath:
    """Return where the rear axle was to go, in the virtual road's map; raises ConfigError where points give no path."""
    points = recorded_points(resolved)
    try:
        return ReferencePath.from_points(points[:, 0], points[:, 1])
    except ValueError as error:
        raise ConfigError(f"scenario.json: path_m: {error}") from None


def recorded_vehicle(resolved: Mapping[str, Any]) -> Vehicle:
    """Return the car as it was declared."""
    return Vehicle(**{field.name: float(resolved["vehicle"][field.name]) for field in fields(Vehicle)})
