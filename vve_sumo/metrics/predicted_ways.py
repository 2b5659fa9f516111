"""The ways along which road users are expected to go on, and where each of them is on its way.

A way is a line in the map. An actor goes along it at its present speed and keeps its present distance beside it and
its present turn against it. Knows actors' boxes over time; neither the ego nor what two predictions have in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.geometry import Boxes
from vve_sumo.metrics.tracking import wrapped
from vve_sumo.values import Floats

Indices = NDArray[np.int64]

#: of the samples of a way [m]
SPACING = 1.0
#: an actor that is this much farther from its last place than its speed explains has been moved, not driven [m]
MAX_JUMP = 5.0


class Line(NamedTuple):
    """A polyline in driving direction, map [m]."""

    x: Floats
    y: Floats


class Places(NamedTuple):
    """Where actors are on their ways: one entry a row of the table of actors."""

    way: Indices  #: number of the way
    along: Floats  #: arc length on it [m]
    beside: Floats  #: centre of the box from the way [m], left positive
    turn: Floats  #: heading of the box minus the way's [rad]

    def select(self, rows: Any) -> Places:
        """Return the places of these rows."""
        return Places(self.way[rows], self.along[rows], self.beside[rows], self.turn[rows])


class WayPoints(NamedTuple):
    """Points of ways."""

    x: Floats  #: map [m]
    y: Floats  #: map [m]
    heading: Floats  #: of the way [rad], counter-clockwise from the map's +x, continuous along it


@dataclass(frozen=True, slots=True)
class Ways:
    """Lines as one table of samples, SPACING apart, one way after the other; straight on beyond both ends."""

    x: Floats  #: map [m]
    y: Floats  #: map [m]
    heading: Floats  #: [rad], continuous along each way
    first: Indices  #: number of each way's first sample
    count: Indices  #: of each way's samples, at least 2

    @classmethod
    def from_lines(cls, lines: Sequence[Line]) -> Ways:
        """Sample lines of at least two different points each."""
        sampled = [_sampled(line) for line in lines]
        count = np.array([len(way.x) for way in sampled], np.int64)
        first = np.cumsum(count) - count
        x, y, heading = (np.concatenate([way[i] for way in sampled] or [np.zeros(0)]) for i in range(3))
        return cls(x, y, heading, first, count)

    def with_lines(self, lines: Sequence[Line]) -> Ways:
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

    def place(self, way: Indices, along: Floats, boxes: Boxes) -> Places:
        """Return the places of boxes that are beside their ways at these arc lengths [m]."""
        point = self.at(way, along)
        beside = (boxes.y - point.y) * np.cos(point.heading) - (boxes.x - point.x) * np.sin(point.heading)
        return Places(way, along, beside, wrapped(boxes.heading - point.heading))


def recorded_ways(time: Floats, actor: Indices, boxes: Boxes, beyond: float) -> tuple[Ways, Places]:
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
            Line(
                np.append(x[rows], x[last] + ahead * np.cos(heading)),
                np.append(y[rows], y[last] + ahead * np.sin(heading)),
            )
        )
    ways = Ways.from_lines(lines)
    back = np.argsort(order)
    return ways, ways.place(way[back], along[back], boxes)


def _sampled(line: Line) -> WayPoints:
    """Return points SPACING apart on a line and, straight on, the first one past its end."""
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(line.x), np.diff(line.y)))))
    last = int(np.searchsorted(driven, driven[-1])) - 1
    beyond = SPACING / (driven[-1] - driven[last])
    x, y = (np.append(column, column[-1] + beyond * (column[-1] - column[last])) for column in line)
    at = SPACING * np.arange(max(2, int(np.ceil(driven[-1] / SPACING)) + 1))
    driven = np.append(driven, driven[-1] + SPACING)
    x, y = np.interp(at, driven, x), np.interp(at, driven, y)
    return WayPoints(x, y, np.unwrap(np.arctan2(np.gradient(y), np.gradient(x))))
