"""Decides when the computer is calm enough for a drive to begin: a second without a late wake-up, or too long without.

Takes times and knows no clock, no process and no operator.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from vve_sumo.timing import MAX_STEP_INTERVAL, MIN_STEP_INTERVAL, PERIOD

CALM_TIME: Final = 1.0  #: time that must pass without a late wake-up [s]
#: a later wake-up counts as late [s]. While it waits for a late setpoint, the gateway may itself be woken 10 ms late
#: before its own clock stops the car; this is half of it
MAX_WAKE_UP_LATENESS: Final = 0.005
CALM_TIMEOUT: Final = 30.0  #: time without a calm second after which nobody waits for one any more [s]


def gateway_lateness(before: float, step: float, handed: float) -> float:
    """Return how late the gateway was woken for a step [s].

    before, step: times of the step before and of this one [s]. handed: when the newest setpoint was sent to it [s], NaN
    for never. A gateway steps when a setpoint has come, and without one when it has waited long enough for it.
    """
    if before < handed <= step:
        return max(0.0, step - max(handed, before + MIN_STEP_INTERVAL * PERIOD))
    return max(0.0, step - before - MAX_STEP_INTERVAL * PERIOD)


class JitterWait:
    """The wait for a second without a late wake-up; once over, it is over for good."""

    def __init__(self) -> None:
        self._wake_ups: deque[tuple[float, float]] = deque()  # of the last second: when, and how late [s]
        self._begun = math.nan  # when the first was observed [s]
        self._last_news = ""  # the last news
        self.waits = True  #: whether to wait still
        self.given_up = False  #: the wait is over because CALM_TIMEOUT has passed

    def observe(self, now: float, late: float) -> None:
        """Take a wake-up at time `now` [s], which does not run backwards, that was `late` [s]."""
        if not self._begun <= now:
            self._begun = now
        self._wake_ups.append((now, late))
        while self._wake_ups[0][0] <= now - CALM_TIME:
            self._wake_ups.popleft()
        calm = now - self._begun >= CALM_TIME and self.worst <= MAX_WAKE_UP_LATENESS
        self.given_up |= self.waits and not calm and now - self._begun >= CALM_TIMEOUT
        self.waits &= not calm and not self.given_up

    @property
    def worst(self) -> float:
        """How late the worst wake-up of the last second was [s]; 0 before the first."""
        return max((late for _, late in self._wake_ups), default=0.0)

    @property
    def worst_text(self) -> str:
        """How late the worst wake-up of the last second was, in words; empty while none was late."""
        return (
            f"worst wake-up {1e3 * self.worst:.0f} ms in the last second" if self.worst > MAX_WAKE_UP_LATENESS else ""
        )

    def news(self) -> str:
        """Return a line for the operator, once for the begin of the wait and once where it was given up; else empty."""
        news = ""
        if self.given_up:
            news = f"no calm second in {CALM_TIMEOUT:.0f} s: the simulated vehicle drives all the same"
        elif self.waits and self.worst_text and not self._last_news:
            news = f"waiting for a calm second: {self.worst_text}; close other programs"
        if news in ("", self._last_news):
            return ""
        self._last_news = news
        return news
