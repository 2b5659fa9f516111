"""How fast an actor of a story goes from tick to tick: changes in closed form, and what follows another body.

Pure arithmetic; knows neither triggers nor files.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple, Protocol

from vve_sumo.scenario.story_conditions import Body, Scene
from vve_sumo.scenario.story_schema import KeptDistance, LineChange, Meeting, ProfilePoint, SpeedAction
from vve_sumo.scenario.transitions import Transition, length
from vve_sumo.values import EGO

#: rate at which a limited actor makes up for a distance that is small [1/s]
GAP_GAIN: Final = 1.0
#: a meeting is over when so little time is left until the ego is there [s]
MEETING_TIME: Final = 0.05
#: an ego slower than this is not awaited: the actor keeps its speed [m/s]
WAITING_SPEED: Final = 0.1


class Moved(NamedTuple):
    """One tick of an actor's motion along its line."""

    way: float  #: gone in the tick [m]
    speed: float  #: at its end [m/s]
    over: bool  #: whether the action is over


class Motion(Protocol):
    """What says how fast an actor goes until another motion takes its place."""

    def step(self, time: float, dt: float, speed: float, s: float, scene: Scene) -> Moved:
        """Advance by `dt` [s] to a time [s] since it began; `speed` [m/s] and `s` [m] are those before."""
        ...


class Change:
    """A change of speed in closed form."""

    def __init__(self, transitions: Sequence[Transition]) -> None:
        self._pieces = list(transitions)
        self._gone = 0.0

    @property
    def start(self) -> Moved:
        """Speed at which it begins, and whether it is over at once."""
        piece = next((piece for piece in self._pieces if piece.over > 0.0), None)
        return Moved(0.0, self._pieces[-1].after if piece is None else piece.before, piece is None)

    def step(self, time: float, dt: float, speed: float, s: float, scene: Scene) -> Moved:
        """As in Motion; exact at any tick."""
        total, rest = 0.0, time
        for piece in self._pieces[:-1]:
            spent = min(rest, piece.over)
            total, rest = total + piece.integral(spent), rest - spent
            if rest <= 0.0 and spent < piece.over:
                return self._moved(total, piece.at(spent)[0], False)
        last = self._pieces[-1]
        return self._moved(total + last.integral(rest), last.at(rest)[0], rest >= last.over)

    def _moved(self, total: float, speed: float, over: bool) -> Moved:
        way, self._gone = total - self._gone, total
        return Moved(max(way, 0.0), max(speed, 0.0), over)


def change_of(action: SpeedAction, speed: float, scene: Scene) -> Motion:
    """Return the change that an action makes of a speed [m/s]; the speed of another body is that of this tick."""
    if action.continuous:
        return FollowedSpeed(action)
    target = max(action.to_mps if action.of is None else _of_another(action, speed, scene), 0.0)
    over = action.over_s or 0.0
    if action.acceleration_mps2 is not None:
        over = length(action.shape, target - speed, action.acceleration_mps2)
    if action.over_m is not None:
        # By all these shapes the mean speed over the time is the mean of both speeds.
        mean = 0.5 * (speed + target)
        over = action.over_m / mean if mean > 0.0 else 0.0
    return Change([Transition(speed, target, action.shape, over)])


def profile_of(points: Sequence[ProfilePoint], speed: float) -> Motion:
    """Return the change along a profile's straight pieces from a speed [m/s]."""
    pieces = []
    for point in points:
        pieces.append(Transition(speed, point.speed_mps, "linear", point.over_s))
        speed = point.speed_mps
    return Change(pieces)


def _of_another(action: SpeedAction, speed: float, scene: Scene) -> float:
    other = scene.bodies.get(action.of or "")
    return speed if other is None else action.factor * other.speed + action.to_mps


class FollowedSpeed:
    """The speed of another body, for good."""

    def __init__(self, action: SpeedAction) -> None:
        self._action = action

    def step(self, time: float, dt: float, speed: float, s: float, scene: Scene) -> Moved:
        """As in Motion; the way is by the mean of both speeds."""
        now = max(_of_another(self._action, speed, scene), 0.0)
        return Moved(0.5 * (speed + now) * dt if time > dt else now * dt, now, False)


class Timed:
    """A place on the line for each time."""

    def __init__(self, change: LineChange) -> None:
        self._timing = change.timing

    def step(self, time: float, dt: float, speed: float, s: float, scene: Scene) -> Moved:
        """As in Motion; before the first place it stands there, after the last one it keeps its speed."""
        first, last = self._timing[0], self._timing[-1]
        if time >= last.time_s:
            return Moved(max(last.at_m - s, 0.0) + speed * min(time - last.time_s, dt), speed, True)
        if time <= first.time_s:
            return Moved(max(first.at_m - s, 0.0), 0.0, False)
        for one, later in pairwise(self._timing):
            if time < later.time_s:
                rate = (later.at_m - one.at_m) / (later.time_s - one.time_s)
                return Moved(max(one.at_m + rate * (time - one.time_s) - s, 0.0), rate, False)
        return Moved(0.0, speed, True)


class Following:
    """A distance to another body along the actor's line."""

    def __init__(self, action: KeptDistance, reach: tuple[float, float]) -> None:
        """`reach`: how far the actor's box goes back (negative) and forward of its reference point [m]."""
        self._action, self._reach, self._side = action, reach, action.side

    @property
    def other(self) -> str:
        """The id of the other body."""
        return self._action.to

    @property
    def at_once(self) -> bool:
        """Whether nothing limits how the distance is taken up."""
        return self._action.acceleration_mps2 is None

    def missing(self, s: float, other: Body, other_s: float, turned: float, speed: float) -> float:
        """Return how far along its line the actor is behind where it shall be [m]."""
        action = self._action
        if self._side == "any":
            self._side = "ahead" if s >= other_s else "behind"
        gap = action.gap_m if action.gap_m is not None else (action.headway_s or 0.0) * speed
        back, front = _reach_along(other, turned) if action.freespace else (0.0, 0.0)
        own_back, own_front = self._reach if action.freespace else (0.0, 0.0)
        wanted = other_s + back - gap - own_front
        if self._side == "ahead":
            wanted = other_s + front + gap - own_back
        return wanted - s

    def follow(self, missing: float, speed: float, other_speed: float, dt: float) -> Moved:
        """Return one tick of taking the distance up, and keeping it."""
        action = self._action
        if action.acceleration_mps2 is None or action.deceleration_mps2 is None:
            # Without limits the actor is where it shall be at once; a way back is one, too.
            return Moved(missing, speed if action.once else other_speed, action.once)
        # The speed from which it brakes down to the other's within what is missing, less where that is little.
        limit = action.deceleration_mps2 if missing > 0.0 else action.acceleration_mps2
        excess = math.copysign(min(math.sqrt(2.0 * limit * abs(missing)), GAP_GAIN * abs(missing)), missing)
        wanted = max(other_speed + excess, 0.0)
        if action.speed_limit_mps is not None:
            wanted = min(wanted, action.speed_limit_mps)
        now = min(max(wanted, speed - action.deceleration_mps2 * dt), speed + action.acceleration_mps2 * dt)
        reached = action.once and abs(missing) < 0.05 and abs(now - other_speed) < 0.05
        return Moved(0.5 * (speed + now) * dt, max(now, 0.0), reached)


def _reach_along(body: Body, turned: float) -> tuple[float, float]:
    """How far a body's box goes back and forward of its reference point along a line that it is turned to [rad]."""
    axis = body.heading - turned
    cos, sin = math.cos(axis), math.sin(axis)
    along = [(x - body.x) * cos + (y - body.y) * sin for x, y in body.box.corners()]
    return min(along), max(along)


class Arriving:
    """An arrival with the ego: at each tick the acceleration that gets there then with the least effort.

    With the way d left in the time T, from the speed v to the speed w, the acceleration whose square over the time is
    least is a line over the time, which begins with 6 d / T^2 - (4 v + 2 w) / T; where w is free with
    3 (d / T - v) / T.
    """

    def __init__(self, meeting: Meeting) -> None:
        self._meeting = meeting

    def step(self, time: float, dt: float, speed: float, s: float, scene: Scene) -> Moved:
        """As in Motion."""
        meeting, ego = self._meeting, scene.bodies.get(EGO)
        if ego is None:
            return Moved(speed * dt, speed, False)
        left = meeting.ego_at_m - scene.path.project(ego.x, ego.y).s
        if left <= 0.0:
            wanted = self._wanted(ego.speed)
            return Moved(speed * dt, speed if wanted is None else wanted, True)
        if ego.speed < WAITING_SPEED:
            return Moved(speed * dt, speed, False)
        # The ego is where it is at the end of the tick, the actor where it was at its beginning.
        due = left / ego.speed + dt
        now = max(speed + self._acceleration(due, meeting.at_m - s, speed, self._wanted(ego.speed)) * dt, 0.0)
        return Moved(0.5 * (speed + now) * dt, now, False)

    def _wanted(self, of_ego: float) -> float | None:
        meeting = self._meeting
        return meeting.speed_mps if meeting.relative_mps is None else max(of_ego + meeting.relative_mps, 0.0)

    def _acceleration(self, due: float, way: float, speed: float, wanted: float | None) -> float:
        if wanted is None:
            return 3.0 * (way / due - speed) / due if due > MEETING_TIME else 0.0
        steady = self._meeting.steady_m / wanted if wanted > 0.0 else 0.0
        steady = max(steady, self._meeting.steady_s)
        due, way = due - steady, way - steady * wanted
        if due <= MEETING_TIME:
            return (wanted - speed) / MEETING_TIME
        return 6.0 * way / (due * due) - (4.0 * speed + 2.0 * wanted) / due
