"""Frames of a mapped DBC file: numbers and conditions in them, their counters, and the checksums that seal them.

Signals of both byte orders may share a message. Knows bits and scales, and not what a number is for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from vve_sumo.dbc import Signal

#: share of a count by which rounding may miss a whole one
ROUNDING: Final = 1e-6


class Views(NamedTuple):
    """A frame's bytes as one number in either byte order."""

    little: int
    big: int


def views_of(data: bytes) -> Views:
    """Return a frame's bytes as numbers."""
    return Views(int.from_bytes(data, "little"), int.from_bytes(data, "big"))


def count_in(signal: Signal, views: Views) -> int:
    """Return the count that a frame carries."""
    return signal.count(views[signal.order == "big"])


class Placed(NamedTuple):
    """A count to be put into a frame."""

    signal: Signal
    value: int  #: the count


@dataclass(frozen=True, slots=True)
class Condition:
    """A yes or no by one signal."""

    message: int  #: identifier
    signal: Signal
    yes: tuple[int, ...]  #: counts that mean yes; the first one is what is sent
    no: int

    def read(self, views: Views) -> bool:
        """Return whether a frame says yes."""
        return count_in(self.signal, views) in self.yes

    def placed(self, value: bool) -> Placed:
        """Return the count that says yes or no."""
        return Placed(self.signal, self.yes[0] if value else self.no)


@dataclass(frozen=True, slots=True)
class Number:
    """A number by one signal, in SI units; `scale` is what one unit of the DBC file is in SI units."""

    message: int  #: identifier
    signal: Signal
    scale: float
    low: float  #: least that the wire takes [SI]
    high: float  #: greatest
    invalid: frozenset[int] = frozenset()  #: counts that say that it is not known
    valid: Condition | None = None  #: in the same message; says whether it is known

    def read(self, views: Views) -> float:
        """Return the number in a frame, NaN where the frame says that it is not known."""
        count = count_in(self.signal, views)
        if count in self.invalid or not (self.valid is None or self.valid.read(views)):
            return math.nan
        return (count * self.signal.scale + self.signal.offset) * self.scale

    def placed(self, value: float) -> Placed:
        """Return the count that stands for a number; raises ValueError for NaN and beyond the wire's range."""
        if not self.low <= value <= self.high:
            raise ValueError(f"{self.signal.name} must be {self.low:g} to {self.high:g} in SI units, got {value:g}")
        return Placed(self.signal, round((value / self.scale - self.signal.offset) / self.signal.scale))

    def placed_down(self, value: float) -> Placed:
        """Return the count of a number that is at most this one, but not zero, which may mean "no limit"."""
        placed = self.placed(value)
        count = math.floor((value / self.scale - self.signal.offset) / self.signal.scale + ROUNDING)
        return Placed(placed.signal, count or 1)

    def nearest(self, value: float) -> list[Placed] | None:
        """Return the counts nearest to a number, as a device reports it; None for NaN that the wire cannot say."""
        known = value == value
        says = [] if self.valid is None else [self.valid.placed(known)]
        if known:
            return [*says, self.placed(min(max(value, self.low), self.high))]
        if self.invalid:
            return [*says, Placed(self.signal, min(self.invalid))]
        return says or None


class Seal(NamedTuple):
    """A checksum of a message, over its bytes with the checksum's own bits zero, or a counter's complement."""

    signal: Signal
    compute: Callable[[Sequence[int]], int]
    identifier: bool  #: the two low bytes of the identifier go before the data, high byte first
    of: Signal | None = None  #: of which it is the complement


@dataclass(frozen=True, slots=True)
class Layout:
    """One message: how its frames are put together, and what makes one whole."""

    id: int
    name: str
    size: int  #: [bytes]
    counter: Signal | None = None
    seals: tuple[Seal, ...] = ()
    constants: tuple[Placed, ...] = ()

    def packed(self, placed: Iterable[Placed], counter: int = 0) -> bytes:
        """Return the bytes of a frame with these counts, its constants, its counter and its checksums."""
        data = self._with(bytes(self.size), [*self.constants, *placed])
        return self.counted(data, counter)

    def altered(self, data: bytes, placed: Iterable[Placed]) -> bytes:
        """Return a frame's bytes with other counts, sealed anew; the counter stays."""
        return self._sealed(self._with(data, placed))

    def counted(self, data: bytes, counter: int) -> bytes:
        """Return a frame's bytes with another counter, sealed anew."""
        placed = [] if self.counter is None else [Placed(self.counter, counter & self.counter.mask)]
        return self.altered(data, placed)

    def count(self, views: Views) -> int | None:
        """Return the counter of a frame; None for a message without."""
        return None if self.counter is None else count_in(self.counter, views) & self.counter.mask

    def intact(self, data: bytes) -> bool:
        """Whether the checksums of a frame of the right length are right."""
        return not self.seals or self._sealed(data) == data

    def _with(self, data: bytes, placed: Iterable[Placed]) -> bytes:
        little, big = 0, 0
        keep_little, keep_big = (1 << 8 * self.size) - 1, (1 << 8 * self.size) - 1
        for signal, count in placed:
            if signal.order == "little":
                little |= (count & signal.mask) << signal.shift
                keep_little &= ~(signal.mask << signal.shift)
            else:
                big |= (count & signal.mask) << signal.shift
                keep_big &= ~(signal.mask << signal.shift)
        whole = int.from_bytes(data, "little") & keep_little
        whole &= int.from_bytes(keep_big.to_bytes(self.size, "big"), "little")
        whole |= little | int.from_bytes(big.to_bytes(self.size, "big"), "little")
        return whole.to_bytes(self.size, "little")

    def _sealed(self, data: bytes) -> bytes:
        for seal in self.seals:
            if seal.of is not None:
                count = ~count_in(seal.of, views_of(data))
            else:
                bare = self._with(data, [Placed(seal.signal, 0)])
                full = _byte_of(seal.signal, self.size)
                covered = [byte for place, byte in enumerate(bare) if place != full]
                head = [self.id >> 8 & 0xFF, self.id & 0xFF] if seal.identifier else []
                count = seal.compute([*head, *covered])
            data = self._with(data, [Placed(seal.signal, count)])
        return data


def _byte_of(signal: Signal, size: int) -> int | None:
    """Return the place of the one byte that a signal fills; None for one that fills no byte."""
    if signal.length != 8 or signal.shift % 8:
        return None
    place = signal.shift // 8
    return place if signal.order == "little" else size - 1 - place
