"""Follows by a lidar, and by V2X messages, who comes on the ways that go first, and how far these are in sight.

What is not in sight may hold somebody: the lidar tells how far along each way a car would be seen. It must not know
what is done about them.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.values import Observation, PointCloud, Stations, Vehicle

from .junction_ways import Conflict, Way
from .lidar_detections import standing
from .line_of_sight import in_sight
from .sightings import AxleMotion, Memory
from .trend import Trend

HALF_LANE: Final = 1.2  #: what is nearer than this to the middle of a way is on it [m]
CELL: Final = 0.2  #: points in one cell of this size are one [m]
APART: Final = 3.5  #: between two bodies on a way, at least [m]
POINTS: Final = 2  #: of a body, at least
SIGMA: Final = 0.3  #: of the place of a body's front on its way [m]
FAST, AGILITY = 12.0, 2.0  #: of a body's speed: standard deviation to begin with [m/s], spectral density [m2/s3]
GATE: Final = 3.0  #: a body is no farther than this from where it is expected [m] ...
GATE_NEW: Final = 2.5  #: ... and one that was seen once, farther by so much [m]
KEPT: Final = 0.5  #: one that is not seen any more is kept for so long [s]
SURE: Final = 4  #: turns after which a speed is known
#: who has gone no farther than this [m] in so long [s] waits, and is not expected to set out: the speed of a front that
#: flickers from turn to turn is not known so well
STAYS, WAITS = 1.0, 2.0
LENGTH: Final = 5.0  #: of a car [m]
STEP: Final = 2.0  #: of the places of a way that are looked at [m]: between two of them no car fits
LOOKED: Final = 190.0  #: so far back along a way it is looked [m]
BESIDE: Final = 1.6  #: a station's place is no farther from the middle of its way than this [m]
SAME_WAY: Final = math.cos(math.radians(40.0))  #: of the greatest angle between a station and its way


class Other(NamedTuple):
    """One who comes on a way."""

    front: float  #: along the way [m]
    rear: float  #: along the way [m]
    speed: float  #: along the way [m/s]
    known: bool  #: whether the speed is known
    waits: bool  #: whether it has stood for long

    def moved(self, time: float) -> Other:
        """Return where it is after a time [s], if it goes on."""
        return self._replace(front=self.front + self.speed * time, rear=self.rear + self.speed * time)


class _Followed:
    """A body on a way, from turn to turn."""

    __slots__ = ("front", "hits", "rear", "seen", "stays_at", "stays_since", "time")

    def __init__(self, time: float, front: float, rear: float) -> None:
        self.time = self.seen = time
        self.front, self.rear, self.hits = Trend(front, SIGMA**2, FAST**2, AGILITY), rear, 1
        self.stays_at, self.stays_since = front, time

    def predict(self, time: float) -> None:
        self.front.predict(time - self.time)
        self.rear += self.front.rate * (time - self.time)
        self.time = time

    def update(self, front: float, rear: float) -> None:
        self.front.update(front, SIGMA**2)
        self.rear, self.seen, self.hits = rear, self.time, self.hits + 1
        if abs(self.front.value - self.stays_at) > STAYS:
            self.stays_at, self.stays_since = self.front.value, self.time

    def other(self, now: float) -> Other:
        since = now - self.time
        speed = max(self.front.rate, 0.0)
        front = self.front.value + speed * since
        rear = min(self.rear + speed * since, front - LENGTH)
        return Other(front, rear, speed, self.hits >= SURE, now - self.stays_since > WAITS)


class LidarMount(NamedTuple):
    """Where the lidar is, and how far it sees."""

    forward: float  #: of the rear axle [m]
    height: float  #: over the road [m]
    range: float  #: as far as this it sees a car [m]


class OthersOnWays:
    """Keeps who is on the ways of one crossing."""

    def __init__(self, vehicle: Vehicle, lidar: LidarMount) -> None:
        self._bumper = vehicle.rear_axle_to_bumper
        self._forward, self._height, self._range = lidar
        self._memory = Memory()
        self._followed: list[list[_Followed]] = []
        self._heard: list[list[Other]] = []  # at the time of the messages' output
        self._messages: Stations | None = None
        self.in_sight: list[float] = []  #: of each way: from where on to the conflict it is in sight [m]
        self._conflicts: list[Conflict] = []
        self._newest = -math.inf

    def step(self, observation: Observation, conflicts: list[Conflict]) -> None:
        """Take in the newest turn and the newest messages; raises TypeError where the scenario has no lidar."""
        turn = next((one for one in observation.sensors.values() if isinstance(one, PointCloud)), None)
        if turn is None:
            raise TypeError("right of way: the scenario has no sensor of kind lidar, by which others are seen")
        self._memory.add(observation.pose)
        if conflicts is not self._conflicts:
            self._conflicts = conflicts
            self._followed, self._heard = [[] for _ in conflicts], [[] for _ in conflicts]
            self._messages = None
            self.in_sight = [one.reach for one in conflicts]
        if not conflicts:
            return
        if turn.time > self._newest:
            self._newest = turn.time
            self._take(turn)
        stations = next((one for one in observation.sensors.values() if isinstance(one, Stations)), None)
        if stations is not None and stations is not self._messages:
            self._hear(stations)
        self._messages = stations

    def on(self, number: int, now: float) -> list[Other]:
        """Return who is on the way of a conflict, by its number, at a time [s]."""
        seen = [one.other(now) for one in self._followed[number] if one.hits > 1]
        since = 0.0 if self._messages is None else now - self._messages.time
        return seen + [one.moved(since) for one in self._heard[number]]

    def _take(self, turn: PointCloud) -> None:
        axle = self._memory.at(turn.time)
        x, y, _height, _firing = standing(turn, axle, self._forward, self._height, self._forward)
        cells = np.unique(np.stack((np.rint(x / CELL), np.rint(y / CELL))), axis=1) * CELL
        cos, sin = math.cos(axle.heading), math.sin(axle.heading)
        x, y = axle.x + cells[0] * cos - cells[1] * sin, axle.y + cells[0] * sin + cells[1] * cos
        for number, conflict in enumerate(self._conflicts):
            bodies = _bodies(conflict.way, x, y)
            self._follow(self._followed[number], turn.time, bodies)
            self._followed[number] = [one for one in self._followed[number] if turn.time - one.seen <= KEPT]
            self.in_sight[number] = self._seen_from(conflict, turn, axle)

    @staticmethod
    def _follow(followed: list[_Followed], time: float, bodies: list[tuple[float, float]]) -> None:
        for one in followed:
            one.predict(time)
        free = list(followed)
        for front, rear in bodies:
            away = [(abs(one.front.value - front) - (GATE_NEW if one.hits == 1 else 0.0), one) for one in free]
            nearest = min(away, key=lambda pair: pair[0], default=None)
            if nearest is not None and nearest[0] < GATE:
                nearest[1].update(front, rear)
                free.remove(nearest[1])
            else:
                followed.append(_Followed(time, front, rear))

    def _seen_from(self, conflict: Conflict, turn: PointCloud, axle: AxleMotion) -> float:
        """Return from where on a way is in sight up to the conflict [m]; the conflict's place for nowhere."""
        s = np.arange(conflict.reach, max(conflict.reach - LOOKED, 0.0), -STEP)
        if not len(s):  # the way begins within the conflict
            return conflict.reach
        seen = in_sight(*conflict.way.at(s), turn, axle, self._forward, self._height, self._range)
        # One place that is not seen is too short for a car.
        hidden = np.flatnonzero(~seen[1:] & ~seen[:-1]) if len(seen) > 1 else np.flatnonzero(~seen)
        return float(s[hidden[0]]) if len(hidden) else float(s[-1])

    def _hear(self, stations: Stations) -> None:
        """Take in what stations say of themselves."""
        then = self._memory.at(stations.time)
        cos, sin = math.cos(then.heading), math.sin(then.heading)
        ahead = stations.x + self._bumper
        x, y = then.x + ahead * cos - stations.y * sin, then.y + ahead * sin + stations.y * cos
        for number, conflict in enumerate(self._conflicts):
            s, d = conflict.way.locate(x, y) if len(x) else (x, y)
            self._heard[number] = []
            for row in np.flatnonzero(np.abs(d) < BESIDE).tolist():
                (x0, x1), (y0, y1) = (one.tolist() for one in conflict.way.at(np.array((s[row] - 1.0, s[row] + 1.0))))
                heading = then.heading + float(stations.heading[row])
                if math.cos(heading - math.atan2(y1 - y0, x1 - x0)) < SAME_WAY:
                    continue
                half, speed = 0.5 * float(stations.length[row]), float(stations.speed[row])
                front = float(s[row]) + speed * float(stations.age[row]) + half
                self._heard[number].append(Other(front, front - 2.0 * half, speed, True, False))


def _bodies(way: Way, x: np.ndarray, y: np.ndarray) -> list[tuple[float, float]]:
    """Return front and rear along a way of what stands or moves on it [m], by points of the map."""
    low_x, high_x, low_y, high_y = way.x.min(), way.x.max(), way.y.min(), way.y.max()
    near = (x > low_x - 2.0) & (x < high_x + 2.0) & (y > low_y - 2.0) & (y < high_y + 2.0)
    if not near.any():
        return []
    s, d = way.locate(x[near], y[near])
    on = np.sort(s[(np.abs(d) < HALF_LANE) & (s > 0.0) & (s < way.s[-1])])
    pieces = np.split(on, np.flatnonzero(np.diff(on) > APART) + 1)
    return [(float(piece[-1]), float(piece[0])) for piece in pieces if len(piece) >= POINTS]
