"""The kernel's stamps, which are of the wall clock, as moments of the monotonic clock.

Knows two clocks; must not know sockets. The wall clock may be set or slewed at any instant, between a stamp and its
reading, too. A stamp is believed only where the wall clock ran on evenly, look by look, from before it was given until
after it was read; else the portion is said to come when it is read: later than it did, which is the safe side.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

WALL_STEP: Final = 0.002  #: a wall clock that moved by more against the monotonic one was set [s]
WALL_SLEW: Final = 1e-3  #: beside what NTP slews it: 500 ppm, and as much again


def wall_ahead() -> float:
    """Wall clock minus monotonic clock [s]: the closest of three looks, for one may be interrupted."""
    looks = []
    for _ in range(3):
        before = time.monotonic()
        wall = time.time()
        after = time.monotonic()
        looks.append((after - before, wall - 0.5 * (before + after)))
    return min(looks)[1]


class Stamps:
    """Dates what is read from one queue; `begin` before it is read, `dated` after, every time, read or not."""

    def __init__(self, ahead: Callable[[], float] = wall_ahead, now: Callable[[], float] = time.monotonic) -> None:
        self._ahead, self._now = ahead, now
        self._last = self._look()
        self._was_set = False  # the wall clock, since before the oldest stamp that can be in the queue

    def begin(self) -> None:
        """Look at the clocks before reading."""
        self._was_set |= self._set_since_last()

    def dated(self, stamped: list[tuple[float, bytes]], emptied: bool) -> list[tuple[float, bytes]]:
        """Return the portions with the moments they came; a stamp of NaN is none.

        `emptied` says that nothing was left in the queue: what comes next was stamped after `begin`.
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
        """Look at the clocks; whether the wall clock's distance is another than at the last look."""
        (then, before), self._last = self._last, self._look()
        now, ahead = self._last
        return not abs(ahead - before) <= WALL_STEP + WALL_SLEW * (now - then)
