"""When two bodies that go on along their lines meet: the ego along its course, an actor along its way.

Knows the course, ways and boxes; neither records, nor where ways come from, nor what a contact means.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vve_sumo.geometry import Boxes, separation
from vve_sumo.metrics.course import PredictedCourse, Starts
from vve_sumo.metrics.predicted_ways import Bodies, WayPlaces, Ways
from vve_sumo.values import Floats

#: least step of the search for a contact: a touch that is over sooner may be missed [s]
MIN_STEP = 0.05
#: rate at which the velocity of one against the other turns at most, taken as 4 m/s2 across for each [m/s2]
MAX_TURNING = 8.0
#: the moment of a contact is known to this [s]
RESOLUTION = 1e-8


class Pairs(NamedTuple):
    """The ego and an actor at one tick, and the time that is looked at: an entry each."""

    start: Starts  #: where the ego is
    speed: Floats  #: of the ego along its course, not negative [m/s]
    place: WayPlaces  #: of the actor
    other_speed: Floats  #: of the actor along its way, not negative [m/s]
    length: Floats  #: of the actor's box [m]
    width: Floats  #: of the actor's box [m]
    begin: Floats  #: from now [s]
    end: Floats  #: from now [s]

    def select(self, rows: Any) -> Pairs:
        """Return these pairs, or these as an array of another shape."""
        start, speed, place, *rest = self
        other_speed, length, width, begin, end = (column[rows] for column in rest)
        return Pairs(start.select(rows), speed[rows], place.select(rows), other_speed, length, width, begin, end)


class Prediction:
    """The ego's course and the actors' ways, along which both go on."""

    def __init__(self, course: PredictedCourse, ways: Ways) -> None:
        self.course, self.ways = course, ways

    def ego(self, pairs: Pairs, time: Floats) -> Boxes:
        """Return the ego's boxes at times from now [s]."""
        return self.course.body(pairs.start, pairs.speed * time, pairs.speed)

    def other(self, pairs: Pairs, time: Floats) -> Boxes:
        """Return the actors' boxes at times from now [s]."""
        return self._boxes(pairs, self._bodies(pairs, time))

    def _bodies(self, pairs: Pairs, time: Floats) -> Bodies:
        return self.ways.bodies(pairs.place, pairs.place.along + pairs.other_speed * time)

    @staticmethod
    def _boxes(pairs: Pairs, bodies: Bodies) -> Boxes:
        return Boxes(bodies.x, bodies.y, bodies.heading, pairs.length, pairs.width, pairs.other_speed)

    def first_contact(self, pairs: Pairs) -> Floats:
        """Return when the bodies of each pair first touch [s from now]; inf for never within the time looked at.

        Steps that no contact fits into (conservative advancement, Mirtich 1996), but none shorter than MIN_STEP.
        """
        found, before, now = np.full(len(pairs.begin), np.inf), pairs.begin.copy(), pairs.begin.copy()
        rows = np.flatnonzero(pairs.begin <= pairs.end)
        while len(rows):
            apart, step = self._apart(pairs.select(rows), now[rows])
            found[rows[apart <= 0.0]] = now[rows[apart <= 0.0]]
            rows, step = rows[apart > 0.0], step[apart > 0.0]
            rows, step = rows[now[rows] < pairs.end[rows]], step[now[rows] < pairs.end[rows]]
            before[rows] = now[rows]
            now[rows] = np.minimum(now[rows] + step, pairs.end[rows])
        bracketed = np.flatnonzero(np.isfinite(found) & (found > before))
        found[bracketed] = self._narrowed(pairs.select(bracketed), before[bracketed], found[bracketed])
        return found

    def _apart(self, pairs: Pairs, time: Floats) -> tuple[Floats, Floats]:
        """Return how far the bodies are apart at least [m], and for how long they do not meet [s]."""
        one, bodies = self.ego(pairs, time), self._bodies(pairs, time)
        apart = separation(one, self._boxes(pairs, bodies))
        ego_x, ego_y = one.speed * np.cos(one.heading), one.speed * np.sin(one.heading)
        # Every point of a body between a front and a rear on the way moves between as these two do.
        closing = np.zeros(len(time))
        for way in (bodies.front_way, bodies.rear_way):
            vx, vy = pairs.other_speed * np.cos(way) - ego_x, pairs.other_speed * np.sin(way) - ego_y
            closing = np.maximum(closing, np.hypot(vx, vy))
        step = (np.sqrt(closing * closing + 2.0 * MAX_TURNING * np.maximum(apart, 0.0)) - closing) / MAX_TURNING
        return apart, np.maximum(step, MIN_STEP)

    def _narrowed(self, pairs: Pairs, before: Floats, after: Floats) -> Floats:
        """Return when the bodies touch, between two times, by halving.

        False position gains next to nothing where the nearest edges of the bodies change in between.
        """
        while len(rows := np.flatnonzero(after - before > RESOLUTION)):
            between = 0.5 * (before[rows] + after[rows])
            apart, _ = self._apart(pairs.select(rows), between)
            before[rows] = np.where(apart > 0.0, between, before[rows])
            after[rows] = np.where(apart > 0.0, after[rows], between)
        return after
