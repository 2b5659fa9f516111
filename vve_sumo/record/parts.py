"""The growing parts of a record, raw bytes and tables: buffered, hashed batch by batch, and kept as each part is.

A file of bytes only grows by whole lines or chunks. A table in a file grows as an Arrow stream, which becomes a Parquet
file as it is closed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vve_sumo.coded_texts import CodedTexts, joined
from vve_sumo.record.arrow_arrays import coded_array, number_array, string_array
from vve_sumo.record.hashes import ColumnHashes
from vve_sumo.record.layout import CLOSED_ENDING, NUMPY_KINDS
from vve_sumo.sensors.port import Column

#: Returns a text's bytes; most texts of a record are names and codes that come at every tick.
_encoded = lru_cache(maxsize=4096)(str.encode)


class _CodedBytes(NamedTuple):
    """Bytes of texts of which few differ."""

    codes: NDArray[np.int32]  #: of each row
    pieces: list[bytes]  #: what the codes stand for


#: hashed values of a column in a batch: bytes of texts, or numbers
_Hashed = Sequence[bytes] | NDArray[Any] | _CodedBytes


def _array(column: _Hashed, kind: pa.DataType) -> pa.Array:
    if isinstance(column, _CodedBytes):
        return coded_array(column.codes, column.pieces, kind)
    return number_array(column, kind) if isinstance(column, np.ndarray) else string_array(column, kind)


def _joined_texts(parts: Sequence[Column]) -> Column:
    coded = [part for part in parts if isinstance(part, CodedTexts)]
    return joined(coded) if len(coded) == len(parts) else list(chain.from_iterable(parts))


class RawPart:
    """Growing bytes of a raw part: buffered, then hashed and dropped."""

    def __init__(self) -> None:
        self.hash = hashlib.sha256()  #: of all that was flushed
        self._waiting: list[bytes] = []

    def append(self, data: bytes) -> None:
        """Add bytes: a whole line or chunk."""
        self._waiting.append(data)

    def flush(self) -> None:
        """Hash and keep what is buffered."""
        rest = b"".join(self._waiting)
        self._waiting.clear()
        self.hash.update(rest)
        self._keep(rest)

    def forget(self) -> None:
        """Drop the buffered bytes."""
        self._waiting.clear()

    def abandon(self) -> None:
        """Close the file, if there is one, as it is."""

    def close(self) -> None:
        """Finish the file, if there is one."""

    def _keep(self, data: bytes) -> None:
        """Store hashed bytes; here nothing is stored."""


class RawFile(RawPart):
    """Growing bytes of a raw part, written to a file."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self._sink = file.open("xb", buffering=0)

    def abandon(self) -> None:
        self._sink.close()

    def close(self) -> None:
        self._sink.close()

    def _keep(self, data: bytes) -> None:
        rest, begun = memoryview(data), self._sink.tell()
        try:
            while rest:
                rest = rest[self._sink.write(rest) :]
        except OSError:
            # The file shall end with a whole line or chunk.
            self._sink.truncate(begun)
            raise


class TablePart:
    """A growing table: rows are buffered, then hashed and kept in memory batch by batch."""

    def __init__(self, schema: pa.Schema) -> None:
        self.schema = schema
        self.hashes = ColumnHashes(schema)
        self._kinds = [(kind, NUMPY_KINDS.get(kind)) for kind in schema.types]
        self._rows: list[tuple[Any, ...]] = []
        self._portions: list[tuple[int, int, tuple[Column, ...]]] = []
        self._batches: list[pa.RecordBatch] = []

    def append(self, row: tuple[Any, ...]) -> None:
        """Add a row."""
        self._rows.append(row)

    def extend(self, tick: int, rows: int, portion: tuple[Column, ...]) -> None:
        """Add a tick's rows as the columns after `tick`: texts as sequences, numbers as arrays.

        A table gets only columns or only rows.
        """
        self._portions.append((tick, rows, portion))

    def flush(self) -> None:
        """Hash and keep the buffered rows as a batch."""
        if not self._rows and not self._portions:
            return
        columns: list[Any] = list(zip(*self._rows, strict=True)) if self._rows else self._joined()
        hashed = [
            self._strings(number, column, kind) if numeric is None else self._numbers(number, column, numeric)
            for number, (column, (kind, numeric)) in enumerate(zip(columns, self._kinds, strict=True))
        ]
        self.forget()
        self._keep(hashed)

    def forget(self) -> None:
        """Drop the buffered rows."""
        self._rows.clear()
        self._portions.clear()

    def abandon(self) -> None:
        """Close the file, if there is one, as it is."""

    def close(self) -> pa.Table | None:
        """Finish the table and return it; None where only its hash remains."""
        return pa.Table.from_batches(self._batches, self.schema)

    def _joined(self) -> list[Column]:
        ticks, rows, portions = zip(*self._portions, strict=True)
        columns: list[Column] = [np.repeat(ticks, rows)]
        for parts, (_kind, numeric) in zip(zip(*portions, strict=True), self._kinds[1:], strict=True):
            columns.append(_joined_texts(parts) if numeric is None else np.concatenate(parts))
        return columns

    def _strings(self, number: int, column: Column, kind: pa.DataType) -> _Hashed:
        if isinstance(column, CodedTexts):
            coded = _CodedBytes(column.codes, list(map(_encoded, column.texts)))
            self.hashes.add_coded(number, *coded)
            return coded
        pieces: list[bytes] = list(column) if kind == pa.binary() else list(map(_encoded, column))
        self.hashes.add_bytes(number, pieces)
        return pieces

    def _numbers(self, number: int, column: Column, numeric: Any) -> NDArray[Any]:
        numbers: NDArray[Any] = np.asarray(column, numeric)
        self.hashes.add_numbers(number, numbers)
        return numbers

    def _keep(self, hashed: Sequence[_Hashed]) -> None:
        """Store the hashed columns of a batch."""
        self._batches.append(self._batch(hashed))

    def _batch(self, hashed: Sequence[_Hashed]) -> pa.RecordBatch:
        arrays = [_array(column, kind) for column, (kind, _numeric) in zip(hashed, self._kinds, strict=True)]
        return pa.RecordBatch.from_arrays(arrays, schema=self.schema)


class HashedTable(TablePart):
    """A growing table of which only the hash remains."""

    def _keep(self, hashed: Sequence[_Hashed]) -> None:
        """Store nothing."""

    def close(self) -> None:
        """Return no table."""


class TableFile(TablePart):
    """A growing table in a file: a stream of batches that becomes a Parquet file."""

    def __init__(self, file: Path, schema: pa.Schema) -> None:
        super().__init__(schema)
        self._file = file
        self._sink = file.open("xb")
        self._stream = pa.ipc.new_stream(self._sink, schema)

    def abandon(self) -> None:
        self._sink.close()

    def close(self) -> pa.Table:
        """Replace the stream by a Parquet file; a kill at any moment leaves at least one of them whole."""
        self._stream.close()
        self._sink.close()
        with pa.ipc.open_stream(self._file) as stream:
            table = stream.read_all()
        half = self._file.with_suffix(".half")
        try:
            pq.write_table(table, half, compression="zstd")
        except OSError:
            half.unlink(missing_ok=True)
            raise
        half.replace(self._file.with_suffix(CLOSED_ENDING))
        self._file.unlink()
        return table

    def _keep(self, hashed: Sequence[_Hashed]) -> None:
        self._stream.write_batch(self._batch(hashed))
        self._sink.flush()
