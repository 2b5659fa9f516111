"""Writes and reads the table of the lanes around a drive's path.

Knows neither how the lanes were found nor what they are used for.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from vve_sumo.record.layout import CLOSED_ENDING, ROADS, ROADS_SCHEMA
from vve_sumo.record.reader import read_table
from vve_sumo.world.network import NetworkLane


def roads_table(lanes: Sequence[NetworkLane]) -> pa.Table:
    """Return the table of these lanes."""
    columns = (
        [lane.name for lane in lanes],
        [lane.kind for lane in lanes],
        [lane.width for lane in lanes],
        [lane.shape[:, 0].tolist() for lane in lanes],
        [lane.shape[:, 1].tolist() for lane in lanes],
        [lane.successors for lane in lanes],
    )
    return pa.table(
        [pa.array(column, kind) for column, kind in zip(columns, ROADS_SCHEMA.types, strict=True)], schema=ROADS_SCHEMA
    )


def write_roads(folder: Path, lanes: Sequence[NetworkLane]) -> None:
    """Write the table of these lanes into a record; raises OSError."""
    pq.write_table(roads_table(lanes), folder / f"{ROADS}{CLOSED_ENDING}", compression="zstd")


def read_roads(folder: Path) -> pa.Table:
    """Return a record's table of lanes, without rows for a record of an earlier layout, which has none.

    Raises ConfigError where its file cannot be read.
    """
    if not (folder / f"{ROADS}{CLOSED_ENDING}").is_file():
        return ROADS_SCHEMA.empty_table()
    return read_table(folder, ROADS)
