"""Conflicts by predicted paths: when the ego's body and an actor's would meet, and what braking avoids that.

The ego goes along its course, an actor along its way, both at their present speed. Knows ways, boxes and the course;
neither records nor where ways come from.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.geometry import Boxes, separation
from vve_sumo.metrics.clipping import nearest_in_band
from vve_sumo.metrics.contact import Pairs, Prediction
from vve_sumo.metrics.course import PredictedCourse, Starts
from vve_sumo.metrics.following import MAX_DECELERATION
from vve_sumo.metrics.lead_vehicle import AT_REST, SAME_WAY
from vve_sumo.metrics.predicted_ways import SPACING, Indices, WayPlaces, Ways
from vve_sumo.metrics.routes import OWN_PATH
from vve_sumo.path import swept_half_widths
from vve_sumo.values import Floats

#: so far ahead ego and actors are predicted [s]
HORIZON = 10.0
#: an actor whose box keeps farther from all that the ego sweeps never meets the ego [m]
MARGIN = 0.5
#: a path that turns by more beside a body does not keep its distance from it [rad]: less costs a twentieth of MARGIN
#: for each metre from the body's middle to its end
BENT = 0.05
#: before and after a contact, the part of an actor's way in which it may cross the ego's course [m], and its samples
ZONE, ZONE_SAMPLES = 25.0, 101
#: the time in which it crosses is sampled, and then again and again around the moment that asks for most braking
CROSSING_SAMPLES, ZOOM_SAMPLES, ZOOMS = 33, 9, 9
#: of each side of a box that is clipped to the band
PIECES = 2
#: an actor that touches the band by no more than this is in it [m]
TOUCH = 1e-9
#: along a commanded path crossings are looked for so far ahead [m]
SEARCHED = 200.0
#: pairs whose crossings are looked at together: bounds the memory
CHUNK = 500
#: distances [m], speeds [m/s] and times [s] are not divided by less
MIN_ROOM = 1e-9


class PredictedEgo(NamedTuple):
    """The ego: one entry a tick, NaN where it is not known."""

    course: PredictedCourse  #: where it goes on from there
    speed: Floats  #: [m/s]
    boxes: Boxes  #: its body


class Contacts(NamedTuple):
    """What is predicted of the ego and an actor at one tick: an entry a row of the table of actors."""

    time: Floats  #: until their bodies meet [s]; 0 where they overlap, NaN where they do not meet
    deceleration: Floats  #: least constant one of the ego, begun now, that avoids that [m/s2], MAX_DECELERATION at most


def contacts(ego: PredictedEgo, at: Indices, boxes: Boxes, ways: Ways, places: WayPlaces) -> Contacts:
    """Return what is predicted of actors and the ego: `at` is the tick of each row of `boxes` and `places`."""
    time, deceleration = np.full(len(at), np.nan), np.full(len(at), np.nan)
    search = _Search(Prediction(ego.course, ways), boxes, places)
    rows, pairs = search.pairs(ego, at)
    met = search.prediction.first_contact(pairs)
    # Who overlaps the ego's predicted body now, but not the ego itself, is beside a car that is a little off its path.
    found = np.flatnonzero(np.isfinite(met) & (met > 0.0) & ~search.from_behind(pairs, met))
    time[rows[found]] = met[found]
    deceleration[rows[found]] = search.deceleration(pairs.select(found), met[found])
    touching = separation(ego.boxes.select(at), boxes) <= 0.0
    time[touching], deceleration[touching] = 0.0, MAX_DECELERATION
    return Contacts(time, deceleration)


class _Crossers(NamedTuple):
    """Actors at moments of their ways, one after the other."""

    start: Starts  #: where the ego is now
    corners: tuple[Floats, Floats]  #: of the actor's box, x and y, (4, n) [m]
    ahead: Floats  #: of the corners along the ego's course, (4, n) [m]
    beside: Floats  #: likewise beside it
    band: tuple[Floats, Floats]  #: how far the ego's body reaches to the right and to the left there [m]
    known: NDArray[np.bool_]  #: False where the actor is far from the ego's course


class _Search:
    """Looks for contacts of the ego with actors on their ways."""

    def __init__(self, prediction: Prediction, boxes: Boxes, places: WayPlaces) -> None:
        self.prediction, self._boxes, self._places = prediction, boxes, places

    @cached_property
    def _sweep(self) -> tuple[Floats, Floats]:
        """How far the ego's body reaches to the left and right of its paths, at every sample of its routes [m]."""
        from scipy.ndimage import maximum_filter1d

        routes, vehicle = self.prediction.course.routes, self.prediction.course.vehicle
        left, right = swept_half_widths(routes.samples.curvature, vehicle.rear_axle_to_bumper, vehicle.width)
        size = 2 * math.ceil(vehicle.length) + 1
        return maximum_filter1d(left, size), maximum_filter1d(right, size)

    @cached_property
    def _nearest(self) -> Indices:
        """The sample of the path that is nearest to each sample of a way; -1 where none is so near as to matter."""
        from scipy.spatial import KDTree

        path, ways, vehicle = self.prediction.course.path, self.prediction.ways, self.prediction.course.vehicle
        table = path.samples
        body = np.max(np.hypot(self._boxes.length, self._boxes.width), initial=0.0)
        reach = float(vehicle.length + body + np.max(np.abs(self._places.beside), initial=0.0))
        counted = np.flatnonzero((table.s > -reach) & (table.s < path.length + reach))
        tree = KDTree(np.column_stack((table.x[counted], table.y[counted])))
        row = np.asarray(tree.query(np.column_stack((ways.x, ways.y)), distance_upper_bound=reach)[1], np.int64)
        nearest = np.full(len(ways.x), -1, np.int64)
        # A sample without a neighbour is given the number of samples.
        known = row < len(counted)
        nearest[known] = counted[row[known]]
        return nearest

    @cached_property
    def _reach(self) -> tuple[Floats, Floats]:
        """First and last arc length of each way at which its actor may touch what the ego sweeps [m]."""
        ways, table, places = self.prediction.ways, self.prediction.course.path.samples, self._places
        widest = np.zeros((5, len(ways.first)))
        turned = np.abs(np.sin(places.turn))
        columns = (self._boxes.length, self._boxes.width, places.chord, np.abs(places.beside), turned)
        for greatest, column in zip(widest, columns, strict=True):
            np.maximum.at(greatest, places.way, column)
        rows = np.flatnonzero(self._nearest >= 0)
        way = np.searchsorted(ways.first, rows, "right") - 1
        length, width, chord, beside, turn = widest[:, way]
        along = SPACING * (rows - ways.first[way]).astype(np.float64)
        middle = np.zeros(len(rows))
        sample, body = self._nearest[rows], ways.bodies(WayPlaces(way, along, chord, middle, middle), along)
        _, d, _ = table.project(body.x, body.y, sample)
        skew = body.heading - np.arctan2(table.tangent_y[sample], table.tangent_x[sample])
        reach = 0.5 * np.hypot(length, width) + beside
        left, right, curvature = self._greatest_near(float(reach.max(initial=0.0)))
        # At a bend a body may reach into the ego's way with its ends alone, far from what is nearest to its middle.
        straight = 0.5 * (length * (np.abs(np.sin(skew)) + turn) + width) + beside
        half = np.where(curvature[sample] * reach > BENT, reach, straight) + MARGIN
        close = (d < left[sample] + half) & (d > -right[sample] - half)
        first, last = np.full(len(ways.first), np.inf), np.full(len(ways.first), -np.inf)
        np.minimum.at(first, way[close], along[close] - SPACING)
        np.maximum.at(last, way[close], along[close] + SPACING)
        return first, last

    def _greatest_near(self, reach: float) -> tuple[Floats, Floats, Floats]:
        """Return the greatest sweep to the left and right [m] and curvature [1/m] within a reach of each sample."""
        from scipy.ndimage import maximum_filter1d

        size, table = 2 * math.ceil(reach) + 1, self.prediction.course.path.samples
        # The scenario's path is the first of the routes.
        columns = (*(side[: len(table.s)] for side in self._sweep), np.abs(table.curvature))
        left, right, curvature = (maximum_filter1d(column, size) for column in columns)
        return left, right, curvature

    def pairs(self, ego: PredictedEgo, at: Indices) -> tuple[Indices, Pairs]:
        """Return the rows of actors that may meet the ego, and the time in which they may."""
        start, speed = ego.course.starts.select(at), np.maximum(ego.speed[at], 0.0)
        speed = np.where(speed < AT_REST, 0.0, speed)
        other = np.where(np.abs(self._boxes.speed) < MIN_ROOM, 0.0, np.abs(self._boxes.speed))
        first, last = (edge[self._places.way] - self._places.along for edge in self._reach)
        # Of an ego that goes elsewhere than along the scenario's path nothing is known beforehand.
        first, last = np.where(start.elsewhere, -np.inf, first), np.where(start.elsewhere, np.inf, last)
        left = ego.course.end(start)
        with np.errstate(divide="ignore", invalid="ignore"):
            begin = np.where(other > 0.0, first / other, np.where(first <= 0.0, 0.0, np.inf))
            end = np.where(other > 0.0, last / other, np.where(last >= 0.0, np.inf, -np.inf))
            ends = np.where(speed > 0.0, left / speed, np.where(left >= 0.0, np.inf, -np.inf))
        begin, end = np.maximum(begin, 0.0), np.minimum(np.minimum(end, ends), HORIZON)
        rows = np.flatnonzero((begin <= end) & (speed + other > AT_REST) & np.isfinite(start.s))
        boxes = self._boxes
        pairs = Pairs(start, speed, self._places, other, boxes.length, boxes.width, begin, end)
        return rows, pairs.select(rows)

    def from_behind(self, pairs: Pairs, time: Floats) -> NDArray[np.bool_]:
        """Return whether the actor then runs into the ego's rear, which no braking of the ego avoids.

        It moves, its middle is behind the ego, and its foremost corner behind the ego's middle: the middle alone says
        nothing of a long body, which may be hit with its front.
        """
        known = np.where(np.isfinite(time), time, 0.0)
        ego, other = self.prediction.ego(pairs, known), self.prediction.other(pairs, known)
        ahead = (other.x - ego.x) * np.cos(ego.heading) + (other.y - ego.y) * np.sin(ego.heading)
        turned = other.heading - ego.heading
        foremost = ahead + 0.5 * (other.length * np.abs(np.cos(turned)) + other.width * np.abs(np.sin(turned)))
        moves = pairs.other_speed >= AT_REST
        behind: NDArray[np.bool_] = moves & (ahead < -0.5 * ego.length) & (foremost < 0.0)
        return behind

    def deceleration(self, pairs: Pairs, time: Floats) -> Floats:
        """Return the least constant deceleration of the ego that avoids the contacts at these times [m/s2]."""
        ego, other = self.prediction.ego(pairs, time), self.prediction.other(pairs, time)
        along = np.cos(other.heading - pairs.place.turn - ego.heading)
        closing = pairs.speed - pairs.other_speed * along
        leads = (pairs.other_speed < AT_REST) | ((along > math.cos(SAME_WAY)) & (closing > 0.0))
        needed = closing / (2.0 * time)
        rows = np.flatnonzero(~leads)
        needed[rows] = self._crossing(pairs.select(rows), time[rows])
        return np.minimum(needed, MAX_DECELERATION)

    def _crossing(self, pairs: Pairs, time: Floats) -> Floats:
        """Return the least deceleration that keeps the bumper short of actors while they are in the ego's way."""
        needed = [
            self._crossing_of(pairs.select(rows), time[rows])
            for rows in np.split(np.arange(len(time)), np.arange(CHUNK, len(time), CHUNK))
        ]
        return np.concatenate(needed)

    def _crossing_of(self, pairs: Pairs, time: Floats) -> Floats:
        enters, leaves = self._in_the_way(pairs, time)
        share = np.linspace(0.0, 1.0, CROSSING_SAMPLES)
        needed, rows = np.zeros(len(time)), np.arange(len(time))
        for _ in range(1 + ZOOMS):
            moments = enters[:, None] + (leaves - enters)[:, None] * share
            asked = self._yielding_at(pairs, moments)
            needed, worst = np.maximum(needed, asked.max(axis=1)), np.argmax(asked, axis=1)
            enters = moments[rows, np.maximum(worst - 1, 0)]
            leaves = moments[rows, np.minimum(worst + 1, len(share) - 1)]
            share = np.linspace(0.0, 1.0, ZOOM_SAMPLES)
        return needed

    def _in_the_way(self, pairs: Pairs, time: Floats) -> tuple[Floats, Floats]:
        """Return when actors that the ego would touch at these times come into the band that it sweeps, and leave."""
        since = np.linspace(-ZONE, ZONE, ZONE_SAMPLES) / pairs.other_speed[:, None]
        moments = np.maximum(time[:, None] + since, 0.0)
        clearance = self._clearance(pairs, moments)
        number, contact = np.arange(ZONE_SAMPLES), ZONE_SAMPLES // 2
        clear = clearance >= 0.0
        before = np.max(np.where(clear & (number < contact), number, -1), axis=1)
        after = np.min(np.where(clear & (number > contact), number, ZONE_SAMPLES), axis=1)
        enters = _touch(moments, clearance, before + 1, np.maximum(before, 0))
        return enters, _touch(moments, clearance, after - 1, np.minimum(after, ZONE_SAMPLES - 1))

    def _yielding_at(self, pairs: Pairs, moments: Floats) -> Floats:
        """Return the deceleration that keeps the bumper short of actors at moments from now [s], a row a pair."""
        crossers, course = self._crossers(pairs, moments), self.prediction.course

        def project(number: Indices, x: Floats, y: Floats, near: Floats) -> tuple[Floats, Floats]:
            return course.project(crossers.start.select(number), x, y, near)

        right, left = (edge + TOUCH for edge in crossers.band)
        begins = nearest_in_band(crossers.corners, crossers.ahead, project, -right, left, PIECES)
        room = np.where(crossers.known, begins, np.inf) - course.vehicle.rear_axle_to_bumper
        return yielding(pairs.speed[:, None], room.reshape(moments.shape), moments)

    def _clearance(self, pairs: Pairs, moments: Floats) -> Floats:
        """Return how far beside what the ego sweeps actors are at moments from now [m], a row a pair.

        Negative is inside; inf where an actor is far from the ego's course.
        """
        crossers = self._crossers(pairs, moments)
        right, left = crossers.band
        clearance = np.maximum(crossers.beside.min(axis=0) - left, -right - crossers.beside.max(axis=0))
        return np.where(crossers.known, clearance, np.inf).reshape(moments.shape)

    def _crossers(self, pairs: Pairs, moments: Floats) -> _Crossers:
        course, ways = self.prediction.course, self.prediction.ways
        each, time = pairs.select(np.repeat(np.arange(len(moments)), moments.shape[1])), moments.ravel()
        corners = self.prediction.other(each, time).corners()
        row = np.rint((each.place.along + each.other_speed * time) / SPACING).astype(np.int64)
        way, start = each.place.way, each.start
        sample = self._nearest[ways.first[way] + np.clip(row, 0, ways.count[way] - 1)]
        near = course.path.samples.s[sample] - start.s
        commanded = np.flatnonzero((start.route != OWN_PATH) & ~start.leaves)
        near[commanded] = self._near(
            start.select(commanded), *(column[:, commanded].mean(axis=0) for column in corners)
        )
        sample[commanded] = course.routes.row(start.route, start.s + near)[commanded]
        ahead, beside = course.project(start, *corners, near)
        vehicle = course.vehicle
        arcs = swept_half_widths(start.curvature, vehicle.rear_axle_to_bumper, vehicle.width)
        left, right = (
            np.where(start.leaves, of_arc, side[sample]) for of_arc, side in zip(arcs, self._sweep, strict=True)
        )
        return _Crossers(start, corners, ahead, beside, (right, left), start.leaves | (sample >= 0))

    def _near(self, start: Starts, x: Floats, y: Floats) -> Floats:
        """Return how far ahead along commanded paths points are, about [m]."""
        course, near = self.prediction.course, np.zeros(len(x))
        for rows in np.split(np.arange(len(x)), np.arange(CHUNK, len(x), CHUNK)):
            ahead = np.full(len(rows), 0.5 * SEARCHED)
            near[rows], _, _ = course.find(start.select(rows), x[rows], y[rows], ahead, 0.5 * SEARCHED + ZONE)
        return near


def _touch(moments: Floats, clearance: Floats, inside: Indices, outside: Indices) -> Floats:
    """Return when the clearance is 0 between the samples `inside` and `outside` of each row.

    It is the moment of the sample `inside` where the clearance is not known to pass through 0 between the two.
    """
    rows = np.arange(len(inside))
    inner, outer = clearance[rows, inside], clearance[rows, outside]
    crosses = (inner < 0.0) & (outer >= 0.0) & np.isfinite(outer)
    share = np.divide(inner, inner - outer, out=np.zeros(len(rows)), where=crosses)
    here = moments[rows, inside]
    return np.where(crosses, here + share * (moments[rows, outside] - here), here)


def yielding(speed: Floats, distance: Floats, time: Floats) -> Floats:
    """Return the least constant deceleration with which one has not gone farther than a distance by a time [m/s2].

    speed: [m/s], distance: [m], time: [s]. It arrives there just then, with 2 (v t - d) / t^2, or, where it would be at
    rest sooner (d < v t / 2), stops there, with v^2 / 2 d. inf where it is there already.
    """
    room, moving = np.maximum(distance, MIN_ROOM), np.maximum(speed, MIN_ROOM)
    # A stop is an arrival at the time that the stop takes, 2 d / v.
    late = np.maximum(np.minimum(time, 2.0 * room / moving), MIN_ROOM)
    return np.where(distance > 0.0, np.maximum(2.0 * (speed * late - room) / (late * late), 0.0), np.inf)
