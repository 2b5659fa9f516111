"""Packs and unpacks the signals of 8-byte CAN frames in Motorola order, where a DBC file places them.

Knows bits; it must not know what any signal means.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

BITS: Final = 64  #: of a frame


@dataclass(frozen=True, slots=True)
class Signal:
    """Where a number lies in a frame and how it is scaled."""

    start: int  #: of the most significant bit, as a DBC file numbers bits: 8 times the byte plus the bit's weight
    length: int  #: [bits]
    scale: float = 1.0  #: of one count
    offset: float = 0.0  #: what a count of 0 stands for
    signed: bool = False  #: two's complement

    @property
    def shift(self) -> int:
        """Bits between the signal's least significant bit and the end of the frame."""
        return BITS - self.length - (self.start // 8 * 8 + 7 - self.start % 8)

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the greatest value that the signal can carry."""
        least, greatest = self._counts
        return least * self.scale + self.offset, greatest * self.scale + self.offset

    @property
    def _counts(self) -> tuple[int, int]:
        half = 1 << (self.length - 1)
        return (-half, half - 1) if self.signed else (0, 2 * half - 1)

    def put(self, value: float) -> int:
        """Return the frame's bits, as a number of 64 bits, that carry a value; one out of range saturates.

        Raises ValueError for a number that is not finite.
        """
        if not math.isfinite(value):
            raise ValueError(f"a signal carries finite numbers only, got {value}")
        least, greatest = self._counts
        count = min(max((value - self.offset) / self.scale, least), greatest)
        return (round(count) & (1 << self.length) - 1) << self.shift

    def get(self, bits: int) -> float:
        """Return the value that a frame's bits carry."""
        count = bits >> self.shift & (1 << self.length) - 1
        if self.signed and count >> (self.length - 1):
            count -= 1 << self.length
        return count * self.scale + self.offset


def data_of(*bits: int) -> bytes:
    """Return the 8 bytes of a frame from the bits of its signals."""
    whole = 0
    for each in bits:
        whole |= each
    return whole.to_bytes(8, "big")


def bits_of(data: bytes) -> int:
    """Return the bits of a frame's bytes; one shorter than 8 bytes counts as padded with zeros."""
    return int.from_bytes(data.ljust(8, b"\0"), "big")
