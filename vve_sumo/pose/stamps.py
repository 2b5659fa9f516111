"""Converts the kernel's time stamps, which are of the wall clock, to the monotonic clock.

It knows two clocks; it must not know sockets. The wall clock may be set or slewed at any instant, also between a stamp
and its reading. A stamp is used only if the wall clock ran evenly, check by check, from before the stamp was given
until after it was read. Otherwise the time of reading counts as arrival: later than the true one, which is the safe
side.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

WALL_STEP: Final = 0.002  #: a wall clock that moved by more against the monotonic one was set [s]
WALL_SLEW: Final = 1e-3  #: largest slew of the wall clock: NTP's 500 ppm, and as much again


def wall_ahead() -> float:
    """Wall clock minus monotonic clock [s]: the fastest of three readings, as one may be interrupted."""
    looks = []
    for _ in range(3):
        before = time.monotonic()
        wall = time.time()
        after = time.monotonic()
        looks.append((after - before, wall - 0.5 * (before + after)))
    return min(looks)[1]


class Stamps:
    """Dates portions read from one queue: call `begin` before and `dated` after every read, even of an empty queue."""

    def __init__(self, ahead: Callable[[], float] = wall_ahead, now: Callable[[], float] = time.monotonic) -> None:
        self._ahead, self._now = ahead, now
        self._last = self._look()
        self._was_set = False  # whether the wall clock was set since before the oldest stamp in the queue

    def begin(self) -> None:
        """Compare the clocks before reading."""
        self._was_set |= self._set_since_last()

    def dated(self, stamped: list[tuple[float, bytes]], emptied: bool) -> list[tuple[float, bytes]]:
        """Return the portions with their times of arrival; a stamp of NaN is none.

        `emptied` says that nothing was left in the queue: the next portion was stamped after `begin`.
        """
        set_meanwhile = self._set_since_last()
        self._was_set |= set_meanwhile
        now, ahead = self._last
        moments = [(now if self._was_set else stamp - ahead, data) for stamp, data in stamped]
        if emptied:
            self._was_set = set_meanwhile
        return [(moment if moment <= now else now, data) for moment, data in moments]

    def _look(self) -> tuple[float, float]:
        ahead = self._ahead()
        return self._now(), ahead

    def _set_since_last(self) -> bool:
        """Compare the clocks; whether their difference has changed since the last comparison."""
        (then, before), self._last = self._last, self._look()
        now, ahead = self._last
        return not abs(ahead - before) <= WALL_STEP + WALL_SLEW * (now - then)
