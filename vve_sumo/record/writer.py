"""Writes the record of a drive into one folder while the drive goes on, and hashes it.

Knows rows and what a record's parts are; neither SUMO nor the wall clock. Parts are written in batches of a few ticks,
so a killed process leaves everything but the last batch readable. A live drive's record has two more tables; the record
of a drive that is not kept has no files.
"""

from __future__ import annotations

import contextlib
import json
import operator
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vve_sumo.bus import candump_lines
from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import hash_parts
from vve_sumo.record.layout import (
    CHUNK_HEAD,
    CLOSED_ENDING,
    COMMANDED,
    LIVE_SCHEMAS,
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
from vve_sumo.record.parts import HashedTable, RawFile, RawPart, TableFile, TablePart
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

#: ticks between two writes; 10 ticks of 20 ms are 0.2 s, the most that a killed process may lose
TICKS_PER_BATCH: Final = 10

#: the same for a record that is not kept: nothing can be lost, and longer batches are faster
UNKEPT_TICKS_PER_BATCH: Final = 250

#: tables of a record that is not kept whose rows are kept in memory: the summary's metrics are computed from them
SUMMARISED = frozenset({"ticks", "actors", COMMANDED})


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
        self._parts: dict[str, RawPart | TablePart] = {**self._raw, **self._tables}
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

    def _optional(self, name: str) -> TablePart | None:
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

    def _bytes(self, _name: str) -> RawPart:
        return RawPart()

    def _table(self, name: str, schema: pa.Schema) -> TablePart:
        return TablePart(schema) if name in SUMMARISED else HashedTable(schema)


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

    def _bytes(self, name: str) -> RawPart:
        return RawFile(self._own(name))

    def _table(self, name: str, schema: pa.Schema) -> TablePart:
        self._own(f"{name}{CLOSED_ENDING}")  # which it becomes
        return TableFile(self._own(f"{name}{OPEN_ENDING}"), schema)


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

    def _optional(self, name: str) -> TablePart | None:
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
