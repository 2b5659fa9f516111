"""How a receiver on the ego hears the radio of an actor: what is between them, and the power that comes.

Knows bodies, walls and the arithmetic of propagation; knows no message. Draws from each station's own stream.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vve_sumo.body_kinds import BODY_KINDS, PERSONS
from vve_sumo.sensors.street import Walls
from vve_sumo.v2x.propagation import DECORRELATION, SHADOWING, Sight, body_loss, path_loss
from vve_sumo.values import Actors

#: a person carries the radio at this share of the height; vehicles and riders have it on top: assumptions
CARRIED_AT: Final = 0.6

_Lengths: TypeAlias = float | NDArray[np.float64]


class Antenna(NamedTuple):
    """The place of an antenna."""

    x: float  #: map [m]
    y: float  #: map [m]
    z: float  #: above the ground [m]


class Obstruction(NamedTuple):
    """What is between two antennas."""

    sight: Sight
    height: float = 0.0  #: of the highest body between them [m], where the sight is BODY


@dataclass(slots=True)
class Fading:
    """The part of a station's loss that chance decides; it changes as the antennas move."""

    generator: np.random.Generator
    shadowing: float = math.nan  #: a number of the standard normal distribution; NaN before the first
    blocked: float = 0.0  #: likewise, of the body in between
    x: float = 0.0  #: the station's place relative to the receiver at the last message, map [m]
    y: float = 0.0
    behind: bool = False  #: whether a body was in between

    def at(self, x: float, y: float, *, behind: bool) -> tuple[float, float]:
        """Return both numbers at a place relative to the receiver, map [m]; a body that comes between is drawn anew."""
        fresh, body = self.generator.standard_normal(2).tolist()
        if math.isnan(self.shadowing):
            self.shadowing = fresh
        else:
            keep = math.exp(-math.hypot(x - self.x, y - self.y) / DECORRELATION)
            self.shadowing = keep * self.shadowing + math.sqrt(1.0 - keep * keep) * fresh
        if behind and not self.behind:
            self.blocked = body
        self.x, self.y, self.behind = x, y, behind
        return self.shadowing, self.blocked


def antenna_of(actors: Actors, row: int) -> Antenna:
    """Return where an actor has its antenna: in the middle of its box."""
    height = float(actors.height[row])
    carried = BODY_KINDS[actors.kind[row]] in PERSONS
    return Antenna(float(actors.x[row]), float(actors.y[row]), CARRIED_AT * height if carried else height)


class Obstacles:
    """What may be between the ego and the actors at one time. The ego itself hides nothing."""

    def __init__(self, actors: Actors, walls: Walls) -> None:
        """`walls` hide whatever is behind them: no building is as low as an antenna."""
        self._actors, self._walls = actors, walls
        headings = actors.heading.tolist()  # NumPy's cosine differs between processors
        self._cos = np.array([math.cos(one) if math.isfinite(one) else math.nan for one in headings], np.float64)
        self._sin = np.array([math.sin(one) if math.isfinite(one) else math.nan for one in headings], np.float64)

    def between(self, receiver: Antenna, sender: Antenna, row: int) -> Obstruction:
        """Return what is between a receiver and the antenna of the actor in a row, which itself hides nothing."""
        to_x, to_y = sender.x - receiver.x, sender.y - receiver.y
        if _meets_wall(receiver, to_x, to_y, self._walls):
            return Obstruction(Sight.BUILDING)
        hides = self._meets_box(receiver, to_x, to_y)
        hides[row] = False
        heights = self._actors.height[hides]
        highest = float(heights.max()) if len(heights) else 0.0
        return Obstruction(Sight.BODY, highest) if highest >= min(receiver.z, sender.z) else Obstruction(Sight.CLEAR)

    def visible(self, eye: Antenna, rows: NDArray[np.intp], own: int) -> NDArray[np.bool_]:
        """Say of the actors in some rows whether an eye of the actor in row `own` sees their middles past all others.

        A body hides what is behind it if it is as high as the eye, or as what is looked at.
        """
        actors = self._actors
        to_x, to_y = (actors.x[rows] - eye.x)[:, np.newaxis], (actors.y[rows] - eye.y)[:, np.newaxis]
        hides = self._meets_box(eye, to_x, to_y)
        hides &= actors.height >= np.minimum(eye.z, actors.height[rows])[:, np.newaxis]
        hides[:, own] = False
        hides[np.arange(len(rows)), rows] = False
        seen: NDArray[np.bool_] = ~(hides.any(axis=1) | _meets_wall(eye, to_x, to_y, self._walls))
        return seen

    def _meets_box(self, start: Antenna, to_x: _Lengths, to_y: _Lengths) -> NDArray[np.bool_]:
        """Say of each actor whether the line from a place, which leads so far, goes through its box.

        Of n lines, whose lengths are n by 1, the answer is n by the actors.
        """
        actors, cos, sin = self._actors, self._cos, self._sin
        east, north = start.x - actors.x, start.y - actors.y
        # In the frame of each box: where the line begins, and its way to the other end.
        along, across = east * cos + north * sin, north * cos - east * sin
        by_along, by_across = to_x * cos + to_y * sin, to_y * cos - to_x * sin
        first, last = np.zeros(len(cos)), np.ones(len(cos))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for begin, way, half in ((along, by_along, 0.5 * actors.length), (across, by_across, 0.5 * actors.width)):
                one, other = (-half - begin) / way, (half - begin) / way
                level = way == 0.0
                enters = np.where(level, np.where(np.abs(begin) > half, 2.0, 0.0), np.minimum(one, other))
                leaves = np.where(level, 1.0, np.maximum(one, other))
                first, last = np.maximum(first, enters), np.minimum(last, leaves)
        meets: NDArray[np.bool_] = first < last
        return meets


def received_power(power: float, receiver: Antenna, sender: Antenna, found: Obstruction, fading: Fading) -> float:
    """Return the power that comes of one that is radiated, both in dBm with the antennas' gains included."""
    x, y = sender.x - receiver.x, sender.y - receiver.y
    distance = math.sqrt(x * x + y * y + (sender.z - receiver.z) ** 2)
    shadowing, blocked = fading.at(x, y, behind=found.sight is Sight.BODY)
    loss = path_loss(distance, found.sight) + SHADOWING[found.sight] * shadowing
    if found.sight is Sight.BODY:
        loss += body_loss(distance, (receiver.z, sender.z), found.height, blocked)
    return power - loss


def _meets_wall(start: Antenna, to_x: _Lengths, to_y: _Lengths, walls: Walls) -> NDArray[np.bool_]:
    """Say whether the line from a place, which leads so far, crosses a wall; of n lines, n by 1, each."""
    across = walls.along_x * to_y - walls.along_y * to_x
    east, north = walls.x - start.x, walls.y - start.y
    with np.errstate(divide="ignore", invalid="ignore"):
        # The line is start + share * to, the wall is end + part * along.
        share = (walls.along_x * north - walls.along_y * east) / across
        part = (to_x * north - to_y * east) / across
        met: NDArray[np.bool_] = (share > 0.0) & (share < 1.0) & (part >= 0.0) & (part <= 1.0)
    return np.asarray(met.any(axis=-1))
