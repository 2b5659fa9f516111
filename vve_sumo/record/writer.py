"""Writes the record of a drive: one folder, appended as the drive goes, hashed over what was simulated.

Knows rows and bytes; neither SUMO nor the wall clock. Tables grow as Arrow streams in batches of a few ticks, so a
killed process leaves everything but the last batch readable; a finished drive holds Parquet files instead. A live
drive's record is the same with two tables more; one that nobody keeps is the same without its files.
"""

from __future__ import annotations

import hashlib
import json
import operator
from collections.abc import Callable, Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vve_sumo.bus import candump_lines
from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import ColumnHashes, hash_parts
from vve_sumo.record.layout import (
    CHUNK_HEAD,
    CLOSED_ENDING,
    LIVE_SCHEMAS,
    NUMPY_KINDS,
    OPEN_ENDING,
    RAW_PARTS,
    SCHEMAS,
    UNHASHED,
    sensor_schemas,
    sensor_table,
)
from vve_sumo.record.summary import write_summary
from vve_sumo.sensors.port import Column
from vve_sumo.values import Actors, Frame, GatewayRow, LatencyRow, TickRow

#: ticks between two writes; 10 ticks of 20 ms are 0.2 s, the most that a kill may lose
TICKS_PER_BATCH = 10

#: of a record that nobody keeps there is nothing to lose, and longer batches are quicker
UNKEPT_TICKS_PER_BATCH = 250


class _Bytes:
    """Growing bytes, kept as they are: they wait, then go to the hash."""

    def __init__(self) -> None:
        self.hash = hashlib.sha256()
        self._waiting: list[bytes] = []

    def append(self, data: bytes) -> None:
        self._waiting.append(data)

    def flush(self) -> None:
        rest = b"".join(self._waiting)
        self._waiting.clear()
        self.hash.update(rest)
        self._keep(rest)

    def forget(self) -> None:
        """Let go of what waits."""
        self._waiting.clear()

    def abandon(self) -> None:
        """Let go of what is kept."""

    def close(self) -> None:
        """Finish what is kept."""

    def _keep(self, data: bytes) -> None:
        """Keep what has been hashed: nowhere."""


class _BytesFile(_Bytes):
    """The same, in a file."""

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
            # Half a line or half a chunk is no evidence.
            self._sink.truncate(begun)
            raise


class _Table:
    """A growing table: rows wait, a batch at a time goes to the hash and is kept in memory."""

    def __init__(self, schema: pa.Schema) -> None:
        self.schema = schema
        self.hashes = ColumnHashes(schema)
        self._kinds = [(kind, NUMPY_KINDS.get(kind)) for kind in schema.types]
        self._rows: list[tuple[Any, ...]] = []
        self._portions: list[tuple[Column, ...]] = []
        self._batches: list[pa.RecordBatch] = []

    def append(self, row: tuple[Any, ...]) -> None:
        """Take in a row."""
        self._rows.append(row)

    def extend(self, portion: tuple[Column, ...]) -> None:
        """Take in rows as columns: texts as sequences, numbers as arrays. A table gets either these or rows."""
        self._portions.append(portion)

    def flush(self) -> None:
        if not self._rows and not self._portions:
            return
        columns: list[Any] = list(zip(*self._rows, strict=True)) if self._rows else self._joined()
        arrays = [
            self._strings(number, column, kind) if numeric is None else self._numbers(number, column, kind, numeric)
            for number, (column, (kind, numeric)) in enumerate(zip(columns, self._kinds, strict=True))
        ]
        self.forget()
        self._keep(pa.RecordBatch.from_arrays(arrays, schema=self.schema))

    def forget(self) -> None:
        """Let go of what waits."""
        self._rows.clear()
        self._portions.clear()

    def abandon(self) -> None:
        """Let go of what is kept."""

    def close(self) -> pa.Table:
        """Finish the table and return it."""
        return pa.Table.from_batches(self._batches, self.schema)

    def _joined(self) -> list[Column]:
        return [
            list(chain.from_iterable(parts)) if numeric is None else np.concatenate(parts)
            for parts, (_kind, numeric) in zip(zip(*self._portions, strict=True), self._kinds, strict=True)
        ]

    # Arrow's own `array` takes five times as long for a short column, and imports pandas wherever there is one.

    def _strings(self, number: int, column: Column, kind: pa.DataType) -> pa.Array:
        pieces = column if kind == pa.binary() else [text.encode() for text in column]
        self.hashes.add_bytes(number, pieces)
        ends = np.zeros(len(pieces) + 1, np.int32)
        np.cumsum([len(piece) for piece in pieces], out=ends[1:])
        return pa.Array.from_buffers(kind, len(pieces), [None, pa.py_buffer(ends), pa.py_buffer(b"".join(pieces))])

    def _numbers(self, number: int, column: Column, kind: pa.DataType, numeric: Any) -> pa.Array:
        numbers: NDArray[Any] = np.asarray(column, numeric)
        self.hashes.add_numbers(number, numbers)
        kept = np.packbits(numbers, bitorder="little") if kind == pa.bool_() else numbers
        return pa.Array.from_buffers(kind, len(numbers), [None, pa.py_buffer(kept)])

    def _keep(self, batch: pa.RecordBatch) -> None:
        """Keep what has been hashed."""
        self._batches.append(batch)


class _TableFile(_Table):
    """The same, in a file: a stream of batches that becomes a Parquet file."""

    def __init__(self, file: Path, schema: pa.Schema) -> None:
        super().__init__(schema)
        self._file = file
        self._sink = file.open("xb")
        self._stream = pa.ipc.new_stream(self._sink, schema)

    def abandon(self) -> None:
        self._sink.close()

    def close(self) -> pa.Table:
        """Turn the stream into a Parquet file and take the stream away; a kill in between leaves one of them whole."""
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

    def _keep(self, batch: pa.RecordBatch) -> None:
        self._stream.write_batch(batch)
        self._sink.flush()


class MemoryRecorder:
    """What is kept of one drive while it is being driven: in memory, until nobody needs it any more.

    The hash covers the resolved scenario with its versions, the raw inputs with their drive times and every
    recorded column; never a wall-clock time and never the bytes of a table's file.
    """

    schemas: ClassVar[Mapping[str, pa.Schema]] = SCHEMAS  #: of its tables, but for those of sensors
    ticks_per_batch: ClassVar[int] = UNKEPT_TICKS_PER_BATCH

    def __init__(self, resolved: dict[str, Any], epoch: float) -> None:
        """Begin with the scenario as it was resolved, which declares the tables of its sensors.

        `epoch` is the GNSS second of drive time 0.
        """
        self._epoch = epoch
        self.tables: dict[str, pa.Table] = {}  #: once it is closed
        text = (json.dumps(resolved, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()
        self._raw = {name: self._bytes(name) for name in RAW_PARTS}
        self._raw["scenario.json"].append(text)
        self._raw["scenario.json"].flush()
        self._pose, self._can = self._raw["pose.bin"], self._raw["can.log"]
        schemas = {**self.schemas, **sensor_schemas(resolved)}
        self._tables = {name: self._table(name, schema) for name, schema in schemas.items()}
        self._parts: dict[str, _Bytes | _Table] = {**self._raw, **self._tables}
        self._ticks = 0

    def received_pose(self, time: float, data: bytes) -> None:
        """Keep pose bytes as they came, with their receive time."""
        self._pose.append(CHUNK_HEAD.pack(time, len(data)) + data)

    def saw_frames(self, time: float, channel: str, frames: Iterable[Frame]) -> None:
        """Keep CAN frames heard or sent at one time, in candump form; `time` is drive time, written as GNSS time."""
        self._can.append(candump_lines(self._epoch + time, channel, frames).encode())

    def sensed(self, tick: int, sensor: str, measured: float, columns: tuple[Column, ...]) -> None:
        """Keep what came out of a sensor at a tick: drive time at which it was measured [s], columns of its table."""
        rows = len(columns[0])
        self._tables["readings"].append((tick, sensor, measured, rows))
        if rows:
            self._tables[sensor_table(sensor)].extend((np.full(rows, tick), *columns))

    def snapshot(self, tick: int, actors: Actors) -> None:
        """Keep the actors that tick `tick` looks at."""
        if not actors.ids:
            return
        columns = (
            actors.x,
            actors.y,
            actors.heading,
            actors.speed,
            actors.length,
            actors.width,
            actors.radar_cross_section,
            actors.lateral_speed,
        )
        self._tables["actors"].extend((np.full(len(actors.ids), tick), actors.ids, *columns))

    def ticked(self, row: TickRow) -> None:
        """Keep the row of a tick; every `ticks_per_batch`-th takes everything kept so far away."""
        self._tables["ticks"].append(_as_tuple(row))
        self._ticks += 1
        if self._ticks % self.ticks_per_batch == 0:
            self.flush()

    def attach(self, name: str, text: str) -> None:
        """Keep a text that belongs to the drive and not to its hash."""

    def flush(self) -> None:
        """Bring everything kept so far to where it stays, and into the hash."""
        for part in self._parts.values():
            part.flush()

    def close(self) -> dict[str, str]:
        """Finish everything and return the hash of each part (hexadecimal SHA-256)."""
        self.flush()
        for raw in self._raw.values():
            raw.close()
        self.tables = {name: table.close() for name, table in self._tables.items()}
        tables = {name: table.hashes.hexdigest() for name, table in self._tables.items() if name not in UNHASHED}
        return {name: raw.hash.hexdigest() for name, raw in self._raw.items()} | tables

    def discard(self) -> None:
        """Let go of everything: the drive never was."""
        for part in self._parts.values():
            part.abandon()

    def _bytes(self, _name: str) -> _Bytes:
        return _Bytes()

    def _table(self, _name: str, schema: pa.Schema) -> _Table:
        return _Table(schema)


class Record(MemoryRecorder):
    """The folder of one drive while it is being driven; every TICKS_PER_BATCH-th tick brings it to disk."""

    ticks_per_batch = TICKS_PER_BATCH

    def __init__(self, folder: Path, resolved: dict[str, Any], epoch: float) -> None:
        """Open the record in `folder`, which is `claim`ed; nothing that lies there already is written over."""
        self._made = [place for place in (folder, *folder.parents) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        super().__init__(resolved, epoch)

    def attach(self, name: str, text: str) -> None:
        """Keep a text in a file of that name."""
        (self.folder / name).write_text(text, encoding="utf-8")

    def discard(self) -> None:
        """Take away everything that the record made: its files, and the folders that were not there before."""
        super().discard()
        for file in self.folder.iterdir():
            file.unlink()
        for place in self._made:
            place.rmdir()

    def summarise(self, summary: dict[str, Any]) -> None:
        """Write `summary.json`; not-a-number and infinity become null."""
        write_summary(self.folder, summary)

    def _bytes(self, name: str) -> _Bytes:
        return _BytesFile(self.folder / name)

    def _table(self, name: str, schema: pa.Schema) -> _Table:
        return _TableFile(self.folder / f"{name}{OPEN_ENDING}", schema)


class LiveRecord(Record):
    """The record of a live drive: two tables more, and a part that can't be written doesn't take the others with it.

    Whoever claimed the folder may have put logs of processes into it.
    """

    schemas = SCHEMAS | LIVE_SCHEMAS

    def __init__(self, folder: Path, resolved: dict[str, Any], epoch: float) -> None:
        """Open the record in `folder`, which is claimed."""
        super().__init__(folder, resolved, epoch)
        self.broken: set[str] = set()  #: parts that can't be written any more; what they hold already stays

    def ticked(self, row: TickRow) -> None:
        """Keep the row of a tick; when it goes to disk is its owner's business, who has a clock."""
        self._tables["ticks"].append(_as_tuple(row))

    def attach(self, name: str, text: str) -> None:
        """Keep a text in a file of that name, or at least note that it can't be."""
        try:
            super().attach(name, text)
        except OSError:
            self.broken.add(name)

    def stepped(self, row: GatewayRow) -> None:
        """Keep the row of a step of the gateway."""
        self._tables["gateway"].append(_gateway_tuple(row))

    def timed(self, row: LatencyRow) -> None:
        """Keep the latencies of one tick."""
        self._tables["latency"].append(_latency_tuple(row))

    def flush(self) -> None:
        """Bring everything kept so far to disk and into the hash, or at least what can be."""
        for name, part in self._parts.items():
            if name in self.broken:
                part.forget()
                continue
            try:
                part.flush()
            except OSError:
                self.broken.add(name)

    def close(self) -> dict[str, str]:
        """Finish what can be finished and return the hash of each part; a broken one stays as far as it came."""
        self.flush()
        for name, part in self._parts.items():
            try:
                part.abandon() if name in self.broken else part.close()
            except OSError:
                self.broken.add(name)
        return hash_parts(self.folder)


def claim(folder: Path) -> None:
    """Raise ConfigError unless a record can be opened in `folder`: it is absent, or an empty folder."""
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder} is a file, expected a folder for the record")
    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty, expected an empty or absent folder for the record")


#: A tick's row as the tuple of its fields, in their order.
_as_tuple: Callable[[TickRow], tuple[Any, ...]] = operator.attrgetter(*TickRow.__slots__)
_gateway_tuple: Callable[[GatewayRow], tuple[Any, ...]] = operator.attrgetter(*GatewayRow.__slots__)
_latency_tuple: Callable[[LatencyRow], tuple[Any, ...]] = operator.attrgetter(*LatencyRow.__slots__)
