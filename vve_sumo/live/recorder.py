"""Runs the recorder's process: writes the record from the messages of drive and gateway.

It outlives both, and neither waits for it. It reports a failure to write once, and goes on with the parts that it can
write.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from vve_sumo.drive.several_egos import BESIDE_LIVE
from vve_sumo.live import signals
from vve_sumo.live.channel import Channel
from vve_sumo.live.priority import OOM_RECORDER, lower_priority, set_oom_score
from vve_sumo.live.recorder_client import RECORD, RecordBatch
from vve_sumo.live.spawn import receive_config
from vve_sumo.live.summary import summarise, summarise_simulated
from vve_sumo.messages import MalformedMessage
from vve_sumo.record.layout import PROVENANCE
from vve_sumo.record.signals import files_of
from vve_sumo.record.summary import write_summary
from vve_sumo.record.writer import LiveRecord, SimulatedEgoRecord
from vve_sumo.values import SignalChange

#: between two writes [s]; a kill loses at most the last 0.2 s, messages on their way included
FLUSH_INTERVAL: Final = 0.1

#: methods of the record that a client's batch has arguments for
METHODS: Final = tuple(name for name in RecordBatch.__struct_fields__ if name != "ended")

#: makes a summary from the record's folder and the drive's message of how it ended (None if there was none)
Summarise = Callable[[Path, dict[str, Any] | None], dict[str, Any]]


class Recorder:
    """Writes what comes through `channels` into `record`, until all their other ends are gone."""

    def __init__(self, record: LiveRecord, channels: list[Channel]) -> None:
        self._record = record
        self._channels = {channel.fileno(): channel for channel in channels}
        self._failure_reported = False
        self.ended: dict[str, Any] | None = None  #: the drive's message of how it ended

    def run(self) -> None:
        """Write until all channels are closed."""
        poll = select.poll()
        for descriptor in self._channels:
            poll.register(descriptor, select.POLLIN)
        due = time.monotonic() + FLUSH_INTERVAL
        while self._channels:
            for descriptor, _event in poll.poll(max(1000.0 * (due - time.monotonic()), 0.0)):
                self._take(self._channels[descriptor])
                if self._channels[descriptor].closed:
                    poll.unregister(descriptor)
                    del self._channels[descriptor]
            if time.monotonic() >= due:
                self._flush()
                due = time.monotonic() + FLUSH_INTERVAL

    def _take(self, channel: Channel) -> None:
        for datagram in channel.receive():
            batch = RECORD.decode(datagram)
            if isinstance(batch, MalformedMessage):
                self._record.broken.add("messages")
                continue
            for method in METHODS:
                for arguments in getattr(batch, method):
                    getattr(self._record, method)(*arguments)
            self.ended = batch.ended or self.ended

    def _flush(self) -> None:
        self._record.flush()
        if self._record.broken and not self._failure_reported:
            self._failure_reported = True
            for channel in self._channels.values():
                channel.send(b"record_failed")


def finish(record: LiveRecord, ended: dict[str, Any] | None, summarise: Summarise) -> None:
    """Finish a record's files and write its summary."""
    record.close()
    if ended is not None:
        for name, text in files_of(SignalChange(*change) for change in ended.pop("signals", ())).items():
            record.attach(name, text)
    write_summary(record.folder, summarise(record.folder, ended) | {"record_broken": sorted(record.broken)})


def main() -> None:
    """Record one drive."""
    signals.ignore()
    set_oom_score(OOM_RECORDER)
    lower_priority()
    config, channels = receive_config()
    simulated = config["resolved"].get(BESIDE_LIVE)
    record = (SimulatedEgoRecord if simulated else LiveRecord)(
        Path(config["folder"]), config["resolved"], config["epoch"]
    )
    record.attach(PROVENANCE, config["provenance"])
    recorder = Recorder(record, list(channels.values()))
    recorder.run()
    finish(record, recorder.ended, summarise_simulated if simulated else summarise)


if __name__ == "__main__":
    main()
