"""Small records written by hand: a straight path along +x, and whatever rows a test wants."""

from __future__ import annotations

import dataclasses
import json
import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests import vehicles
from tests.record.declared import LIVE_TABLES, RESOLVED, TABLES
from vve_sumo.body_kinds import number_of
from vve_sumo.record.layout import LAYOUT
from vve_sumo.record.rows import TickRow
from vve_sumo.record.summary import write_summary

CAR = vehicles.FUSION.vehicle
PERIOD = 0.02
KINDS = {"int": 0, "float": 0.0, "bool": False, "str": ""}
BOX = {
    "heading_rad": 0.0,
    "speed_mps": 0.0,
    "length_m": 4.0,
    "width_m": 2.0,
    "y_m": 0.0,
    "radar_cross_section_m2": 10.0,
    "lateral_speed_mps": 0.0,
    "height_m": 1.5,
    "kind": number_of("car"),
}


def write(folder: Path, ticks: list[dict[str, Any]], summary: dict[str, Any] | None = None, **changes: Any) -> Path:
    """Write a record of which `ticks` says what is not 0 in each row; `changes` are of its scenario.json."""
    folder.mkdir()
    plain = {f.name: KINDS[str(f.type)] for f in dataclasses.fields(TickRow)}
    rows = [plain | {"tick": i, "time_s": i * PERIOD} | row for i, row in enumerate(ticks)]
    for name, schema in TABLES.items():
        pq.write_table(pa.Table.from_pylist(rows if name == "ticks" else [], schema), folder / f"{name}.parquet")
    settings = {"title": "by hand", "seed": 1, "controller": {"name": "nobody"}}
    resolved = {
        "layout": LAYOUT,
        "scenario": "by_hand",
        "period_s": PERIOD,
        "settings": settings | {"radar": {"ideal": False, "range_limit_m": None}},
        "path_m": [f"{x:.1f} 0.0" for x in np.arange(0.0, 301.0, 2.0)],
        "vehicle": {field.name: getattr(CAR, field.name) for field in dataclasses.fields(CAR)},
        "files_sha256": {},
        "versions": {},
    } | RESOLVED
    (folder / "scenario.json").write_text(json.dumps(resolved | changes), encoding="utf-8")
    if summary is not None:
        write_summary(folder, summary)
    return folder


def put(folder: Path, name: str, rows: Iterable[dict[str, Any]]) -> None:
    """Give a record another table of that name."""
    pq.write_table(pa.Table.from_pylist([*rows], LIVE_TABLES[name]), folder / f"{name}.parquet")


def put_scans(folder: Path, ticks: Iterable[int], detections: Iterable[dict[str, Any]] = ()) -> None:
    """Give a record a radar that scanned at these ticks, without latency, and what it detected."""
    found = [*detections]
    rows = Counter(row["tick"] for row in found)
    put(folder, "readings", (
        {"tick": tick, "sensor": "radar", "measured_s": tick * PERIOD, "rows": rows[tick]} for tick in ticks
    ))  # fmt: skip
    put(folder, "sensor_radar", found)


def moving(time: np.ndarray[Any, Any], x: np.ndarray[Any, Any], speed: np.ndarray[Any, Any]) -> list[dict[str, Any]]:
    """Rows of a car on the path whose rear axle is truly at x, at these moments of the drive."""
    return [
        {
            "time_s": t,
            "true_x_m": at,
            "x_m": at,
            "s_m": at,
            "true_speed_mps": v,
            "speed_mps": v,
            "measured_steering_rad": math.nan,
        }
        for t, at, v in zip(time.tolist(), x.tolist(), speed.tolist(), strict=True)
    ]
