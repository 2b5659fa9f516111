"""What the process of the people's page and the drive's process tell each other, and the drive's end of the channel.

The drive is handed reports and nothing else; what goes back is what people are shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from msgspec import Struct

from vve_sumo.live.channel import Channel
from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind
from vve_sumo.people.person_view import PersonView


class ArrivedReport(Struct, frozen=True, tag=True):
    """A report of a person, as a datagram of `people.reports`."""

    received: float  #: drive time of its arrival at this machine [s]
    datagram: bytes


class ShownToPeople(Struct, frozen=True, tag=True):
    """What the people's pages are to show."""

    state: str  #: arming state of the gateway
    views: tuple[PersonView, ...]


_CODEC: Final = MessageCodec[ArrivedReport | ShownToPeople](MessageKind.PEOPLE_LINK, ArrivedReport | ShownToPeople)


def encode(message: ArrivedReport | ShownToPeople) -> bytes:
    """Return the datagram of a message."""
    return _CODEC.encode(message)


def decode(datagram: bytes) -> ArrivedReport | ShownToPeople | MalformedMessage:
    """Return the message in a datagram."""
    return _CODEC.decode(datagram)


class PeopleFeed:
    """The drive's end of the channel; never waits and never raises."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel

    @property
    def closed(self) -> bool:
        """Whether the other process is gone, as far as sending or receiving has shown."""
        return self._channel.closed

    def fileno(self) -> int:
        """Return the file descriptor to wait on; once `closed` do not wait on it."""
        return self._channel.fileno()

    def receive(self) -> list[ArrivedReport]:
        """Return the reports that have come, in order."""
        came = map(decode, self._channel.receive())
        return [message for message in came if isinstance(message, ArrivedReport)]

    def show(self, state: str, views: Sequence[PersonView]) -> None:
        """Have this shown; what there is no room for is not."""
        if not self._channel.closed:
            self._channel.send(encode(ShownToPeople(state, tuple(views))))

    def close(self) -> None:
        """Close the drive's end."""
        self._channel.close()
