"""Detects a standoff: the ego and a SUMO driver stand in each other's way, and SUMO's driver never backs up.

Plain geometry and times; must not know SUMO.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from vve_sumo.geometry import Box, overlap

#: A standoff ends after this time [s]: the driver is taken off the road. The time is longer than a left turn waits
#: inside a junction for a phase of a signal.
MAX_WAIT: Final = 60.0

#: Below this speed a body stands [m/s]; the speed of a measured pose is never quite 0.
STANDING: Final = 0.2

#: A body's way reaches so far ahead of it [m], and so far to either side [m]. A driver who meets the ego on the wrong
#: side stops 7.4 m before it, because SUMO assumes that every body lies behind its front along the lane. SUMO's drivers
#: need their whole lane, which is some 0.8 m wider than the car on either side.
MAX_DISTANCE_AHEAD: Final = 8.0
MAX_DISTANCE_BESIDE: Final = 0.8


class Standoff:
    """Keeps since when each driver has been in a standoff with the ego."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}

    def over(self, time: float, ego: Box, speed: float, drivers: Iterable[tuple[str, Box]]) -> list[str]:
        """Return the drivers whose standoff with the ego has lasted too long at a drive time [s].

        `speed` [m/s] is the ego's; `drivers` are the standing ones near the ego, with their boxes.
        """
        if abs(speed) >= STANDING:
            self._since.clear()
            return []
        way = _way(ego)
        opposed = {name for name, box in drivers if overlap(way, box) and overlap(_way(box), ego)}
        self._since = {name: self._since.get(name, time) for name in sorted(opposed)}
        return [name for name, since in self._since.items() if time - since >= MAX_WAIT]


def _way(body: Box) -> Box:
    """Return the box that must be free for the body to go on."""
    wide = Box(body.x, body.y, body.heading, body.length, body.width + 2.0 * MAX_DISTANCE_BESIDE)
    return wide.stretched(MAX_DISTANCE_AHEAD)
