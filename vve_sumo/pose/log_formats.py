"""The formats of receivers' logs, and which of them a file has.

It knows decoders; it must not know files or what becomes of the fixes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, Protocol, runtime_checkable

from vve_sumo.pose import ncom, nmea, novatel, sbf, trust, ubx
from vve_sumo.values import Fix

HEAD: Final = 1 << 18  #: bytes by which a format is recognised, unless nothing is found in them
#: bytes that are decoded at once: an NCOM packet's, so that the decoder's codes are those of the newest fix
PORTION: Final = ncom.LENGTH


@runtime_checkable
class LogDecoder(Protocol):
    """What is needed of a decoder of logs."""

    @property
    def discarded(self) -> int:
        """How many bytes belonged to no message."""
        ...

    @property
    def counts(self) -> Mapping[Any, int]:
        """What became of messages and epochs, by outcome."""
        ...

    @property
    def recognised(self) -> int:
        """How many messages had a right checksum and are of a kind that is read."""
        ...

    def feed(self, data: bytes, time_received: float) -> list[Fix]:
        """Return the fixes that `data` completes."""
        ...


class LogFormat(NamedTuple):
    """A format of logs."""

    name: str  #: in few words
    message: str  #: what it is made of
    decoder: Callable[[], LogDecoder]
    profile: trust.TrustProfile  #: by which a live receiver that sends it is judged


FORMATS: Final = (
    LogFormat("OXTS NCOM", "NCOM packet", ncom.Decoder, trust.DRIVE),
    LogFormat("u-blox UBX", "UBX message", ubx.Decoder, trust.UBX),
    LogFormat("Septentrio SBF", "SBF block", sbf.Decoder, trust.SBF),
    LogFormat("NovAtel OEM7", "NovAtel log", novatel.Decoder, trust.NOVATEL),
    LogFormat("NMEA 0183", "NMEA sentence", nmea.Decoder, trust.NMEA),
)


def format_of(data: bytes) -> LogFormat | None:
    """Return the format by which most fixes are found in a log, or most messages; None where there is no message.

    Receivers may send several formats at once, such as UBX and NMEA; of equal ones the first in `FORMATS` is taken.
    """
    for part in (data[:HEAD], data):
        found, best = max(((_found(one, part), -rank) for rank, one in enumerate(FORMATS)))
        if found[1]:
            return FORMATS[-best]
    return None


def _found(of: LogFormat, data: bytes) -> tuple[int, int]:
    decoder = of.decoder()
    return len(decoder.feed(data, 0.0)), decoder.recognised
