"""Follows the bodies around by a lidar: the outline that is seen of each, on the path, and how it moves.

A radar gives one point of a body; to steer around a body takes all of its near sides. The lidar sees them, and to every
side. A radar's track of the same body tells its speed along the path better. It must not know what is steered around.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.path import PathProjection, ReferencePath
from vve_sumo.values import Observation, PointCloud, Vehicle

from .assignment import assign
from .lidar_detections import POINTS, continuing, standing, touching
from .line_of_sight import in_sight
from .sightings import AxleMotion, Memory, output_of
from .tracks import Track
from .trend import Trend

BEHIND, AHEAD = 40.0, 100.0  #: how far from the rear axle along the path bodies are looked for [m]
ASIDE: Final = 20.0  #: and how far beside the path, wherever it bends to [m]
BLOCK: Final = 5.0  #: blocks of this size are near the path or not, with all that stands in them [m]
BESIDE: Final = 9.0  #: bodies that are all farther beside the path are left alone [m]
GRAIN: Final = 0.1  #: points in cells of this size are one point of an outline [m]
GATE: Final = 1.5  #: along and across together, within which a body is the one of the turn before [m]
FAST: Final = 16.0  #: of a body that was seen once nothing is known but that it is not faster than this [m/s]
KEPT: Final = 0.5  #: a body lives on unseen for so long [s]
SEEN: Final = 2  #: turns until a body counts
FAMILIAR: Final = 5  #: turns until a small body is known to be one by itself
KNOWN, KNOWN_LARGE = 3, 6  #: until the motion of a small body does, and of another one
SPARSE: Final = 0.006  #: rays are so far apart at a distance [rad]: by so much a side may jump
SMALL: Final = 1.2  #: one that is smaller is followed by its middle, others by the sides that are nearest [m]
#: From so far on [m] a few rays meet a car, not all of which come back: what looks small may be any part of it, another
#: one in every turn, so that its middle jumps to and fro.
RESOLVED: Final = 45.0
PLACE_SIGMA, SIDE_SIGMA = 0.06, 0.15  #: of the middle of a small body, of the nearest sides of others [m]
ALONG_AGILITY, ACROSS_AGILITY = 1.0, 0.5  #: spectral densities of acceleration [m2/s3]
ACROSS_FASTEST: Final = 4.0  #: standard deviation of a speed across the path before any is measured [m/s]
MOVES, CRAWLS = 3.0, 0.4  #: it moves if so many standard deviations, and so much [m/s], say so
RANGE: Final = 90.0  #: as far as this the lidar sees a car [m]
ONE_BODY: Final = 1.5  #: a radar's track so near to an outline is of the same body [m]
LENGTH, WIDTH = 5.0, 2.0  #: of a body of which only a radar's track is known [m]
ONCOMING: Final = -2.0  #: of such bodies only those count that come nearer along the path [m/s]


class Body(NamedTuple):
    """The outline that is seen of a body, and how it moves."""

    s: np.ndarray  #: of its points along the path [m]
    d: np.ndarray  #: of its points to the left of the path [m]
    along: float  #: speed along the path [m/s]
    across: float  #: speed across the path, left positive [m/s]
    sigma: float  #: standard deviation of the speed across [m/s]
    drift: float = 0.0  #: the speed across as it is measured, where `across` is 0 until it surely moves [m/s]

    @property
    def small(self) -> bool:
        """Whether it is no larger than a person or a bicycle."""
        return bool(np.ptp(self.s) < 2.2 and np.ptp(self.d) < SMALL)

    def moved(self, time: float) -> Body:
        """Return where it will be after a time [s]."""
        return self._replace(s=self.s + self.along * time, d=self.d + self.across * time)


class _Followed:
    """A body from turn to turn."""

    __slots__ = ("across", "along", "by_far", "by_left", "d", "hits", "moves", "s", "seen", "speed", "time")

    def __init__(self, time: float, s: np.ndarray, d: np.ndarray) -> None:
        self.time = self.seen = time
        self.s, self.d, self.hits = s, d, 1
        self.speed: float | None = None  # along the path, as a radar has it [m/s]
        self.by_far = self.by_left = 0  # which sides it is followed by
        self.moves = False, False  # whether it surely did along and across the path when it was seen last
        self.along = Trend(0.0, SIDE_SIGMA**2, FAST**2, ALONG_AGILITY)
        self.across = Trend(0.0, SIDE_SIGMA**2, ACROSS_FASTEST**2, ACROSS_AGILITY)

    def predict(self, time: float) -> None:
        """Move on to a time [s]."""
        dt = time - self.time
        self.time = time
        self.along.predict(dt)
        self.across.predict(dt)
        self.s, self.d = self.s + self._pace() * dt, self.d + self.across.rate * dt * (self.hits > 1)

    def _pace(self) -> float:
        return (self.along.rate if self.speed is None else self.speed) if self.hits > 1 else 0.0

    def begin(self, s: float, d: float) -> None:
        """Begin both filters, seen from a place on the path."""
        self.along.value, self.across.value, sigma = self._sides(s, d)
        self.along.variance = self.across.variance = sigma * sigma

    def update(self, s: np.ndarray, d: np.ndarray, here: tuple[float, float]) -> None:
        """Take in what a turn shows of it, seen from a place on the path."""
        self.s, self.d, self.seen = s, d, self.time
        self.hits += 1
        before = self.by_far, self.by_left
        along, across, sigma = self._sides(*here)
        if self.by_far != before[0]:
            self.along.value = along
        if self.by_left != before[1]:
            self.across.value = across
        self.along.update(along, sigma * sigma)
        is_small = self.by_left == before[1] == 0
        if is_small and (across - self.across.value) ** 2 > MOVES**2 * (self.across.variance + sigma * sigma):
            # It sets out or turns back: what its speed was says nothing about what it is.
            self.across.rate_variance += ACROSS_FASTEST**2
        self.across.update(across, sigma * sigma)
        # One who is hidden for a moment goes on, though nobody sees that he does.
        known = self.hits >= (KNOWN if self.by_far == 0 else KNOWN_LARGE)
        self.moves = known and _surely(self.along), known and _surely(self.across)

    def _sides(self, s: float, d: float) -> tuple[float, float, float]:
        """Return the places along and across that it is followed by [m], and their standard deviation [m]."""
        near, far = float(self.s.min()), float(self.s.max())
        right, left = float(self.d.min()), float(self.d.max())
        if max(far - near, left - right) < SMALL and max(near - s, s - far) < RESOLVED:
            self.by_far = self.by_left = 0
            return 0.5 * (near + far), 0.5 * (right + left), PLACE_SIGMA
        self.by_far = 1 if near > s else 2 if far < s else 3
        self.by_left = 1 if 0.5 * (right + left) > d else 2
        along = near if self.by_far == 1 else far if self.by_far == 2 else 0.5 * (near + far)
        return along, right if self.by_left == 1 else left, SIDE_SIGMA + SPARSE * abs(along - s)

    def cost(self, s: np.ndarray, d: np.ndarray) -> float:
        """Return how far a turn's outline is from it [m]; infinite beyond the gate."""
        reach = GATE + (FAST * 0.1 if self.hits == 1 else 0.0)
        away = abs(_nearest(s, self.s)) + abs(_nearest(d, self.d))
        return away if away < reach else math.inf

    def body(self, time: float) -> Body:
        """Return it at a time [s]."""
        along, across = self.moves
        pace = self.speed if self.speed is not None else self.along.rate * along
        aside, since = self.across.rate * across, time - self.time
        return Body(
            self.s + pace * since,
            self.d + aside * since,
            pace,
            aside,
            math.sqrt(self.across.rate_variance),
            self.across.rate,
        )


class Outlines:
    """Keeps the bodies."""

    def __init__(self, vehicle: Vehicle, sensor: str, forward: float, height: float) -> None:
        """`sensor` is the lidar's name; it is mounted `forward` of the rear axle [m] and so high over the road [m]."""
        self._vehicle, self._sensor, self._forward, self._height = vehicle, sensor, forward, height
        self._memory = Memory()
        self._followed: list[_Followed] = []
        self._newest = -math.inf
        self._turn: PointCloud | None = None
        self._axle: AxleMotion

    def step(self, observation: Observation, projection: PathProjection) -> bool:
        """Take in a turn if it is new, and tell whether it was; raises TypeError where there is no such lidar."""
        turn = output_of(observation, self._sensor, PointCloud, "lidar")
        self._memory.add(observation.pose)
        if not turn.time > self._newest:
            return False
        self._newest = turn.time
        axle = self._memory.at(turn.time)
        self._turn, self._axle = turn, axle
        # What lies ahead was met in the middle of the turn.
        time, here = turn.time - 0.5 * _duration(turn), (projection.s, projection.d)
        for one in self._followed:
            one.predict(time)
        pieces = self._pieces(turn, axle, observation.path, projection.s)
        known = list(self._followed)
        taken = assign([[one.cost(s, d) for one in known] for s, d in pieces])
        for number, (s, d) in enumerate(pieces):
            if number in taken:
                known[taken[number]].update(s, d, here)
            else:
                fresh = _Followed(time, s, d)
                fresh.begin(*here)
                self._followed.append(fresh)
        self._followed = [one for one in self._followed if time - one.seen <= KEPT]
        return True

    def bodies(self, time: float, tracks: Sequence[Track]) -> list[Body]:
        """Return the bodies at a time [s]; `tracks` are a radar's, on the same path.

        A track beyond the lidar's sight that comes nearer along the path is a body, too.
        """
        found = []
        lonely = [track for track in tracks if track.speed < ONCOMING and track.time - track.seen <= KEPT]
        for one in self._followed:
            if one.hits < SEEN:
                continue
            own = [track for track in tracks if _is_of(track, one, time)]
            if own:
                nearest = min(own, key=lambda track: abs(track.s - float(one.s.min())))
                one.speed = 0.0 if nearest.speed**2 < (MOVES**2) * nearest.p_v else nearest.speed
                lonely = [track for track in lonely if track not in own]
            found.append(one.body(time))
        return found + [_taken_for_a_car(track, time) for track in lonely]

    def in_sight(self, path: ReferencePath, places: Sequence[float], d: float) -> bool:
        """Tell whether the newest turn would show a car at all these places, s along a path and `d` beside it [m].

        One place alone that is not in sight is too short for a car.
        """
        points = [path.at(s) for s in places]
        x = np.array([point.x - d * math.sin(point.heading) for point in points])
        y = np.array([point.y + d * math.cos(point.heading) for point in points])
        if self._turn is None:
            return False
        seen = in_sight(x, y, self._turn, self._axle, self._forward, self._height, RANGE)
        return bool((seen[1:] | seen[:-1]).all() if len(seen) > 1 else seen.all())

    def _pieces(
        self, turn: PointCloud, axle: AxleMotion, path: ReferencePath, ego_s: float
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return s and d [m] of each body near the path; `ego_s` is the rear axle's [m]."""
        x, y, _height, _firing = standing(turn, axle, self._forward, self._height, self._forward)
        near = _along(path, ego_s, axle, x, y)
        x, y = x[near], y[near]
        behind, ahead = max(-float(x.min(initial=0.0)), BEHIND), max(float(x.max(initial=0.0)), ASIDE)
        touch = touching(x, y, behind, ahead, max(float(np.abs(y).max(initial=0.0)), ASIDE))
        apart = _of(touch, x, y, self._small_ones(path, axle))
        labels = _whole(x - self._forward, y, touch, math.tau / len(turn.azimuth), apart)
        cos, sin = math.cos(axle.heading), math.sin(axle.heading)
        order = np.lexsort((np.floor(y / GRAIN), np.floor(x / GRAIN), labels))
        cells = np.stack((labels[order], np.floor(x[order] / GRAIN), np.floor(y[order] / GRAIN)))
        first = np.ones(len(order), np.bool_)
        first[1:] = (cells[:, 1:] != cells[:, :-1]).any(axis=0)
        counts = np.bincount(labels)
        kept = order[first]
        labels, x, y = labels[kept], x[kept], y[kept]
        s, d = path.locate(axle.x + x * cos - y * sin, axle.y + x * sin + y * cos, ego_s - BEHIND, ego_s + AHEAD)
        pieces = []
        for number in np.unique(labels).tolist():
            own = (labels == number) & np.isfinite(s) & np.isfinite(d)
            if counts[number] >= POINTS and own.any() and float(np.abs(d[own]).min()) < BESIDE:
                pieces.append((s[own], d[own]))
        return pieces

    def _small_ones(self, path: ReferencePath, axle: AxleMotion) -> list[tuple[float, float]]:
        """Return where small bodies are that have been followed for some time, ahead and left of the rear axle [m]."""
        places = []
        for one in self._followed:
            if one.by_far == 0 and one.hits >= FAMILIAR:
                at, d = path.at(float(one.s.mean())), float(one.d.mean())
                east = at.x - d * math.sin(at.heading) - axle.x
                north = at.y + d * math.cos(at.heading) - axle.y
                cos, sin = math.cos(axle.heading), math.sin(axle.heading)
                places.append((east * cos + north * sin, north * cos - east * sin))
        return places


def _of(labels: np.ndarray, x: np.ndarray, y: np.ndarray, places: Sequence[tuple[float, float]]) -> np.ndarray:
    """Return the numbers of the pieces that lie as a whole around one of some places [m]."""
    apart: set[int] = set()
    for ahead, left in places:
        around = np.hypot(x - ahead, y - left) < SMALL
        apart |= set(labels[around].tolist()) - set(labels[~around].tolist())
    return np.array(sorted(apart), np.intp)


def _along(path: ReferencePath, ego_s: float, axle: AxleMotion, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return which points, ahead and left of the rear axle [m], stand in blocks that the path ahead or behind leads by.

    Of a path that bends, the car's own axis leads away.
    """
    points = [path.at(s) for s in np.arange(ego_s - BEHIND, ego_s + AHEAD + BLOCK, BLOCK).tolist()]
    east, north = np.array([point.x for point in points]) - axle.x, np.array([point.y for point in points]) - axle.y
    cos, sin = math.cos(axle.heading), math.sin(axle.heading)
    ahead, left = east * cos + north * sin, north * cos - east * sin
    count = math.ceil(2.0 * AHEAD / BLOCK)
    middle = BLOCK * (np.arange(count) + 0.5) - AHEAD
    away = (middle[:, None, None] - ahead) ** 2 + (middle[None, :, None] - left) ** 2
    by_path = away.min(axis=2) < ASIDE * ASIDE
    near = (np.abs(x) < AHEAD) & (np.abs(y) < AHEAD)
    row, column = (((np.where(near, value, 0.0) + AHEAD) / BLOCK).astype(np.intp) for value in (x, y))
    along: np.ndarray = near & by_path[row, column]
    return along


def _whole(x: np.ndarray, y: np.ndarray, labels: np.ndarray, step: float, apart: np.ndarray) -> np.ndarray:
    """Return the numbers of bodies that points belong to: pieces of one body, as the lidar sees them, are put together.

    `x` and `y` count from the lidar [m], `step` is the angle from one ray to the next [rad]. The pieces whose numbers
    are in `apart` are bodies of their own: who steps out between two cars is no part of either.
    """
    if not len(x):
        return labels
    far = np.hypot(x, y)
    order = np.argsort(far, kind="stable")
    numbers, first, piece = np.unique(labels[order], return_index=True, return_inverse=True)
    goes_on = continuing(far[order], np.arctan2(y, x)[order], piece, first, step)
    alone = np.isin(numbers, apart)
    goes_on &= ~(alone[:, None] | alone)
    owner = np.where(goes_on.any(axis=1), goes_on.argmax(axis=1), np.arange(len(first)))
    # A piece goes on one that is nearer, so that the chain ends.
    while (owner[owner] != owner).any():
        owner = owner[owner]
    whole = np.empty_like(labels)
    whole[order] = owner[piece]
    return whole


def _duration(turn: PointCloud) -> float:
    return float(-turn.time_offset.min(initial=0.0))


def _surely(trend: Trend) -> bool:
    """Tell whether a rate stands out from its noise."""
    return trend.rate * trend.rate > MOVES * MOVES * trend.rate_variance and abs(trend.rate) > CRAWLS


def _nearest(first: np.ndarray, second: np.ndarray) -> float:
    """Return how far apart two outlines are in one direction, by the nearer of their two ends [m]."""
    low, high = float(first.min() - second.min()), float(first.max() - second.max())
    return low if abs(low) < abs(high) else high


def _is_of(track: Track, one: _Followed, time: float) -> bool:
    at = track.s + track.speed * (time - track.time)
    near = float(one.s.min()) - ONE_BODY <= at <= float(one.s.max()) + ONE_BODY
    d = track.across.value
    return near and float(one.d.min()) - ONE_BODY <= d <= float(one.d.max()) + ONE_BODY


def _taken_for_a_car(track: Track, time: float) -> Body:
    """Return a car of which a radar sees the nearest point: the rest of it lies beyond, seen from the path.

    It counts a standard deviation farther off than it is measured: far away that is most of a lane.
    """
    s, d = track.s + track.speed * (time - track.time), track.d
    near = math.copysign(abs(d) + math.sqrt(track.d_variance), d)
    far = near + math.copysign(WIDTH, d)
    return Body(s + np.array([0.0, 0.0, LENGTH, LENGTH]), np.array([near, far] * 2), track.speed, 0.0, 0.0)
