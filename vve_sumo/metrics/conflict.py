"""Conflicts by predicted paths: when the ego's body and an actor's would meet, and what braking avoids that.

The ego goes along its path, an actor along its way, both at their present speed. Knows ways, boxes and the path;
neither records nor where ways come from.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.geometry import Boxes, separation
from vve_sumo.metrics.contact import Pairs, Prediction
from vve_sumo.metrics.following import MAX_DECELERATION
from vve_sumo.metrics.lead_vehicle import AT_REST, SAME_WAY
from vve_sumo.metrics.predicted_ways import SPACING, Indices, Places, Ways
from vve_sumo.path import Path, swept_half_widths
from vve_sumo.values import Floats, Vehicle

#: so far ahead ego and actors are predicted [s]
HORIZON = 10.0
#: an actor whose box keeps farther from all that the ego sweeps never meets the ego [m]
MARGIN = 0.5
#: before and after a contact, the part of an actor's way in which it may cross the ego's path [m], and its samples
ZONE, ZONE_SAMPLES = 25.0, 101
#: distances [m], speeds [m/s] and times [s] are not divided by less
MIN_ROOM = 1e-9


class Ego(NamedTuple):
    """The ego: one entry a tick, NaN where it is not known."""

    station: Floats  #: of the rear axle on its path [m]
    speed: Floats  #: [m/s]
    boxes: Boxes  #: its body


class Contacts(NamedTuple):
    """What is predicted of the ego and an actor at one tick: an entry a row of the table of actors."""

    time: Floats  #: until their bodies meet [s]; 0 where they overlap, NaN where they do not meet
    deceleration: Floats  #: least constant one of the ego, begun now, that avoids that [m/s2], MAX_DECELERATION at most


def contacts(ego: Ego, at: Indices, boxes: Boxes, ways: Ways, places: Places, path: Path, vehicle: Vehicle) -> Contacts:
    """Return what is predicted of actors and the ego: `at` is the tick of each row of `boxes` and `places`."""
    time, deceleration = np.full(len(at), np.nan), np.full(len(at), np.nan)
    search = _Search(Prediction(path, vehicle, ways), boxes, places)
    rows, pairs = search.pairs(ego, at)
    met = search.prediction.first_contact(pairs)
    # Who overlaps the ego's predicted body now, but not the ego itself, is beside a car that is off its path.
    found = np.flatnonzero(np.isfinite(met) & (met > 0.0) & ~search.from_behind(pairs, met))
    time[rows[found]] = met[found]
    deceleration[rows[found]] = search.deceleration(pairs.select(found), met[found])
    touching = separation(ego.boxes.select(at), boxes) <= 0.0
    time[touching], deceleration[touching] = 0.0, MAX_DECELERATION
    return Contacts(time, deceleration)


class _Search:
    """Looks for contacts of the ego with actors on their ways."""

    def __init__(self, prediction: Prediction, boxes: Boxes, places: Places) -> None:
        self.prediction, self._boxes, self._places = prediction, boxes, places

    @cached_property
    def _sweep(self) -> tuple[Floats, Floats]:
        """How far the ego's body reaches to the left and right of its path, at every sample of the path [m]."""
        from scipy.ndimage import maximum_filter1d

        path, vehicle = self.prediction.path, self.prediction.vehicle
        left, right = swept_half_widths(path.samples.curvature, vehicle.rear_axle_to_bumper, vehicle.width)
        size = 2 * math.ceil(vehicle.length) + 1
        return maximum_filter1d(left, size), maximum_filter1d(right, size)

    @cached_property
    def _nearest(self) -> Indices:
        """The sample of the path that is nearest to each sample of a way; -1 where none is so near as to matter."""
        from scipy.spatial import KDTree

        table, ways, vehicle = self.prediction.path.samples, self.prediction.ways, self.prediction.vehicle
        body = np.max(np.hypot(self._boxes.length, self._boxes.width), initial=0.0)
        reach = float(vehicle.length + body + np.max(np.abs(self._places.beside), initial=0.0))
        counted = np.flatnonzero((table.s > -reach) & (table.s < self.prediction.path.length + reach))
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
        ways, table, places = self.prediction.ways, self.prediction.path.samples, self._places
        widest = np.zeros((4, len(ways.first)))
        for greatest, column in zip(
            widest,
            (self._boxes.length, self._boxes.width, np.abs(places.beside), np.abs(np.sin(places.turn))),
            strict=True,
        ):
            np.maximum.at(greatest, places.way, column)
        rows = np.flatnonzero(self._nearest >= 0)
        way = np.searchsorted(ways.first, rows, "right") - 1
        length, width, beside, turn = widest[:, way]
        sample = self._nearest[rows]
        _, d, _ = table.project(ways.x[rows], ways.y[rows], sample)
        skew = ways.heading[rows] - np.arctan2(table.tangent_y[sample], table.tangent_x[sample])
        half = 0.5 * (length * (np.abs(np.sin(skew)) + turn) + width) + beside + MARGIN
        left, right = self._sweep
        close = (d < left[sample] + half) & (d > -right[sample] - half)
        first, last = np.full(len(ways.first), np.inf), np.full(len(ways.first), -np.inf)
        along = SPACING * (rows - ways.first[way])[close]
        np.minimum.at(first, way[close], along - SPACING)
        np.maximum.at(last, way[close], along + SPACING)
        return first, last

    def pairs(self, ego: Ego, at: Indices) -> tuple[Indices, Pairs]:
        """Return the rows of actors that may meet the ego, and the time in which they may."""
        own, speed = ego.station[at], np.where(np.abs(ego.speed[at]) < AT_REST, 0.0, np.maximum(ego.speed[at], 0.0))
        other = np.where(np.abs(self._boxes.speed) < MIN_ROOM, 0.0, np.abs(self._boxes.speed))
        first, last = (edge[self._places.way] - self._places.along for edge in self._reach)
        with np.errstate(divide="ignore", invalid="ignore"):
            begin = np.where(other > 0.0, first / other, np.where(first <= 0.0, 0.0, np.inf))
            end = np.where(other > 0.0, last / other, np.where(last >= 0.0, np.inf, -np.inf))
            left = self.prediction.path.length - own
            ends = np.where(speed > 0.0, left / speed, np.where(left >= 0.0, np.inf, -np.inf))
        begin, end = np.maximum(begin, 0.0), np.minimum(np.minimum(end, ends), HORIZON)
        rows = np.flatnonzero((begin <= end) & (speed + other > AT_REST) & np.isfinite(own))
        boxes = self._boxes
        pairs = Pairs(own, speed, self._places, other, boxes.length, boxes.width, begin, end)
        return rows, pairs.select(rows)

    def from_behind(self, pairs: Pairs, time: Floats) -> NDArray[np.bool_]:
        """Return whether the actor then runs into the ego's rear, which no braking of the ego avoids."""
        known = np.where(np.isfinite(time), time, 0.0)
        ego, other = self.prediction.ego(pairs, known), self.prediction.other(pairs, known)
        ahead = (other.x - ego.x) * np.cos(ego.heading) + (other.y - ego.y) * np.sin(ego.heading)
        behind: NDArray[np.bool_] = ahead < -0.5 * ego.length
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
        since = np.linspace(-ZONE, ZONE, ZONE_SAMPLES) / pairs.other_speed[:, None]
        moments = np.maximum(time[:, None] + since, 0.0)
        start, clearance = self._occupied(pairs, moments)
        number, contact = np.arange(ZONE_SAMPLES), ZONE_SAMPLES // 2
        clear = clearance >= 0.0
        enters = np.max(np.where(clear & (number < contact), number, -1), axis=1) + 1
        leaves = np.min(np.where(clear & (number > contact), number, ZONE_SAMPLES), axis=1) - 1
        _reach_out(moments, start, clearance, enters, np.maximum(enters - 1, 0))
        _reach_out(moments, start, clearance, leaves, np.minimum(leaves + 1, ZONE_SAMPLES - 1))
        there = (number >= enters[:, None]) & (number <= leaves[:, None])
        # Of two samples next to each other the nearer holds until the later: nothing in between asks for more.
        start[:, 1:] = np.where(there[:, :-1] & there[:, 1:], np.minimum(start[:, :-1], start[:, 1:]), start[:, 1:])
        room = start - (pairs.station + self.prediction.vehicle.rear_axle_to_bumper)[:, None]
        needed: Floats = np.max(yielding(pairs.speed[:, None], room, moments), axis=1, where=there, initial=0.0)
        return needed

    def _occupied(self, pairs: Pairs, moments: Floats) -> tuple[Floats, Floats]:
        """Return where along the path actors begin, and how far beside what the ego sweeps they are [m].

        moments: from now [s], a row a pair. Negative is inside; inf, both, where an actor is far from the path.
        """
        prediction, ways, place = self.prediction, self.prediction.ways, pairs.place
        spread = pairs.select((slice(None), None))
        boxes = prediction.other(spread, moments)
        row = np.rint((spread.place.along + spread.other_speed * moments) / SPACING).astype(np.int64)
        row = ways.first[place.way][:, None] + np.clip(row, 0, ways.count[place.way][:, None] - 1)
        sample = self._nearest[row]
        s, d, _ = prediction.path.samples.project(*boxes.corners(), np.broadcast_to(sample, (4, *sample.shape)))
        left, right = (side[sample] for side in self._sweep)
        clearance = np.maximum(d.min(axis=0) - left, -right - d.max(axis=0))
        return np.where(sample < 0, np.inf, s.min(axis=0)), np.where(sample < 0, np.inf, clearance)


def _reach_out(moments: Floats, start: Floats, clearance: Floats, inside: Indices, outside: Indices) -> None:
    """Move a sample of each row outwards, to where the clearance towards its neighbour is 0; a row a pair."""
    rows = np.arange(len(inside))
    inner, outer = clearance[rows, inside], clearance[rows, outside]
    crosses = (inner < 0.0) & (outer >= 0.0) & np.isfinite(outer)
    share = np.divide(inner, inner - outer, out=np.zeros(len(rows)), where=crosses)
    for column in (moments, start):
        here, there = column[rows, inside], np.where(crosses, column[rows, outside], 0.0)
        column[rows, inside] = here + share * (there - here)


def yielding(speed: Floats, distance: Floats, time: Floats) -> Floats:
    """Return the least constant deceleration with which one has not gone farther than a distance by a time [m/s2].

    speed: [m/s], distance: [m], time: [s]. It arrives there just then, with 2 (v t - d) / t^2, or, where it would be at
    rest sooner (d < v t / 2), stops there, with v^2 / 2 d. inf where it is there already.
    """
    room, moving = np.maximum(distance, MIN_ROOM), np.maximum(speed, MIN_ROOM)
    # A stop is an arrival at the time that the stop takes, 2 d / v.
    late = np.maximum(np.minimum(time, 2.0 * room / moving), MIN_ROOM)
    return np.where(distance > 0.0, np.maximum(2.0 * (speed * late - room) / (late * late), 0.0), np.inf)
