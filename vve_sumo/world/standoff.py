"""Ends a standoff: ego and a driver stand nose to nose, each in the other's way, and SUMO's driver never backs up.

Plain geometry and times; must not know SUMO.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from vve_sumo.geometry import Box, overlap

#: A driver who can't go on because of the ego, and the ego because of him, is taken off the street after so long [s].
#: Longer than a left turn waits inside a junction for a phase of a signal.
MAX_WAIT: Final = 60.0

#: Slower is standing [m/s]: a measured pose is never quite at rest.
STANDING: Final = 0.2

#: What lies so far ahead of a body [m], and so far beside that [m], is in its way. A driver who meets the ego on the
#: wrong side stops 7.4 m before it, for SUMO takes every body to lie behind its front as the lane goes; and SUMO's
#: drivers need their whole lane, which is some 0.8 m wider than they are on either side.
MAX_DISTANCE_AHEAD: Final = 8.0
MAX_DISTANCE_BESIDE: Final = 0.8


class Standoff:
    """Since when each driver has been in a standoff with the ego."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}

    def over(self, time: float, ego: Box, speed: float, drivers: Iterable[tuple[str, Box]]) -> list[str]:
        """Return the drivers whose standoff with the ego has lasted too long at a drive time [s].

        `speed` [m/s] is the ego's; `drivers` are those near it that stand, with the ground that they cover.
        """
        if abs(speed) >= STANDING:
            self._since.clear()
            return []
        way = _way(ego)
        opposed = {name for name, box in drivers if overlap(way, box) and overlap(_way(box), ego)}
        self._since = {name: self._since.get(name, time) for name in sorted(opposed)}
        return [name for name, since in self._since.items() if time - since >= MAX_WAIT]


def _way(body: Box) -> Box:
    """Return the ground on which nothing may be if the body is to go on."""
    wide = Box(body.x, body.y, body.heading, body.length, body.width + 2.0 * MAX_DISTANCE_BESIDE)
    return wide.stretched(MAX_DISTANCE_AHEAD)
