"""Reads what the page in a person's browser says, as W3C's Geolocation and DeviceOrientation give it.

Angles come in degrees clockwise from true north and accuracies as 95 % radii (W3C Recommendation "Geolocation",
section 6); both may be absent. Knows no socket and no clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta, Struct

from vve_sumo.people.reports import FieldEntered, PageAlive, PersonStop, PositionReport, Report

#: A sign of life that may be older than this is none [s]: the network held it back, or the page hears nothing.
OLDEST_SIGN: Final = 1.0

#: A position that the phone itself dates later than the moment at which it sent it is tolerated up to here [s].
CLOCK_TOLERANCE: Final = 0.1

Id = Annotated[str, Meta(min_length=1, max_length=64)]
Degrees = Annotated[float, Meta(ge=-360.0, le=360.0)]
#: of a browser: milliseconds of Unix time
Milliseconds = Annotated[float, Meta(ge=0.0, le=1e14)]
#: Number of the newest of the server's messages that the page had received when it sent its own; 0 before the first.
Echo = Annotated[int, Meta(ge=0, le=2**53)]


class PagePosition(Struct, frozen=True, tag_field="type", tag="position", forbid_unknown_fields=True):
    """A position, as the page sends it."""

    person: Id
    echo: Echo
    timestamp: Milliseconds  #: of the position, by the phone's clock
    sent: Milliseconds  #: when the page sent it, by the same clock
    latitude: Annotated[float, Meta(ge=-90.0, le=90.0)]
    longitude: Annotated[float, Meta(ge=-180.0, le=180.0)]
    accuracy: Annotated[float, Meta(ge=0.0, le=1e7)]  #: radius of 95 % [m]
    heading: Degrees | None = None  #: direction of motion
    compass: Degrees | None = None  #: direction that the phone points in


class PageEntered(Struct, frozen=True, tag_field="type", tag="entered", forbid_unknown_fields=True):
    """The acknowledged start, as the page sends it."""

    person: Id
    echo: Echo
    consent: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


class PageSign(Struct, frozen=True, tag_field="type", tag="alive", forbid_unknown_fields=True):
    """A sign of life, as the page sends it."""

    person: Id
    echo: Echo


class PageStop(Struct, frozen=True, tag_field="type", tag="stop", forbid_unknown_fields=True):
    """The stop button, as the page sends it."""

    person: Id
    echo: Echo


PageMessage: TypeAlias = PagePosition | PageEntered | PageSign | PageStop
_DECODER: Final[msgspec.json.Decoder[PageMessage]] = msgspec.json.Decoder(PageMessage)


def read(text: str | bytes) -> PageMessage | None:
    """Return the message in a text that a page sent; None for anything else."""
    try:
        return _DECODER.decode(text)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


def report_of(message: PageMessage, received: float, sent_at: Callable[[int], float]) -> Report | None:
    """Return the report that a page's message is, which arrived at drive time `received` [s].

    `sent_at` gives the drive time at which a message of the server's was sent [s], by its number; NaN for a number
    that none has. The page sent its own message after that one, and the position was `sent - timestamp` old by then, by
    one clock: so the position is no older than it is dated here, whatever the phone's clock shows and however long the
    network took. None for a message that cannot be dated, because its echo is no message's or the
    phone's clock was set, and for a sign of life that may be older than `OLDEST_SIGN`.
    """
    if isinstance(message, PageEntered):
        return FieldEntered(message.person, message.consent)
    if isinstance(message, PageStop):
        return PersonStop(message.person)
    earliest = min(sent_at(message.echo), received)
    if not math.isfinite(earliest):
        return None
    if isinstance(message, PageSign):
        return PageAlive(message.person) if received - earliest <= OLDEST_SIGN else None
    age = (message.sent - message.timestamp) / 1000.0
    if age < -CLOCK_TOLERANCE:
        return None
    heading = message.heading if message.compass is None else message.compass
    return PositionReport(
        message.person,
        earliest - max(age, 0.0),
        math.radians(message.latitude),
        math.radians(message.longitude),
        message.accuracy,
        math.nan if heading is None else math.remainder(math.radians(90.0 - heading), math.tau),
    )
