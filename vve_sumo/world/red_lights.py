"""Tells when an ego passes a stop line on red, by what SUMO shows. Knows no path and no controller."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import libsumo

from vve_sumo.values import Pose

#: letters at which no vehicle may pass the line: red, and red with yellow
RED: Final = frozenset("ru")
#: lines of a signal that is farther from the front bumper than this are not looked at [m]
REACH: Final = 100.0


class _Line(NamedTuple):
    """A stop line with the letters of its ways."""

    x: float  #: of its middle, map [m]
    y: float
    cos: float  #: of the lane's heading
    sin: float
    half: float  #: of its width [m]
    ways: Sequence[tuple[int, tuple[str, str]]]  #: index of the letter; edges before and after


class RedLights:
    """The stop lines of all signals of the network that SUMO runs."""

    def __init__(self) -> None:
        """Read them from SUMO; raises SUMO's errors."""
        self._lines: dict[str, list[_Line]] = {name: _lines(name) for name in libsumo.trafficlight.getIDList()}

    def passed(self, before: Pose, after: Pose, route: Sequence[str], shown: Mapping[str, str]) -> str:
        """Return the signal whose line a front bumper passed on red between two poses; empty for none.

        `shown` are the signals' states in that time. Of the ways from the line's lane that count which the `route`
        takes; where it takes none of them, all must be red.
        """
        for name, lines in self._lines.items():
            if not lines or math.hypot(lines[0].x - after.x, lines[0].y - after.y) > REACH:
                continue
            for line in lines:
                if _crosses(line, before, after) and _is_red(line, route, shown.get(name, "")):
                    return name
        return ""


def _lines(name: str) -> list[_Line]:
    ways: dict[str, list[tuple[int, tuple[str, str]]]] = {}
    for index, links in enumerate(libsumo.trafficlight.getControlledLinks(name)):
        for incoming, outgoing, _via in links:
            edges = libsumo.lane.getEdgeID(incoming), libsumo.lane.getEdgeID(outgoing)
            if not edges[0].startswith(":"):  # a way of pedestrians
                ways.setdefault(incoming, []).append((index, edges))
    found = []
    for lane, own in ways.items():
        (x0, y0), (x, y) = libsumo.lane.getShape(lane)[-2:]
        heading = math.atan2(y - y0, x - x0)
        found.append(_Line(x, y, math.cos(heading), math.sin(heading), 0.5 * libsumo.lane.getWidth(lane), own))
    return found


def _crosses(line: _Line, before: Pose, after: Pose) -> bool:
    behind = (before.x - line.x) * line.cos + (before.y - line.y) * line.sin
    beyond = (after.x - line.x) * line.cos + (after.y - line.y) * line.sin
    across = (after.y - line.y) * line.cos - (after.x - line.x) * line.sin
    return behind < 0.0 <= beyond and abs(across) <= line.half


def _is_red(line: _Line, route: Sequence[str], state: str) -> bool:
    pairs = set(pairwise(route))
    indices = [index for index, edges in line.ways if edges in pairs] or [index for index, _edges in line.ways]
    letters = [state[index] for index in indices if index < len(state)]
    return bool(letters) and all(letter in RED for letter in letters)
