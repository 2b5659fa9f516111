"""Computes the hashes of a record: of each part, of the whole, and of the bytes of its files.

Knows the layout; neither how a record is written nor who compares hashes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vve_sumo.errors import ConfigError
from vve_sumo.record.arrow_arrays import coded_array
from vve_sumo.record.layout import (
    CLOSED_ENDING,
    LIVE_SCHEMAS,
    NUMPY_KINDS,
    OPTIONAL_SCHEMAS,
    PROVENANCE,
    RAW_PARTS,
    ROADS,
    SCHEMAS,
    SENSOR_TABLE,
    TICK_METRICS,
    UNHASHED,
)
from vve_sumo.record.reader import read_stored_table, sensor_tables


class ColumnHashes:
    """Hashes a table column by column, so that the hash does not depend on the portions in which rows came."""

    def __init__(self, schema: pa.Schema) -> None:
        self._hashes = [hashlib.sha256(name.encode()) for name in schema.names]

    def add_bytes(self, column: int, pieces: Iterable[bytes]) -> None:
        """Add byte strings to a column; each is hashed with its length, so that different columns never look alike."""
        self._hashes[column].update(b"".join(_with_lengths(pieces)))

    def add_coded(self, column: int, codes: NDArray[np.int32], pieces: Sequence[bytes]) -> None:
        """Add a byte string for each code, which is a place in `pieces`; the hash is that of `add_bytes`."""
        _validity, _ends, added = coded_array(codes, _with_lengths(pieces), pa.binary()).buffers()
        self._hashes[column].update(added)

    def add_numbers(self, column: int, numbers: NDArray[Any]) -> None:
        """Add numbers to a column, of the column's own kind."""
        self._hashes[column].update(np.ascontiguousarray(numbers).data)

    def hexdigest(self) -> str:
        """Return the hash of the table so far (hexadecimal)."""
        return hashlib.sha256(b"".join(part.digest() for part in self._hashes)).hexdigest()


def _with_lengths(pieces: Iterable[bytes]) -> list[bytes]:
    return [b"%d:%b" % (len(piece), piece) for piece in pieces]


def hash_table(table: pa.Table) -> str:
    """Return the hash of a whole table; it equals the hash that `ColumnHashes` gave while the table grew.

    A column in which values are absent has a hash of its own: no writer leaves one out, a damaged file may.
    """
    hashes = ColumnHashes(table.schema)
    for number, column in enumerate(table.columns):
        numeric = NUMPY_KINDS.get(column.type)
        if column.null_count:
            hashes.add_bytes(number, [b"absent: %d" % column.null_count])
            continue
        if numeric is None:
            hashes.add_bytes(number, column.cast(pa.binary()).to_pylist())
        else:
            hashes.add_numbers(number, column.to_numpy().astype(numeric, copy=False))
    return hashes.hexdigest()


def hash_parts(folder: Path) -> dict[str, str]:
    """Return the hash of every part of a record, finished or left open, from its files (hexadecimal SHA-256).

    Raises ConfigError where a part is missing or unreadable.
    """
    names = (*OPTIONAL_SCHEMAS, *(name for name in LIVE_SCHEMAS if name not in UNHASHED))
    there = [name for name in names if any(folder.glob(f"{name}.*"))]
    return {name: hash_part(folder, name) for name in (*RAW_PARTS, *SCHEMAS, *sensor_tables(folder), *there)}


def hash_part(folder: Path, name: str) -> str:
    """Return the hash of one part of a record; raises ConfigError as `hash_parts` does."""
    return hash_file(folder / name) if name in RAW_PARTS else hash_table(read_stored_table(folder, name))


def hash_file(file: Path) -> str:
    """Return the hash of a file's bytes (hexadecimal SHA-256); raises ConfigError where it cannot be read."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from None


def hash_files(folder: Path) -> dict[str, str]:
    """Return the hash of the bytes of every finished table's file, and of the record's provenance.

    The hash of a record covers the tables' rows only, so that it does not depend on how a table's file is encoded.
    These hashes also show a changed byte that leaves the rows as they were.
    """
    return {file.name: hash_file(file) for file in hashed_files(folder)}


def hashed_files(folder: Path) -> list[Path]:
    """Return the files that `hash_files` covers."""
    names = (*SCHEMAS, *OPTIONAL_SCHEMAS, *LIVE_SCHEMAS, ROADS, TICK_METRICS)
    tables = [folder / f"{name}{CLOSED_ENDING}" for name in names]
    files = [*tables, *sorted(folder.glob(f"{SENSOR_TABLE}*{CLOSED_ENDING}")), folder / PROVENANCE]
    return [file for file in files if file.is_file()]


def whole(parts: dict[str, str]) -> str:
    """Return the hash of a record, computed from the hashes of its parts."""
    return hashlib.sha256("".join(f"{name} {parts[name]}\n" for name in sorted(parts)).encode()).hexdigest()
