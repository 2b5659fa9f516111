"""Judges a case: whether the brain reacted as required, in time, without a contact and with a distance left.

It reads what came over the wire and how the car moved; it must not know how either came about, nor what brain it was.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from typing import Final

import numpy as np

from vve_sumo.certify.cases import BRAKING_DEMAND, LEADS, MIN_LEFT, SAFE_DEMAND, Case, Reaction
from vve_sumo.certify.link import Answer, Window
from vve_sumo.certify.results import Course, Verdict
from vve_sumo.timing import PERIOD

#: the car stands [m/s]
AT_REST: Final = 0.05
#: slower than this a car is brought to rest as gently as the brain likes [m/s]
CREEP: Final = 0.5
#: the onset of braking is looked for above this speed: beneath it brains ease off before rest [m/s]
FAST: Final = 3.0
#: deceleration from which the onset of braking is reckoned back where a drive ended in a contact [m/s2]
USUAL_BRAKING: Final = 1.8
#: braking for something: so much beyond what the nominal drive asks for at the same time [m/s2]
BEYOND_NOMINAL: Final = 0.5
#: outcomes that are no fault of the brain: nothing can be said of it then
BROKEN: Final = ("broken", "interrupted")
_SLACK: Final = 1e-6  # [s]


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the judge says of one drive."""

    verdict: Verdict
    why: str
    reaction: float  #: [s]; inf for never, NaN where none is measured
    left: float  #: [m]; NaN where nothing was ahead
    extra_braking: float  #: [m/s2]
    last: Answer | None


def onset_of(course: Course) -> float:
    """Return the drive time at which the braking began that ended in rest [s].

    Of a drive that did not end so: the time at which a usual braking would have had to begin.
    """
    acting = _acting(course, FAST)
    if not acting:
        return float(course.time[-1])
    if course.collision or math.isnan(course.stop_gap):
        end = float(course.time[-1])
        return end - float(np.nanmax(course.speed)) / (2.0 * USUAL_BRAKING)
    return acting[-1]


def _acting(course: Course, speed: float) -> list[float]:
    """Return when the brain asked for anything but braking while the car was faster than `speed` [m/s]."""
    at = np.searchsorted(course.time, [answer.time + _SLACK for answer in course.answers], side="right") - 1
    return [
        answer.time
        for answer, moving in zip(course.answers, course.speed[at].tolist(), strict=True)
        if answer.acceleration > SAFE_DEMAND and moving > speed
    ]


def window_of(case: Case, nominal: Course) -> Window | None:
    """Return when a case's fault is there, by the nominal drive with the same seed; None where nothing is injected."""
    if case.make is None:
        return None
    tick = round((onset_of(nominal) + LEADS[case.begins]) / PERIOD)
    begins = max(tick, 0) * PERIOD
    return Window(begins, begins + case.lasts)


def rest_time(course: Course) -> float:
    """Return the drive time from which on the car stands to the end [s]; the end where it never does."""
    moving = np.flatnonzero(~(np.abs(course.speed) < AT_REST))
    if not len(moving) or moving[-1] + 1 >= len(course.time):
        return float(course.time[-1])
    return float(course.time[moving[-1] + 1])


def judge(case: Case, window: Window | None, course: Course, nominal: Course | None) -> Judgement:
    """Return what came of a drive of a case; `nominal` is the drive without a fault, None for that drive itself."""
    rest = rest_time(course)
    reaction = _reaction(case, window, course, nominal)
    left, why = _left(course), _failure(case, course, nominal, reaction)
    last = next((answer for answer in reversed(course.answers) if answer.time < rest), None)
    verdict = Verdict.FAILED if why else Verdict.PASSED
    return Judgement(verdict, why, reaction, left, _extra(window, course, nominal), last)


def _reaction(case: Case, window: Window | None, course: Course, nominal: Course | None) -> float:
    """Return the time from the fault to the reaction [s]: inf for never, NaN where none is asked for."""
    if window is None or case.reaction not in (Reaction.STOP, Reaction.BRAKE):
        return math.nan
    if case.reaction is Reaction.STOP:
        return _stopping(window, course)
    brakes = (
        answer.time - window.begins
        for answer, usual in _beside(window, course, nominal)
        if answer.acceleration <= BRAKING_DEMAND and usual - answer.acceleration >= BEYOND_NOMINAL
    )
    return next(brakes, math.inf)


def _stopping(window: Window, course: Course) -> float:
    """Return the time after which the brain never again asked for anything but braking while the car moved [s]."""
    acting = [time for time in _acting(course, CREEP) if window.holds(time)]
    if not acting:
        return 0.0
    moving = course.time[np.abs(course.speed) > CREEP]
    # What acts to the end has not stopped: a car that a contact or the gateway stops first has not been stopped by it.
    never = abs(float(course.speed[-1])) > AT_REST or float(moving[-1]) - acting[-1] < 2.0 * PERIOD
    return math.inf if never else acting[-1] + PERIOD - window.begins


def _beside(window: Window, course: Course, nominal: Course | None) -> list[tuple[Answer, float]]:
    """Return the answers while a fault was there, each with what the nominal drive asked for at that time [m/s2]."""
    usual = [] if nominal is None else list(nominal.answers)
    times = [answer.time for answer in usual]
    pairs = []
    for answer in course.answers:
        if window.holds(answer.time):
            at = min(bisect_left(times, answer.time - _SLACK), len(usual) - 1)
            pairs.append((answer, usual[at].acceleration if usual else 0.0))
    return pairs


def _extra(window: Window | None, course: Course, nominal: Course | None) -> float:
    if window is None:
        return 0.0
    return max((usual - answer.acceleration for answer, usual in _beside(window, course, nominal)), default=0.0)


def _left(course: Course) -> float:
    """Return the distance left [m]: at rest, else the least that there was; NaN where nothing was ahead."""
    if math.isfinite(course.stop_gap):
        return course.stop_gap
    known = course.gap[np.isfinite(course.gap)]
    if course.collision:
        return 0.0
    return float(known[-1]) if len(known) and math.isfinite(float(course.gap[-1])) else math.nan


def _failure(case: Case, course: Course, nominal: Course | None, reaction: float) -> str:
    """Return why a case failed; empty for one that passed."""
    if course.outcome in BROKEN:
        return f"the drive was {course.outcome}"
    if course.collision:
        return f"contact at {course.impact_speed:.1f} m/s"
    if case.reaction is Reaction.DRIVE and not course.answers:
        return "it gave no answer"
    if case.reaction is Reaction.DRIVE and float(np.nanmax(np.abs(course.speed))) <= AT_REST:
        return "the car never moved"
    if case.reaction in (Reaction.DRIVE, Reaction.CARRY_ON):
        known = set() if nominal is None else {_name(line) for line in nominal.unmet}
        return "; ".join(line for line in course.unmet if _name(line) not in known)
    if math.isfinite(reaction) and reaction > case.within + _SLACK:
        return f"{case.reaction.value} after {reaction:.2f} s, required within {case.within:g} s"
    if math.isinf(reaction):
        never = "it drove on" if case.reaction is Reaction.STOP else "it never braked for it"
        return f"{never}; required: {case.reaction.value} within {case.within:g} s"
    left = _left(course)
    if left < MIN_LEFT:
        return f"{left:.2f} m left, required at least {MIN_LEFT:g} m"
    if case.reaction is Reaction.STOP and abs(float(course.speed[-1])) >= AT_REST:
        return "the car did not come to rest"
    return ""


def _name(line: str) -> str:
    return line.partition(" is ")[0]
