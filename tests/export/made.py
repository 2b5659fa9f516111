"""A record written by hand for every format: an ego on a circle, and one body of each sort that formats treat apart."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.analysis.made import BOX, PERIOD, put, write
from vve_sumo.record.layout import ROADS_SCHEMA

TICKS = 151
TIME = np.arange(TICKS) * PERIOD
RADIUS, SPEED = 40.0, 8.0
#: of the ego's rear axle, on a circle to the left that begins northwards at (0, 0)
HEADING = math.pi / 2 + SPEED * TIME / RADIUS
X, Y = RADIUS * np.cos(HEADING - math.pi / 2) - RADIUS, RADIUS * np.sin(HEADING - math.pi / 2)

#: what stands, who walks by the scenario, and a truck of the traffic that is away from tick 60 to tick 79
ACTORS: dict[str, dict[str, Any]] = {
    "parked": {"x_m": 30.0, "y_m": 5.0, "heading_rad": 0.3, "length_m": 4.6, "width_m": 1.8},
    "walker": {"x_m": 8.0, "y_m": -3.0, "heading_rad": math.pi, "length_m": 0.6, "width_m": 0.5, "speed_mps": 1.5,
               "radar_cross_section_m2": 0.5},
    "lorry.7": {"x_m": -50.0, "y_m": 20.0, "heading_rad": -0.4, "length_m": 9.0, "width_m": 2.4, "speed_mps": 10.0,
                   "radar_cross_section_m2": 100.0},
}  # fmt: skip
SETTINGS = {
    "title": "by hand: <&>",
    "seed": 1,
    "controller": {"name": "nobody"},
    "radar": {"ideal": False, "range_limit_m": None},
    "obstacles": [{"id": "parked"}],
    "actors": [{"id": "walker", "kind": "pedestrian"}],
}


#: the street up to where the ego begins, its left lane, the bend that the ego takes, and ways on foot
BEND = np.linspace(0.0, 0.8, 17)
ROADS: list[dict[str, Any]] = [
    {"lane": "street_0", "kind": "lane", "width_m": 3.0, "x_m": [0.0, 0.0, 0.0], "y_m": [-60.0, -20.0, 0.0],
     "successors": [":bend_0_0", "beyond_0"]},
    {"lane": "street_1", "kind": "lane", "width_m": 3.0, "x_m": [-3.0, -3.0], "y_m": [-60.0, 0.0], "successors": []},
    {"lane": ":bend_0_0", "kind": "junction", "width_m": 3.4, "x_m": (RADIUS * np.cos(BEND) - RADIUS).tolist(),
     "y_m": (RADIUS * np.sin(BEND)).tolist(), "successors": []},
    {"lane": ":bend_c0_0", "kind": "crossing", "width_m": 4.0, "x_m": [-10.0, 10.0, 10.0], "y_m": [-3.0] * 3,
     "successors": []},
    {"lane": "side_0", "kind": "walkway", "width_m": 2.0, "x_m": [5.0, 5.0], "y_m": [-60.0, 0.0], "successors": []},
    {"lane": "dot_0", "kind": "lane", "width_m": 2.0, "x_m": [5.0, 5.0], "y_m": [0.0, 0.0], "successors": []},
]  # fmt: skip


def away(actor: str, tick: int) -> bool:
    """Whether the actor is not near the ego at a tick."""
    return actor.startswith("lorry") and 60 <= tick < 80


def box_at(actor: str, tick: int) -> dict[str, Any]:
    """Return the row of an actor at a tick: it goes on steadily."""
    row = {"tick": tick, "actor": actor, **BOX, **ACTORS[actor]}
    way = row["speed_mps"] * tick * PERIOD
    row["x_m"] += way * math.cos(row["heading_rad"])
    row["y_m"] += way * math.sin(row["heading_rad"])
    return row


def record(folder: Path, summary: Any, ticks: int = TICKS, speed: float = SPEED, **changes: Any) -> Path:
    """Write the record; its actors' table is whole up to `ticks`."""
    rows = [
        {
            "true_x_m": x,
            "true_y_m": y,
            "true_heading_rad": math.remainder(heading, math.tau),
            "true_speed_mps": speed,
            "actors": sum(not away(actor, tick + 1) for actor in ACTORS),
            "note": 'he said "on, on"' if tick == 3 else "",
            "measured_steering_rad": math.nan,
        }
        for tick, (x, y, heading) in enumerate(zip(X.tolist(), Y.tolist(), HEADING.tolist(), strict=True))
    ]
    write(folder, rows, summary, **({"settings": SETTINGS} | changes))
    put(folder, "actors", (box_at(actor, t) for t in range(ticks) for actor in ACTORS if not away(actor, t)))
    return folder


def with_roads(folder: Path) -> Path:
    """Write the record with the lanes of ROADS."""
    record(folder, {"outcome": "timeout"})
    pq.write_table(pa.Table.from_pylist(ROADS, ROADS_SCHEMA), folder / "roads.parquet")
    return folder
