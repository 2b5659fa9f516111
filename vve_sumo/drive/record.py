"""The record of a drive: one folder, appended as the drive goes, hashed over what was simulated.

Knows rows and bytes; neither SUMO nor the wall clock. Tables grow as Arrow streams in batches of a few ticks, so a
killed process leaves everything but the last batch readable; a finished drive holds Parquet files instead. A live
drive's record is the same with two tables more.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import operator
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vve_sumo.bus import candump_lines
from vve_sumo.errors import ConfigError
from vve_sumo.values import Actors, Detections, Frame, GatewayRow, LatencyRow, TickRow

#: ticks between two writes; 10 ticks of 20 ms are 0.2 s, the most that a kill may lose
TICKS_PER_BATCH = 10

#: numpy's kind of each numeric column; by way of numpy a short column becomes Arrow's five times faster
_NUMPY = {pa.int64(): np.int64, pa.int8(): np.int8, pa.float64(): np.float64, pa.bool_(): np.bool_}
_ARROW: dict[str, pa.DataType] = {
    "int": pa.int64(), "float": pa.float64(), "bool": pa.bool_(), "str": pa.string(), "bytes": pa.binary()
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

SCHEMAS: dict[str, pa.Schema] = {
    "ticks": _row_schema(TickRow),
    "detections": _schema(
        [
            _TICK,
            ("range_m", pa.float64(), "from the middle of the front bumper to the seen point"),
            ("azimuth_rad", pa.float64(), "direction of the seen point from the front bumper, left positive"),
            ("range_rate_mps", pa.float64(), "radial velocity at the antenna, opening positive"),
            ("mode", pa.int8(), "0 long range, 1 medium range"),
            ("actor", pa.string(), "what was seen: truth that no controller is told"),
        ]
    ),
    "actors": _schema(
        [
            ("tick", pa.int64(), "number of the tick that looks at this snapshot"),
            ("actor", pa.string(), "name in SUMO"),
            ("x_m", pa.float64(), "centre of the box, map"),
            ("y_m", pa.float64(), "centre of the box, map"),
            ("heading_rad", pa.float64(), "counter-clockwise from the map's +x"),
            ("speed_mps", pa.float64(), "along the heading"),
            ("length_m", pa.float64(), "of the box, along the heading"),
            ("width_m", pa.float64(), "of the box"),
            ("radar_cross_section_m2", pa.float64(), "at 77 GHz, by the kind of actor: an assumption"),
        ]
    ),
}

#: tables that only a live drive has
LIVE_SCHEMAS: dict[str, pa.Schema] = {"gateway": _row_schema(GatewayRow), "latency": _row_schema(LatencyRow)}

#: tables that the hash leaves out: they tell how long things took, and no two drives take equally long
UNHASHED = frozenset({"latency"})

#: parts of a record that are hashed as they stand in their files
RAW_PARTS = ("scenario.json", "pose.bin", "can.log")

#: what an open table is called in the folder, and a finished one
OPEN_ENDING, CLOSED_ENDING = ".arrows", ".parquet"

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

    def add_texts(self, column: int, texts: Iterable[str]) -> None:
        """Take in further texts of a column; each with its length, so that no two columns of texts look the same."""
        self.add_bytes(column, [text.encode() for text in texts])

    def add_bytes(self, column: int, pieces: Iterable[bytes]) -> None:
        """Take in further byte strings of a column, each with its length."""
        self._hashes[column].update(b"".join(b"%d:%b" % (len(piece), piece) for piece in pieces))

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
        if column.type == pa.binary():
            hashes.add_bytes(number, column.to_pylist())
        elif numeric is None:
            hashes.add_texts(number, column.to_pylist())
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
    """Return the hash of the bytes of every finished table's file.

    A byte of such a file may say nothing of what the table holds; so the hash of a record, which is to be the same
    whoever writes the files, does not see it. This one does.
    """
    files = (folder / f"{name}{CLOSED_ENDING}" for name in SCHEMAS | LIVE_SCHEMAS)
    return {file.name: hash_file(file) for file in files if file.is_file()}


def whole(parts: dict[str, str]) -> str:
    """Return the hash of a record out of the hashes of its parts."""
    return hashlib.sha256("".join(f"{name} {parts[name]}\n" for name in sorted(parts)).encode()).hexdigest()


class _Raw:
    """One growing file of bytes, kept as they are: they wait, then go to the hash and to the file."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.hash = hashlib.sha256()
        self._sink = file.open("xb", buffering=0)
        self._waiting: list[bytes] = []

    def append(self, data: bytes) -> None:
        self._waiting.append(data)

    def flush(self) -> None:
        rest = memoryview(b"".join(self._waiting))
        self._waiting.clear()
        begun = self._sink.tell()
        self.hash.update(rest)
        try:
            while rest:
                rest = rest[self._sink.write(rest) :]
        except OSError:
            # Half a line or half a chunk is no evidence.
            self._sink.truncate(begun)
            raise

    def forget(self) -> None:
        """Let go of what waits."""
        self._waiting.clear()

    def abandon(self) -> None:
        """Let go of the file."""
        self._sink.close()

    def close(self) -> None:
        self._sink.close()


class _Table:
    """One growing table: rows wait in columns, a batch at a time goes to the hash and to the file."""

    def __init__(self, file: Path, schema: pa.Schema) -> None:
        self.file = file
        self._schema = schema
        self._kinds = [(kind, _NUMPY.get(kind)) for kind in schema.types]
        self.hashes = _ColumnHashes(schema)
        self._sink = file.open("xb")
        self._stream = pa.ipc.new_stream(self._sink, schema)
        self._waiting: list[tuple[Any, ...]] = []

    def append(self, row: tuple[Any, ...]) -> None:
        self._waiting.append(row)

    def extend(self, rows: Iterable[tuple[Any, ...]]) -> None:
        self._waiting.extend(rows)

    def flush(self) -> None:
        if not self._waiting:
            return
        arrays = []
        for number, (column, (kind, numeric)) in enumerate(
            zip(zip(*self._waiting, strict=True), self._kinds, strict=True)
        ):
            if kind == _ARROW["bytes"]:
                self.hashes.add_bytes(number, column)
                arrays.append(pa.array(column, kind))
            elif numeric is None:
                self.hashes.add_texts(number, column)
                arrays.append(pa.array(column, kind))
            else:
                numbers: NDArray[Any] = np.array(column, numeric)
                self.hashes.add_numbers(number, numbers)
                arrays.append(pa.array(numbers, kind))
        self._stream.write_batch(pa.RecordBatch.from_arrays(arrays, schema=self._schema))
        self._sink.flush()
        self._waiting.clear()

    def forget(self) -> None:
        """Let go of what waits."""
        self._waiting.clear()

    def abandon(self) -> None:
        """Let go of the file, unfinished."""
        self._sink.close()

    def close(self) -> None:
        """Turn the stream into a Parquet file and take the stream away; a kill in between leaves one of them whole."""
        self._stream.close()
        self._sink.close()
        with pa.ipc.open_stream(self.file) as stream:
            table = stream.read_all()
        half = self.file.with_suffix(".half")
        try:
            pq.write_table(table, half, compression="zstd")
        except OSError:
            half.unlink(missing_ok=True)
            raise
        half.replace(self.file.with_suffix(CLOSED_ENDING))
        self.file.unlink()


class Record:
    """The folder of one drive while it is being driven.

    The hash covers the resolved scenario with its versions, the raw inputs with their drive times and every
    recorded column; never a wall-clock time and never the bytes of a table's file.
    """

    schemas: ClassVar[Mapping[str, pa.Schema]] = SCHEMAS  #: of its tables

    def __init__(self, folder: Path, resolved: dict[str, Any], epoch: float) -> None:
        """Open the record in `folder`, which is `claim`ed; nothing that lies there already is written over."""
        self._made = [place for place in (folder, *folder.parents) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._epoch = epoch
        text = (json.dumps(resolved, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()
        self._raw = {name: _Raw(folder / name) for name in RAW_PARTS}
        self._raw["scenario.json"].append(text)
        self._raw["scenario.json"].flush()
        self._pose, self._can = self._raw["pose.bin"], self._raw["can.log"]
        self._tables = {name: _Table(folder / f"{name}{OPEN_ENDING}", self.schemas[name]) for name in self.schemas}
        self._parts: dict[str, _Raw | _Table] = {**self._raw, **self._tables}
        self._ticks = 0

    def received_pose(self, time: float, data: bytes) -> None:
        """Keep pose bytes as they came, with their receive time."""
        self._pose.append(_CHUNK_HEAD.pack(time, len(data)) + data)

    def saw_frames(self, time: float, channel: str, frames: Iterable[Frame]) -> None:
        """Keep CAN frames heard or sent at one time, in candump form; `time` is drive time, written as GNSS time."""
        self._can.append(candump_lines(self._epoch + time, channel, frames).encode())

    def scanned(self, tick: int, detections: Detections, seen: Sequence[str]) -> None:
        """Keep one radar scan; `seen` names the actor behind each detection."""
        columns = (detections.range, detections.azimuth, detections.range_rate, detections.mode)
        lists = [column.tolist() for column in columns]
        self._tables["detections"].extend(zip([tick] * len(seen), *lists, seen, strict=True))

    def snapshot(self, tick: int, actors: Actors) -> None:
        """Keep the actors that tick `tick` looks at."""
        columns = (
            actors.x,
            actors.y,
            actors.heading,
            actors.speed,
            actors.length,
            actors.width,
            actors.radar_cross_section,
        )
        lists = [column.tolist() for column in columns]
        self._tables["actors"].extend(zip([tick] * len(actors.ids), actors.ids, *lists, strict=True))

    def ticked(self, row: TickRow) -> None:
        """Keep the row of a tick; every TICKS_PER_BATCH-th brings everything kept so far to disk."""
        self._tables["ticks"].append(_as_tuple(row))
        self._ticks += 1
        if self._ticks % TICKS_PER_BATCH == 0:
            self.flush()

    def flush(self) -> None:
        """Bring everything kept so far to disk and into the hash."""
        for part in self._parts.values():
            part.flush()

    def close(self) -> dict[str, str]:
        """Finish the record's files and return the hash of each of its parts (hexadecimal SHA-256)."""
        self.flush()
        for part in self._parts.values():
            part.close()
        tables = {name: table.hashes.hexdigest() for name, table in self._tables.items() if name not in UNHASHED}
        return {name: raw.hash.hexdigest() for name, raw in self._raw.items()} | tables

    def discard(self) -> None:
        """Take away everything that the record made: its files, and the folders that were not there before."""
        for part in self._parts.values():
            part.abandon()
        for file in self.folder.iterdir():
            file.unlink()
        for place in self._made:
            place.rmdir()

    def summarise(self, summary: dict[str, Any]) -> None:
        """Write `summary.json`; not-a-number and infinity become null."""
        write_summary(self.folder, summary)


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

    def stepped(self, row: GatewayRow) -> None:
        """Keep the row of a step of the gateway."""
        self._tables["gateway"].append(_gateway_tuple(row))

    def timed(self, row: LatencyRow) -> None:
        """Keep a line of the latency ledger."""
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
    """Write a record's `summary.json`; not-a-number and infinity become null."""
    text = json.dumps(_finite(summary), indent=1, allow_nan=False)
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")


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
