"""TimestampIts: milliseconds since 2004-01-01T00:00:00Z, leap seconds counted (ETSI TS 102 894-2, TimestampIts)."""

from __future__ import annotations

from typing import Final

#: the epoch of TimestampIts in GNSS time [s since 1980-01-06]: 8761 days, and the 13 leap seconds until then
EPOCH_GNSS: Final = 8761 * 86_400 + 13
#: TimestampIts has 42 bits
MAX_TIME_MS: Final = 2**42 - 1
GENERATION_DELTA: Final = 65_536  #: generationDeltaTime is TimestampIts modulo this [ms]


def from_gnss(time: float) -> int:
    """Return the TimestampIts [ms] of a GNSS time [s since 1980-01-06, no leap seconds], rounded to the nearest."""
    return round(1000.0 * (time - EPOCH_GNSS))


def require_time(time_ms: int) -> int:
    """Return a TimestampIts [ms] that a message can carry; raises ValueError for another."""
    if not 0 <= time_ms <= MAX_TIME_MS:
        raise ValueError(f"TimestampIts: expected 0 to {MAX_TIME_MS} ms, got {time_ms}")
    return time_ms


def unfold(remainder: int, modulus: int, now_ms: int) -> int:
    """Return the time that has a remainder and is nearest to `now_ms`, but not before the epoch; of two, the earlier.

    A message carries the remainder of its TimestampIts [ms] only. That of the receiver is ahead by the transport, and
    off by what the two clocks differ.
    """
    ahead = (remainder - now_ms) % modulus
    nearest = now_ms + (ahead if ahead < modulus - ahead else ahead - modulus)
    return nearest if nearest >= 0 else nearest + modulus
