"""The table of what a user's metrics say of every tick: how it is made and written.

Knows rows and columns; nothing of who measures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from vve_sumo.metrics.metric import Metric
from vve_sumo.record.layout import CLOSED_ENDING, TICK_METRICS, tick_metrics_schema


def tick_metrics_table(
    rows: Mapping[str, Metric], columns: Mapping[str, Sequence[Any]], ticks: pa.Table
) -> pa.Table | None:
    """Return the table of these columns beside the numbers of the ticks; None where there is no column.

    A metric without a column, because it failed, has none in the table either.
    """
    if not columns:
        return None
    schema = tick_metrics_schema({name: rows[name] for name in columns})
    return pa.table([ticks["tick"].combine_chunks(), *map(pa.array, columns.values())], schema=schema)


def write_tick_metrics(folder: Path, table: pa.Table | None) -> None:
    """Write the table into a record, if there is one; raises OSError."""
    if table is not None:
        pq.write_table(table, folder / f"{TICK_METRICS}{CLOSED_ENDING}", compression="zstd")
