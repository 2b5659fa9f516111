"""Whether a person is on the virtual road, and how: a state machine by age and uncertainty, with hysteresis.

Every transition is decided in this file. A state gets worse at once. It gets better only when the limits of the better
state, less a margin, have held for a while. Knows neither places nor messages.
"""

from __future__ import annotations

import enum
import math
from typing import Final

from vve_sumo.people.setup import PresenceLimits

#: Share of its limits that a better state must keep to before it is entered.
BETTER_SHARE: Final = 0.8
#: For how long it must do so [s]: as long as a phone's period, so that a state does not change with every position.
RECOVERY_TIME: Final = 1.0


class Presence(enum.IntEnum):
    """How a person is on the virtual road; the larger, the worse."""

    EXACT = 0  #: as a body
    AREA = 1  #: as a body that is larger by the uncertainty of its place
    WARNING = 2  #: as an area, and everybody is told
    GONE = 3  #: not at all


def classify(limits: PresenceLimits, age: float, radius: float, share: float = 1.0) -> Presence:
    """Return the state for an age [s] and a radius of uncertainty [m], which may be infinite or NaN.

    Every limit is taken times `share`.
    """
    if not (age <= share * limits.lost_age and radius <= share * limits.lost):
        return Presence.GONE
    if not (age <= share * limits.warning_age and radius <= share * limits.warning):
        return Presence.WARNING
    return Presence.EXACT if radius <= share * limits.exact else Presence.AREA


class PresenceMachine:
    """The state of one person, who is gone at first."""

    def __init__(self, limits: PresenceLimits) -> None:
        self._limits = limits
        self.state = Presence.GONE
        self._better_since = math.inf  # since when a better state would hold [s]
        self._best = Presence.GONE  # that would have held all that time

    def step(self, now: float, age: float, radius: float) -> Presence:
        """Return the state at drive time `now` [s], which never falls; age [s] and radius [m] as in `classify`."""
        worst = classify(self._limits, age, radius)
        if worst > self.state:
            self.state = worst
        better = classify(self._limits, age, radius, BETTER_SHARE)
        if better >= self.state:
            self._better_since, self._best = math.inf, Presence.EXACT
            return self.state
        if self._better_since == math.inf:
            self._better_since, self._best = now, better
        self._best = max(self._best, better)
        if now - self._better_since >= RECOVERY_TIME:
            self.state, self._better_since, self._best = self._best, math.inf, Presence.EXACT
        return self.state
