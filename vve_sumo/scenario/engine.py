"""Moves a scenario's actors tick by tick: when each enters, what it does when, and where exactly it is.

A pure state machine: it is told the ego's pose and answers with boxes. Must not know SUMO, files or who looks at them.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple, Protocol

from vve_sumo.body_kinds import TYPICAL
from vve_sumo.laws import clamp
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.road_users import Actor, ActorEvent, Kind, When
from vve_sumo.scenario.story_schema import Groups
from vve_sumo.scenario.story_stage import StoryStage
from vve_sumo.values import ActorState, Pose, Vehicle

#: Acceleration of people who set off or stop on foot [m/s2], where a scenario states none and asks for measured ones:
#: 0.14 g with a standard deviation of 0.09 g up to 1.36 m/s, the mean of 288 people at crosswalks (Fugger, Randles,
#: Stein, Whiting and Gallagher, Transportation Research Record 1705, 2000). Of stopping and of children it is assumed.
WALKING_ACCELERATION: Final = 1.4
ON_FOOT: Final[frozenset[Kind]] = frozenset({"pedestrian", "child"})

#: A time that a trigger states has come when no more than this is left of it [s]: ticks add up to it in floats.
TIME_TOLERANCE: Final = 1e-6

#: Below this speed [m/s] a body that goes over sidewards turns less than the way it goes: whoever stands faces on.
TURNING_SPEED: Final = 2.0

#: On the inside of a bend a line beside a path is shorter than the path, but never by more than this factor.
MIN_LENGTH_RATIO: Final = 0.2
ROUNDS: Final = 8  #: of Newton's method for the s of a place on a line beside a path
NEAR_ENOUGH: Final = 1e-10  #: [m]

#: An s on the ego's path is looked for from the last one only if that is no older than this [s].
STALE: Final = 0.5

#: Closing speed of what is beside the ego [m/s]: no gap is there to close.
NEVER: Final = -math.inf


class ActorProgress(Protocol):
    """How far and how fast, from the moment it began."""

    def at(self, time: float) -> tuple[float, float]:
        """Return distance [m] and speed [m/s] at a time [s] since it began."""
        ...


@dataclass(frozen=True, slots=True)
class SpeedChange:
    """From one speed to another at an acceleration that builds up linearly; steady afterwards, and exact throughout.

    With the acceleration a built up in T: v = v0 + a t^2 / (2 T) while it does, then v0 + a (t - T / 2).
    """

    before: float  #: speed it begins at [m/s]
    after: float  #: speed it ends at [m/s]
    acceleration: float = math.inf  #: size of it [m/s2]; inf changes the speed at once
    build_up: float = 0.0  #: [s]

    @property
    def duration(self) -> float:
        """Time until the speed is the one it ends at [s]."""
        change = abs(self.after - self.before)
        if change == 0.0 or math.isinf(self.acceleration):
            return 0.0
        built_up = 0.5 * self.acceleration * self.build_up
        if change <= built_up:
            return math.sqrt(2.0 * change * self.build_up / self.acceleration)
        return 0.5 * self.build_up + change / self.acceleration

    def at(self, time: float) -> tuple[float, float]:
        """Return distance [m] and speed [m/s] at a time [s] since it began."""
        end = self.duration
        if time < end:
            return self._changing(time)
        reached = self._changing(end)[0] if end > 0.0 else 0.0
        return reached + self.after * (time - end), self.after

    def _changing(self, time: float) -> tuple[float, float]:
        rate = math.copysign(self.acceleration, self.after - self.before)
        ramp = min(time, self.build_up)
        part = ramp / self.build_up if self.build_up > 0.0 else 0.0
        speed = self.before + 0.5 * rate * part * ramp
        distance = self.before * ramp + rate * part * ramp * ramp / 6.0
        rest = time - ramp
        distance += rest * (speed + 0.5 * rate * rest)
        low, high = sorted((self.before, self.after))
        return distance, min(max(speed + rate * rest, low), high)


class RecordedSpeed:
    """A recorded speed, straight between its rows, from its first row on; its last speed holds."""

    def __init__(self, times: Sequence[float], speeds: Sequence[float]) -> None:
        """`times` [s] rise strictly, `speeds` [m/s] are not negative; at least one of each."""
        self._times = [float(time) - float(times[0]) for time in times]
        self._speeds = [float(speed) for speed in speeds]
        self._reached = [0.0]
        rows = list(zip(self._times, self._speeds, strict=True))
        for (start, speed), (end, next_speed) in pairwise(rows):
            self._reached.append(self._reached[-1] + 0.5 * (speed + next_speed) * (end - start))

    def at(self, time: float) -> tuple[float, float]:
        """Return distance [m] and speed [m/s] at a time [s] since it began."""
        i = max(bisect_right(self._times, time) - 1, 0)
        since, speed = time - self._times[i], self._speeds[i]
        if i + 1 == len(self._times):
            return self._reached[i] + speed * since, speed
        slope = (self._speeds[i + 1] - speed) / (self._times[i + 1] - self._times[i])
        return self._reached[i] + since * (speed + 0.5 * slope * since), max(speed + slope * since, 0.0)


class Sidestep(NamedTuple):
    """From one lateral offset d to another with the least jerk: 10 p^3 - 15 p^4 + 6 p^5 over the part p of its time.

    T. Flash and N. Hogan, "The coordination of arm movements", J. Neuroscience 5 (1985).
    """

    before: float  #: d it begins at [m]
    after: float  #: d it ends at [m]
    over: float = 0.0  #: time that it takes [s]; 0 is at once

    def at(self, time: float) -> tuple[float, float]:
        """Return d [m] and its rate [m/s] at a time [s] since it began."""
        if not time < self.over:
            return self.after, 0.0
        p, way = time / self.over, self.after - self.before
        rest = 1.0 - p
        return self.before + way * p * p * p * (
            10.0 + p * (6.0 * p - 15.0)
        ), 30.0 * way * p * p * rest * rest / self.over


class ActorLine(Protocol):
    """The line that an actor moves along or beside."""

    @property
    def over(self) -> bool:
        """Whether the actor has come to its end."""
        ...

    def move(self, distance: float, d: float) -> None:
        """Go a distance [m] on while being at `d` [m] beside it."""
        ...

    def spot(self, d: float) -> tuple[float, float, float, float]:
        """Return x, y [m], heading [rad] of the way it goes there, and which side a growing d is: 1 is left."""
        ...


class AlongPath:
    """Along a path, or against it, at a lateral offset d that counts from the path, left of the path positive.

    The distance gone is that of the actor itself: on a line at d beside a path it is s - d (turn), which is exact
    where d stays the same.
    """

    def __init__(self, path: ReferencePath, s: float, sense: float) -> None:
        """`sense` is 1 along the path and -1 against it; `s` [m] the place on it."""
        self.s, self._path, self._sense = s, path, sense
        self._path_point = path.at(s)

    @property
    def over(self) -> bool:
        """Whether the path ends here, in the direction that the actor goes."""
        return self.s > self._path.length if self._sense > 0.0 else self.s < 0.0

    def move(self, distance: float, d: float) -> None:
        """Go a distance [m] on while being at `d` [m] beside the path."""
        if distance == 0.0:
            return
        wanted, from_heading = self._sense * distance, self._path_point.heading
        low, high = sorted((0.0, wanted / MIN_LENGTH_RATIO))
        gone, there = wanted, self._path.at(self.s + wanted)
        for _ in range(ROUNDS):
            missing = wanted - gone + d * math.remainder(there.heading - from_heading, math.tau)
            if not abs(missing) > NEAR_ENOUGH:
                break
            gone = clamp(gone + missing / max(1.0 - d * there.curvature, MIN_LENGTH_RATIO), low, high)
            there = self._path.at(self.s + gone)
        self.s += gone
        self._path_point = there

    def spot(self, d: float) -> tuple[float, float, float, float]:
        """Return x, y [m], heading [rad] of the way it goes there, and which side a growing d is: 1 is left."""
        x, y, heading, _ = self._path_point
        turned = heading if self._sense > 0.0 else heading + math.pi
        return x - d * math.sin(heading), y + d * math.cos(heading), turned, self._sense


class Straight:
    """A straight line from a place, without an end."""

    def __init__(self, x: float, y: float, heading: float) -> None:
        self._x, self._y, self._heading, self._gone = x, y, heading, 0.0
        self._cos, self._sin = math.cos(heading), math.sin(heading)

    @property
    def over(self) -> bool:
        """Never."""
        return False

    def move(self, distance: float, d: float) -> None:
        """Go a distance [m] on."""
        self._gone += distance

    def spot(self, d: float) -> tuple[float, float, float, float]:
        """Return x, y [m], heading [rad] of the way it goes there, and which side a growing d is: 1 is left."""
        x = self._x + self._gone * self._cos - d * self._sin
        return x, self._y + self._gone * self._sin + d * self._cos, self._heading, 1.0


class EgoMotion(NamedTuple):
    """What the triggers know of the ego."""

    s: float  #: of its front bumper on its path [m]
    speed: float  #: [m/s]
    length: float  #: [m]


class RoomBetween(NamedTuple):
    """What lies between the ego and an actor, along the ego's path."""

    centre: float  #: from the ego's front bumper forward to the actor's centre [m]
    gap: float  #: between their nearest faces, ahead of the ego or behind it [m]; 0 beside it
    closing: float  #: speed at which the gap shrinks [m/s]; NEVER beside it


def far(when: When) -> bool:
    """Return whether a trigger asks how far the actor is from the ego."""
    return when.ego_within_m is not None or when.ttc_s is not None or when.ego_arrives_in_s is not None


def fires(when: When, now: float, since: float, ego: EgoMotion | None, between: RoomBetween | None) -> bool:
    """Return whether every condition that a trigger states holds.

    `now` is the drive's time, `since` the time that `after_s` counts from [s]; `ego` and `between` are None where
    nobody knows them, and then no condition about them holds. Neither does any on NaN.
    """
    if when.drive_s is not None and not now >= when.drive_s - TIME_TOLERANCE:
        return False
    if when.after_s is not None and not now - since >= when.after_s - TIME_TOLERANCE:
        return False
    if when.ego_at_m is not None and not (ego is not None and ego.s >= when.ego_at_m):
        return False
    if when.ego_speed_mps is not None and not (ego is not None and ego.speed >= when.ego_speed_mps):
        return False
    if not far(when):
        return True
    return ego is not None and between is not None and _near(when, ego, between)


def _near(when: When, ego: EgoMotion, between: RoomBetween) -> bool:
    if when.ego_within_m is not None and not between.gap <= when.ego_within_m:
        return False
    if when.ttc_s is not None and not (between.closing > 0.0 and between.gap <= when.ttc_s * between.closing):
        return False
    wanted = when.ego_arrives_in_s
    return wanted is None or (ego.speed > 0.0 and between.centre <= wanted * ego.speed)


class ActorController:
    """One actor: it waits, enters, goes through its events, and leaves."""

    def __init__(
        self, actor: Actor, ego_path: ReferencePath, path: ReferencePath, recordings: Mapping[str, RecordedSpeed]
    ) -> None:
        """`path` is the actor's own, or the ego's again; `recordings` are found by the names that its events use."""
        self._actor, self._ego_path, self._path, self._recordings = actor, ego_path, path, recordings
        size = TYPICAL[actor.kind]
        self._length = size.length if actor.length_m is None else actor.length_m
        self._width = size.width if actor.width_m is None else actor.width_m
        self._turned = math.radians(actor.turned_deg)
        self._along = abs(actor.turned_deg) in (0.0, 180.0)
        walks = actor.fidelity == "measured" and actor.kind in ON_FOOT
        self._acceleration = WALKING_ACCELERATION if walks else math.inf
        self._line: ActorLine | None = None
        self._d, self._rate, self._speed = 0.0, 0.0, actor.speed_mps
        self._course: ActorProgress = SpeedChange(actor.speed_mps, actor.speed_mps)
        self._side = Sidestep(0.0, 0.0)
        self._course_began = self._side_began = self._begun = self._covered = 0.0
        self._waiting: list[ActorEvent] = list(reversed(actor.events))
        self._looked = (0.0, -math.inf)  # s on the ego's path, and when
        self.gone = False  #: whether it left for good

    @property
    def begun(self) -> int:
        """How many of its events it has begun; -1 before it entered."""
        return -1 if self._line is None else len(self._actor.events) - len(self._waiting)

    def step(self, now: float, ego: EgoMotion | None) -> ActorState | None:
        """Advance to a time [s] of the drive and return the actor; None while it is not on the virtual road."""
        if self._line is None:
            self._enter(now, ego)
        else:
            self._move(now, self._line)
        if self._line is None or self.gone:
            return None
        while self._waiting and self._due(self._waiting[-1].when, now, self._begun, ego, self._line):
            event = self._waiting.pop()
            if event.leaves:
                self.gone = True
                return None
            self._begin(event, now)
        return self._state(self._line)

    def _enter(self, now: float, ego: EgoMotion | None) -> None:
        when = self._actor.enters
        if not far(when) and not fires(when, now, 0.0, ego, None):
            return
        line = self._entrance(ego)
        if line is None or not self._due(when, now, 0.0, ego, line):
            return
        self._line, self.gone = line, line.over
        self._begun = self._course_began = self._side_began = now

    def _entrance(self, ego: EgoMotion | None) -> ActorLine | None:
        """The line that it would move along if it entered now; its d and its state are those of its entry."""
        actor = self._actor
        if actor.at_m is not None:
            s = actor.at_m
        elif actor.ahead_m is not None and ego is not None:
            half = self._half(self._turned)
            s = ego.s + actor.ahead_m + (half if actor.ahead_m >= 0.0 else -half)
        else:
            return None
        self._d = actor.offset_m
        if self._along:
            self._side = Sidestep(self._d, self._d)
            return AlongPath(self._path, s, 1.0 if self._turned == 0.0 else -1.0)
        at = self._path.at(s)
        x, y = at.x - self._d * math.sin(at.heading), at.y + self._d * math.cos(at.heading)
        self._d = 0.0
        return Straight(x, y, at.heading + self._turned)

    def _move(self, now: float, line: ActorLine) -> None:
        covered, self._speed = self._course.at(now - self._course_began)
        before = self._d
        self._d, self._rate = self._side.at(now - self._side_began)
        line.move(covered - self._covered, 0.5 * (before + self._d))
        self._covered = covered
        self.gone = line.over

    def _begin(self, event: ActorEvent, now: float) -> None:
        self._begun = now
        if event.speed_mps is not None:
            rate = self._acceleration if event.acceleration_mps2 is None else event.acceleration_mps2
            self._take(SpeedChange(self._speed, event.speed_mps, rate, event.build_up_s), now)
        if event.speeds is not None:
            self._take(self._recordings[event.speeds], now)
        if event.offset_m is not None:
            self._side, self._side_began = Sidestep(self._d, event.offset_m, event.over_s or 0.0), now
            self._d, self._rate = self._side.at(0.0)

    def _take(self, course: ActorProgress, now: float) -> None:
        self._course, self._course_began = course, now
        self._covered, self._speed = course.at(0.0)

    def _due(self, when: When, now: float, since: float, ego: EgoMotion | None, line: ActorLine) -> bool:
        between = self._between(now, ego, line) if ego is not None and far(when) else None
        return fires(when, now, since, ego, between)

    def _between(self, now: float, ego: EgoMotion, line: ActorLine) -> RoomBetween:
        x, y, heading, _ = line.spot(self._d)
        if isinstance(line, AlongPath) and self._path is self._ego_path:
            s, angle = line.s, self._turned
        else:
            last, when = self._looked
            foot = self._ego_path.project(x, y, last if now - when <= STALE else None)
            self._looked = (foot.s, now)
            s, angle = foot.s, heading - foot.heading
        half, along = self._half(angle), self._speed * math.cos(angle)
        centre = s - ego.s
        ahead, behind = centre - half, -centre - half - ego.length
        if ahead > 0.0:
            return RoomBetween(centre, ahead, ego.speed - along)
        return RoomBetween(centre, behind, along - ego.speed) if behind > 0.0 else RoomBetween(centre, 0.0, NEVER)

    def _half(self, angle: float) -> float:
        """Half of what the box covers of a line that it stands at an angle [rad] to [m]."""
        return 0.5 * (self._length * abs(math.cos(angle)) + self._width * abs(math.sin(angle)))

    def _state(self, line: ActorLine) -> ActorState:
        x, y, heading, side = line.spot(self._d)
        turn = math.atan2(side * self._rate, max(self._speed, TURNING_SPEED)) if self._rate != 0.0 else 0.0
        speed = self._speed * math.cos(turn) + side * self._rate * math.sin(turn)
        heading = math.remainder(heading + turn, math.tau)
        return ActorState(self._actor.id, self._actor.kind, x, y, heading, speed, self._length, self._width)


class ScenarioEngine:
    """All actors of a drive."""

    def __init__(
        self,
        actors: Sequence[Actor],
        path: ReferencePath,
        lines: Mapping[str, ReferencePath],
        recordings: Mapping[str, tuple[Sequence[float], Sequence[float]]],
        vehicle: Vehicle,
        end: Groups = (),
    ) -> None:
        """Have the actors wait; nothing moves before the first step.

        `path` is the ego's; `lines` and `recordings` (times [s], speeds [m/s]) are what the actors' names of paths
        and recorded speeds mean. Every place s lies on its path, sizes and times are as the schema allows. `end` is the
        trigger that ends the drive.
        """
        courses = {name: RecordedSpeed(*columns) for name, columns in recordings.items()}
        self._stage = StoryStage([one for one in actors if one.story is not None], path, lines, vehicle, end)
        self._parts = [
            self._stage.actors.get(one.id)
            or ActorController(one, path, path if one.path is None else lines[one.path], courses)
            for one in actors
        ]
        self._path, self._vehicle = path, vehicle
        self._ids = [one.id for one in actors]
        self._ego_s: float | None = None
        self._now = -math.inf
        self._states: tuple[ActorState, ...] = ()

    @property
    def begun(self) -> tuple[int, ...]:
        """How many of its events each actor has begun, in the scenario's order; -1 before it entered."""
        return tuple(part.begun for part in self._parts)

    def step(self, now: float, pose: Pose | None) -> tuple[ActorState, ...]:
        """Advance to a time [s] since the drive began and return who is on the virtual road, in the scenario's order.

        `pose` is that of the ego's front bumper at the same moment; where it is None or not finite the actors move
        on and no trigger that asks for the ego fires. A time that is not later than the last moves nobody.
        """
        if not (self._parts or self._stage.watches) or not math.isfinite(now):
            return self._states
        self._now = max(self._now, now)
        ego = self._ego(pose)
        plain = [part for part in self._parts if isinstance(part, ActorController)]
        stepped = [part.step(self._now, ego) for part in plain if not part.gone]
        states = tuple(state for state in stepped if state is not None)
        if self._stage.watches:
            found = {state.id: state for state in (*states, *self._stage.step(self._now, ego and pose, states))}
            states = tuple(found[name] for name in self._ids if name in found)
        self._states = states
        return states

    @property
    def ended(self) -> bool:
        """Whether the trigger that ends the drive has fired."""
        return self._stage.ended

    def _ego(self, pose: Pose | None) -> EgoMotion | None:
        if pose is None or not all(map(math.isfinite, (pose.x, pose.y, pose.speed))):
            return None
        self._ego_s = self._path.project(pose.x, pose.y, self._ego_s).s
        return EgoMotion(self._ego_s, pose.speed, self._vehicle.length)
