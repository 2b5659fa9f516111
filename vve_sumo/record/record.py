"""The record of a drive: one folder, appended as the drive goes, hashed over what was simulated.

Knows rows and bytes; neither SUMO nor the wall clock. Tables grow as Arrow streams in batches of a few ticks, so a
killed process leaves everything but the last batch readable; a finished drive holds Parquet files instead. A live
drive's record is the same with two tables more; one that nobody keeps is the same without its files.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import operator
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vve_sumo.bus import candump_lines
from vve_sumo.errors import ConfigError
from vve_sumo.sensors.port import Column, SensorTable
from vve_sumo.sensors.registry import SENSORS
from vve_sumo.values import Actors, Frame, GatewayRow, LatencyRow, TickRow

#: ticks between two writes; 10 ticks of 20 ms are 0.2 s, the most that a kill may lose
TICKS_PER_BATCH = 10

#: of a record that nobody keeps there is nothing to lose, and longer batches are quicker
UNKEPT_TICKS_PER_BATCH = 250

#: numpy's kind of each numeric column
_NUMPY = {pa.int64(): np.int64, pa.int8(): np.int8, pa.float64(): np.float64, pa.bool_(): np.bool_}
_ARROW: dict[str, pa.DataType] = {
    "int": pa.int64(), "int8": pa.int8(), "float": pa.float64(),
    "bool": pa.bool_(), "str": pa.string(), "bytes": pa.binary(),
}  # fmt: skip


def _row_schema(row: type[TickRow | GatewayRow | LatencyRow]) -> pa.Schema:
    return pa.schema(
        [
            pa.field(f.name, _ARROW[str(f.type)], metadata={"meaning": f.metadata["meaning"]})
            for f in dataclasses.fields(row)
        ]
    )


def _schema(columns: Sequence[tuple[str, pa.DataType, str]]) -> pa.Schema:
    return pa.schema([pa.field(name, kind, metadata={"meaning": meaning}) for name, kind, meaning in columns])


_TICK = ("tick", pa.int64(), "number of the tick")


def _sensor_schema(table: SensorTable) -> pa.Schema:
    return _schema([_TICK, *((name, _ARROW[kind], meaning) for name, kind, meaning in table.columns)])


SCHEMAS: dict[str, pa.Schema] = {
    "ticks": _row_schema(TickRow),
    **{kind.table.name: _sensor_schema(kind.table) for kind in SENSORS.values()},
    "actors": _schema(
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
        ]
    ),
}
#: Columns of the actors' table that hold numbers, as `Actors` orders them.
ACTOR_COLUMNS: Final = tuple(SCHEMAS["actors"].names[2:])

#: tables that only a live drive has
LIVE_SCHEMAS: dict[str, pa.Schema] = {"gateway": _row_schema(GatewayRow), "latency": _row_schema(LatencyRow)}

#: tables that the hash leaves out: they tell how long things took, and no two drives take equally long
UNHASHED = frozenset({"latency"})

#: parts of a record that are hashed as they stand in their files
RAW_PARTS = ("scenario.json", "pose.bin", "can.log")

#: what an open table is called in the folder, and a finished one
OPEN_ENDING, CLOSED_ENDING = ".arrows", ".parquet"

#: key of a summary's hash of itself
SUMMARY_HASH_KEY = "summary_sha256"
#: file of a record that says where the drive comes from; no part of its hash
PROVENANCE = "provenance.json"

#: files whose bytes have hashes of their own beside that of the record
HASHED_FILES = (*(f"{name}{CLOSED_ENDING}" for name in SCHEMAS | LIVE_SCHEMAS), PROVENANCE)

_CHUNK_HEAD = struct.Struct("<dI")


def read_pose_chunks(file: Path) -> list[tuple[float, bytes]]:
    """Return (receive time [s], bytes) of every complete chunk in a `pose.bin`; a torn last one is left out."""
    try:
        raw = file.read_bytes()
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from None
    chunks, at = [], 0
    while at + _CHUNK_HEAD.size <= len(raw):
        time, size = _CHUNK_HEAD.unpack_from(raw, at)
        at += _CHUNK_HEAD.size
        if at + size > len(raw):
            break
        chunks.append((time, raw[at : at + size]))
        at += size
    return chunks


def read_table(folder: Path, name: str) -> pa.Table:
    """Return one of the record's tables, finished or left open by a killed drive (up to its last whole batch).

    Raises ConfigError where the folder holds neither form of it, or one that can't be read.
    """
    closed, still_open = folder / f"{name}{CLOSED_ENDING}", folder / f"{name}{OPEN_ENDING}"
    if not closed.is_file() and not still_open.is_file():
        raise ConfigError(f"{folder}: no {name}{CLOSED_ENDING} and no {name}{OPEN_ENDING}: not a drive's record")
    file = closed if closed.is_file() else still_open
    try:
        table = pq.read_table(closed) if closed.is_file() else _read_open(still_open, (SCHEMAS | LIVE_SCHEMAS)[name])
        table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise ConfigError(f"{file}: cannot be read: {' '.join(str(error).split())[:200]}") from None
    return table


def _read_open(file: Path, schema: pa.Schema) -> pa.Table:
    """Return what a stream holds up to its last whole batch."""
    batches: list[pa.RecordBatch] = []
    try:
        with pa.ipc.open_stream(file) as stream:
            batches.extend(iter(stream.read_next_batch, None))
    except (StopIteration, pa.ArrowException, OSError):
        pass
    return pa.Table.from_batches(batches, schema=schema)


class _ColumnHashes:
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
    hashes = _ColumnHashes(table.schema)
    for number, column in enumerate(table.columns):
        numeric = _NUMPY.get(column.type)
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
    return {name: hash_part(folder, name) for name in (*RAW_PARTS, *SCHEMAS, *live)}


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
    files = [folder / name for name in HASHED_FILES]
    return {file.name: hash_file(file) for file in files if file.is_file()}


def whole(parts: dict[str, str]) -> str:
    """Return the hash of a record out of the hashes of its parts."""
    return hashlib.sha256("".join(f"{name} {parts[name]}\n" for name in sorted(parts)).encode()).hexdigest()


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
        self.hashes = _ColumnHashes(schema)
        self._kinds = [(kind, _NUMPY.get(kind)) for kind in schema.types]
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

    schemas: ClassVar[Mapping[str, pa.Schema]] = SCHEMAS  #: of its tables
    ticks_per_batch: ClassVar[int] = UNKEPT_TICKS_PER_BATCH

    def __init__(self, resolved: dict[str, Any], epoch: float) -> None:
        """Begin with the scenario as it was resolved; `epoch` is the GNSS second of drive time 0."""
        self._epoch = epoch
        self.tables: dict[str, pa.Table] = {}  #: once it is closed
        text = (json.dumps(resolved, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()
        self._raw = {name: self._bytes(name) for name in RAW_PARTS}
        self._raw["scenario.json"].append(text)
        self._raw["scenario.json"].flush()
        self._pose, self._can = self._raw["pose.bin"], self._raw["can.log"]
        self._tables = {name: self._table(name, schema) for name, schema in self.schemas.items()}
        self._parts: dict[str, _Bytes | _Table] = {**self._raw, **self._tables}
        self._ticks = 0

    def received_pose(self, time: float, data: bytes) -> None:
        """Keep pose bytes as they came, with their receive time."""
        self._pose.append(_CHUNK_HEAD.pack(time, len(data)) + data)

    def saw_frames(self, time: float, channel: str, frames: Iterable[Frame]) -> None:
        """Keep CAN frames heard or sent at one time, in candump form; `time` is drive time, written as GNSS time."""
        self._can.append(candump_lines(self._epoch + time, channel, frames).encode())

    def sensed(self, tick: int, sensor: str, columns: tuple[Column, ...]) -> None:
        """Keep what came out of the sensor of that name at a tick, as the columns of its table."""
        rows = len(columns[0])
        if rows:
            self._tables[SENSORS[sensor].table.name].extend((np.full(rows, tick), *columns))

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


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Write a record's `summary.json`, sealed by a hash of itself; not-a-number and infinity become null."""
    half = folder / "summary.half"
    half.write_text(sealed(_finite(summary)), encoding="utf-8")
    half.replace(folder / "summary.json")


def sealed(summary: dict[str, Any]) -> str:
    """Return a summary as its file holds it, with the hash of all that it says but that hash."""
    said = {key: value for key, value in summary.items() if key != SUMMARY_HASH_KEY}
    seal = hashlib.sha256(_spelt(said).encode()).hexdigest()
    return _spelt(said | {SUMMARY_HASH_KEY: seal})


def _spelt(summary: dict[str, Any]) -> str:
    return json.dumps(summary, indent=1, allow_nan=False) + "\n"


def claim(folder: Path) -> None:
    """Raise ConfigError unless a record can be opened in `folder`: it is absent, or an empty folder."""
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder} is a file, expected a folder for the record")
    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty, expected an empty or absent folder for the record")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, float) and not (-float("inf") < value < float("inf")):
        return None
    return value


#: A tick's row as the tuple of its fields, in their order.
_as_tuple: Callable[[TickRow], tuple[Any, ...]] = operator.attrgetter(*TickRow.__slots__)
_gateway_tuple: Callable[[GatewayRow], tuple[Any, ...]] = operator.attrgetter(*GatewayRow.__slots__)
_latency_tuple: Callable[[LatencyRow], tuple[Any, ...]] = operator.attrgetter(*LatencyRow.__slots__)
