"""A record written by hand for every format: an ego on a circle, and one body of each sort that formats treat apart."""

from __future__ import annotations

import datetime
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.analysis.made import BOX, PERIOD, put, write
from vve_sumo.body_kinds import number_of
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
               "radar_cross_section_m2": 0.5, "height_m": 1.7, "kind": number_of("pedestrian")},
    "lorry.7": {"x_m": -50.0, "y_m": 20.0, "heading_rad": -0.4, "length_m": 9.0, "width_m": 2.4, "speed_mps": 10.0,
                   "radar_cross_section_m2": 100.0, "height_m": 3.5, "kind": number_of("truck")},
}  # fmt: skip
SETTINGS = {
    "title": "by hand: <&>",
    "seed": 1,
    "controller": {"name": "nobody"},
    "ego": {"speed_mps": 11.0},
    "radar": {"ideal": False, "range_limit_m": None},
    "obstacles": [{"id": "parked"}],
    "actors": [{"id": "walker", "kind": "pedestrian"}],
}


#: the virtual road up to where the ego begins, its left lane, the bend that the ego takes, and ways on foot
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


#: GNSS second of drive time 0, 2026-01-01T00:00:00 UTC: 46 years of 365 days, 12 leap days, less the five days of 1980
#: before GNSS time began, and 18 leap seconds
EPOCH = 86_400.0 * (46 * 365 + 12 - 5) + 18.0
UNIX_EPOCH = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC).timestamp()
#: the lot lies on the virtual road turned by this [rad] and moved by so much [m]
TURN, SHIFT = 0.5, (30.0, -12.0)
#: of the pipeline's estimate, by which it is off the truth: x, y [m], heading [rad]
ESTIMATE_OFF = (0.02, -0.03, 0.004)
OF_DRIVE: dict[str, Any] = {
    "settings": SETTINGS,
    "epoch_gnss_s": EPOCH,
    "lot_projection": "+proj=tmerc +lat_0=40 +lon_0=-83 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs",
    "lot_to_road": {"rotation_rad": TURN, "x_m": SHIFT[0], "y_m": SHIFT[1]},
    "vehicle_model": {
        "interface": {"name": "dataspeed_dbw1", "settings": {"variant": "dbw1_2024"}},
        "mounting": {"forward": 0.9, "left": -0.25, "heading_misalignment": 0.0},
    },
}
#: drive time, bus, identifier, payload and whether the gateway sent it, of frames of every length; 0x60 to 0x66 are
#: Dataspeed's command frames
FRAMES = [
    (round(0.003 * number, 6), f"can{number % 2}", (0x60, 0x61, 0x7FF, 0x64)[number % 4], bytes(range(number % 9)),
     number % 4 in (0, 3))
    for number in range(1000)
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
            "x_m": x + ESTIMATE_OFF[0],
            "y_m": y + ESTIMATE_OFF[1],
            "heading_rad": math.remainder(heading + ESTIMATE_OFF[2], math.tau),
            "true_x_m": x,
            "true_y_m": y,
            "true_heading_rad": math.remainder(heading, math.tau),
            "true_speed_mps": speed,
            "actors": sum(not away(actor, tick + 1) for actor in ACTORS),
            "note": 'he said "on, on"' if tick == 3 else "",
            "measured_steering_rad": math.nan,
            "state": "engaged",
        }
        for tick, (x, y, heading) in enumerate(zip(X.tolist(), Y.tolist(), HEADING.tolist(), strict=True))
    ]
    write(folder, rows, summary, **(OF_DRIVE | changes))
    epoch = changes.get("epoch_gnss_s", EPOCH)
    (folder / "can.log").write_text(
        "".join(f"({epoch + time:.6f}) {bus} {name:03X}#{data.hex().upper()}\n" for time, bus, name, data, _ in FRAMES)
    )
    put(folder, "actors", (box_at(actor, t) for t in range(ticks) for actor in ACTORS if not away(actor, t)))
    return folder


def with_roads(folder: Path) -> Path:
    """Write the record with the lanes of ROADS."""
    record(folder, {"outcome": "timeout"})
    pq.write_table(pa.Table.from_pylist(ROADS, ROADS_SCHEMA), folder / "roads.parquet")
    return folder
