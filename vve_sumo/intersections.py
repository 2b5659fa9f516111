"""Defines the lanes of an intersection with signals. Knows neither SUMO's files nor messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

LaneUse = Literal["vehicle", "bicycle", "pedestrian"]


@dataclass(frozen=True, slots=True)
class IntersectionLane:
    """A lane that leads to an intersection or away from it."""

    id: str  #: SUMO's
    edge: str  #: SUMO's, which lanes beside each other share
    use: LaneUse  #: who alone may use it; `vehicle` where several may
    points: tuple[tuple[float, float], ...]  #: of its middle, along its direction, map [m]
    width: float  #: [m]


@dataclass(frozen=True, slots=True)
class IntersectionLink:
    """A way across the intersection, for which a signal is."""

    index: int  #: of its letter in the signal's state
    incoming: str  #: id of the lane before it
    outgoing: str  #: id of the lane after it
    direction: str  #: SUMO's letter: s straight, l and L left, r and R right, t around


@dataclass(frozen=True, slots=True)
class Intersection:
    """All that one signal controls."""

    signal: str  #: SUMO's id
    incoming: tuple[IntersectionLane, ...]
    outgoing: tuple[IntersectionLane, ...]
    links: tuple[IntersectionLink, ...]  #: by rising index


@dataclass(frozen=True, slots=True)
class SignalPhase:
    """What a signal shows now."""

    state: str  #: SUMO's letter for each of its links
    remaining: float  #: time for which it will show this at least [s]
    #: what it will show then, and for how long at least [s], as far as its program is fixed
    coming: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class LinkShow:
    """What one link is shown over a time that begins now or later."""

    letter: str  #: SUMO's, of the signal's state
    begin: float  #: earliest, from now [s]
    end: float  #: earliest, from now [s]


def shows(phase: SignalPhase, index: int) -> Sequence[LinkShow]:
    """Return what the link of a letter is shown from now on, each time to the next other letter; [] for no letter."""
    found: list[LinkShow] = []
    begin = 0.0
    for state, lasts in ((phase.state, phase.remaining), *phase.coming):
        if index >= len(state):
            return []
        end = begin + lasts
        if found and found[-1].letter == state[index]:
            found[-1] = LinkShow(state[index], found[-1].begin, end)
        else:
            found.append(LinkShow(state[index], begin, end))
        begin = end
    return found
