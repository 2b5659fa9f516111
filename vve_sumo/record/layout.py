"""Defines what a record consists of: its files, the columns of its tables, and the tables that its sensors declare.

No file is read or written here.
"""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import pyarrow as pa

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.metric import Metric
from vve_sumo.metrics.own import DeclaredMetrics
from vve_sumo.record.columns import described_schema
from vve_sumo.record.rows import (
    GatewayRow,
    LatencyRow,
    PersonReportRow,
    PersonRow,
    SignalRow,
    StationDatagramRow,
    StationRow,
    TickRow,
)
from vve_sumo.sensors.port import SensorColumn
from vve_sumo.values import EGO

#: Version of a record's layout. Layout 2 added path and car; 3 added provenance.json and the summary's hash of itself;
#: 4 added the actors' lateral speed and the time of measurement of a scan; 5 added, for live drives, the actors of
#: SUMO's last step, under the tick after the last; 6 added the vehicle model; 7 added a table for each sensor in place
#: of the radar's alone, and the hashes of the code of interface and receiver; 8 added the lanes around the path;
#: 9 added the actors' height and kind; 10 added the signals that the ego ran on red.
LAYOUT = 10
#: layouts that can be read: what a record of 7 to 9 lacks follows from what it holds, or is left out
READABLE_LAYOUTS = (7, 8, 9, 10)
#: numpy's type of each numeric column
NUMPY_KINDS = {pa.int64(): np.int64, pa.int8(): np.int8, pa.float64(): np.float64, pa.bool_(): np.bool_}
_ARROW: dict[str, pa.DataType] = {
    "int": pa.int64(), "int8": pa.int8(), "float": pa.float64(),
    "bool": pa.bool_(), "str": pa.string(), "bytes": pa.binary(),
}  # fmt: skip


_Row: TypeAlias = (
    TickRow | GatewayRow | LatencyRow | PersonReportRow | PersonRow | SignalRow | StationDatagramRow | StationRow
)


def _row_schema(row: type[_Row]) -> pa.Schema:
    return described_schema((f.name, _ARROW[str(f.type)], f.metadata["meaning"]) for f in dataclasses.fields(row))


_TICK = ("tick", pa.int64(), "number of the tick")


def _sensor_schema(columns: Sequence[SensorColumn]) -> pa.Schema:
    return described_schema([_TICK, *((column.name, _ARROW[column.kind], column.meaning) for column in columns)])


#: tables that every record has
SCHEMAS: dict[str, pa.Schema] = {
    "ticks": _row_schema(TickRow),
    "readings": described_schema(
        [
            ("tick", pa.int64(), "number of the tick at which the reading came out"),
            ("sensor", pa.string(), "name of the sensor"),
            ("measured_s", pa.float64(), "drive time at which it was measured"),
            ("rows", pa.int64(), "rows that it has in the sensor's own table"),
        ]
    ),
    "actors": described_schema(
        [
            ("tick", pa.int64(), "number of the tick that looks at this snapshot, or would have after the last"),
            ("actor", pa.string(), "name in SUMO"),
            ("x_m", pa.float64(), "centre of the box, map"),
            ("y_m", pa.float64(), "centre of the box, map"),
            ("heading_rad", pa.float64(), "counter-clockwise from the map's +x"),
            ("speed_mps", pa.float64(), "along the heading"),
            ("length_m", pa.float64(), "of the box, along the heading"),
            ("width_m", pa.float64(), "of the box"),
            ("radar_cross_section_m2", pa.float64(), "at 77 GHz, by the kind of actor: an assumption"),
            ("lateral_speed_mps", pa.float64(), "of the centre across the heading, left positive"),
            ("height_m", pa.float64(), "of the box, above the ground"),
            ("kind", pa.int8(), f"of body: {', '.join(f'{n} {kind}' for n, kind in enumerate(BODY_KINDS))}"),
        ]
    ),
}
#: Columns of the actors' table that hold numbers, as `Actors` orders them.
ACTOR_COLUMNS: Final = tuple(SCHEMAS["actors"].names[2:])

#: name of the table of the paths that commands carry
COMMANDED: Final = "commanded_paths"
#: names of the tables of real people: what came from them, and what it was taken for
PEOPLE_REPORTS, PEOPLE = "people_reports", "people"
#: names of the tables of real stations: what the on-board unit received, and the bodies that came of it
STATION_DATAGRAMS, STATIONS = "station_datagrams", "stations"
#: name of the table of what sensors were handed of the traffic signals
SIGNAL_PLANS: Final = "signal_plans"
#: Tables of records of which not every drive writes any row; such a drive's record has no file of theirs and no hash.
#: They are flushed in this order and before all others: a kill between two flushes never leaves a tick whose commanded
#: path is missing, nor a person or a station without the reports behind
#: them, nor what a signal showed.
OPTIONAL_SCHEMAS: Final[dict[str, pa.Schema]] = {
    COMMANDED: described_schema(
        [
            ("tick", pa.int64(), "number of the tick whose command carries the path"),
            ("x_m", pa.float64(), "point of the path, in driving order: rear axle, map"),
            ("y_m", pa.float64(), "as x_m"),
            ("speed_mps", pa.float64(), "that the controller means to have there"),
        ]
    ),
    PEOPLE_REPORTS: _row_schema(PersonReportRow),
    PEOPLE: _row_schema(PersonRow),
    STATION_DATAGRAMS: _row_schema(StationDatagramRow),
    STATIONS: _row_schema(StationRow),
    SIGNAL_PLANS: _row_schema(SignalRow),
}

#: name of the table of the lanes around the path
ROADS: Final = "roads"
#: its columns. It is written once, when the drive begins. The record's hash leaves it out, because it follows from
#: network and path, which `scenario.json` holds the hash and the points of.
ROADS_SCHEMA: Final = described_schema(
    [
        ("lane", pa.string(), "name in SUMO"),
        (
            "kind",
            pa.string(),
            "`lane`, `junction` (a lane inside a junction), `crossing`, or `walkway` (for pedestrians alone)",
        ),
        ("width_m", pa.float64(), "of the lane"),
        ("x_m", pa.list_(pa.float64()), "centre line in driving direction, map"),
        ("y_m", pa.list_(pa.float64()), "centre line in driving direction, map"),
        ("successors", pa.list_(pa.string()), "lanes that it leads into, those inside junctions included"),
    ]
)

#: tables that only a live drive has
LIVE_SCHEMAS: dict[str, pa.Schema] = {"gateway": _row_schema(GatewayRow), "latency": _row_schema(LatencyRow)}

#: tables that the record's hash leaves out: they hold durations, which differ from drive to drive
UNHASHED = frozenset({"latency"})

#: parts of a record that are hashed as the bytes of their files
RAW_PARTS = ("scenario.json", "pose.bin", "can.log")

#: endings of the files of an open and of a finished table
OPEN_ENDING, CLOSED_ENDING = ".arrows", ".parquet"
#: file with the drive's code, versions and machine; not part of the record's hash
PROVENANCE = "provenance.json"

#: table of what a user's metrics say of every tick; not part of the record's hash, as it follows from the others
TICK_METRICS: Final = "metrics"

#: prefix of the name of a sensor's table; the name of the sensor follows
SENSOR_TABLE: Final = "sensor_"

#: folder in a record that holds the records of the drive's further egos, by their ids
FURTHER_EGOS: Final = "egos"

#: head of a chunk in `pose.bin`: receive time [s] and number of bytes
CHUNK_HEAD = struct.Struct("<dI")


def ego_folder(record: Path, ego: str) -> Path:
    """Return the folder that holds an ego's own parts of a record: the record itself for the car of [ego].

    That of a further ego is a record of its own, in the first one's. Raises ConfigError for an ego that the record does
    not have.
    """
    if ego == EGO:
        return record
    if ego not in (known := further_egos(record)):
        raise ConfigError(f"{record}: no ego {ego!r}, expected {' or '.join(map(repr, (EGO, *known)))}")
    return record / FURTHER_EGOS / ego


def further_egos(record: Path) -> tuple[str, ...]:
    """Return the ids of a drive's further egos, in order; empty for the record of a drive of one."""
    return tuple(sorted(file.parent.name for file in (record / FURTHER_EGOS).glob("*/scenario.json")))


def sensor_table(sensor: str) -> str:
    """Return the name of a sensor's table."""
    return f"{SENSOR_TABLE}{sensor}"


def sensor_schemas(resolved: Mapping[str, Any]) -> dict[str, pa.Schema]:
    """Return the schema of each sensor's table that a record's `scenario.json` declares, by the table's name.

    Raises ConfigError where the declaration is missing or not of this version.
    """
    try:
        declared = {
            name: [SensorColumn(*column) for column in columns] for name, columns in resolved["sensors"].items()
        }
        return {sensor_table(name): _sensor_schema(columns) for name, columns in declared.items()}
    except (AttributeError, KeyError, TypeError) as error:
        raise ConfigError(f"scenario.json: sensors: no columns of this version: {error!r}") from None


def recorded_metrics(resolved: Mapping[str, Any]) -> DeclaredMetrics:
    """Return the rows of the user's metrics that a record's `scenario.json` declares.

    Raises ConfigError where they are of no version that is known.
    """
    try:
        return DeclaredMetrics.from_dict(resolved.get("metrics", {}))
    except ConfigError as error:
        raise ConfigError(f"scenario.json: {error}") from None


def tick_metrics_schema(rows: Mapping[str, Metric]) -> pa.Schema:
    """Return the schema of the table of the user's metrics of the ticks."""
    return described_schema([_TICK, *((row.name, _ARROW[row.kind], row.meaning) for row in rows.values())])


def recorded_brain(resolved: Mapping[str, Any]) -> str:
    """Return the kind of the external controller that decided in a drive, by `scenario.json`; empty for none."""
    kind = resolved.get("brain") or resolved.get("rig", {}).get("brain", {}).get("kind", "own")
    return "" if kind == "own" else str(kind)


def check_layout(resolved: Mapping[str, Any], file: Path) -> None:
    """Raise ConfigError for a record of a layout that this version cannot read; `file` is its `scenario.json`."""
    layout = resolved.get("layout", 1)
    if layout not in READABLE_LAYOUTS:
        readable = " or ".join(map(str, READABLE_LAYOUTS))
        raise ConfigError(f"{file}: layout {layout} of a record, expected {readable}: another vve-sumo wrote it")
