"""The scene of a drive for the page: everything that does not move, as plain JSON in SI units.

Built from what a record and a live drive both have: the content of `scenario.json` and the lanes around the path. Knows
neither ticks nor how anything is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.drive.assembly import LotAlignment
from vve_sumo.errors import VveError
from vve_sumo.lot.geofence import Geofence
from vve_sumo.path import ReferencePath
from vve_sumo.record.declared import recorded_path, recorded_vehicle
from vve_sumo.record.drawings import drawings_of
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.schema import Rig
from vve_sumo.sensors.drawing import Drawing, Mounting
from vve_sumo.values import Floats, Vehicle

if TYPE_CHECKING:
    import pyarrow as pa

#: version of scene and frames; a page refuses another
VERSION: Final = 2
#: what the car's height and the driver's eyes are taken as where no vehicle model says it [m]: a mid-size saloon, eyes
#: ahead of the rear axle, left of the middle and above the ground
EGO_HEIGHT: Final = 1.48
EYES: Final = (1.25, 0.37, 1.15)
#: kinds of lanes by the record's kinds
LANE_KINDS: Final = {"lane": "road", "junction": "junction", "crossing": "crossing", "walkway": "foot"}
#: coordinates are sent with so many decimals: millimetres
DECIMALS: Final = 3


def rig_of(resolved: Mapping[str, Any]) -> Rig | None:
    """Return the rig of a live drive; None of a drive without one, or of a rig that this version cannot read."""
    if "rig" not in resolved:
        return None
    try:
        return rigs.parse_json(resolved["rig"], Path(str(resolved.get("rig_name", "rig"))))
    except VveError:
        return None


def geofence_of(resolved: Mapping[str, Any]) -> Geofence | None:
    """Return the geofence of a live drive's lot; None where there is none."""
    rig = rig_of(resolved)
    return None if rig is None else meaning.geofence_of(rig, LotAlignment.from_dict(resolved).alignment)


def scene_of(resolved: Mapping[str, Any], roads: pa.Table, *, source: str) -> dict[str, Any]:
    """Return the scene of a drive, without actors and events, which `frames` knows of a record.

    `resolved` is the content of `scenario.json`, `roads` the table of lanes, `source` is "record" or "live".
    """
    path, vehicle, rig = recorded_path(resolved), recorded_vehicle(resolved), rig_of(resolved)
    return {
        "version": VERSION,
        "title": str(resolved["settings"]["title"]),
        "name": str(resolved["scenario"]),
        "source": source,
        "duration": None,
        "period": float(resolved["period_s"]),
        "ego": {
            "length": vehicle.length,
            "width": vehicle.width,
            "height": EGO_HEIGHT,
            "rear_overhang": vehicle.rear_overhang,
            "wheelbase": vehicle.wheelbase,
            "eye": list(EYES),
            "steering_ratio": vehicle.steering_ratio,
            "steering_limit": vehicle.steering_limit,
        },
        "desired_speed": float(resolved["settings"]["ego"]["speed_mps"]),
        "lanes": list(_lanes(roads)),
        "network": None,
        "buildings": [],
        "path": _driven(path),
        "path_length": path.length,
        "stop_line": _stop_line(path, vehicle),
        "lot": _lot(resolved),
        "lot_to_road": resolved.get("lot_to_road"),
        "sensors": [_sensor(name, drawing) for name, drawing in drawings_of(resolved).items()],
        "actors": {},
        "people": [str(person["id"]) for person in resolved.get("people", ())],
        "events": [],
        "latency_budget": None if rig is None else rig.latency.budget_ms / 1000.0,
    }


def body(kind: int, length: float, width: float, height: float) -> dict[str, Any]:
    """Return an actor's body as the scene has it: `kind` is a row of BODY_KINDS, the rest metres."""
    return {"kind": BODY_KINDS[kind], "length": length, "width": width, "height": height}


def finite(value: float | None, decimals: int = 6) -> float | None:
    """Return a number for JSON: rounded, None where it is not finite."""
    return None if value is None or not math.isfinite(value) else round(value, decimals)


def _pairs(x: Floats, y: Floats) -> list[list[float]]:
    points: list[list[float]] = np.round(np.column_stack((x, y)), DECIMALS).tolist()
    return points


def _driven(path: ReferencePath) -> list[list[float]]:
    """The path from its first point to its last; the table of samples goes on beyond both."""
    table = path.samples
    inside = (table.s >= 0.0) & (table.s <= path.length)
    return _pairs(table.x[inside], table.y[inside])


def _lanes(roads: pa.Table) -> Iterable[dict[str, Any]]:
    columns = (roads[name].to_pylist() for name in ("lane", "kind", "width_m", "x_m", "y_m", "successors"))
    for name, kind, width, x, y, successors in zip(*columns, strict=True):
        yield {
            "id": name,
            "kind": LANE_KINDS.get(kind, "other"),
            "width": width,
            "points": _pairs(np.array(x), np.array(y)),
            "successors": list(successors or ()),
        }


def _stop_line(path: ReferencePath, vehicle: Vehicle) -> dict[str, float]:
    """The end of the path as a stop line: where the front bumper is when the rear axle has come to the path's end."""
    end = path.at(path.length)
    ahead = vehicle.rear_axle_to_bumper
    return {
        "x": end.x + ahead * math.cos(end.heading),
        "y": end.y + ahead * math.sin(end.heading),
        "heading": end.heading,
    }


def _lot(resolved: Mapping[str, Any]) -> dict[str, Any] | None:
    rig = rig_of(resolved)
    if rig is None:
        return None
    lot = meaning.lot_of(rig)
    return {
        "outline": _pairs(lot.outline[:, 0], lot.outline[:, 1]),
        "holes": [_pairs(hole[:, 0], hole[:, 1]) for hole in lot.holes],
        "edges": [_pairs(line[:, 0], line[:, 1]) for line in lot.edges],
        "margin": lot.margin,
    }


def _sensor(name: str, drawing: Drawing) -> dict[str, Any]:
    """Return how the page draws a sensor's readings; without a field of view it has no sectors."""
    view = drawing.view
    sectors = [] if view is None else [[sector.range_m, sector.half_angle_rad] for sector in view.sectors]
    return {
        "name": name,
        "shape": drawing.shape,
        "names_actors": drawing.actor is not None,
        "view": None if view is None else _frame(view.frame),
        "sectors": [{"range": range_, "half_angle": half_angle} for range_, half_angle in sectors],
    }


def _frame(frame: Mounting) -> dict[str, float]:
    return {"forward": frame.x_m, "left": frame.y_m, "yaw": frame.yaw_rad}
