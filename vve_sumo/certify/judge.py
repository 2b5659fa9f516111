"""Judges a case: whether the brain reacted as required, in time, without a contact and within the limits.

It reads what came over the wire and how the car moved; it must not know how either came about, nor what brain it was.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from vve_sumo.certify.cases import BRAKING_DEMAND, HARD_BRAKING, UNDISTURBED, Case, Reaction
from vve_sumo.certify.limits import CertificateLimits
from vve_sumo.certify.link import Answer, Window
from vve_sumo.certify.moments import AT_REST, MAX_SILENCE, acting, rest_time
from vve_sumo.certify.results import CaseDrive, CaseVerdict
from vve_sumo.timing import PERIOD

#: slower than this a car is brought to rest as gently as the brain likes [m/s]
CREEP: Final = 0.5
#: braking for something: so much beyond what the nominal drive asks for at the same time [m/s2]
BEYOND_NOMINAL: Final = 0.5
#: braking for a target lasts so long at least, in all [s]: a single setpoint is noise
LEAST_BRAKING: Final = 0.3
#: braking for what is to be left alone lasts no longer, in all [s]
MOST_BRAKING: Final = 0.1
#: a drive with a fault may be so much ahead of or behind the nominal one [s]
SHIFT: Final = 0.3
#: a brain may ask for so much of the car's steering: the gateway limits it, but who asks for more has another unit
MOST_STEERING: Final = 1.5
#: outcomes that are no fault of the brain: nothing can be said of it then
BROKEN: Final = ("broken", "interrupted")
#: outcomes of a drive that nothing cut short
FINISHED: Final = ("stopped", "completed")
_SLACK: Final = 1e-6  # [s]


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the judge says of one drive."""

    verdict: CaseVerdict
    why: str
    reaction: float  #: [s]; inf for never, NaN where none is measured
    left: float  #: [m]; NaN where nothing was ahead
    extra_braking: float  #: [m/s2]
    last: Answer | None


@dataclass(frozen=True, slots=True)
class Rules:
    """What every drive is held to."""

    limits: CertificateLimits
    speed: float  #: that the scenario asks for [m/s]
    steering: float = math.inf  #: road-wheel angle that the car has on either side [rad]


def judge(case: Case, window: Window | None, course: CaseDrive, nominal: CaseDrive | None, rules: Rules) -> Judgement:
    """Return what came of a drive of a case; `nominal` is the drive without a fault, None for that drive itself."""
    rest = rest_time(course)
    reaction = _reaction(case, window, course, nominal)
    left, why = _left(course), _failure(case, window, course, nominal, reaction, rules)
    last = next((answer for answer in reversed(course.answers) if answer.time < rest), None)
    verdict = CaseVerdict.FAILED if why else CaseVerdict.PASSED
    return Judgement(verdict, why, reaction, left, _extra(window, course, nominal), last)


def _reaction(case: Case, window: Window | None, course: CaseDrive, nominal: CaseDrive | None) -> float:
    """Return the time from the fault to the reaction [s]: inf for never, NaN where none is asked for."""
    if window is None or case.reaction not in (Reaction.STOP, Reaction.BRAKE):
        return math.nan
    if case.reaction is Reaction.STOP:
        return _stopping(window, course)
    brakes = [
        answer.time - window.begins
        for answer, usual in _beside(window, course, nominal)
        if answer.acceleration <= BRAKING_DEMAND and usual - answer.acceleration >= BEYOND_NOMINAL
    ]
    # A brain may say the same several times a tick: it brakes no longer for that.
    return brakes[0] if len(set(brakes)) * PERIOD >= LEAST_BRAKING - _SLACK else math.inf


def _stopping(window: Window, course: CaseDrive) -> float:
    """Return the time after which the brain never again asked for anything but braking while the car moved [s]."""
    active = [time for time in acting(course, CREEP) if window.holds(time)]
    if not active:
        return 0.0
    moving = course.time[np.abs(course.speed) > CREEP]
    # What acts to the end has not stopped: a car that a contact or the gateway stops first has not been stopped by it.
    never = abs(float(course.speed[-1])) > AT_REST or float(moving[-1]) - active[-1] < 2.0 * PERIOD
    return math.inf if never else active[-1] + PERIOD - window.begins


def _beside(window: Window, course: CaseDrive, nominal: CaseDrive | None) -> list[tuple[Answer, float]]:
    """Return the answers while a fault was there, each with what the nominal drive asked for at that time [m/s2]."""
    usual = [] if nominal is None else list(nominal.answers)
    times = [answer.time for answer in usual]
    pairs = []
    for answer in course.answers:
        if window.holds(answer.time):
            at = min(bisect_left(times, answer.time - _SLACK), len(usual) - 1)
            pairs.append((answer, usual[at].acceleration if usual else 0.0))
    return pairs


def _extra(window: Window | None, course: CaseDrive, nominal: CaseDrive | None) -> float:
    if window is None:
        return 0.0
    return max((usual - answer.acceleration for answer, usual in _beside(window, course, nominal)), default=0.0)


def _harder(window: Window, course: CaseDrive, nominal: CaseDrive, demand: float) -> float:
    """Return for how long the brain asked for `demand` [m/s2] of braking beyond the nominal drive's hardest nearby [s].

    Nearby is within SHIFT; looked at from the fault's begin to SHIFT behind its end.
    """
    times = [answer.time for answer in nominal.answers]
    seen = Window(window.begins, window.ends + SHIFT)
    harder = set()
    for answer in course.answers:
        if seen.holds(answer.time):
            low = bisect_left(times, answer.time - SHIFT)
            high = bisect_left(times, answer.time + SHIFT + _SLACK)
            usual = min((one.acceleration for one in nominal.answers[low:high]), default=0.0)
            if min(usual, 0.0) - answer.acceleration >= -demand:
                harder.add(answer.time)
    return len(harder) * PERIOD


def _left(course: CaseDrive) -> float:
    """Return the distance left [m]: at rest, else the least that there was; NaN where nothing was ahead."""
    if math.isfinite(course.stop_gap):
        return course.stop_gap
    if course.collision:
        return 0.0
    known = course.gap[np.isfinite(course.gap)]
    return float(known[-1]) if len(known) and math.isfinite(float(course.gap[-1])) else math.nan


def _failure(
    case: Case, window: Window | None, course: CaseDrive, nominal: CaseDrive | None, reaction: float, rules: Rules
) -> str:
    """Return why a case failed; empty for one that passed."""
    if course.outcome in BROKEN:
        return f"the drive was {course.outcome}"
    if course.collision:
        return f"contact at {course.impact_speed:.1f} m/s"
    if case.reaction is Reaction.DRIVE and not (course.answers and course.taken):
        refused = ", ".join(f"{count} x {code}" for code, count in sorted(course.refused.items()))
        return f"none of its answers was taken ({refused})" if refused else "it gave no answer"
    if case.reaction is Reaction.DRIVE and float(np.nanmax(np.abs(course.speed))) <= AT_REST:
        return "the car never moved"
    if window is not None and (why := _over_before(window, course)):
        return why
    found = [*_beyond(course, rules), *_untimely(case, reaction)]
    steered = max((abs(answer.steering) for answer in course.answers), default=0.0)
    if case.reaction is Reaction.DRIVE and steered > MOST_STEERING * rules.steering:
        found.append(f"it asked for {steered:.2f} rad of steering, the car has {rules.steering:.2f} rad")
    if case.reaction in UNDISTURBED:
        found += _disturbed(case, window, course, nominal, rules.limits)
    elif not found:
        found += _not_safe(case, course, rules.limits)
    return "; ".join(found)


def _over_before(window: Window, course: CaseDrive) -> str:
    """Return why a fault had nothing to hit, as it had in the nominal drive: then no reaction to it was seen."""
    last = max((answer.time for answer in course.answers if answer.time < window.begins - _SLACK), default=-math.inf)
    if window.begins - last > MAX_SILENCE + _SLACK:
        return "it had fallen silent before the fault began, which tested nothing"
    if rest_time(course) <= window.begins + _SLACK:
        return "the car had come to rest, or the drive was over, before the fault began, which tested nothing"
    return ""


def _beyond(course: CaseDrive, rules: Rules) -> Iterator[str]:
    """Yield the limits that hold at any time and were not kept."""
    limits = rules.limits
    aside = float(np.nanmax(np.abs(course.deviation), initial=0.0))
    if aside > limits.max_deviation_m:
        yield f"{aside:.2f} m from the path, allowed {limits.max_deviation_m:g} m"
    over = float(np.nanmax(course.speed)) - rules.speed
    if over > limits.max_overspeed_mps:
        asked = f"the scenario's {rules.speed:.1f} m/s"
        yield f"{over:.1f} m/s faster than {asked}, allowed {limits.max_overspeed_mps:g} m/s"


def _untimely(case: Case, reaction: float) -> Iterator[str]:
    if math.isinf(reaction):
        never = "it drove on" if case.reaction is Reaction.STOP else "it never braked for it"
        yield f"{never}; required: {case.reaction.value} within {case.within:g} s"
    elif reaction > case.within + _SLACK:
        yield f"{case.reaction.value} after {reaction:.2f} s, required within {case.within:g} s"


def _disturbed(
    case: Case, window: Window | None, course: CaseDrive, nominal: CaseDrive | None, limits: CertificateLimits
) -> Iterator[str]:
    """Yield how a drive that was to go on as without a fault did not."""
    if course.outcome not in FINISHED:
        yield f"the drive ended otherwise: {', '.join((course.outcome, *course.reasons))}"
    elif not math.isfinite(course.stop_gap):
        yield "it did not come to rest before what stands there"
    elif not limits.min_left_m <= course.stop_gap <= limits.max_left_m:
        yield f"{course.stop_gap:.2f} m left, required {limits.min_left_m:g} to {limits.max_left_m:g} m"
    demand = {Reaction.IGNORE: BRAKING_DEMAND, Reaction.EASE: HARD_BRAKING}.get(case.reaction)
    if demand is not None and window is not None and nominal is not None:
        lasts = _harder(window, course, nominal, demand)
        if lasts > MOST_BRAKING + _SLACK:
            yield f"it braked for it, by {-demand:g} m/s² or more beyond the drive without a fault, for {lasts:.2f} s"


def _not_safe(case: Case, course: CaseDrive, limits: CertificateLimits) -> Iterator[str]:
    left = _left(course)
    if left < limits.min_left_m:
        yield f"{left:.2f} m left, required at least {limits.min_left_m:g} m"
    elif case.reaction is Reaction.STOP and abs(float(course.speed[-1])) >= AT_REST:
        yield "the car did not come to rest"
