"""What can go wrong on a wire to a control computer: portions of bytes or frames in, altered ones out.

A fault is a plain object that is asked once a tick. It knows what the wire carries and drive time; it must not know
sockets, clocks, or why somebody injects it. Chance is passed in: the same seed alters the same bits.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from operator import xor
from random import Random
from typing import Any, Final, Protocol, TypeAlias

from vve_sumo.pose import ncom
from vve_sumo.values import Frame
from vve_sumo.wire.datagrams import RadarDatagram, Target, decode_radar, encode_radar

#: what a wire carries at one tick: datagrams, portions of a stream, or CAN frames
Portions: TypeAlias = Sequence[Any]

#: number of the object whose range is not a number, where there is no object: none of the first that are given out
MADE_UP_NUMBER: Final = 4242
#: offset of the flags, and of the first target's range, in a radar datagram [bytes]
_FLAGS, _FIRST_RANGE = 6, 48
_CRC_LENGTH: Final = 4  # [bytes]
#: half a microsecond: times of ticks are compared without their last bits [s]
_SLACK: Final = 5e-7


class WireFault(Protocol):
    """One fault on one wire; `step` is called once a tick, in order, also before and after the fault is there."""

    def step(self, now: float, portions: Portions, active: bool) -> Portions:
        """Return what the wire carries at drive time `now` [s] in place of `portions`; these, where not `active`."""
        ...


class Freeze:
    """The same portions again and again: those of the last healthy tick at which any were due."""

    def __init__(self) -> None:
        self._last: Portions = ()

    def step(self, _now: float, portions: Portions, active: bool) -> Portions:
        """Return the last healthy portions wherever some are due."""
        if active:
            return self._last if portions else ()
        self._last = tuple(portions) or self._last
        return portions


class DropOut:
    """Nothing is carried."""

    def step(self, _now: float, portions: Portions, active: bool) -> Portions:
        """Return nothing."""
        return () if active else portions


class Delay:
    """Every portion arrives later; those that are still under way when the fault ends are lost."""

    def __init__(self, delay: float) -> None:
        """`delay` in seconds."""
        self._delay = delay
        self._under_way: deque[tuple[float, Portions]] = deque()

    def step(self, now: float, portions: Portions, active: bool) -> Portions:
        """Return the portions that are due by now."""
        if not active:
            self._under_way.clear()
            return portions
        self._under_way.append((now + self._delay, tuple(portions)))
        due: list[Any] = []
        while self._under_way and self._under_way[0][0] <= now + _SLACK:
            due.extend(self._under_way.popleft()[1])
        return due


class BitFlips:
    """One bit of every n-th portion is the other one."""

    def __init__(self, chance: Random, every: int = 1) -> None:
        """`every` 1 hits each portion."""
        self._chance, self._every, self._count = chance, every, 0

    def step(self, _now: float, portions: Portions, active: bool) -> Portions:
        """Return the portions, some with a bit flipped."""
        return [self._flipped(one) for one in portions] if active else portions

    def _flipped(self, portion: Any) -> Any:
        self._count += 1
        if self._count % self._every:
            return portion
        if isinstance(portion, Frame):
            return portion._replace(data=_flip(portion.data, self._chance))
        return _flip(portion, self._chance)


def _flip(data: bytes, chance: Random) -> bytes:
    if not data:
        return data
    bit = chance.randrange(8 * len(data))
    flipped = bytearray(data)
    flipped[bit // 8] ^= 1 << bit % 8
    return bytes(flipped)


#: returns the bytes of a radar datagram in place of a valid one, given the newest and the last healthy one
RadarEdit: TypeAlias = Callable[[RadarDatagram, RadarDatagram], bytes]


class EditedRadar:
    """Valid radar datagrams are other ones, with a right CRC; those that are not valid pass as they are."""

    def __init__(self, edit: RadarEdit) -> None:
        self._edit = edit
        self._last: RadarDatagram | None = None

    def step(self, _now: float, portions: Portions, active: bool) -> Portions:
        """Return the datagrams, edited."""
        return [self._one(data, active) for data in portions]

    def _one(self, data: bytes, active: bool) -> bytes:
        newest = decode_radar(data)
        if newest is None or not newest.valid:
            return data
        if not active or self._last is None:
            self._last = newest
        return self._edit(newest, self._last) if active else data


def aged(newest: RadarDatagram, last: RadarDatagram) -> bytes:
    """Return a datagram that still shows the last healthy scan, under its true time of measurement."""
    return encode_radar(replace(newest, measured=last.measured, targets=last.targets))


def counter_stopped(newest: RadarDatagram, last: RadarDatagram) -> bytes:
    """Return a datagram whose sequence stands; all else in it is new."""
    return encode_radar(replace(newest, sequence=last.sequence))


def marked_invalid(newest: RadarDatagram, _last: RadarDatagram) -> bytes:
    """Return a datagram that says that it is not valid, and whose contents look good all the same."""
    return _sealed(encode_radar(newest), _FLAGS, struct.pack("<H", 0))


def not_a_number(newest: RadarDatagram, _last: RadarDatagram) -> bytes:
    """Return a datagram that says that it is valid, and whose first range is not a number."""
    targets = newest.targets or (Target(MADE_UP_NUMBER, 1.0, 0.0, 0.0),)
    return _sealed(encode_radar(replace(newest, targets=targets)), _FIRST_RANGE, struct.pack("<f", math.nan))


def _sealed(data: bytes, offset: int, part: bytes) -> bytes:
    """Return a datagram with other bytes at an offset, and the CRC that belongs to them."""
    body = data[:offset] + part + data[offset + len(part) : -_CRC_LENGTH]
    return body + struct.pack("<I", zlib.crc32(body))


class Rewritten:
    """Every portion is another one."""

    def __init__(self, edit: Callable[[Any], Any]) -> None:
        """`edit` returns what is carried in place of a portion."""
        self._edit = edit

    def step(self, _now: float, portions: Portions, active: bool) -> Portions:
        """Return the portions, rewritten."""
        return [self._edit(one) for one in portions] if active else portions


def nmea_without_fix(portion: bytes) -> bytes:
    """Return NMEA sentences that say that there is no fix, while position and motion in them look good.

    GGA says quality 0 and RMC status V; every checksum is right.
    """
    return b"\r\n".join(map(_without_fix, portion.split(b"\r\n")))


def _without_fix(sentence: bytes) -> bytes:
    fields = sentence.partition(b"*")[0].split(b",")
    if fields[0].endswith(b"GGA"):
        fields[6] = b"0"
    elif fields[0].endswith(b"RMC"):
        fields[2] = b"V"
    else:
        return sentence
    content = b",".join(fields)
    return b"%b*%02X" % (content, reduce(xor, content[1:]))


class UnlockedNcom:
    """Every NCOM packet says that its unit is not locked; the rest of it looks good, and its checksums are right."""

    def step(self, _now: float, portions: Portions, active: bool) -> Portions:
        """Return the packets, marked."""
        return [ncom.with_status(data, ncom.LOCKING) for data in portions] if active else portions
