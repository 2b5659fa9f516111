"""Decides when the car leaves its path for what is in its way, plans the way around it, and leads the car along it.

Two cases. What stands or is slow is gone around in comfort, where the road beside is seen to be free for as long as
that takes: who comes the other way goes first. And where full braking would come too late, the car swerves, as hard as
the gateway lets it, braking meanwhile: the least time to stop against the least time to come to the side. In all other
cases the car brakes on its path, as `follow_and_stop` does; once it is out, it does not stop in the way of who comes if
it can go on before him. It must not know how a planner plans, nor brakes' laws.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.controller import Tuning, settle
from vve_sumo.path import PathProjection
from vve_sumo.values import Observation, Vehicle

from . import follow_and_stop
from .follow_and_stop import FollowAndStop, Way, steering_law
from .free_space import LEFT, Margins, Nodes, Room, room, sides_to_pass
from .in_the_way import (
    COMFORT,
    HEAD,
    LOOKS_FROM,
    URGENT,
    WANTED,
    Sight,
    asks_for_room,
    beside_at_rest,
    braked_speeds,
    can_wait,
    comes_at_once,
    comes_nearer,
    comes_too_late,
    covers,
    creeping_speeds,
    in_path,
    is_gone,
    is_met,
    is_slow,
    leads_free,
    may_come_over,
    too_near,
)
from .lateral_plan import LateralLimits, LateralPlan, Planner, Planning, Task, times_at
from .outlines import Body, Outlines
from .pull_out import CRAWLS, REACH, Start, way_out
from .speed import SPEEDING_UP
from .tracks import Target, Tracker
from .way_around import NEAR, NODES, SPACING, URGENT_ACCELERATION, URGENT_JERK, WayAround, speeding_up

#: as COMFORT, before the car has left its path: it must then be back so much earlier before who comes the other way
SETTING_OUT: Final = COMFORT._replace(slack=3.5)
#: a way in comfort that is this far from all bodies is kept where no new one is found [m]
KEPT: Final = 0.7
#: where the car would else stop in the way of who comes, it goes on so long before him, and so far from him [s], [m]
HURRIED, NEAREST = COMFORT._replace(slack=0.5), NEAR
COMFORT_ACCELERATION, COMFORT_JERK = 1.8, 2.0  #: lateral, of a way in comfort [m/s2], [m/s3]
#: speeds of a way in comfort, tried one after the other: out of a narrow place a car comes slowly only [m/s]
CAPS: Final = (math.inf, 5.0, 3.0, 2.0)
SLOWS: Final = 1.0  #: and from so much more it slows down to one of them [m/s]
ONE_BEND: Final = 0.02  #: out near full lock a car comes where the road's curvature changes by no more [1/m]
STANDS: Final = 0.2  #: a car that is no faster has come to rest [m/s]
AT_PATH, ALONG_PATH = 0.12, 0.03  #: the car so near to its path, and its way, is back on it [m]
ASTRAY: Final = 0.7  #: a way that the car is farther off than this begins anew where the car is [m]
WANDERS: Final = 0.3  #: so far beside its path a way may lead on any road [m]
BACK: Final = 0.6  #: a car that waits no farther beside its path is out of the way of who comes the other way [m]
SIGHT: Final = 80.0  #: as far as this a lidar sees a car [m]
LOOKS_EVERY: Final = 3.0  #: between the places of the road beside that must be in sight [m]
REACTION: Final = 1.0  #: the car must be back on its side so long before who comes the other way [s]
BLIND: Final = 0.6  #: after so long without a turn of the lidar a car on a way of its own stops [s]
LOOKS: Final = 3  #: a way in comfort must be free in so many turns of the lidar, one after the other
#: portions of work on a decision in one tick, of about a millisecond each; a tick that takes in a turn of the lidar has
#: less time and does one. For a swerve every tick counts.
PORTIONS, URGENT_PORTIONS = 3, 12

TUNING: dict[str, float | str | bool] = {
    **follow_and_stop.TUNING,
    "gap_m": 15.0,  #: bumper to target at rest: room to steer out from there
    "sensor": "roof",  #: name of the scenario's lidar
    "forward_m": 1.4,  #: of the lidar from the rear axle
    "height_m": 1.9,  #: of the lidar over the road
    "left_m": 0.0,  #: how far the rear axle may go to the left of its path; the scenario's corridor should have it
    "right_m": 0.0,  #: the same to the right
}
RANGES: dict[str, tuple[float, float]] = {
    **follow_and_stop.RANGES,
    "forward_m": (-5.0, 15.0),
    "height_m": (0.2, 5.0),
    "left_m": (0.0, 12.0),
    "right_m": (0.0, 12.0),
}


_DECIDED: Final = object()


class _Try(NamedTuple):
    """A way in comfort that is to be looked for."""

    cap: float  #: of the speed until the car is beside what blocks its path [m/s]
    sides: Sequence[int]  #: on which it passes the bodies
    pulls_out: bool  #: whether it begins near full lock


class SteerAround:
    """Keeps the way."""

    def __init__(self, vehicle: Vehicle, planner: Planner, outlines: Outlines, tuning: dict[str, float]) -> None:
        """`tuning` as in TUNING, numbers alone."""
        self._vehicle, self._planner, self._outlines = vehicle, planner, outlines
        self._left, self._right = tuning["left_m"], tuning["right_m"]
        self._lateral, self._brakes = tuning["lateral_acceleration_m_s2"], bool(tuning["emergency"])
        self._line: WayAround | None = None
        self._along: float | None = None  # place along the way [m]
        self._bodies: list[Body] = []
        self._seen = 0.0  # drive time for which the bodies hold [s]
        self._in_path: list[Body] = []  # what of them stands in the scenario's path or goes along it
        self._free = 0  # turns in a row in which a way in comfort was free
        self._decision: Generator[None, None, None] | None = None  # by the newest turn, while it is being made
        self._hurries = False  # whether it is about a swerve
        self._tried = 0  # of the speeds and sides of a way in comfort, the one that was tried last

    def step(self, observation: Observation, projection: PathProjection, tracker: Tracker) -> Way | None:
        """Return the way to take, None for the scenario's path; called once a tick, after the tracker."""
        if not (self._left or self._right):
            return None
        if self._outlines.step(observation, projection):
            self._bodies = self._outlines.bodies(observation.time, tracker.confirmed)
            self._seen = observation.time
            sight = self._sight(observation, projection)
            self._in_path = in_path(sight)
            # What was still being decided on by an older turn is out of date.
            self._decision = self._deciding(sight, self._decision is not None)
            self._decide(1)
        else:
            self._decide(PORTIONS)
        if self._line is None:
            return None
        pose, line = observation.pose, self._line
        on_line = line.path.project(pose.x, pose.y, self._along)
        self._along = on_line.s
        commanded = line.commanded_from(math.floor(projection.s / SPACING))
        bodies = [body.moved(observation.time - self._seen) for body in self._bodies]
        met = line.met(bodies, self._vehicle, projection, pose.speed)
        if not observation.time - self._seen <= BLIND:
            met = (Target(0.0, 0.0), met[1])
        return Way(line.path, on_line, line.profile, commanded, *met)

    def in_path(self, observation: Observation, projection: PathProjection) -> Target | None:
        """Return the nearest body that stands in the scenario's path or goes along it, by its outline.

        A radar's one point of a body may lie beside the path while a side of the body is in it.
        """
        bumper = projection.s + self._vehicle.rear_axle_to_bumper
        moved = [body.moved(observation.time - self._seen) for body in self._in_path]
        ahead = [(float(body.s.min()) - bumper, body) for body in moved if float(body.s.max()) > bumper]
        gap, body = min(ahead, key=lambda pair: pair[0], default=(math.inf, None))
        return None if body is None else Target(gap, body.along)

    def _sight(self, observation: Observation, here: PathProjection) -> Sight:
        first = math.floor(here.s / SPACING)
        s = SPACING * (first + np.arange(NODES))
        curvature = np.array([observation.path.at(node).curvature for node in s.tolist()])
        nodes = Nodes.of(self._vehicle, s, curvature)
        speed, speeds = max(observation.pose.speed, 0.0), []
        for bend in curvature.tolist():
            limit = min(observation.desired_speed, math.sqrt(self._lateral / max(abs(bend), 1e-6)))
            speed = math.sqrt(min(speed * speed + 2.0 * SPEEDING_UP * SPACING, max(limit, speed) ** 2))
            speeds.append(max(speed, 0.5))
        bodies = [body for body in self._bodies if not is_gone(body, here.s - self._vehicle.rear_overhang)]
        return Sight(self._vehicle, observation, here, bodies, nodes, speeds, first)

    # What to do, once a turn. The ticks until the next turn share the work, so that no tick is held up.

    def _decide(self, portions: int) -> None:
        """Go on deciding for so many portions of work, for more where the car has to swerve."""
        done = 0
        while self._decision is not None and done < (URGENT_PORTIONS if self._hurries else portions):
            done += 1
            if next(self._decision, _DECIDED) is _DECIDED:
                self._decision = None

    def _deciding(self, sight: Sight, was_cut_off: bool) -> Generator[None, None, None]:
        """Decide, and yield after each portion of work; what is decided counts once it is.

        Where the decision by the turn before was cut off, it was looking for a new way in comfort, and had not come to
        what is done without one. That comes first now: else the car would go on along a way that is not free any more.
        """
        times = times_at(sight.speeds, SPACING)
        asking = [body for body in sight.bodies if asks_for_room(sight, times, body)]
        blocking = [body for body in asking if not comes_nearer(body)]
        self._hurries = comes_too_late(sight, asking, self._line, self._brakes)
        if not asking and self._line is None:
            self._free = self._tried = 0
            return
        if self._line is not None and sight.here.s < self._line.out_until and self._is_free(sight, self._keeps(sight)):
            # No planner's way has such bends.
            self._keep(sight)
            return
        plan = None
        if (self._line is None or not was_cut_off) and all(is_slow(body, sight) for body in blocking):
            plan = yield from self._in_comfort(sight, blocking)
        if plan is not None:
            self._adopt(sight, plan, urgent=False)
        elif self._line is None or self._gives_up(sight, asking, blocking):
            yield from self._swerve(sight, asking)
        elif not self._line.urgent and (yield from self._stays(sight, blocking)):
            pass
        elif not (yield from self._swerve(sight, [body for body in sight.bodies if is_met(sight, body, self._line)])):
            self._go_on(sight)

    def _gives_up(self, sight: Sight, asking: list[Body], blocking: list[Body]) -> bool:
        """Give up a way for which the car has no use any more; tell whether it did.

        That is, while the car is still on its path, one in comfort that is not free, where the car can slow down behind
        what is there, in comfort or, where the way leads too near to somebody, with all there is; and an urgent one
        where braking is not too late after all; and an urgent one on which the car has come to rest: it leads past
        bodies nearer than anybody would set out to go.
        """
        assert self._line is not None
        if self._line.urgent:
            # The way itself leads past whom it is about: without it he would be met.
            needed = comes_too_late(sight, asking, None, self._brakes)
            useful = needed or (abs(sight.here.d) > AT_PATH and sight.observation.pose.speed > STANDS)
        elif abs(sight.here.d) > AT_PATH:
            useful = True
        else:
            useful = bool(blocking) and (
                self._is_free(sight, self._keeps(sight))
                or (not can_wait(sight, blocking) and self._is_free(sight, COMFORT))
                or comes_too_late(sight, asking, None, self._brakes)
            )
        if not useful:
            self._line = self._along = None
        return not useful

    def _stays(self, sight: Sight, blocking: list[Body]) -> Generator[None, None, bool]:
        """Keep to the way that the car has, or take the one back to its path; tell whether one of them will do."""
        if blocking and self._is_free(sight, self._keeps(sight)):
            self._keep(sight)
            return True
        back = (yield from self._way_back(sight)) if can_wait(sight, blocking) else None
        if back is not None and beside_at_rest(sight, back) < BACK:
            self._adopt(sight, back, urgent=False)
            return True
        if blocking and self._is_free(sight, COMFORT):
            # Stopped halfway out it would be in the way of who comes.
            self._keep(sight)
            return True
        if (yield from self._hurrying(sight, blocking)):
            return True
        if back is not None:
            self._adopt(sight, back, urgent=False)
        return back is not None

    def _hurrying(self, sight: Sight, blocking: list[Body]) -> Generator[None, None, bool]:
        """Go on before who comes, in whose way the car would else come to rest, if it can; tell whether.

        That takes a car that moves: one at rest would be too late.
        """
        assert self._line is not None
        present = self._going_on(sight)
        hindering = too_near(sight, present, COMFORT, KEPT, KEPT)
        moves = sight.observation.pose.speed > STANDS
        if not (moves and any(map(comes_nearer, hindering)) and all(is_slow(body, sight) for body in blocking)):
            return False
        if self._hurries_on(sight, KEPT) or self._hurries_on(sight, NEAREST):
            return True
        yield
        limits = LateralLimits.of(self._vehicle, min(COMFORT_ACCELERATION, self._lateral), COMFORT_JERK)
        choices = sides_to_pass(sight.bodies, blocking)
        sides = choices[0 if max(present.d) > -min(present.d) or len(choices) < 2 else 1]
        plan = yield from self._planner.planning(self._task(sight, sides, HURRIED, limits, sight.speeds))
        if plan is not None:
            self._adopt(sight, plan, urgent=False)
        return plan is not None

    def _hurries_on(self, sight: Sight, away: float) -> bool:
        """Take the way that the car has as fast as its bends allow, if it leads past all; tell whether it does.

        Past who comes it may lead at a distance `away` [m]. Near full lock it is not taken faster: the steering wheel
        would come too late.
        """
        assert self._line is not None
        present = self._going_on(sight)
        fastest = self._line.fastest(sight.first, sight.speeds)
        out = [SPACING * (sight.first + node) < self._line.out_until for node in range(NODES)]
        speeds = [min(pair) if turns else pair[0] for turns, *pair in zip(out, fastest, present.speeds, strict=True)]
        plan = present._replace(speeds=tuple(speeding_up(speeds)))
        free = not too_near(sight, plan, HURRIED, KEPT, away)
        if free:
            self._lay(sight, plan, urgent=False)
        return free

    def _swerve(self, sight: Sight, threats: list[Body]) -> Generator[None, None, bool]:
        """Take an urgent way past bodies that it is too late to brake for, if there is one; tell whether."""
        plan = yield from self._urgently(sight, threats)
        if plan is not None:
            self._adopt(sight, plan, urgent=True)
        return plan is not None

    def _keep(self, sight: Sight) -> None:
        """Go on along the way that there is, at its speeds."""
        self._lay(sight, self._going_on(sight), urgent=False)

    def _going_on(self, sight: Sight) -> LateralPlan:
        """Return the way that there is, from here on, at its speeds or the slower ones that the path allows."""
        assert self._line is not None
        d, planned = self._line.ahead(sight.first)
        return LateralPlan(tuple(d), tuple(np.minimum(sight.speeds, planned).tolist()), self._line.out_until)

    def _is_free(self, sight: Sight, keeps: Margins) -> bool:
        """Tell whether the way that the car has is free, if less generously than a new one has to be."""
        return leads_free(sight, self._going_on(sight), keeps, KEPT)

    def _in_comfort(self, sight: Sight, blocking: list[Body]) -> Planning:
        """Return a way in comfort that is seen to be free; the car sets out on one once it was free for some turns.

        Where the next turn comes before all speeds and sides are tried, that one goes on where this one was.
        """
        limits = LateralLimits.of(self._vehicle, min(COMFORT_ACCELERATION, self._lateral), COMFORT_JERK)
        keeps = self._keeps(sight)
        limits = limits if self._is_out(sight) else limits.share(self._planner.setting_out_share)
        caps = [cap for cap in CAPS if cap >= sight.speeds[0] - SLOWS]
        choices = sides_to_pass(sight.bodies, blocking)
        tries = [_Try(cap, sides, pulls_out=False) for cap in caps for sides in choices]
        if self._planner.pulls_out and sight.observation.pose.speed < STANDS and blocking:
            tries += [_Try(crawl, sides, pulls_out=True) for crawl in CRAWLS for sides in choices[:2]]
        for place in range(self._tried if self._tried < len(tries) else 0, len(tries)):
            yield
            self._tried = place
            one = tries[place]
            if one.pulls_out:
                plan = yield from self._pulling_out(sight, blocking, one, limits)
            else:
                speeds = creeping_speeds(sight, blocking, one.cap)
                plan = yield from self._planner.planning(self._task(sight, one.sides, keeps, limits, speeds))
            if plan is not None and (self._is_out(sight) or not blocking or self._may_set_out(sight, blocking, plan)):
                self._free += 1
                taken = self._line is not None or self._free >= LOOKS
                # Begun with the first one again, the search might never come to this one and be done within a turn.
                self._tried = 0 if taken else place
                yield
                return plan if taken else None
        self._tried = self._free = 0
        return None

    def _pulling_out(self, sight: Sight, blocking: list[Body], one: _Try, limits: LateralLimits) -> Planning:
        """Return a way that begins near full lock, at a crawl: out of a place too near for a way in comfort."""
        here, keeps = sight.here, self._keeps(sight)
        bends = sight.nodes.curvature[: math.ceil(REACH / SPACING)]
        near = [body for body in blocking if float(body.s.min()) < here.s + REACH]
        # Who is no larger than a person may walk on.
        if np.ptp(bends) > ONE_BEND or not near or any(body.small for body in near):
            return None
        side = next(side for body, side in zip(sight.bodies, one.sides, strict=True) if body is near[0])
        start = Start(here.s, here.d, sight.heading_error, float(bends.mean()))
        standing = [body for body in sight.bodies if abs(body.along) < STANDS and not body.across]
        out = way_out(
            self._vehicle, start, near, standing,
            left=side == LEFT, speed=one.cap, clearance=keeps.clearance,
            aside=self._left if side == LEFT else self._right,
        )  # fmt: skip
        if out is None:
            return None
        yield
        head = tuple(out.d_at(s) for s in sight.nodes.s.tolist() if s < out.ends + 2.0 * SPACING)
        speeds = creeping_speeds(sight, blocking, one.cap, out.ends)
        task = self._task(sight, one.sides, keeps, limits, speeds)._replace(head=head, before=())
        plan = yield from self._planner.planning(task)
        if plan is None or not leads_free(sight, plan, keeps, KEPT):
            return None
        return plan._replace(out_until=out.ends)

    def _urgently(self, sight: Sight, blocking: list[Body]) -> Planning:
        """Return a way past bodies for which braking alone comes too late, as hard as the gateway lets the car go."""
        if not blocking or not comes_too_late(sight, blocking, self._line, self._brakes):
            return None
        self._hurries = True
        limits = LateralLimits.of(self._vehicle, URGENT_ACCELERATION, URGENT_JERK)
        paces = [braked_speeds(sight)] if self._brakes else []
        if not self._brakes or any(map(comes_nearer, blocking)):
            # A car at rest cannot get out of anybody's way.
            paces.append([max(sight.observation.pose.speed, 0.5)] * NODES)
        for keeps, speeds in product(URGENT, paces):
            for sides in sides_to_pass(sight.bodies, blocking):
                yield
                plan = yield from self._planner.planning(self._task(sight, sides, keeps, limits, speeds))
                if plan is not None and not any(comes_at_once(sight, plan, body) for body in blocking):
                    return plan
        return None

    def _task(
        self, sight: Sight, sides: Sequence[int], keeps: Margins, limits: LateralLimits, speeds: Sequence[float]
    ) -> Task:
        def free(times: Sequence[float]) -> Room:
            return room(sight.nodes, times, sight.bodies, sides, keeps).within(
                max(self._right, WANDERS), max(self._left, WANDERS)
            )

        head, line = self._head(sight), self._line
        before: tuple[float, ...] = ()
        if line is not None and head[-1] == line.d_at(sight.first + HEAD - 1):
            before = tuple(line.d_at(sight.first + node) for node in range(NODES))
        return Task(head, SPACING, sight.nodes.curvature.tolist(), speeds, free, limits, before)

    def _head(self, sight: Sight) -> tuple[float, ...]:
        """Return the d of the nodes that a new way leaves where they were: those of the old way, or the car's."""
        line, here = self._line, sight.here
        if line is not None and abs(self._off(sight)) < ASTRAY:
            return tuple(line.d_at(sight.first + node) for node in range(HEAD))
        slope = math.tan(sight.heading_error)
        slope = min(max(slope, -0.3), 0.3)
        places = (SPACING * (sight.first + node) - here.s for node in range(HEAD))
        return tuple(here.d + slope * place for place in places)

    def _off(self, sight: Sight) -> float:
        """Return how far the car is off its way [m]."""
        assert self._line is not None
        pose = sight.observation.pose
        return self._line.path.project(pose.x, pose.y, self._along).d

    def _is_out(self, sight: Sight) -> bool:
        """Tell whether the car has left its path already, so that it is too late to ask whether it should."""
        return self._line is not None and abs(sight.here.d) > 0.5 * self._vehicle.width

    def _keeps(self, sight: Sight) -> Margins:
        return COMFORT if self._is_out(sight) else SETTING_OUT

    def _may_set_out(self, sight: Sight, blocking: list[Body], plan: LateralPlan) -> bool:
        """Tell whether a way is back on its path before that ends, where the car stops, and is seen to be free.

        And whether who blocks the path stays where he is: who comes over is not gone around until he keeps his line.
        """
        if any(map(may_come_over, blocking)):
            return False
        end = max(int(sight.observation.path.length / SPACING) - sight.first, 0)
        return max(map(abs, plan.d[end:]), default=0.0) < AT_PATH and self._sees(sight, plan)

    def _sees(self, sight: Sight, plan: LateralPlan) -> bool:
        """Tell whether all of the road beside is in sight that somebody could come along before the car is back.

        He is taken to be as fast as the car may be. Whoever is seen in that lane blocks the way of those behind him.
        """
        d = np.array(plan.d)
        out = np.flatnonzero(np.abs(d) > 0.5 * WANTED)
        if not len(out):
            return True
        times = times_at(plan.speeds, SPACING)
        last = int(out[-1])
        aside = float(d[np.abs(d).argmax()])
        fastest = sight.observation.desired_speed
        until = sight.here.s + min(SPACING * last + fastest * (times[last] + REACTION), SIGHT)
        until = min([until, *(float(body.s.min()) for body in sight.bodies if covers(body, aside, sight.here.s))])
        places = np.arange(sight.here.s + LOOKS_FROM, until, LOOKS_EVERY).tolist()
        return self._outlines.in_sight(sight.observation.path, places, aside)

    # The way itself.

    def _adopt(self, sight: Sight, plan: LateralPlan, urgent: bool) -> None:
        """Take a way; one that has come back to the path, with the car on it, ends."""
        if max(map(abs, plan.d)) < ALONG_PATH and abs(sight.here.d) < AT_PATH:
            self._line = self._along = None
            return
        self._lay(sight, plan, urgent=urgent, braking=urgent and plan.speeds[-1] < plan.speeds[0])

    def _way_back(self, sight: Sight) -> Planning:
        """Return the way back to the path, where the car brakes for what is in it."""
        limits = LateralLimits.of(self._vehicle, URGENT_ACCELERATION, URGENT_JERK)
        task = self._task(sight, (), COMFORT, limits, sight.speeds)
        return self._planner.planning(task._replace(room=lambda times: Room([-math.inf] * NODES, [math.inf] * NODES)))

    def _go_on(self, sight: Sight) -> None:
        """Go on along the way that there is, the car braking for what is in it now."""
        assert self._line is not None
        self._lay(sight, self._going_on(sight), urgent=self._line.urgent, braking=self._line.braking)

    def _lay(self, sight: Sight, plan: LateralPlan, *, urgent: bool, braking: bool = False) -> None:
        path = sight.observation.path
        self._line = WayAround.of_plan(
            path, sight.first, plan, sight.speeds, self._lateral, urgent=urgent, braking=braking
        )
        self._along = None


def controller(vehicle: Vehicle, tuning: Tuning, planner: Planner, defaults: Tuning) -> FollowAndStop:
    """Make a controller that steers around by a planner; raises ConfigError as `follow_and_stop` does."""
    settled = settle(tuning, defaults, RANGES)
    name, sensor = str(settled.pop("steering")), str(settled.pop("sensor"))
    numbers = {key: float(value) for key, value in settled.items()}
    outlines = Outlines(vehicle, sensor, numbers["forward_m"], numbers["height_m"])
    around = SteerAround(vehicle, planner, outlines, numbers)
    return FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers, avoidance=around)
