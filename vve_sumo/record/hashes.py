"""The hashes of a record: of each part of it, of the whole, of the bytes of its files.

Knows the layout; neither how a record is written nor who compares hashes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vve_sumo.errors import ConfigError
from vve_sumo.record.layout import (
    CLOSED_ENDING,
    LIVE_SCHEMAS,
    NUMPY_KINDS,
    PROVENANCE,
    RAW_PARTS,
    SCHEMAS,
    SENSOR_TABLE,
    UNHASHED,
)
from vve_sumo.record.reader import read_table, sensor_tables


class ColumnHashes:
    """The hash of a table, column by column, so that it doesn't matter in which portions the rows came."""

    def __init__(self, schema: pa.Schema) -> None:
        self._hashes = [hashlib.sha256(name.encode()) for name in schema.names]

    def add_bytes(self, column: int, pieces: Iterable[bytes]) -> None:
        """Take in further byte strings of a column; each with its length, so that no two such columns look the same."""
        self._hashes[column].update(b"".join([b"%d:%b" % (len(piece), piece) for piece in pieces]))

    def add_numbers(self, column: int, numbers: NDArray[Any]) -> None:
        """Take in further numbers of a column, of the column's own kind."""
        self._hashes[column].update(np.ascontiguousarray(numbers).data)

    def hexdigest(self) -> str:
        """Return the hash of the table so far (hexadecimal)."""
        return hashlib.sha256(b"".join(part.digest() for part in self._hashes)).hexdigest()


def hash_table(table: pa.Table) -> str:
    """Return the hash of a finished table, the same as it had while it grew."""
    hashes = ColumnHashes(table.schema)
    for number, column in enumerate(table.columns):
        numeric = NUMPY_KINDS.get(column.type)
        if numeric is None:
            hashes.add_bytes(number, column.cast(pa.binary()).to_pylist())
        else:
            hashes.add_numbers(number, column.to_numpy().astype(numeric, copy=False))
    return hashes.hexdigest()


def hash_parts(folder: Path) -> dict[str, str]:
    """Return the hash of every part of a record, from its files (hexadecimal SHA-256); whether finished or left open.

    Raises ConfigError where a part is missing or unreadable.
    """
    live = [name for name in LIVE_SCHEMAS if name not in UNHASHED and any(folder.glob(f"{name}.*"))]
    return {name: hash_part(folder, name) for name in (*RAW_PARTS, *SCHEMAS, *sensor_tables(folder), *live)}


def hash_part(folder: Path, name: str) -> str:
    """Return the hash of one part of a record; raises ConfigError as `hash_parts` does."""
    return hash_file(folder / name) if name in RAW_PARTS else hash_table(read_table(folder, name))


def hash_file(file: Path) -> str:
    """Return the hash of a file's bytes (hexadecimal SHA-256); raises ConfigError where it can't be read."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from None


def hash_files(folder: Path) -> dict[str, str]:
    """Return the hash of the bytes of every finished table's file, and of the record's provenance.

    A byte of a table's file may say nothing of what the table holds; so the hash of a record, which is to be the same
    whoever writes the files, does not see it. This one does.
    """
    return {file.name: hash_file(file) for file in hashed_files(folder)}


def hashed_files(folder: Path) -> list[Path]:
    """Return the files whose bytes have hashes of their own beside that of the record."""
    tables = [folder / f"{name}{CLOSED_ENDING}" for name in SCHEMAS | LIVE_SCHEMAS]
    files = [*tables, *sorted(folder.glob(f"{SENSOR_TABLE}*{CLOSED_ENDING}")), folder / PROVENANCE]
    return [file for file in files if file.is_file()]


def whole(parts: dict[str, str]) -> str:
    """Return the hash of a record out of the hashes of its parts."""
    return hashlib.sha256("".join(f"{name} {parts[name]}\n" for name in sorted(parts)).encode()).hexdigest()
