"""The record of a drive: one folder, appended as the drive goes, hashed over what was simulated.

Knows rows and bytes; neither SUMO nor the wall clock. Tables grow as Arrow streams in batches of a few ticks, so a
killed process leaves everything but the last batch readable; a finished drive holds Parquet files instead.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import operator
import struct
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vve_sumo.bus import candump_lines
from vve_sumo.errors import ConfigError
from vve_sumo.values import Actors, Detections, Frame, TickRow

#: ticks between two writes; 10 ticks of 20 ms are 0.2 s, the most that a kill may lose
TICKS_PER_BATCH = 10

#: numpy's kind of each numeric column; by way of numpy a short column becomes Arrow's five times faster
_NUMPY = {pa.int64(): np.int64, pa.int8(): np.int8, pa.float64(): np.float64, pa.bool_(): np.bool_}
_ARROW: dict[str, pa.DataType] = {"int": pa.int64(), "float": pa.float64(), "bool": pa.bool_(), "str": pa.string()}


def _tick_schema() -> pa.Schema:
    return pa.schema(
        [
            pa.field(f.name, _ARROW[str(f.type)], metadata={"meaning": f.metadata["meaning"]})
            for f in dataclasses.fields(TickRow)
        ]
    )


def _schema(columns: Sequence[tuple[str, pa.DataType, str]]) -> pa.Schema:
    return pa.schema([pa.field(name, kind, metadata={"meaning": meaning}) for name, kind, meaning in columns])


_TICK = ("tick", pa.int64(), "number of the tick")

SCHEMAS: dict[str, pa.Schema] = {
    "ticks": _tick_schema(),
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

    Raises ConfigError where the folder holds neither form of it.
    """
    closed, still_open = folder / f"{name}{CLOSED_ENDING}", folder / f"{name}{OPEN_ENDING}"
    if closed.is_file():
        return pq.read_table(closed)
    if not still_open.is_file():
        raise ConfigError(f"{folder}: no {name}{CLOSED_ENDING} and no {name}{OPEN_ENDING}: not a drive's record")
    batches: list[pa.RecordBatch] = []
    try:
        with pa.ipc.open_stream(still_open) as stream:
            batches.extend(iter(stream.read_next_batch, None))
    except (StopIteration, pa.ArrowInvalid, OSError):
        pass
    return pa.Table.from_batches(batches, schema=SCHEMAS[name])


class _ColumnHashes:
    """The hash of a table, column by column, so that it doesn't matter in which portions the rows came."""

    def __init__(self, schema: pa.Schema) -> None:
        self._hashes = [hashlib.sha256(name.encode()) for name in schema.names]

    def add_texts(self, column: int, texts: Iterable[str]) -> None:
        """Take in further texts of a column; each with its length, so that no two columns of texts look the same."""
        coded = [text.encode() for text in texts]
        self._hashes[column].update(b"".join(b"%d:%b" % (len(text), text) for text in coded))

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
            hashes.add_texts(number, column.to_pylist())
        else:
            hashes.add_numbers(number, column.to_numpy().astype(numeric, copy=False))
    return hashes.hexdigest()


def hash_parts(folder: Path) -> dict[str, str]:
    """Return the hash of every part of a finished record, from its files (hexadecimal SHA-256).

    Raises ConfigError where a part is missing or unreadable.
    """
    parts = {}
    for name in RAW_PARTS:
        try:
            parts[name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        except OSError as error:
            raise ConfigError(f"{folder / name}: cannot be read: {error.strerror}") from None
    return parts | {name: hash_table(read_table(folder, name)) for name in SCHEMAS}


def whole(parts: dict[str, str]) -> str:
    """Return the hash of a record out of the hashes of its parts."""
    return hashlib.sha256("".join(f"{name} {parts[name]}\n" for name in sorted(parts)).encode()).hexdigest()


class _Table:
    """One growing table: rows wait in columns, a batch at a time goes to the hash and to the file."""

    def __init__(self, file: Path, schema: pa.Schema) -> None:
        self.file = file
        self._schema = schema
        self._kinds = [(kind, _NUMPY.get(kind)) for kind in schema.types]
        self.hashes = _ColumnHashes(schema)
        self._sink = file.open("wb")
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
            if numeric is None:
                self.hashes.add_texts(number, column)
                arrays.append(pa.array(column, kind))
            else:
                numbers: NDArray[Any] = np.array(column, numeric)
                self.hashes.add_numbers(number, numbers)
                arrays.append(pa.array(numbers, kind))
        self._stream.write_batch(pa.RecordBatch.from_arrays(arrays, schema=self._schema))
        self._sink.flush()
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
        pq.write_table(table, half, compression="zstd")
        half.replace(self.file.with_suffix(CLOSED_ENDING))
        self.file.unlink()


class Record:
    """The folder of one drive while it is being driven.

    The hash covers the resolved scenario with its versions, the raw inputs with their drive times and every
    recorded column; never a wall-clock time and never the bytes of a table's file.
    """

    def __init__(self, folder: Path, resolved: dict[str, Any], epoch: float) -> None:
        """Open the record in `folder`; raises ConfigError where that is not an empty or absent folder."""
        claim(folder)
        self._made = [place for place in (folder, *folder.parents) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._epoch = epoch
        text = (json.dumps(resolved, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()
        (folder / "scenario.json").write_bytes(text)
        self._raw_hashes = {name: hashlib.sha256() for name in RAW_PARTS}
        self._raw_hashes["scenario.json"].update(text)
        self._pose: IO[bytes] = (folder / "pose.bin").open("wb")
        self._can: IO[bytes] = (folder / "can.log").open("wb")
        self._pose_waiting: list[bytes] = []
        self._can_waiting: list[str] = []
        self._tables = {name: _Table(folder / f"{name}{OPEN_ENDING}", schema) for name, schema in SCHEMAS.items()}
        self._ticks = 0

    def received_pose(self, time: float, data: bytes) -> None:
        """Keep pose bytes as they came, with their receive time."""
        self._pose_waiting.append(_CHUNK_HEAD.pack(time, len(data)) + data)

    def saw_frames(self, time: float, channel: str, frames: Iterable[Frame]) -> None:
        """Keep CAN frames heard or sent at one time, in candump form; `time` is drive time, written as GNSS time."""
        self._can_waiting.append(candump_lines(self._epoch + time, channel, frames))

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
        pose, can = b"".join(self._pose_waiting), "".join(self._can_waiting).encode()
        for name, part, file in (("pose.bin", pose, self._pose), ("can.log", can, self._can)):
            self._raw_hashes[name].update(part)
            file.write(part)
            file.flush()
        self._pose_waiting.clear()
        self._can_waiting.clear()
        for table in self._tables.values():
            table.flush()

    def close(self) -> dict[str, str]:
        """Finish the record's files and return the hash of each of its parts (hexadecimal SHA-256)."""
        self.flush()
        self._pose.close()
        self._can.close()
        for table in self._tables.values():
            table.close()
        tables = {name: table.hashes.hexdigest() for name, table in self._tables.items()}
        return {name: raw.hexdigest() for name, raw in self._raw_hashes.items()} | tables

    def discard(self) -> None:
        """Take away everything that the record made: its files, and the folders that were not there before."""
        self._pose.close()
        self._can.close()
        for table in self._tables.values():
            table.abandon()
        for file in self.folder.iterdir():
            file.unlink()
        for place in self._made:
            place.rmdir()

    def summarise(self, summary: dict[str, Any]) -> None:
        """Write `summary.json`; not-a-number and infinity become null."""
        text = json.dumps(_finite(summary), indent=1, allow_nan=False)
        (self.folder / "summary.json").write_text(text + "\n", encoding="utf-8")


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
