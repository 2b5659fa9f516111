"""Defines the ways across a junction and which of them go first. Knows neither SUMO's files nor traffic."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Control(enum.IntEnum):
    """What tells a way across a junction to give way."""

    NONE = 0  #: nobody goes first
    YIELD = 1  #: a minor road, or a turn across oncoming traffic
    STOP = 2  #: a stop sign
    ALL_WAY_STOP = 3  #: a stop sign, as everybody else has one
    EQUAL = 4  #: equal roads: who comes from the side that the rules name goes first
    SIGNAL = 5  #: a signal, at whose green others may go first: a turn across oncoming traffic


@dataclass(frozen=True, slots=True)
class JunctionWay:
    """A way across a junction, with the lane before it and the begin of the lane after it."""

    incoming: str  #: id of the lane before it, SUMO's
    outgoing: str  #: id of the lane after it, SUMO's
    control: Control
    points: tuple[tuple[float, float], ...]  #: of its middle, in driving direction, map [m]
    line: float  #: where along the points the lane before it ends, at its stop line [m]
    exit: float  #: where along the points the lane after it begins [m]
    width: float  #: of the lane before it [m]
    speed_limit: float  #: on the lanes before it, the greatest [m/s]
    speed_across: float  #: allowed inside the junction, the least [m/s]
    ends: bool  #: whether nobody comes from beyond the first point: a dead end
    prior: tuple[int, ...]  #: rows of the ways of the junction that go first


@dataclass(frozen=True, slots=True)
class Junction:
    """A junction at which somebody has to give way."""

    id: str  #: SUMO's
    ways: tuple[JunctionWay, ...]  #: all for vehicles
