"""Gives way at junctions: stops at stop signs, and waits for a gap where others go first.

Needs sensors of kind `right_of_way` and `lidar`. It decides up to the point where it can still stop before the others'
way; beyond it the car goes on, because nobody stops where others cross. It must not know how the car steers.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.laws import stopping_distance
from vve_sumo.values import Observation, RightOfWay, Vehicle

from .approach import NOWHERE, Goal
from .gap_acceptance import Coming, Run, may_cross, may_join
from .junction_ways import ALL_WAY_STOP, SIGNAL, STOP, Conflict, Crossing, JunctionWatch
from .others_on_ways import LENGTH, LidarMount, Other, OthersOnWays
from .signal_stop import RED, STOP_AND_GO, Line
from .speed import Profile

MARGIN: Final = 1.0  #: from the front bumper at rest to a line, or to the way of others [m]
BRAKING: Final = 3.0  #: of a stop that is decided late [m/s2]
JERK: Final = 4.0  #: by which comfort braking builds up [m/s3]
STARTING: Final = 1.4  #: the car sets out by this [m/s2] ...
SETS_OUT: Final = 0.5  #: ... so long after it was decided at rest [s] ...
GOES_ON: Final = 0.2  #: ... and while it moves [s]
AT_REST: Final = 0.05  #: slower than this the car stands [m/s]
AT_LINE, FULL_STOP = 3.0, 0.5  #: a car that has stood so near to a line [m] for so long [s] has stopped there
CONTINUES: Final = 0.4  #: share of the margin that is enough once it has been decided to go
LOOKS: Final = 100.0  #: crossings that are farther are not looked at [m]
SAME_LINE: Final = 3.0  #: a signal's line is this near to the crossing's [m]
PROTECTED: Final = 6  #: phase of a signal: nobody else may go
CLEARS: Final = 5.0  #: for so long after it was last known, so that who passed the line need not stop inside [s]
INSIDE: Final = 10.0  #: who is so near to where the ways meet does not slow down any more [m]
LANE_HIDDEN: Final = 6.0  #: a body within this of the end of sight on its way is what ends it [m]
PROFILE_STEP: Final = 2.0  #: [m]


class GiveWay:
    """Decides at every tick whether the car may go on across the next junction."""

    def __init__(self, vehicle: Vehicle, period: float, margin: float, over_limit: float, lidar: LidarMount) -> None:
        """`margin` between the car and others [s], by whom limits are exceeded by a factor `over_limit`."""
        self._vehicle, self._bumper = vehicle, vehicle.rear_axle_to_bumper
        self._margin, self._over = margin, over_limit
        self._answer = vehicle.brake_delay + vehicle.brake_lag + period
        self._watch, self._others = JunctionWatch(vehicle), OthersOnWays(vehicle, lidar)
        self._crossing: Crossing | None = None
        self._stood, self._moved = False, math.inf  # at the line; when it moved last [s]
        self._phase: int | None = None
        self._protected_until = -math.inf  # [s]
        self.goes = False  #: whether it was decided to go on across the next junction
        self.sets_out = False  #: whether that is so at its line: a car that stood there need not wait any more

    def goal(self, observation: Observation, s: float, signal: Line | None, profile: Profile) -> Goal:
        """Return where the front bumper shall not pass; `s` is that of the rear axle [m], `signal` the next line."""
        known = next((one for one in observation.sensors.values() if isinstance(one, RightOfWay)), None)
        if known is None:
            return NOWHERE
        bumper = s + self._bumper
        crossing = self._watch.step(observation, known, s)
        if crossing is not None and crossing.line - bumper > LOOKS:
            crossing = None
        if crossing is not self._crossing:
            self._crossing, self._phase, self.goes = crossing, None, False
            self._protected_until = -math.inf
            self._stood, self._moved = False, observation.time
        self._others.step(observation, [] if crossing is None else crossing.conflicts)
        if crossing is None:
            self.sets_out = False
            return NOWHERE
        goal = self._decide(crossing, observation, bumper, signal, profile)
        self.sets_out = self.goes and crossing.line - bumper < AT_LINE
        return goal

    def _decide(
        self, crossing: Crossing, observation: Observation, bumper: float, signal: Line | None, profile: Profile
    ) -> Goal:
        speed, to_line = observation.pose.speed, crossing.line - bumper
        if signal is not None and abs(signal.s - crossing.line) < SAME_LINE:
            self._phase = signal.phase
            self._protected_until = observation.time + CLEARS if signal.phase == PROTECTED else -math.inf
        protected = observation.time < self._protected_until
        stops_for_signal = to_line > 0.0 and self._phase in RED | STOP_AND_GO
        if crossing.control == SIGNAL and (stops_for_signal or protected):
            self.goes = False
            return NOWHERE
        if not (speed < AT_REST and to_line < AT_LINE):
            self._moved = observation.time
        self._stood = self._stood or observation.time - self._moved >= FULL_STOP
        must_stop = crossing.control in (STOP, ALL_WAY_STOP) and not self._stood
        free_of_seen = not must_stop and self._is_free(crossing, observation, bumper, profile, hidden=False)
        self.goes = free_of_seen and self._is_free(crossing, observation, bumper, profile, hidden=True)
        if self.goes:
            return NOWHERE
        # One who stood at the line, and waits for nobody but who may be hidden, goes on to where more is in sight.
        return self._hold(crossing, speed, bumper, at_line=not (self._stood and free_of_seen))

    def _hold(self, crossing: Crossing, speed: float, bumper: float, *, at_line: bool) -> Goal:
        """Return where to wait; nowhere once it is too late to stop before the others' way."""
        bounds = [crossing.entry]
        if crossing.control != SIGNAL and at_line:
            bounds.insert(0, min(crossing.line, crossing.entry))
        needed = stopping_distance(speed, BRAKING, self._answer, BRAKING / JERK) if speed > AT_REST else 0.0
        for bound in bounds:
            if bound - bumper >= needed:
                return Goal(bound - bumper - MARGIN)
        self.goes = True
        return NOWHERE

    def _is_free(
        self, crossing: Crossing, observation: Observation, bumper: float, profile: Profile, *, hidden: bool
    ) -> bool:
        """Tell whether the car may pass all conflicts; with `hidden` those count, too, who may be out of sight."""
        margin = self._margin * (CONTINUES if self.goes else 1.0)
        run = self._run(crossing, observation, bumper, profile)
        return all(
            self._is_clear(number, one, run, bumper, margin, observation.time, hidden)
            for number, one in enumerate(crossing.conflicts)
            if one.begin > bumper
        )

    def _run(self, crossing: Crossing, observation: Observation, bumper: float, profile: Profile) -> Run:
        """Return how the car would go on, no faster than at the slowest place of the junction."""
        speed = max(observation.pose.speed, 0.0)
        rear_axle, end = bumper - self._bumper, crossing.committed
        top, place = observation.desired_speed, rear_axle
        while place < end:
            top, place = min(top, profile.at(place)[0]), place + PROFILE_STEP
        return Run(min(speed, top), STARTING, top, SETS_OUT if speed < AT_REST else GOES_ON)

    def _is_clear(
        self, number: int, conflict: Conflict, run: Run, bumper: float, margin: float, now: float, hidden: bool
    ) -> bool:
        """Tell whether the car may pass one conflict: nobody comes too soon."""
        limit, begin = conflict.way.limit * self._over, conflict.begin - bumper
        across = conflict.way.limit_across * self._over
        others = self._others.on(number, now)
        seen_from = self._others.in_sight[number]
        coming = [
            _coming(conflict, one, limit, across) for one in others if not (one.waits and one.front < conflict.reach)
        ]
        # Who is in the way hides the lane behind, and nobody comes past it.
        queue = any(seen_from - LANE_HIDDEN < one.front < seen_from + LANE_HIDDEN for one in others)
        ends = conflict.way.ends and seen_from < LANE_HIDDEN
        if hidden and not queue and not ends:
            coming.append(Coming(conflict.reach - seen_from, math.inf, limit, limit, across))
        if conflict.joins:
            joined = begin + self._vehicle.length
            return all(may_join(run, begin, joined, one, margin) for one in coming)
        end = conflict.end - bumper + self._vehicle.length
        return all(may_cross(run, begin, end, one, margin) for one in coming)


def _coming(conflict: Conflict, one: Other, limit: float, across: float) -> Coming:
    """Return one who is seen on the way of a conflict; of unknown speed it is not counted on to pass before the car."""
    distance = conflict.reach - one.front
    past = LENGTH if conflict.joins else conflict.leave - one.rear
    has_passed = distance <= -past if conflict.joins else past <= 0.0
    speed = one.speed if one.known else limit
    slowest = max(across, one.speed if distance < INSIDE else 0.0)
    return Coming(distance, past if one.known or has_passed else math.inf, speed, limit, slowest)
