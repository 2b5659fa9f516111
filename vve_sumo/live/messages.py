"""What the processes of a live drive and its console tell each other, besides what the gateway's link carries."""

from __future__ import annotations

from typing import Any, Final

from msgspec import Struct

from vve_sumo.errors import VveError
from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind
from vve_sumo.values import EGO


class Ready(Struct, frozen=True, tag=True):
    """A process has begun its work."""

    address: tuple[str, ...] = ()  #: of the page; interface and channel of the simulated vehicle's bus


class Refused(Struct, frozen=True, tag=True):
    """A process cannot do its work, and ends."""

    text: str  #: one line for the operator
    exit_code: int  #: of the drive


class Notice(Struct, frozen=True, tag=True):
    """A line for the operator."""

    text: str


class DriveStatus(Struct, frozen=True, tag=True):
    """What the console's screen shows of a tick; names carry units as those of the screen's table do."""

    tick: int
    time_s: float  #: drive time
    faults: tuple[str, ...]  #: reason codes of the tick
    details: dict[str, str]  #: the numbers behind some of them, in words
    pose_reasons: tuple[str, ...]  #: why the newest fix was not trusted
    speed_mps: float | None  #: None before the first trusted fix, as of the next two
    to_go_m: float | None  #: along the path
    deviation_m: float | None  #: from the path, left positive
    range_m: float | None  #: least of the newest scan; None for an empty one
    note: str  #: the controller's own word for what it does
    latency: dict[str, Any]  #: of the ticks so far
    missed: int  #: ticks that were skipped so far
    clock: dict[str, Any]  #: the receiver's clock against the drive's, as `ReportedPose` has it; empty for none
    outcome: str | None  #: of the drive, once it has one
    ego: str = EGO  #: id of the ego whose car this is


class Verdict(Struct, frozen=True, tag=True):
    """What came of the drive, for the page."""

    verdict: dict[str, Any]


ConsoleMessage = Ready | Refused | Notice | DriveStatus | Verdict
_CODEC: Final = MessageCodec[ConsoleMessage](MessageKind.CONSOLE, ConsoleMessage)


def encode(message: ConsoleMessage) -> bytes:
    """Return the datagram of a message to or from the console."""
    return _CODEC.encode(message)


def decode(datagram: bytes) -> ConsoleMessage | MalformedMessage:
    """Return the message in a datagram to or from the console."""
    return _CODEC.decode(datagram)


def refusal(error: VveError) -> bytes:
    """Return the datagram of a process that an error keeps from its work."""
    return encode(Refused(str(error), error.exit_code))
