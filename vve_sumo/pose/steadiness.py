"""Finds a receiver whose quality comes and goes: fixes refused again and again, with trusted ones between them.

A trusted fix every 0.1 s is enough for a pose that is never stale, so the trust gate alone would let a car drive on a
receiver that is wrong half of the time. Knows which fixes were refused; it must not know why, nor the fixes.
"""

from __future__ import annotations

from collections import deque
from typing import Final

WINDOW: Final = 1.0  #: over which refused fixes are counted [s]
MAX_REFUSED_SHARE: Final = 0.25  #: of the fixes within the window
MIN_REFUSED: Final = 3  #: fewer refused fixes are none too many, however few came: at 10 Hz two may be lost to noise
MAX_INTERRUPTIONS: Final = 4  #: times within the window that a refused fix came after a trusted one


class Steadiness:
    """Counts refused fixes within the window before the newest, from the first trusted one on."""

    def __init__(self) -> None:
        self._judged: deque[tuple[float, bool, bool]] = deque()  # time, refused, an interruption begins
        self._refused = self._interruptions = 0
        self._begun = self._was_refused = False

    @property
    def unsteady(self) -> bool:
        """Whether too large a share was refused, or trusted fixes were interrupted too often."""
        if self._interruptions > MAX_INTERRUPTIONS:
            return True
        return self._refused >= MIN_REFUSED and self._refused > MAX_REFUSED_SHARE * len(self._judged)

    def step(self, now: float, refused: bool) -> None:
        """Take the gate's judgement of a fix at drive time `now` [s]."""
        self._begun |= not refused
        if not self._begun:
            return
        interrupts = refused and not self._was_refused
        self._was_refused = refused
        judged = self._judged
        judged.append((now, refused, interrupts))
        self._refused += refused
        self._interruptions += interrupts
        while judged[0][0] < now - WINDOW:
            _, refused, interrupts = judged.popleft()
            self._refused -= refused
            self._interruptions -= interrupts
