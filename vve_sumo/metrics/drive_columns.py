"""Columns of a drive: how the ego moved, what was ahead, what was predicted, and the rows of the actors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from vve_sumo.geometry import Boxes
from vve_sumo.metrics.predicted_ways import Indices
from vve_sumo.values import Floats


@dataclass(frozen=True, slots=True)
class Motion:
    """How the rear axle moved: one entry a tick, NaN where nobody knows."""

    true: bool  #: whether this is the truth, which only a simulated vehicle has; else the pipeline's estimate
    time: Floats  #: drive time [s]
    x: Floats  #: map [m]
    y: Floats  #: map [m]
    heading: Floats  #: [rad] counter-clockwise from the map's +x
    speed: Floats  #: along the heading, forward positive [m/s]
    acceleration: Floats  #: rate of change of speed [m/s2]


class LeadMotion(NamedTuple):
    """The lead vehicle's own size and motion, one entry a tick; NaN where there is none."""

    length: Floats  #: [m]
    speed: Floats  #: along the path, away from the ego positive [m/s]
    acceleration: Floats  #: likewise [m/s2]


class Conflict(NamedTuple):
    """What ego and actors come to if all go on along their paths at their present speed: one entry a tick."""

    time: Floats  #: until the ego's body meets an actor's, the least of all actors [s]; 0 at contact, NaN for none
    deceleration: Floats  #: constant one of the ego that avoids that, the greatest of all actors [m/s2], capped
    actor: list[str]  #: that it would meet first, empty for none


class ActorRows(NamedTuple):
    """The rows of the table of actors that belong to a tick of the record."""

    rows: Indices  #: numbers of the rows in the table
    at: Indices  #: index of the tick
    code: Indices  #: number of the actor, an index of `names`
    names: list[str]
    boxes: Boxes  #: a row each
