"""Reads the layout of CAN frames from a DBC file, and packs and unpacks their signals by it.

It reads messages, signals (multiplexed ones too) and names of values, and knows the meaning of none. cantools, which
reads all of such a file, takes longer to import than this package; the tests compare the two.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

_MESSAGE: Final = re.compile(r"BO_ (\d+) (\w+) *: *(\d+) ")
_SIGNAL: Final = re.compile(
    r"SG_ (\w+)(?: (M|m\d+M?))? *: *(\d+)\|(\d+)@([01])([+-]) *"
    r'\(([^,]+),([^)]+)\) *\[([^|]+)\|([^]]+)\] *"([^"]*)"'
)
_NAMES: Final = re.compile(r"VAL_ (\d+) (\w+) ")
_NAME: Final = re.compile(r'(-?\d+) "([^"]*)"')


@dataclass(frozen=True, slots=True)
class Signal:
    """Where a number lies in a message, and how it is scaled."""

    name: str
    length: int  #: [bits]
    order: Literal["little", "big"]  #: of its bytes
    shift: int  #: bits below it, in the message's bytes taken as one number in its byte order; beyond them: no room
    mask: int  #: as many ones as it has bits
    signed: bool  #: two's complement
    min_count: int  #: least count that its bits hold
    max_count: int  #: greatest one
    scale: float  #: of one count
    offset: float  #: what a count of 0 stands for
    minimum: float  #: of its values
    maximum: float
    unit: str
    switch: bool  #: its count says which of the multiplexed signals a frame holds
    case: int | None  #: count of the switch with which a frame holds it; None always
    choices: Mapping[int, str]  #: names of counts

    def count(self, bits: int) -> int:
        """Return the count that the message's number carries."""
        count = bits >> self.shift & self.mask
        return count - self.mask - 1 if count > self.max_count else count

    def put(self, value: float) -> int:
        """Return the message's number with the bits that carry a value; one out of range saturates.

        Raises ValueError for a number that is not finite.
        """
        count = (value - self.offset) / self.scale
        if not self.min_count <= count <= self.max_count:
            if not math.isfinite(value):
                raise ValueError(f"a signal carries finite numbers only, got {value}")
            count = self.min_count if count < self.min_count else self.max_count
        return (round(count) & self.mask) << self.shift

    def get(self, bits: int) -> float:
        """Return the value that the message's number carries."""
        return self.count(bits) * self.scale + self.offset


@dataclass(frozen=True, slots=True)
class Message:
    """Layout of the frames of one identifier."""

    id: int  #: of 29 bits with bit 31 set, as in `values.Frame`
    name: str
    size: int  #: [bytes]
    order: Literal["little", "big"]  #: of the bytes of all its signals; of `read_all`, of the first one
    signals: Mapping[str, Signal]

    def encode(self, **values: float) -> bytes:
        """Return the bytes that carry these values, all other bits zero; values out of range saturate.

        Raises ValueError for a number that is not finite.
        """
        bits = 0
        for name, value in values.items():
            bits |= self.signals[name].put(value)
        return bits.to_bytes(self.size, self.order)

    def altered(self, data: bytes, **values: float) -> bytes:
        """Return a frame's bytes with these values in place of those that were there."""
        bits = self.bits(data)
        for name, value in values.items():
            signal = self.signals[name]
            bits = bits & ~(signal.mask << signal.shift) | signal.put(value)
        return bits.to_bytes(self.size, self.order)

    def decode(self, data: bytes) -> dict[str, float]:
        """Return the values of all signals; bytes that are missing count as zeros."""
        bits = self.bits(data)
        return {signal.name: signal.get(bits) for signal in self.signals.values()}

    def value(self, data: bytes, name: str) -> float:
        """Return the value of one signal."""
        return self.signals[name].get(self.bits(data))

    def bits(self, data: bytes) -> int:
        """Return a frame's bytes as the message's number; bytes that are missing count as zeros."""
        if len(data) != self.size:
            data = data[: self.size].ljust(self.size, b"\0")
        return int.from_bytes(data, self.order)


def read(file: Path) -> dict[str, Message]:
    """Return the messages of a DBC file by name.

    Raises ValueError for a line that it does not understand, and for a message with signals of both byte orders.
    """
    messages = {message.name: message for message in read_all(file)}
    for message in messages.values():
        if any(signal.order != message.order for signal in message.signals.values()):
            raise ValueError(f"{file}: {message.name}: expected signals of one byte order, got both")
    return messages


def read_all(file: Path) -> list[Message]:
    """Return the messages of a DBC file in its order, also where they contradict each other.

    Raises ValueError for a line that it does not understand, OSError for a file that cannot be read.
    """
    lines = [line.strip() for line in _text(file).splitlines()]
    names = {
        found.groups(): {int(count): name for count, name in _NAME.findall(line)}
        for line in lines
        if (found := _NAMES.match(line))
    }
    messages: list[Message] = []
    for line in lines:
        if line.startswith("BO_ "):
            identifier, name, size = _parts(file, _MESSAGE, line)
            messages.append(Message(int(identifier), name, int(size), "big", {}))
        elif line.startswith("SG_ ") and messages:
            message = messages[-1]
            parts = _parts(file, _SIGNAL, line)
            signal = _signal(parts, message.size, names.get((str(message.id), parts[0]), {}))
            order = message.order if message.signals else signal.order
            messages[-1] = replace(message, order=order, signals={**message.signals, signal.name: signal})
    return messages


def _text(file: Path) -> str:
    """Return a DBC file's text; what is not UTF-8 is the code page that Windows programs write."""
    data = file.read_bytes()
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _parts(file: Path, pattern: re.Pattern[str], line: str) -> tuple[str, ...]:
    if (found := pattern.match(line)) is None:
        raise ValueError(f"{file}: expected a message or a signal, got {line!r}")
    return found.groups("")


def _signal(parts: tuple[str, ...], size: int, choices: Mapping[int, str]) -> Signal:
    name, switching, start, length, order, sign, scale, offset, minimum, maximum, unit = parts
    first, bits = int(start), int(length)
    # Motorola's start is the most significant bit, and bit 7 is the first bit of a frame.
    shift = first if order == "1" else 8 * size - bits - (first // 8 * 8 + 7 - first % 8)
    mask, signed = (1 << bits) - 1, sign == "-"
    return Signal(
        name,
        bits,
        "little" if order == "1" else "big",
        shift,
        mask,
        signed,
        ~(mask >> 1) if signed else 0,
        mask >> 1 if signed else mask,
        float(scale),
        float(offset),
        float(minimum),
        float(maximum),
        unit,
        switching == "M",
        int(switching[1:].rstrip("M")) if switching[1:] else None,
        choices,
    )
