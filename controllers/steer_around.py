"""Decides when the car leaves its path for what is in its way, plans the way around it, and leads the car along it.

Two cases. What stands or is slow is gone around in comfort, where the road beside is seen to be free for as long as
that takes: who comes the other way goes first. And where full braking would come too late, the car swerves, as hard as
the gateway lets it, braking meanwhile: the least time to stop against the least time to come to the side. In all other
cases the car brakes on its path, as `follow_and_stop` does. It must not know how a planner plans, nor brakes' laws.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.controller import Tuning, settle
from vve_sumo.laws import sideways_reach, stopping_distance, swerve_time, time_to_cover
from vve_sumo.path import PathProjection
from vve_sumo.values import Observation, Vehicle

from . import follow_and_stop
from .emergency import FIRST_ORDER_RAMP, JERK
from .follow_and_stop import COMFORT_LIMIT, PERIOD, FollowAndStop, Way, steering_law
from .free_space import LEFT, RIGHT, SPREAD_LIMIT, Margins, Nodes, Room, clearances, room, side_of
from .lateral_plan import LateralLimits, LateralPlan, Planner, Planning, Task, times_at
from .outlines import Body, Outlines
from .speed import SLOWING, SPEEDING_UP
from .tracks import Target, Tracker
from .way_around import (
    CONTACT,
    CROSSES,
    NODES,
    SPACING,
    URGENT_ACCELERATION,
    URGENT_JERK,
    WayAround,
    first_met,
)

HEAD: Final = 3  #: nodes, the first one behind the car, that a new way leaves where they were
WANTED: Final = 0.8  #: a body that is nearer than this to the car's side on its path is steered around [m]
COMFORT: Final = Margins(clearance=1.1, lengthwise=0.6, slack=1.5)
#: the same before the car has left its path: it must then be back so much earlier before who comes the other way
SETTING_OUT: Final = COMFORT._replace(slack=3.5)
#: a way in comfort that is this far from all bodies is kept where no new one is found [m]
KEPT: Final = 0.7
#: an urgent way keeps so far from bodies; the first that leads past is taken
URGENT: Final = tuple(Margins(away, 0.3, 0.2, 1.0) for away in (1.0, 0.7, 0.4, 0.15))
#: who comes the other way in the car's way is given way to by steering when he is so near [s]
ONCOMING: Final = 4.0
COMFORT_ACCELERATION, COMFORT_JERK = 1.8, 2.0  #: lateral, of a way in comfort [m/s2], [m/s3]
#: who is not slower than the car would be by so much [m/s], or half as fast, is not gone around in comfort, nor who
#: crosses
SLOWER: Final = 2.0
#: speeds of a way in comfort, tried one after the other: out of a narrow place a car comes slowly only [m/s]
CAPS: Final = (math.inf, 5.0, 3.0, 2.0)
SLOWS: Final = 1.0  #: and from so much more it slows down to one of them [m/s]
STANDS: Final = 0.2  #: a car that is no faster has come to rest [m/s]
AT_PATH, ALONG_PATH = 0.12, 0.03  #: the car so near to its path, and its way, is back on it [m]
ASTRAY: Final = 0.7  #: a way that the car is farther off than this begins anew where the car is [m]
WANDERS: Final = 0.3  #: so far beside its path a way may lead on any road [m]
#: way that coming back takes for each metre beside the path, and what must be left before a body then [m]
BACK_SHARE, WAITS = 2.0, 4.0
BACK: Final = 0.6  #: a car that waits no farther beside its path is out of the way of who comes the other way [m]
SIGHT: Final = 80.0  #: as far as this a lidar sees a car [m]
LOOKS_FROM, LOOKS_EVERY = 6.0, 3.0  #: the places of the road beside that must be in sight [m]
REACTION: Final = 1.0  #: the car must be back on its side so long before who comes the other way [s]
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


class _Sight(NamedTuple):
    """What is known at a turn of the lidar."""

    observation: Observation
    here: PathProjection
    bodies: list[Body]
    nodes: Nodes
    speeds: list[float]  #: that the car would have at the nodes if nothing were in its way [m/s]
    first: int  #: number of the first node


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
            self._in_path = _in_path(sight)
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

    def _sight(self, observation: Observation, here: PathProjection) -> _Sight:
        first = math.floor(here.s / SPACING)
        s = SPACING * (first + np.arange(NODES))
        curvature = np.array([observation.path.at(node).curvature for node in s.tolist()])
        nodes = Nodes.of(self._vehicle, s, curvature)
        speed, speeds = max(observation.pose.speed, 0.0), []
        for bend in curvature.tolist():
            limit = min(observation.desired_speed, math.sqrt(self._lateral / max(abs(bend), 1e-6)))
            speed = math.sqrt(min(speed * speed + 2.0 * SPEEDING_UP * SPACING, max(limit, speed) ** 2))
            speeds.append(max(speed, 0.5))
        bodies = [body for body in self._bodies if not _is_gone(body, here.s - self._vehicle.rear_overhang)]
        return _Sight(observation, here, bodies, nodes, speeds, first)

    # What to do, once a turn. The ticks until the next turn share the work, so that no tick is held up.

    def _decide(self, portions: int) -> None:
        """Go on deciding for so many portions of work, for more where the car has to swerve."""
        done = 0
        while self._decision is not None and done < (URGENT_PORTIONS if self._hurries else portions):
            done += 1
            if next(self._decision, _DECIDED) is _DECIDED:
                self._decision = None

    def _deciding(self, sight: _Sight, was_cut_off: bool) -> Generator[None, None, None]:
        """Decide, and yield after each portion of work; what is decided counts once it is.

        Where the decision by the turn before was cut off, it was looking for a new way in comfort, and had not come to
        what is done without one. That comes first now: else the car would go on along a way that is not free any more.
        """
        times = times_at(sight.speeds, SPACING)
        asking = [body for body in sight.bodies if self._asks_for_room(sight, times, body)]
        blocking = [body for body in asking if not _comes_nearer(body)]
        self._hurries = self._comes_too_late(sight, asking, self._line)
        if not asking and self._line is None:
            self._free = 0
            return
        plan = None
        if (self._line is None or not was_cut_off) and all(_is_slow(body, sight) for body in blocking):
            plan = yield from self._in_comfort(sight, blocking)
        if plan is not None:
            self._adopt(sight, plan, urgent=False)
        elif self._line is None or self._gives_up(sight, asking, blocking):
            yield from self._swerve(sight, asking)
        elif not self._line.urgent and (yield from self._stays(sight, blocking)):
            pass
        elif not (yield from self._swerve(sight, self._in_line(sight))):
            self._go_on(sight)

    def _gives_up(self, sight: _Sight, asking: list[Body], blocking: list[Body]) -> bool:
        """Give up a way for which the car has no use any more; tell whether it did.

        That is, while the car is still on its path, one in comfort that is not free, where the car can slow down behind
        what is there, in comfort or, where the way leads too near to somebody, with all there is; and an urgent one
        where braking is not too late after all; and an urgent one on which the car has come to rest: it leads past
        bodies nearer than anybody would set out to go.
        """
        assert self._line is not None
        if self._line.urgent:
            # The way itself leads past whom it is about: without it he would be met.
            needed = self._comes_too_late(sight, asking, None)
            useful = needed or (abs(sight.here.d) > AT_PATH and sight.observation.pose.speed > STANDS)
        elif abs(sight.here.d) > AT_PATH:
            useful = True
        else:
            useful = bool(blocking) and (
                self._is_free(sight, self._keeps(sight))
                or (not self._can_wait(sight, blocking) and self._is_free(sight, COMFORT))
                or self._comes_too_late(sight, asking, None)
            )
        if not useful:
            self._line = self._along = None
        return not useful

    def _stays(self, sight: _Sight, blocking: list[Body]) -> Generator[None, None, bool]:
        """Keep to the way that the car has, or take the one back to its path; tell whether one of them will do."""
        if blocking and self._is_free(sight, self._keeps(sight)):
            self._keep(sight)
            return True
        back = (yield from self._way_back(sight)) if self._can_wait(sight, blocking) else None
        if back is not None and self._beside_at_rest(sight, back) < BACK:
            self._adopt(sight, back, urgent=False)
            return True
        if blocking and self._is_free(sight, COMFORT):
            # Stopped halfway out it would be in the way of who comes.
            self._keep(sight)
            return True
        if back is not None:
            self._adopt(sight, back, urgent=False)
        return back is not None

    def _swerve(self, sight: _Sight, threats: list[Body]) -> Generator[None, None, bool]:
        """Take an urgent way past bodies that it is too late to brake for, if there is one; tell whether."""
        plan = yield from self._urgently(sight, threats)
        if plan is not None:
            self._adopt(sight, plan, urgent=True)
        return plan is not None

    def _in_line(self, sight: _Sight) -> list[Body]:
        """Return the bodies that are in the way which the car has taken."""
        return [body for body in sight.bodies if self._is_met(sight, body, self._line)]

    def _is_met(self, sight: _Sight, body: Body, line: WayAround | None) -> bool:
        """Tell whether a body is in a way around, or on the path where that is None."""
        d = [0.0 if line is None else line.d_at(sight.first + node) for node in range(NODES)]
        return first_met(sight.nodes, times_at(sight.speeds, SPACING), d, body) is not None

    def _keep(self, sight: _Sight) -> None:
        """Go on along the way that there is, at its speeds."""
        assert self._line is not None
        d, planned = self._line.ahead(sight.first)
        speeds = np.minimum(sight.speeds, planned).tolist()
        self._lay(sight, LateralPlan(tuple(d), tuple(speeds)), urgent=False)

    def _is_free(self, sight: _Sight, keeps: Margins) -> bool:
        """Tell whether the way that the car has is free, if less generously than a new one has to be."""
        line = self._line
        assert line is not None
        d, planned = line.ahead(sight.first)
        times = times_at(np.minimum(sight.speeds, planned).tolist(), SPACING)
        return all(min(clearances(sight.nodes, times, d, body, keeps)) >= KEPT for body in sight.bodies)

    def _can_wait(self, sight: _Sight, blocking: list[Body]) -> bool:
        """Tell whether the car can still come back to its path and slow down there in comfort behind what is there."""
        bumper = sight.here.s + self._vehicle.rear_axle_to_bumper
        back = abs(sight.here.d) * BACK_SHARE + WAITS
        gaps = [float(body.s.min()) - bumper - self._slowing(sight, max(body.along, 0.0)) for body in blocking]
        return min(gaps, default=-math.inf) > back

    def _slowing(self, sight: _Sight, speed: float) -> float:
        """Return the way that the car gains on somebody of a speed [m/s] while slowing in comfort to that speed [m]."""
        delay = 2.0 * PERIOD + self._vehicle.brake_delay
        return stopping_distance(max(sight.observation.pose.speed - speed, 0.0), -COMFORT_LIMIT, delay, 0.7)

    def _asks_for_room(self, sight: _Sight, times: Sequence[float], body: Body) -> bool:
        keeps = CONTACT._replace(slack=COMFORT.slack if body.along > 0.0 else 0.0)
        return min(clearances(sight.nodes, times, [0.0] * NODES, body, keeps)) < WANTED

    def _in_comfort(self, sight: _Sight, blocking: list[Body]) -> Planning:
        """Return a way in comfort that is seen to be free; the car sets out on one once it was free for some turns.

        Where the next turn comes before all speeds and sides are tried, that one goes on where this one was.
        """
        limits = LateralLimits.of(self._vehicle, min(COMFORT_ACCELERATION, self._lateral), COMFORT_JERK)
        keeps = self._keeps(sight)
        limits = limits if self._is_out(sight) else limits.share(self._planner.setting_out_share)
        caps = [cap for cap in CAPS if cap >= sight.speeds[0] - SLOWS]
        tries = [(cap, sides) for cap in caps for sides in _sides(sight.bodies, blocking)]
        for place in range(self._tried if self._tried < len(tries) else 0, len(tries)):
            yield
            self._tried = place
            cap, sides = tries[place]
            speeds = self._creeping(sight, blocking, cap)
            plan = yield from self._planner.planning(self._task(sight, sides, keeps, limits, speeds))
            if plan is not None and (self._is_out(sight) or not blocking or self._may_set_out(sight, blocking, plan)):
                self._tried = 0
                self._free += 1
                yield
                return plan if self._line is not None or self._free >= LOOKS else None
        self._tried = self._free = 0
        return None

    def _creeping(self, sight: _Sight, blocking: list[Body], cap: float) -> list[float]:
        """Return the speeds at the nodes of a car that keeps to a cap until it is beside what blocks its path [m/s]."""
        if cap == math.inf:
            return sight.speeds
        beside = min((float(body.s.min()) for body in blocking), default=-math.inf) - self._vehicle.rear_axle_to_bumper
        speeds = [sight.speeds[0]]
        for s, open_road in zip(sight.nodes.s.tolist()[1:], sight.speeds[1:], strict=True):
            faster = math.sqrt(speeds[-1] ** 2 + 2.0 * SPEEDING_UP * SPACING)
            slower = math.sqrt(max(speeds[-1] ** 2 - 2.0 * SLOWING * SPACING, 0.0))
            speeds.append(min(faster, open_road, max(cap, slower) if s < beside else math.inf))
        return speeds

    def _urgently(self, sight: _Sight, blocking: list[Body]) -> Planning:
        """Return a way past bodies for which braking alone comes too late, as hard as the gateway lets the car go."""
        if not blocking or not self._comes_too_late(sight, blocking, self._line):
            return None
        self._hurries = True
        limits = LateralLimits.of(self._vehicle, URGENT_ACCELERATION, URGENT_JERK)
        paces = [self._braked(sight)] if self._brakes else []
        if not self._brakes or any(map(_comes_nearer, blocking)):
            # A car at rest cannot get out of anybody's way.
            paces.append([max(sight.observation.pose.speed, 0.5)] * NODES)
        for keeps, speeds in product(URGENT, paces):
            for sides in _sides(sight.bodies, blocking):
                yield
                plan = yield from self._planner.planning(self._task(sight, sides, keeps, limits, speeds))
                if plan is not None and not any(_comes_at_once(sight, plan, body) for body in blocking):
                    return plan
        return None

    def _comes_too_late(self, sight: _Sight, blocking: list[Body], line: WayAround | None) -> bool:
        """Tell whether the car would reach one of the bodies before it stands, and can still come to the side of it.

        Who comes the other way counts where he is in a way around, or on the path where that is None.
        Without brakes of its own it steers as late as it can in half a second more than the least time.
        """
        car, speed = self._vehicle, sight.observation.pose.speed
        bumper, delay = sight.here.s + car.rear_axle_to_bumper, car.brake_delay + PERIOD
        build_up = FIRST_ORDER_RAMP * car.brake_lag + car.deceleration_limit / JERK
        answer = car.steering_delay + car.steering_lag + PERIOD
        for body in blocking:
            gap, closing = float(body.s.min()) - bumper, speed - max(body.along, 0.0)
            if gap <= 0.0 or closing <= 0.0:
                continue
            if _comes_nearer(body):
                if gap < (speed - body.along) * ONCOMING and self._is_met(sight, body, line):
                    return True
            elif not self._brakes:
                needs = swerve_time(self._aside(body.moved(gap / closing)), URGENT_ACCELERATION, URGENT_JERK, answer)
                if gap < closing * (needs + 0.5):
                    return True
            elif stopping_distance(closing, car.deceleration_limit, delay, build_up) > gap:
                time = time_to_cover(gap, closing, car.deceleration_limit, delay + 0.5 * build_up)
                if sideways_reach(time - answer, URGENT_ACCELERATION, URGENT_JERK) > 0.0:
                    return True
        return False

    def _aside(self, body: Body) -> float:
        """Return how far the car must go aside to pass a body that is beside it then as it would like to [m]."""
        half = 0.5 * self._vehicle.width + URGENT[0].clearance
        return max(min(float(body.d.max()) + half, half - float(body.d.min())), 0.0)

    def _braked(self, sight: _Sight) -> list[float]:
        """Return the speeds at the nodes while the car brakes with all there is [m/s]."""
        speed, car = sight.observation.pose.speed, self._vehicle
        late = speed * (car.brake_delay + PERIOD)
        squares = (
            speed * speed - 2.0 * car.deceleration_limit * max(SPACING * node - late, 0.0) for node in range(NODES)
        )
        return [math.sqrt(max(square, 0.25)) for square in squares]

    def _task(
        self, sight: _Sight, sides: Sequence[int], keeps: Margins, limits: LateralLimits, speeds: Sequence[float]
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

    def _head(self, sight: _Sight) -> tuple[float, ...]:
        """Return the d of the nodes that a new way leaves where they were: those of the old way, or the car's."""
        line, here = self._line, sight.here
        if line is not None and abs(self._off(sight)) < ASTRAY:
            return tuple(line.d_at(sight.first + node) for node in range(HEAD))
        slope = math.tan(_turned(sight.observation.pose.heading - here.heading))
        slope = min(max(slope, -0.3), 0.3)
        places = (SPACING * (sight.first + node) - here.s for node in range(HEAD))
        return tuple(here.d + slope * place for place in places)

    def _off(self, sight: _Sight) -> float:
        """Return how far the car is off its way [m]."""
        assert self._line is not None
        pose = sight.observation.pose
        return self._line.path.project(pose.x, pose.y, self._along).d

    def _is_out(self, sight: _Sight) -> bool:
        """Tell whether the car has left its path already, so that it is too late to ask whether it should."""
        return self._line is not None and abs(sight.here.d) > 0.5 * self._vehicle.width

    def _keeps(self, sight: _Sight) -> Margins:
        return COMFORT if self._is_out(sight) else SETTING_OUT

    def _may_set_out(self, sight: _Sight, blocking: list[Body], plan: LateralPlan) -> bool:
        """Tell whether a way is back on its path before that ends, where the car stops, and is seen to be free.

        And whether who blocks the path stays where he is: who comes over is not gone around until he keeps his line.
        """
        if any(abs(body.drift) > max(CROSSES, body.sigma) for body in blocking):
            return False
        end = max(int(sight.observation.path.length / SPACING) - sight.first, 0)
        return max(map(abs, plan.d[end:]), default=0.0) < AT_PATH and self._sees(sight, plan)

    def _sees(self, sight: _Sight, plan: LateralPlan) -> bool:
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
        until = min([until, *(float(body.s.min()) for body in sight.bodies if _covers(body, aside, sight.here.s))])
        places = np.arange(sight.here.s + LOOKS_FROM, until, LOOKS_EVERY).tolist()
        return self._outlines.in_sight(sight.observation.path, places, aside)

    # The way itself.

    def _adopt(self, sight: _Sight, plan: LateralPlan, urgent: bool) -> None:
        """Take a way; one that has come back to the path, with the car on it, ends."""
        if max(map(abs, plan.d)) < ALONG_PATH and abs(sight.here.d) < AT_PATH:
            self._line = self._along = None
            return
        self._lay(sight, plan, urgent)

    def _way_back(self, sight: _Sight) -> Planning:
        """Return the way back to the path, where the car brakes for what is in it."""
        limits = LateralLimits.of(self._vehicle, URGENT_ACCELERATION, URGENT_JERK)
        task = self._task(sight, (), COMFORT, limits, sight.speeds)
        return self._planner.planning(task._replace(room=lambda times: Room([-math.inf] * NODES, [math.inf] * NODES)))

    def _beside_at_rest(self, sight: _Sight, plan: LateralPlan) -> float:
        """Return how far beside its path the car comes to rest on a way, slowing in comfort [m]."""
        rest = sight.here.s + self._slowing(sight, 0.0)
        return abs(plan.d[min(round(rest / SPACING) - sight.first, NODES - 1)])

    def _go_on(self, sight: _Sight) -> None:
        """Go on along the way that there is, the car braking for what is in it now."""
        assert self._line is not None
        d = tuple(self._line.d_at(sight.first + node) for node in range(NODES))
        self._lay(sight, LateralPlan(d, tuple(sight.speeds)), self._line.urgent)

    def _lay(self, sight: _Sight, plan: LateralPlan, urgent: bool) -> None:
        self._line = WayAround.of_plan(sight.observation.path, sight.first, plan, sight.speeds, self._lateral, urgent)
        self._along = None


def _in_path(sight: _Sight) -> list[Body]:
    """Return the bodies that stand in the scenario's path, or go along it."""
    nodes, times, path = sight.nodes, times_at(sight.speeds, SPACING), [0.0] * NODES
    reach = float(max(nodes.left.max(), nodes.right.max())) + SPREAD_LIMIT
    found = []
    for body in sight.bodies:
        along = abs(body.across) < CROSSES and not _comes_nearer(body)
        # Most stand beside the road, and what follows takes a third of a millisecond.
        if along and body.d.min() < reach and body.d.max() > -reach and first_met(nodes, times, path, body) is not None:
            found.append(body)
    return found


def _comes_nearer(body: Body) -> bool:
    """Tell whether a body comes the other way: it goes first, and nobody goes around it in comfort."""
    return body.along < -SLOWER


def _comes_at_once(sight: _Sight, plan: LateralPlan, body: Body) -> bool:
    """Tell whether who comes the other way meets the car on the first nodes of a plan, which it leaves where they were.

    So he does where the car has come to rest on them by then.
    """
    if not _comes_nearer(body):
        return False
    node = first_met(sight.nodes, times_at(plan.speeds, SPACING), plan.d, body)
    return node is not None and node < HEAD


def _is_gone(body: Body, rear: float) -> bool:
    """Tell whether a body that came the other way is behind the car's rear, whose s this is [m]."""
    return _comes_nearer(body) and float(body.s.max()) < rear


def _covers(body: Body, d: float, ego_s: float) -> bool:
    """Tell whether a body ahead of the car covers a line `d` beside the path, so that nobody comes along it [m]."""
    ahead = body.s > ego_s + LOOKS_FROM
    return bool((ahead & (body.d <= d)).any() and (ahead & (body.d >= d)).any())


def _is_slow(body: Body, sight: _Sight) -> bool:
    """Tell whether a body stands or goes along slowly, so that it is worth going around."""
    desired = sight.observation.desired_speed
    return abs(body.across) < CROSSES and body.along < max(desired - SLOWER, 0.5 * desired)


def _sides(bodies: Sequence[Body], blocking: Sequence[Body]) -> list[list[int]]:
    """Return the choices of sides to pass on: all that block on the left, on the right, each on its freer side."""
    choices = []
    for choose in (LEFT, RIGHT, 0):
        if (choose == 0 and len(blocking) < 2) or (choose == RIGHT and not blocking):
            continue
        chosen = {id(body): choose or side_of(body) for body in blocking}
        choices.append([chosen.get(id(body), side_of(body)) for body in bodies])
    return choices


def _turned(angle: float) -> float:
    return math.remainder(angle, math.tau)


def controller(vehicle: Vehicle, tuning: Tuning, planner: Planner, defaults: Tuning) -> FollowAndStop:
    """Make a controller that steers around by a planner; raises ConfigError as `follow_and_stop` does."""
    settled = settle(tuning, defaults, RANGES)
    name, sensor = str(settled.pop("steering")), str(settled.pop("sensor"))
    numbers = {key: float(value) for key, value in settled.items()}
    outlines = Outlines(vehicle, sensor, numbers["forward_m"], numbers["height_m"])
    around = SteerAround(vehicle, planner, outlines, numbers)
    return FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers, avoidance=around)
