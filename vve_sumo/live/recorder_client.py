"""What a live process says to the recorder: the record's verbs, gathered and sent as one datagram.

It never waits and never raises: a recorder that is slow, gone or out of disk is a reason code, not a delay.
"""

from __future__ import annotations

import pickle
import time
from collections import deque
from collections.abc import Iterable
from typing import Any, Final

from vve_sumo.live.channel import Channel
from vve_sumo.sensors.port import Column
from vve_sumo.values import Actors, Frame, GatewayRow, LatencyRow, TickRow

#: datagrams kept here while the recorder's queue is full; with one in 20 ms, the recorder may be 2 s behind its queue
MAX_BACKLOG: Final = 100
#: between two tries of the last words [s]
RETRY_INTERVAL: Final = 0.01


class RecorderClient:
    """The record as seen by a process that must not wait for it.

    `failure` is a reason code once the record can't be whole any more: record_full where the recorder doesn't keep up,
    record_lost where it is gone, or what the recorder itself says (record_failed: it cannot write). Empty before.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._calls: list[tuple[str, tuple[Any, ...]]] = []
        self._backlog: deque[bytes] = deque()
        self.failure = ""

    def received_pose(self, time: float, data: bytes) -> None:
        """Keep pose bytes as they came, with their receive time."""
        self._calls.append(("received_pose", (time, data)))

    def saw_frames(self, time: float, channel: str, frames: Iterable[Frame]) -> None:
        """Keep CAN frames heard or sent at one drive time."""
        self._calls.append(("saw_frames", (time, channel, [tuple(frame) for frame in frames])))

    def sensed(self, tick: int, sensor: str, measured: float, columns: tuple[Column, ...]) -> None:
        """Keep what came out of a sensor at a tick: drive time at which it was measured [s], columns of its table."""
        self._calls.append(("sensed", (tick, sensor, measured, columns)))

    def snapshot(self, tick: int, actors: Actors) -> None:
        """Keep the actors that tick `tick` looks at."""
        self._calls.append(("snapshot", (tick, actors)))

    def ticked(self, row: TickRow) -> None:
        """Keep the row of a tick."""
        self._calls.append(("ticked", (row,)))

    def stepped(self, row: GatewayRow) -> None:
        """Keep the row of a step of the gateway."""
        self._calls.append(("stepped", (row,)))

    def timed(self, row: LatencyRow) -> None:
        """Keep the latencies of one tick."""
        self._calls.append(("timed", (row,)))

    def ended(self, how: dict[str, Any]) -> None:
        """Keep how the drive ended, for the summary."""
        self._calls.append(("ended", (how,)))

    def flush(self) -> None:
        """Send what was gathered since the last time; once a tick or step, after everything that is urgent."""
        if self._calls:
            if len(self._backlog) < MAX_BACKLOG:
                self._backlog.append(pickle.dumps(self._calls, pickle.HIGHEST_PROTOCOL))
            else:
                self._fail("record_full")
            self._calls = []
        while self._backlog and self._channel.send(self._backlog[0]):
            self._backlog.popleft()
        for word in self._channel.receive():
            self._fail(word.decode("ascii", "replace"))
        if self._channel.closed:
            self._fail("record_lost")

    def finish(self, patience: float) -> None:
        """Send all that is left; waits at most `patience` [s], so only when nothing moves any more."""
        deadline = time.monotonic() + patience
        self.flush()
        while self._backlog and not self._channel.closed and time.monotonic() < deadline:
            time.sleep(RETRY_INTERVAL)
            self.flush()

    def _fail(self, reason: str) -> None:
        self.failure = self.failure or reason
