"""Reads the files of a record, finished or left open by a killed drive; raises ConfigError where one cannot be read.

Knows the layout; nothing of what the rows mean.
"""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from vve_sumo.config_file import read_json
from vve_sumo.errors import ConfigError
from vve_sumo.record.earlier import with_kinds
from vve_sumo.record.layout import (
    CHUNK_HEAD,
    CLOSED_ENDING,
    COMMANDED,
    LIVE_SCHEMAS,
    OPEN_ENDING,
    OPTIONAL_SCHEMAS,
    SCHEMAS,
    ego_folder,
    sensor_schemas,
)
from vve_sumo.values import EGO


def read_pose_chunks(file: Path) -> list[tuple[float, bytes]]:
    """Return (receive time [s], bytes) of every chunk in a `pose.bin`; an incomplete last chunk is left out."""
    try:
        raw = file.read_bytes()
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from None
    chunks, at = [], 0
    while at + CHUNK_HEAD.size <= len(raw):
        time, size = CHUNK_HEAD.unpack_from(raw, at)
        at += CHUNK_HEAD.size
        if at + size > len(raw):
            break
        chunks.append((time, raw[at : at + size]))
        at += size
    return chunks


def read_table(record: Path, name: str, ego: str = EGO) -> pa.Table:
    """Return one of an ego's tables, finished or left open by a killed drive (up to its last whole batch).

    Columns that the table did not have in an earlier layout are added by what the others say. Raises ConfigError where
    the record has no such ego or neither form of the table, or where its file cannot be read.
    """
    table = read_stored_table(record, name, ego)
    if name != "actors" or "kind" in table.schema.names:
        return table
    resolved = read_json(ego_folder(record, ego) / "scenario.json", "a drive", "settings")
    return with_kinds(table, resolved["settings"])


def read_stored_table(record: Path, name: str, ego: str = EGO) -> pa.Table:
    """Return one of an ego's tables with the columns that its file has; raises ConfigError as `read_table` does."""
    folder = ego_folder(record, ego)
    closed, still_open = folder / f"{name}{CLOSED_ENDING}", folder / f"{name}{OPEN_ENDING}"
    if not closed.is_file() and not still_open.is_file():
        raise ConfigError(f"{folder}: no {name}{CLOSED_ENDING} and no {name}{OPEN_ENDING}: not a drive's record")
    file = closed if closed.is_file() else still_open
    try:
        table = pq.read_table(closed) if closed.is_file() else _read_open(still_open, _schema_of(record, name, ego))
        table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise ConfigError(f"{file}: cannot be read: {' '.join(str(error).split())[:200]}") from None
    return table


def holds_table(record: Path, name: str, ego: str = EGO) -> bool:
    """Return whether a record has an ego's table of that name, finished or left open; raises as `ego_folder` does."""
    folder = ego_folder(record, ego)
    return any((folder / f"{name}{ending}").is_file() for ending in (CLOSED_ENDING, OPEN_ENDING))


def read_commanded(record: Path, ego: str = EGO) -> pa.Table:
    """Return the table of the paths that an ego's commands carry, without a row where the drive had none.

    Raises ConfigError as `read_table` does.
    """
    if holds_table(record, COMMANDED, ego):
        return read_table(record, COMMANDED, ego)
    return OPTIONAL_SCHEMAS[COMMANDED].empty_table()


def sensor_tables(record: Path, ego: str = EGO) -> dict[str, pa.Schema]:
    """Return the schema of each table of an ego's sensors, by the table's name.

    Raises ConfigError as `ego_folder` and `sensor_schemas` do.
    """
    folder = ego_folder(record, ego)
    resolved = read_json(folder / "scenario.json", "a drive", "sensors")
    try:
        return sensor_schemas(resolved)
    except ConfigError as error:
        raise ConfigError(f"{folder}: {error}") from None


def _schema_of(record: Path, name: str, ego: str) -> pa.Schema:
    known = SCHEMAS | OPTIONAL_SCHEMAS | LIVE_SCHEMAS
    schema = known.get(name) or sensor_tables(record, ego).get(name)
    if schema is None:
        raise ConfigError(f"{record}: scenario.json declares no table {name}")
    return schema


def _read_open(file: Path, schema: pa.Schema) -> pa.Table:
    """Return the rows of an Arrow stream up to its last whole batch."""
    batches: list[pa.RecordBatch] = []
    try:
        with pa.ipc.open_stream(file) as stream:
            batches.extend(iter(stream.read_next_batch, None))
    except (StopIteration, pa.ArrowException, OSError):
        pass
    return pa.Table.from_batches(batches, schema=schema)
