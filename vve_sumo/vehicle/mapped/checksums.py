"""Checksums of frames, by what a mapping says of them; each is over bytes in which its own bits are zero."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, reduce
from operator import xor


@cache
def crc8_table(polynomial: int) -> tuple[int, ...]:
    """Return the table of a CRC of eight bits, most significant bit first; `polynomial` without its leading term."""
    table = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = (value << 1) ^ polynomial if value & 0x80 else value << 1
        table.append(value & 0xFF)
    return tuple(table)


def crc8(data: Sequence[int], polynomial: int, initial: int, final_xor: int) -> int:
    """Return the CRC of eight bits of bytes; SAE J1850 is polynomial 0x1D, initial 0xFF, final_xor 0xFF."""
    table, value = crc8_table(polynomial), initial
    for byte in data:
        value = table[value ^ byte]
    return value ^ final_xor


def function_of(kind: str, polynomial: int, initial: int, final_xor: int) -> Callable[[Sequence[int]], int]:
    """Return what computes a checksum of a mapping's `kind`, "sum", "xor" or "crc8", of bytes."""
    if kind == "sum":
        return sum
    if kind == "xor":
        return lambda data: reduce(xor, data, 0)
    return lambda data: crc8(data, polynomial, initial, final_xor)
