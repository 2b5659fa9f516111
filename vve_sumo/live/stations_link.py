"""What the process of the real on-board unit tells the drive's process, and the drive's end of the channel.

The drive is handed datagrams with what they say, and nothing goes back.
"""

from __future__ import annotations

from typing import Final

from msgspec import Struct

from vve_sumo.live.channel import Channel
from vve_sumo.messages import MessageCodec, MessageKind
from vve_sumo.stations.reports import StationReport


class ArrivedDatagram(Struct, frozen=True, array_like=True):
    """A datagram of the on-board unit."""

    received: float  #: drive time of its arrival at this machine [s]
    datagram: bytes
    report: StationReport | None  #: what it says of a station; None where it says nothing
    reason: str  #: code, where it says nothing


_CODEC: Final = MessageCodec[ArrivedDatagram](MessageKind.STATIONS_LINK, ArrivedDatagram)


def encode(received: float, datagram: bytes, said: StationReport | str) -> bytes:
    """Return the message of a datagram that arrived at a drive time [s], with what `reports.read` makes of it."""
    report = said if isinstance(said, StationReport) else None
    return _CODEC.encode(ArrivedDatagram(received, datagram, report, said if isinstance(said, str) else ""))


class StationsFeed:
    """The drive's end of the channel; never waits and never raises."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel

    @property
    def closed(self) -> bool:
        """Whether the other process is gone, as far as receiving has shown."""
        return self._channel.closed

    def fileno(self) -> int:
        """Return the file descriptor to wait on; once `closed` do not wait on it."""
        return self._channel.fileno()

    def receive(self) -> list[tuple[float, bytes, StationReport | str]]:
        """Return what has come, in order: drive time of the arrival [s], the datagram, and what it says."""
        came = map(_CODEC.decode, self._channel.receive())
        return [
            (one.received, one.datagram, one.reason if one.report is None else one.report)
            for one in came
            if isinstance(one, ArrivedDatagram)
        ]

    def close(self) -> None:
        """Close the drive's end."""
        self._channel.close()
