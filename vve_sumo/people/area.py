"""Where a person is shown on the virtual road: a circle that holds the estimated one, and that moves and never jumps.

An estimate jumps with every position that comes, and its circle grows until the next. A body that did so would touch
cars that stand, and no sensor could track it. Knows no virtual road.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.people.track import Estimate

#: How fast the circle gets smaller [m/s]: much less within a phone's period than it grows in it.
SHRINK_RATE: Final = 0.3


class Circle(NamedTuple):
    """A circle in the field's map."""

    x: float  #: of the middle [m]
    y: float  #: of the middle [m]
    radius: float  #: [m]


class ShownArea:
    """The circle of one person, which follows the estimate no faster than the person can go."""

    def __init__(self, max_speed: float) -> None:
        self._max_speed = max_speed
        self._shown: Circle | None = None
        self._time = math.nan

    def step(self, now: float, estimate: Estimate) -> Circle:
        """Return the circle at drive time `now` [s], which never falls; the estimated circle lies inside it."""
        before, step = self._shown, now - self._time
        self._time = now
        if before is None:
            self._shown = Circle(estimate.x, estimate.y, estimate.radius)
            return self._shown
        off_x, off_y = estimate.x - before.x, estimate.y - before.y
        way, reach = math.hypot(off_x, off_y), self._max_speed * step
        share = 1.0 if way <= reach else reach / way
        x, y = before.x + share * off_x, before.y + share * off_y
        needed = estimate.radius + math.hypot(estimate.x - x, estimate.y - y)
        self._shown = Circle(x, y, max(needed, before.radius - SHRINK_RATE * step))
        return self._shown

    def forget(self) -> None:
        """Begin anew with the next estimate."""
        self._shown = None
