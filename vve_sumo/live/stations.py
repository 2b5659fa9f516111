"""Runs the process that hears a real on-board unit: reads its packets, and hands them to the drive with what they say.

Reading takes a tenth of a millisecond or more for each packet, which is no work for the process of the tick. Nothing
that comes over the network can keep the drive from its work: of more packets than a busy street has, the rest is
dropped and counted. When this process dies, the drive knows it at once, and the car is stopped.
"""

from __future__ import annotations

import contextlib
import select
import sys
from collections import Counter, deque
from typing import Final

from vve_sumo.errors import VveError
from vve_sumo.live import messages, signals
from vve_sumo.live.channel import Channel
from vve_sumo.live.priority import OOM_RECORDER, lower_priority, set_oom_score
from vve_sumo.live.spawn import receive_config
from vve_sumo.live.stations_link import encode
from vve_sumo.pose.sources import Source, open_udp
from vve_sumo.stations import reports
from vve_sumo.stations.reports import StationReport

#: so many packets are read within a period, no more: 32 stations that send ten times a second, and as many others
MAX_PACKETS: Final = 64
PERIOD: Final = 0.1  #: [s]


class StationsProcess:
    """Reads packets until the drive is gone."""

    def __init__(self, source: Source, drive: Channel, t0: float, epoch: float) -> None:
        """`t0` is the monotonic second of drive time 0, `epoch` its GNSS second."""
        self._source, self._drive, self._t0, self._epoch = source, drive, t0, epoch
        self._read: deque[float] = deque()  # when packets were read, within the last period [s]
        self.counts: Counter[str] = Counter()  #: of datagrams: read, dropped, lost, and why some said nothing

    def run(self) -> None:
        """Hand packets to the drive until that is gone."""
        watched: list[Source | Channel] = [self._source, self._drive]
        while not self._drive.closed:
            select.select(watched, [], [])
            self._drive.receive()  # nothing comes, but its end shows
            for stamp, datagram in self._source.receive():
                self._take(stamp, datagram)

    def _take(self, stamp: float, datagram: bytes) -> None:
        while self._read and stamp - self._read[0] > PERIOD:
            self._read.popleft()
        if len(self._read) >= MAX_PACKETS:
            self.counts["dropped"] += 1
            return
        self._read.append(stamp)
        received = stamp - self._t0
        said = reports.read(datagram, received, self._epoch)
        self.counts["read" if isinstance(said, StationReport) else said] += 1
        if not self._drive.send(encode(received, datagram, said)):
            self.counts["lost"] += 1


def _say(line: str) -> None:
    with contextlib.suppress(OSError, ValueError):
        print(f"stations: {line}", file=sys.stderr, flush=True)  # noqa: T201 (the log of a process without a terminal)


def main() -> int:
    """Run the process and return its exit code."""
    signals.ignore()
    set_oom_score(OOM_RECORDER)
    lower_priority()
    config, channels = receive_config()
    console = channels["console"]
    try:
        reports.prepare()
        host, _, port = config["listen"].rpartition(":")
        source = open_udp(host, int(port), config["sender"], "v2x.listen", genuine=_is_of_a_unit)
    except VveError as error:
        console.send(messages.refusal(error))
        return error.exit_code
    console.send(messages.encode(messages.Ready()))
    process = StationsProcess(source, channels["drive"], config["t0"], config["epoch"])
    process.run()
    _say(f"datagrams {dict(sorted(process.counts.items()))}, senders {source.sender_report()}")
    source.close()
    return 0


def _is_of_a_unit(datagram: bytes) -> bool:
    return reports.read(datagram, 0.0, 0.0) != "malformed"


if __name__ == "__main__":
    sys.exit(main())
