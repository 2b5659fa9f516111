"""The ways along which road users are expected to go on, and where each of them is on its way.

A way is a line in the map. An actor goes along it at its present speed and keeps its present distance beside it and
its present turn against it. On a lane's way its body is a chord: SUMO puts the front and the rear of a vehicle on the
lane, so that the middle of a long one is off the lane in a bend. On a way that the middle drove, the middle is on it.
Knows actors' boxes over time; neither the ego nor what two predictions have in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.geometry import Boxes
from vve_sumo.metrics.tracking import wrapped
from vve_sumo.values import Floats

Indices = NDArray[np.int64]

#: of the samples of a way [m]
SPACING: Final = 1.0
#: an actor that is this much farther from its last place than its speed explains has been moved, not driven [m]
MAX_JUMP: Final = 5.0


class WayLine(NamedTuple):
    """A polyline in driving direction, map [m]."""

    x: Floats
    y: Floats


class WayPlaces(NamedTuple):
    """Where actors are on their ways: one entry a row of the table of actors."""

    way: Indices  #: number of the way
    along: Floats  #: arc length on it [m]: of the middle between the chord's ends
    chord: Floats  #: length of the body whose front and rear keep to the way [m]; 0 where its middle does
    beside: Floats  #: front and rear, or middle, from the way [m], left positive
    turn: Floats  #: heading of the box minus the chord's, or the way's [rad]

    def select(self, rows: Any) -> WayPlaces:
        """Return the places of these rows."""
        return WayPlaces(*(column[rows] for column in self))


class WayPoints(NamedTuple):
    """Points of ways."""

    x: Floats  #: map [m]
    y: Floats  #: map [m]
    heading: Floats  #: of the way [rad], counter-clockwise from the map's +x, continuous along it


class Bodies(NamedTuple):
    """Bodies on ways."""

    x: Floats  #: of the middle, map [m]
    y: Floats  #: likewise
    heading: Floats  #: [rad]
    front_way: Floats  #: heading of the way at the body's front [rad]
    rear_way: Floats  #: and at its rear


@dataclass(frozen=True, slots=True)
class Ways:
    """Lines as one table of samples, SPACING apart, one way after the other; straight on beyond both ends."""

    x: Floats  #: map [m]
    y: Floats  #: map [m]
    heading: Floats  #: [rad], continuous along each way
    first: Indices  #: number of each way's first sample
    count: Indices  #: of each way's samples, at least 2

    @classmethod
    def from_lines(cls, lines: Sequence[WayLine]) -> Ways:
        """Sample lines of at least two different points each."""
        sampled = [_sampled(line) for line in lines]
        count = np.array([len(way.x) for way in sampled], np.int64)
        first = np.cumsum(count) - count
        x, y, heading = (np.concatenate([way[i] for way in sampled] or [np.zeros(0)]) for i in range(3))
        return cls(x, y, heading, first, count)

    def with_lines(self, lines: Sequence[WayLine]) -> Ways:
        """Return these ways and, after them, those of more lines."""
        more = Ways.from_lines(lines)
        return Ways(
            np.concatenate((self.x, more.x)),
            np.concatenate((self.y, more.y)),
            np.concatenate((self.heading, more.heading)),
            np.concatenate((self.first, more.first + len(self.x))),
            np.concatenate((self.count, more.count)),
        )

    def at(self, way: Indices, along: Floats) -> WayPoints:
        """Return the points of ways at arc lengths [m]."""
        place = along / SPACING
        row = np.clip(np.floor(place).astype(np.int64), 0, self.count[way] - 2)
        share, row = place - row, row + self.first[way]
        x, y, heading = (column[row] for column in (self.x, self.y, self.heading))
        turned = np.clip(share, 0.0, 1.0) * (self.heading[row + 1] - heading)
        return WayPoints(x + share * (self.x[row + 1] - x), y + share * (self.y[row + 1] - y), heading + turned)

    def bodies(self, places: WayPlaces, along: Floats) -> Bodies:
        """Return bodies at these places when they are at arc lengths `along` [m]."""
        front, rear = self.at(places.way, along + 0.5 * places.chord), self.at(places.way, along - 0.5 * places.chord)
        front_x, front_y = _beside(front, places.beside)
        rear_x, rear_y = _beside(rear, places.beside)
        chord = np.arctan2(front_y - rear_y, front_x - rear_x)
        heading = np.where(places.chord > 0.0, chord, front.heading) + places.turn
        back = 0.5 * places.chord
        x, y = front_x - back * np.cos(heading), front_y - back * np.sin(heading)
        return Bodies(x, y, heading, front.heading, rear.heading)

    def place(self, way: Indices, along: Floats, chord: Floats, boxes: Boxes) -> WayPlaces:
        """Return the places of boxes that are beside their ways at these arc lengths [m]."""
        front = self.at(way, along + 0.5 * chord)
        x, y = boxes.x + 0.5 * chord * np.cos(boxes.heading), boxes.y + 0.5 * chord * np.sin(boxes.heading)
        beside = (y - front.y) * np.cos(front.heading) - (x - front.x) * np.sin(front.heading)
        straight = WayPlaces(way, along, chord, beside, np.zeros(len(way)))
        return straight._replace(turn=wrapped(boxes.heading - self.bodies(straight, along).heading))


class PlacedWays(NamedTuple):
    """Ways, and where the rows of the table of actors are on them."""

    ways: Ways
    places: WayPlaces


def recorded_ways(time: Floats, actor: Indices, boxes: Boxes, beyond: float) -> PlacedWays:
    """Return the ways that actors drove in the whole record, and where each row is on its own.

    A way goes on straight for `beyond` [s] at the actor's greatest speed after its last row, along that row's heading.
    time [s], actor (a number) and boxes: a row an actor and tick, in any order. An actor that was put elsewhere, which
    SUMO does with one that is stuck, begins another way there.
    """
    order = np.lexsort((time, actor))
    x, y, speed = boxes.x[order], boxes.y[order], boxes.speed[order]
    step = np.hypot(np.diff(x, prepend=x[:1]), np.diff(y, prepend=y[:1]))
    new = np.diff(actor[order], prepend=-1) != 0
    new |= step > MAX_JUMP + 2.0 * np.abs(speed) * np.diff(time[order], prepend=time[order][:1])
    starts = np.flatnonzero(new)
    driven = np.cumsum(np.where(new, 0.0, step))
    way = np.cumsum(new) - 1
    along = driven - driven[starts][way] if len(starts) else driven
    lines = []
    for rows in np.split(np.arange(len(order)), starts[1:]) if len(starts) else []:
        last = rows[-1]
        ahead = max(SPACING, beyond * float(np.abs(speed[rows]).max()))
        heading = boxes.heading[order[last]] + (np.pi if speed[last] < 0.0 else 0.0)
        lines.append(
            WayLine(
                np.append(x[rows], x[last] + ahead * np.cos(heading)),
                np.append(y[rows], y[last] + ahead * np.sin(heading)),
            )
        )
    ways = Ways.from_lines(lines)
    back = np.argsort(order)
    return PlacedWays(ways, ways.place(way[back], along[back], np.zeros(len(back)), boxes))


def _beside(point: WayPoints, left: Floats) -> tuple[Floats, Floats]:
    return point.x - left * np.sin(point.heading), point.y + left * np.cos(point.heading)


def _sampled(line: WayLine) -> WayPoints:
    """Return points SPACING apart on a line and, straight on, the first one past its end."""
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(line.x), np.diff(line.y)))))
    last = int(np.searchsorted(driven, driven[-1])) - 1
    beyond = SPACING / (driven[-1] - driven[last])
    x, y = (np.append(column, column[-1] + beyond * (column[-1] - column[last])) for column in line)
    at = SPACING * np.arange(max(2, int(np.ceil(driven[-1] / SPACING)) + 1))
    driven = np.append(driven, driven[-1] + SPACING)
    x, y = np.interp(at, driven, x), np.interp(at, driven, y)
    return WayPoints(x, y, np.unwrap(np.arctan2(np.gradient(y), np.gradient(x))))
