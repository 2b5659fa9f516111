"""Judges whether a driver could have avoided the overlap with the ego: by its own way, with its brakes applied in time.

The driver's own way is driven again: from the moment on from which the ego lay across it without a pause, the
driver goes on for the time of reaction and brakes then. An overlap was avoidable if then they never touch.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final, NamedTuple

from vve_sumo.geometry import Box, overlap

REACTION: Final = 1.0  #: [s]
DECELERATION: Final = 4.5  #: [m/s2]
REMEMBERED: Final = 25.0  #: [s]
SPACING: Final = 0.25  #: of the places on the way that are looked at [m]


class Moment(NamedTuple):
    """Ego and one other at one time."""

    time: float  #: [s]
    ego: Box
    other: Box
    speed: float  #: of the other along its heading [m/s]


class Verdict(NamedTuple):
    """What is said of an overlap."""

    avoidable: bool
    lay: float  #: how long the ego had lain across the other's way [s]
    speed: float  #: of the other when the ego came to lie there [m/s]
    impact: float  #: of the other at the overlap [m/s]


class Memory:
    """The last moments of everybody near the ego."""

    def __init__(self, period: float) -> None:
        self._length = round(REMEMBERED / period)
        self._of: dict[str, deque[Moment]] = {}

    def keep(self, time: float, ego: Box, others: Sequence[tuple[str, Box, float]]) -> None:
        """Remember this moment; who is not there any more is forgotten."""
        here = {name for name, _, _ in others}
        for name in [name for name in self._of if name not in here]:
            del self._of[name]
        for name, box, speed in others:
            self._of.setdefault(name, deque(maxlen=self._length)).append(Moment(time, ego, box, speed))

    def of(self, name: str) -> list[Moment]:
        """Return what is known of one, oldest first."""
        return list(self._of.get(name, ()))


def judge(moments: Sequence[Moment]) -> Verdict:
    """Judge an overlap that begins at the last of the moments."""
    way = _way(moments)
    begun = len(moments) - 1
    while begun > 0 and _across(moments[begun - 1].ego, way[begun - 1 :]):
        begun -= 1
    first, last = moments[begun], moments[-1]
    avoidable = not _touches(moments[begun:], [s for s, _ in way][begun:])
    return Verdict(avoidable, last.time - first.time, first.speed, last.speed)


def _way(moments: Sequence[Moment]) -> list[tuple[float, Box]]:
    """Distance driven and place at each moment."""
    driven, found = 0.0, [(0.0, moments[0].other)]
    for before, now in pairwise(moments):
        driven += math.hypot(now.other.x - before.other.x, now.other.y - before.other.y)
        found.append((driven, now.other))
    return found


def _across(ego: Box, ahead: Sequence[tuple[float, Box]]) -> bool:
    """Whether the ego covers a part of what the other has still to drive."""
    last = -math.inf
    for s, box in ahead:
        if s - last >= SPACING or box is ahead[-1][1]:
            last = s
            if overlap(ego, box):
                return True
    return False


def _touches(moments: Sequence[Moment], driven: Sequence[float]) -> bool:
    """Whether the other touches the ego if it brakes after the time of reaction, until it has come to rest.

    What the ego would have done after the overlap nobody knows: it goes on as it did.
    """
    first, last = moments[0], moments[-1]
    period = last.time - moments[-2].time if len(moments) > 1 else 0.0
    away = (last.ego.x - moments[-2].ego.x, last.ego.y - moments[-2].ego.y) if len(moments) > 1 else (0.0, 0.0)
    s, speed, i, k = driven[0], first.speed, 0, 0
    while True:
        ahead = max(k - len(moments) + 1, 0)
        ego = moments[min(k, len(moments) - 1)].ego
        if overlap(replace(ego, x=ego.x + ahead * away[0], y=ego.y + ahead * away[1]), moments[i].other):
            return True
        k += 1
        if k * period <= REACTION and k < len(moments):
            s, speed = driven[k], moments[k].speed
        else:
            slower = max(speed - DECELERATION * period, 0.0)
            s, speed = s + 0.5 * (speed + slower) * period, slower
        if k >= len(moments) and (speed == 0.0 or moments[i] is last):
            return False
        while i + 1 < len(driven) and driven[i + 1] <= s + 1e-9:
            i += 1
