"""Writes the record of a drive into one folder while the drive goes on, and hashes it.

Knows rows and bytes; neither SUMO nor the wall clock. Tables grow as Arrow streams in batches of a few ticks, so a
killed process leaves everything but the last batch readable. At the end of the drive they become Parquet files. A live
drive's record has two more tables; the record of a drive that is not kept has no files.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vve_sumo.bus import candump_lines
from vve_sumo.coded_texts import CodedTexts, joined
from vve_sumo.errors import ConfigError
from vve_sumo.record.arrow_arrays import coded_array, number_array, string_array
from vve_sumo.record.hashes import ColumnHashes, hash_parts
from vve_sumo.record.layout import (
    CHUNK_HEAD,
    CLOSED_ENDING,
    COMMANDED,
    LIVE_SCHEMAS,
    NUMPY_KINDS,
    OPEN_ENDING,
    OPTIONAL_SCHEMAS,
    PEOPLE,
    PEOPLE_REPORTS,
    RAW_PARTS,
    SCHEMAS,
    SIGNAL_PLANS,
    STATION_DATAGRAMS,
    STATIONS,
    UNHASHED,
    sensor_schemas,
    sensor_table,
)
from vve_sumo.record.rows import (
    GatewayRow,
    LatencyRow,
    PersonReportRow,
    PersonRow,
    SignalRow,
    StationDatagramRow,
    StationRow,
    TickRow,
)
from vve_sumo.record.summary import write_summary
from vve_sumo.sensors.port import Column
from vve_sumo.values import Actors, CommandedPath, Frame

#: Returns a text's bytes; most texts of a record are names and codes that come at every tick.
_encoded = lru_cache(maxsize=4096)(str.encode)

#: ticks between two writes; 10 ticks of 20 ms are 0.2 s, the most that a killed process may lose
TICKS_PER_BATCH: Final = 10

#: the same for a record that is not kept: nothing can be lost, and longer batches are faster
UNKEPT_TICKS_PER_BATCH: Final = 250

#: tables of a record that is not kept whose rows are kept in memory: the summary's metrics are computed from them
SUMMARISED = frozenset({"ticks", "actors", COMMANDED})


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


class _Bytes:
    """Growing bytes of a raw part: buffered, then hashed and dropped."""

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
        """Drop the buffered bytes."""
        self._waiting.clear()

    def abandon(self) -> None:
        """Close the file, if there is one, as it is."""

    def close(self) -> None:
        """Finish the file, if there is one."""

    def _keep(self, data: bytes) -> None:
        """Store hashed bytes; here nothing is stored."""


class _BytesFile(_Bytes):
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


class _Table:
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


class _HashedTable(_Table):
    """A growing table of which only the hash remains."""

    def _keep(self, hashed: Sequence[_Hashed]) -> None:
        """Store nothing."""

    def close(self) -> None:
        """Return no table."""


class _TableFile(_Table):
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


def scenario_bytes(resolved: dict[str, Any]) -> bytes:
    """Return the content of a record's scenario.json."""
    return (json.dumps(resolved, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()


class MemoryRecorder:
    """Records one drive in memory: hashes, and the tables in SUMMARISED.

    The hash covers the resolved scenario with its versions, the raw inputs with their drive times and every
    recorded column; never a wall-clock time and never the bytes of a table's file.
    """

    schemas: ClassVar[Mapping[str, pa.Schema]] = SCHEMAS  #: of all tables except the sensors'
    ticks_per_batch: ClassVar[int] = UNKEPT_TICKS_PER_BATCH

    def __init__(self, resolved: dict[str, Any], epoch: float) -> None:
        """Begin with the resolved scenario, which declares the tables of its sensors.

        `epoch` is the GNSS second of drive time 0.
        """
        self._epoch = epoch
        self.tables: dict[str, pa.Table] = {}  #: by name, filled by `close`; those of a record in memory are SUMMARISED
        self._raw = {name: self._bytes(name) for name in RAW_PARTS}
        self._raw["scenario.json"].append(scenario_bytes(resolved))
        self._raw["scenario.json"].flush()
        self._pose, self._can = self._raw["pose.bin"], self._raw["can.log"]
        schemas = {**self.schemas, **sensor_schemas(resolved)}
        self._tables = {name: self._table(name, schema) for name, schema in schemas.items()}
        self._parts: dict[str, _Bytes | _Table] = {**self._raw, **self._tables}
        self._ticks = 0

    def received_pose(self, time: float, data: bytes) -> None:
        """Record pose bytes unaltered, with their receive time [s]."""
        self._pose.append(CHUNK_HEAD.pack(time, len(data)) + data)

    def saw_frames(self, time: float, channel: str, frames: Iterable[Frame]) -> None:
        """Record CAN frames received or sent at one drive time [s], as candump lines with GNSS time."""
        self._can.append(candump_lines(self._epoch + time, channel, frames).encode())

    def sensed(
        self, tick: int, sensor: str, measured: float, columns: tuple[Column, ...], rows: int | None = None
    ) -> None:
        """Record a sensor's reading at a tick: drive time of the measurement [s], columns of the sensor's table.

        With `rows`, so many rows, of which `columns` are the first; the others follow by `more_sensed`.
        """
        here = len(columns[0])
        self._tables["readings"].append((tick, sensor, measured, here if rows is None else rows))
        self.more_sensed(tick, sensor, columns)

    def more_sensed(self, tick: int, sensor: str, columns: tuple[Column, ...]) -> None:
        """Record further rows of a sensor's reading."""
        if rows := len(columns[0]):
            self._tables[sensor_table(sensor)].extend(tick, rows, columns)

    def snapshot(self, tick: int, actors: Actors) -> None:
        """Record the actors that the sensors see at tick `tick`."""
        if not actors.ids:
            return
        columns = (
            actors.ids,
            actors.x,
            actors.y,
            actors.heading,
            actors.speed,
            actors.length,
            actors.width,
            actors.radar_cross_section,
            actors.lateral_speed,
            actors.height,
            actors.kind,
        )
        self._tables["actors"].extend(tick, len(actors.ids), columns)

    def commanded(self, tick: int, path: CommandedPath) -> None:
        """Record the path that the command of tick `tick` carries."""
        columns = (np.array(path.x), np.array(path.y), np.array(path.speed))
        if (table := self._optional(COMMANDED)) is not None:
            table.extend(tick, len(path.x), columns)

    def person_reported(self, row: PersonReportRow) -> None:
        """Record what came from a person."""
        if (table := self._optional(PEOPLE_REPORTS)) is not None:
            table.append(_report_tuple(row))

    def person_placed(self, row: PersonRow) -> None:
        """Record a person at one step of the virtual road."""
        if (table := self._optional(PEOPLE)) is not None:
            table.append(_person_tuple(row))

    def station_received(self, row: StationDatagramRow) -> None:
        """Record a datagram of the real on-board unit."""
        if (table := self._optional(STATION_DATAGRAMS)) is not None:
            table.append(_datagram_tuple(row))

    def station_placed(self, row: StationRow) -> None:
        """Record a real station's body at one step of the virtual road."""
        if (table := self._optional(STATIONS)) is not None:
            table.append(_station_tuple(row))

    def signal_changed(self, row: SignalRow) -> None:
        """Record what a sensor was handed of a traffic signal that changed."""
        if (table := self._optional(SIGNAL_PLANS)) is not None:
            table.append(_signal_tuple(row))

    def _optional(self, name: str) -> _Table | None:
        """Return one of the tables that not every drive has, which is opened with its first row.

        None where it cannot be opened.
        """
        if name not in self._tables:
            self._tables[name] = self._table(name, OPTIONAL_SCHEMAS[name])
            first = {one: self._tables[one] for one in OPTIONAL_SCHEMAS if one in self._tables}
            self._parts = {**first, **{one: part for one, part in self._parts.items() if one not in first}}
        return self._tables[name]

    def ticked(self, row: TickRow) -> None:
        """Record the row of a tick; every `ticks_per_batch`-th tick flushes."""
        self._tables["ticks"].append(_as_tuple(row))
        self._ticks += 1
        if self._ticks % self.ticks_per_batch == 0:
            self.flush()

    def attach(self, name: str, text: str) -> None:
        """Record a text that belongs to the drive but not to its hash; without a folder it is dropped."""

    def flush(self) -> None:
        """Hash and store everything that is buffered."""
        for part in self._parts.values():
            part.flush()

    def close(self) -> dict[str, str]:
        """Finish all parts and return the hash of each (hexadecimal SHA-256)."""
        self.flush()
        for raw in self._raw.values():
            raw.close()
        finished = {name: table.close() for name, table in self._tables.items()}
        self.tables = {name: table for name, table in finished.items() if table is not None}
        tables = {name: table.hashes.hexdigest() for name, table in self._tables.items() if name not in UNHASHED}
        return {name: raw.hash.hexdigest() for name, raw in self._raw.items()} | tables

    def discard(self) -> None:
        """Close all files without finishing them: the drive leaves no record."""
        for part in self._parts.values():
            part.abandon()

    def _bytes(self, _name: str) -> _Bytes:
        return _Bytes()

    def _table(self, name: str, schema: pa.Schema) -> _Table:
        return _Table(schema) if name in SUMMARISED else _HashedTable(schema)


class RecordWriter(MemoryRecorder):
    """Records one drive in a folder; every TICKS_PER_BATCH-th tick is written to disk."""

    ticks_per_batch = TICKS_PER_BATCH

    def __init__(self, folder: Path, resolved: dict[str, Any], epoch: float) -> None:
        """Open the record in `folder`, which `require_empty_folder` has checked; no file that exists is overwritten."""
        self._made = [place for place in (folder, *folder.parents) if not place.exists()]
        self._files: list[Path] = []
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        super().__init__(resolved, epoch)

    def attach(self, name: str, text: str) -> None:
        """Write a text to a file of that name."""
        self._own(name).write_text(text, encoding="utf-8")

    def attach_table(self, name: str, table: pa.Table) -> None:
        """Write a table that belongs to the drive but not to its hash."""
        pq.write_table(table, self._own(f"{name}{CLOSED_ENDING}"), compression="zstd")

    def discard(self) -> None:
        """Delete the files that the record made, and the folders, except those that hold something else."""
        super().discard()
        for file in self._files:
            file.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # not empty: somebody else has put something there
            for place in self._made:
                place.rmdir()

    def summarise(self, summary: dict[str, Any]) -> None:
        """Write `summary.json`; NaN and infinity become null."""
        write_summary(self.folder, summary)

    def _own(self, name: str) -> Path:
        """Return the place of a file; it counts as made by this record unless something lies there already."""
        file = self.folder / name
        if not file.exists():
            self._files.append(file)
        return file

    def _bytes(self, name: str) -> _Bytes:
        return _BytesFile(self._own(name))

    def _table(self, name: str, schema: pa.Schema) -> _Table:
        self._own(f"{name}{CLOSED_ENDING}")  # which it becomes
        return _TableFile(self._own(f"{name}{OPEN_ENDING}"), schema)


class LiveRecord(RecordWriter):
    """Records a live drive, with two more tables; a part that cannot be written does not stop the others.

    The folder may already hold logs of the drive's processes.
    """

    schemas = SCHEMAS | LIVE_SCHEMAS

    def __init__(self, folder: Path, resolved: dict[str, Any], epoch: float) -> None:
        """Open the record in `folder`, which `require_empty_folder` has checked."""
        super().__init__(folder, resolved, epoch)
        self.broken: set[str] = set()  #: parts that can no longer be written; their earlier content stays

    def ticked(self, row: TickRow) -> None:
        """Record the row of a tick without flushing; the owner of the record decides when to flush."""
        self._tables["ticks"].append(_as_tuple(row))

    def _optional(self, name: str) -> _Table | None:
        """Return one of the tables that not every drive has; where it cannot be opened, note it in `broken`."""
        if name in self.broken and name not in self._tables:
            return None
        try:
            return super()._optional(name)
        except OSError:
            self.broken.add(name)
            return None

    def attach(self, name: str, text: str) -> None:
        """Write a text to a file of that name; where that fails, note the name in `broken`."""
        try:
            super().attach(name, text)
        except OSError:
            self.broken.add(name)

    def stepped(self, row: GatewayRow) -> None:
        """Record the row of a gateway step."""
        self._tables["gateway"].append(_gateway_tuple(row))

    def timed(self, row: LatencyRow) -> None:
        """Record the latencies of one tick."""
        self._tables["latency"].append(_latency_tuple(row))

    def flush(self) -> None:
        """Hash everything that is buffered and write it to disk; a part that cannot be written becomes `broken`."""
        for name, part in self._parts.items():
            if name in self.broken:
                part.forget()
                continue
            try:
                part.flush()
            except OSError:
                self.broken.add(name)

    def close(self) -> dict[str, str]:
        """Finish all parts that are not broken, and return the hash of each part, broken ones as far as written."""
        self.flush()
        for name, part in self._parts.items():
            try:
                part.abandon() if name in self.broken else part.close()
            except OSError:
                self.broken.add(name)
        return hash_parts(self.folder)


class SimulatedEgoRecord(LiveRecord):
    """Records a simulated ego of a live drive, with the tables of a lockstep drive."""

    schemas = SCHEMAS


def require_empty_folder(folder: Path) -> None:
    """Raise ConfigError unless a record can be opened in `folder`, which must be absent or an empty folder."""
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder} is a file, expected a folder for the record")
    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty, expected an empty or absent folder for the record")


#: Returns the fields of a row, in their order, as a tuple.
_as_tuple: Callable[[TickRow], tuple[Any, ...]] = operator.attrgetter(*TickRow.__slots__)
_gateway_tuple: Callable[[GatewayRow], tuple[Any, ...]] = operator.attrgetter(*GatewayRow.__slots__)
_report_tuple: Callable[[PersonReportRow], tuple[Any, ...]] = operator.attrgetter(*PersonReportRow.__slots__)
_person_tuple: Callable[[PersonRow], tuple[Any, ...]] = operator.attrgetter(*PersonRow.__slots__)
_latency_tuple: Callable[[LatencyRow], tuple[Any, ...]] = operator.attrgetter(*LatencyRow.__slots__)
_datagram_tuple: Callable[[StationDatagramRow], tuple[Any, ...]] = operator.attrgetter(*StationDatagramRow.__slots__)
_signal_tuple: Callable[[SignalRow], tuple[Any, ...]] = operator.attrgetter(*SignalRow.__slots__)
_station_tuple: Callable[[StationRow], tuple[Any, ...]] = operator.attrgetter(*StationRow.__slots__)
