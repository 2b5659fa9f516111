"""Sends a live process's data to the recorder, what came since the last datagram in one.

Never raises, and never waits but in `finish`: a recorder that is slow, gone or out of disk is a reason code, no delay.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable
from typing import Any, Final

from msgspec import Struct, field

from vve_sumo.live.channel import Channel
from vve_sumo.messages import MessageCodec, MessageKind
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
from vve_sumo.sensors.port import Column
from vve_sumo.values import Actors, CommandedPath, Frame

#: datagrams kept here while the recorder's queue is full; with one every 20 ms, 2 s beyond that queue
MAX_BACKLOG: Final = 100
#: rows of a reading in one datagram: of a lidar's, with its six columns, about 100 kB
MAX_ROWS: Final = 4000
#: between two attempts to send the last datagrams [s]
RETRY_INTERVAL: Final = 0.01


class RecordBatch(Struct, array_like=True, forbid_unknown_fields=True):
    """What a process has for the record: for each method of the record that it calls, the arguments of the calls."""

    received_pose: list[tuple[float, bytes]] = field(default_factory=list)
    saw_frames: list[tuple[float, str, list[Frame]]] = field(default_factory=list)
    sensed: list[tuple[int, str, float, tuple[Any, ...], int]] = field(default_factory=list)
    more_sensed: list[tuple[int, str, tuple[Any, ...]]] = field(default_factory=list)
    snapshot: list[tuple[int, Actors]] = field(default_factory=list)
    commanded: list[tuple[int, CommandedPath]] = field(default_factory=list)
    person_reported: list[tuple[PersonReportRow]] = field(default_factory=list)
    person_placed: list[tuple[PersonRow]] = field(default_factory=list)
    station_received: list[tuple[StationDatagramRow]] = field(default_factory=list)
    station_placed: list[tuple[StationRow]] = field(default_factory=list)
    signal_changed: list[tuple[SignalRow]] = field(default_factory=list)
    ticked: list[tuple[TickRow]] = field(default_factory=list)
    stepped: list[tuple[GatewayRow]] = field(default_factory=list)
    timed: list[tuple[LatencyRow]] = field(default_factory=list)
    ended: dict[str, Any] | None = None  #: how the drive ended, for the summary


RECORD: Final = MessageCodec[RecordBatch](MessageKind.RECORD, RecordBatch)


class RecorderClient:
    """The record as seen by a process that must not wait for it.

    `failure` is a reason code once the record can't be complete any more: record_full if the recorder doesn't keep up,
    record_lost if it is gone, or the code that the recorder sent (record_failed: it cannot write). Empty before.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._batch = RecordBatch()
        self._full: list[RecordBatch] = []  # before it, each of which fills a datagram
        self._empty = True
        self._backlog: deque[bytes] = deque()
        self.failure = ""

    def received_pose(self, time: float, data: bytes) -> None:
        """Keep pose bytes as received, with their receive time."""
        self._batch.received_pose.append((time, data))
        self._empty = False

    def saw_frames(self, time: float, channel: str, frames: Iterable[Frame]) -> None:
        """Keep CAN frames received or sent at one drive time."""
        self._batch.saw_frames.append((time, channel, list(frames)))
        self._empty = False

    def sensed(self, tick: int, sensor: str, measured: float, columns: tuple[Column, ...]) -> None:
        """Keep a sensor's output at a tick: drive time at which it was measured [s], columns of its table.

        A reading of more than MAX_ROWS is sent in several datagrams.
        """
        rows = len(columns[0])
        first = columns if rows <= MAX_ROWS else tuple(column[:MAX_ROWS] for column in columns)
        self._batch.sensed.append((tick, sensor, measured, first, rows))
        for begin in range(MAX_ROWS, rows, MAX_ROWS):
            self._full.append(self._batch)
            part = tuple(column[begin : begin + MAX_ROWS] for column in columns)
            self._batch = RecordBatch(more_sensed=[(tick, sensor, part)])
        self._empty = False

    def snapshot(self, tick: int, actors: Actors) -> None:
        """Keep the actors that tick `tick` uses."""
        self._batch.snapshot.append((tick, actors))
        self._empty = False

    def commanded(self, tick: int, path: CommandedPath) -> None:
        """Keep the path that the command of a tick carries."""
        self._batch.commanded.append((tick, path))
        self._empty = False

    def person_reported(self, row: PersonReportRow) -> None:
        """Keep what came from a person."""
        self._batch.person_reported.append((row,))
        self._empty = False

    def person_placed(self, row: PersonRow) -> None:
        """Keep a person at one step of the virtual road."""
        self._batch.person_placed.append((row,))
        self._empty = False

    def station_received(self, row: StationDatagramRow) -> None:
        """Keep a datagram of the real on-board unit."""
        self._batch.station_received.append((row,))
        self._empty = False

    def station_placed(self, row: StationRow) -> None:
        """Keep a real station's body at one step of the virtual road."""
        self._batch.station_placed.append((row,))
        self._empty = False

    def signal_changed(self, row: SignalRow) -> None:
        """Keep what a sensor was handed of a traffic signal that changed."""
        self._batch.signal_changed.append((row,))
        self._empty = False

    def ticked(self, row: TickRow) -> None:
        """Keep the row of a tick."""
        self._batch.ticked.append((row,))
        self._empty = False

    def stepped(self, row: GatewayRow) -> None:
        """Keep the row of a step of the gateway."""
        self._batch.stepped.append((row,))
        self._empty = False

    def timed(self, row: LatencyRow) -> None:
        """Keep the latencies of one tick."""
        self._batch.timed.append((row,))
        self._empty = False

    def ended(self, how: dict[str, Any]) -> None:
        """Keep how the drive ended, for the summary."""
        self._batch.ended = how
        self._empty = False

    def flush(self) -> None:
        """Send what came since the last flush; to be called once a tick or step, after everything urgent."""
        if not self._empty:
            batches, self._full = [*self._full, self._batch], []
            self._batch, self._empty = RecordBatch(), True
            if len(self._backlog) < MAX_BACKLOG:
                for batch in batches:
                    self._keep(batch)
            else:
                self._fail("record_full")
        while self._backlog and self._channel.send(self._backlog[0]):
            self._backlog.popleft()
        for word in self._channel.receive():
            self._fail(word.decode("ascii", "replace"))
        if self._channel.closed:
            self._fail("record_lost")

    def _keep(self, batch: RecordBatch) -> None:
        try:
            self._backlog.append(RECORD.encode(batch))
        except Exception:  # a lab's own sensor or metric gave what no message holds: the drive stops
            self._fail("record_failed")

    def finish(self, patience: float) -> None:
        """Send all that is left, waiting at most `patience` [s]; to be called only when nothing moves any more."""
        deadline = time.monotonic() + patience
        self.flush()
        while self._backlog and not self._channel.closed and time.monotonic() < deadline:
            time.sleep(RETRY_INTERVAL)
            self.flush()

    def _fail(self, reason: str) -> None:
        self.failure = self.failure or reason
