"""Tables of a drive in a few rows, as metrics read them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pyarrow as pa

from tests.vehicles import FUSION
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.lead_vehicle import LeadVehicle
from vve_sumo.path import ReferencePath
from vve_sumo.record.layout import SCHEMAS
from vve_sumo.record.rows import TickRow

PERIOD = 0.02
CAR = FUSION.vehicle
KINDS = {"int": 0, "float": 0.0, "bool": False, "str": ""}


def ticks_of(rows: list[dict[str, float]]) -> pa.Table:
    plain = {f.name: KINDS[str(f.type)] for f in dataclasses.fields(TickRow)}
    return pa.Table.from_pylist([plain | {"tick": i} | row for i, row in enumerate(rows)], SCHEMAS["ticks"])


def actors_of(rows: list[dict[str, object]]) -> pa.Table:
    plain = {"heading_rad": 0.0, "speed_mps": 0.0, "length_m": 4.0, "width_m": 2.0, "y_m": 0.0}
    return pa.Table.from_pylist([plain | row for row in rows], SCHEMAS["actors"])


def straight() -> ReferencePath:
    x = np.arange(0.0, 301.0, 2.0)
    return ReferencePath.from_points(x, np.zeros_like(x))


def drive_of(ticks: pa.Table, actors: pa.Table, path: ReferencePath | None = None) -> DriveData:
    return DriveData(ticks, actors, straight() if path is None else path, CAR, PERIOD)


def lead_of(ticks: pa.Table, actors: pa.Table, path: ReferencePath | None = None) -> LeadVehicle:
    return drive_of(ticks, actors, path).lead
