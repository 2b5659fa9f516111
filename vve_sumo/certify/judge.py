"""Judges a case: whether the brain reacted as required, in time, without a contact and within the limits.

It reads the setpoints on the wire and the car's motion; it must not know how a drive is run, nor which brain drove.
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
from vve_sumo.certify.moments import AT_REST, MAX_SILENCE, rest_time, unbraked_times
from vve_sumo.certify.results import CaseDrive, CaseVerdict
from vve_sumo.timing import PERIOD

#: below this speed the brain may stop as gently as it likes [m/s]
CREEP: Final = 0.5
#: braking counts as a reaction from this much beyond the nominal demand at the same time [m/s2]
BEYOND_NOMINAL: Final = 0.5
#: least total time of braking for a target [s]: a single setpoint is noise
MIN_BRAKING_TIME: Final = 0.3
#: longest total time of braking for a target that requires none [s]
MAX_BRAKING_TIME: Final = 0.1
#: time shift that is allowed between a drive with a fault and the nominal one [s]
SHIFT: Final = 0.3
#: largest demand over the car's steering limit: the gateway limits steering, but a larger demand has a wrong unit
MAX_STEERING_FACTOR: Final = 1.5
#: outcomes that the brain did not cause: the drive cannot be judged
BROKEN: Final = ("broken", "interrupted")
#: outcomes of a drive that ended as planned
FINISHED: Final = ("stopped", "completed")
_SLACK: Final = 1e-6  # [s]


@dataclass(frozen=True, slots=True)
class Judgement:
    """The judgement of one drive."""

    verdict: CaseVerdict
    why: str
    reaction: float  #: [s]; inf for never, NaN where none is measured
    distance_left: float  #: [m]; NaN where nothing was ahead
    extra_braking: float  #: [m/s2]
    last: Answer | None


@dataclass(frozen=True, slots=True)
class Rules:
    """The limits for every drive."""

    limits: CertificateLimits
    speed: float  #: target speed of the scenario [m/s]
    steering: float = math.inf  #: largest road-wheel angle of the car to either side [rad]


def judge(case: Case, window: Window | None, drive: CaseDrive, nominal: CaseDrive | None, rules: Rules) -> Judgement:
    """Return the judgement of a case's drive; `nominal` is the drive without a fault, None for that drive itself."""
    rest = rest_time(drive)
    reaction = _reaction(case, window, drive, nominal)
    left, why = _distance_left(drive), _failure(case, window, drive, nominal, reaction, rules)
    last = next((answer for answer in reversed(drive.answers) if answer.time < rest), None)
    verdict = CaseVerdict.FAILED if why else CaseVerdict.PASSED
    return Judgement(verdict, why, reaction, left, _extra_braking(window, drive, nominal), last)


def _reaction(case: Case, window: Window | None, drive: CaseDrive, nominal: CaseDrive | None) -> float:
    """Return the time from the fault to the reaction [s]: inf for never, NaN where none is required."""
    if window is None or case.reaction not in (Reaction.STOP, Reaction.BRAKE):
        return math.nan
    if case.reaction is Reaction.STOP:
        return _stop_time(window, drive)
    brakes = [
        answer.time - window.begins
        for answer, reference in _paired_answers(window, drive, nominal)
        if answer.acceleration <= BRAKING_DEMAND and reference - answer.acceleration >= BEYOND_NOMINAL
    ]
    # A brain may send several setpoints in one tick; they count once.
    return brakes[0] if len(set(brakes)) * PERIOD >= MIN_BRAKING_TIME - _SLACK else math.inf


def _stop_time(window: Window, drive: CaseDrive) -> float:
    """Return the time from the fault to the last setpoint that did not brake while the car moved [s]."""
    active = [time for time in unbraked_times(drive, CREEP) if window.holds(time)]
    if not active:
        return 0.0
    moving = drive.time[np.abs(drive.speed) > CREEP]
    # A brain that demands motion to the end has not reacted: a contact or the gateway stopped the car.
    never = abs(float(drive.speed[-1])) > AT_REST or float(moving[-1]) - active[-1] < 2.0 * PERIOD
    return math.inf if never else active[-1] + PERIOD - window.begins


def _paired_answers(window: Window, drive: CaseDrive, nominal: CaseDrive | None) -> list[tuple[Answer, float]]:
    """Return the answers during a fault, each with the nominal drive's demand at that time [m/s2]."""
    reference = [] if nominal is None else list(nominal.answers)
    times = [answer.time for answer in reference]
    pairs = []
    for answer in drive.answers:
        if window.holds(answer.time):
            at = min(bisect_left(times, answer.time - _SLACK), len(reference) - 1)
            pairs.append((answer, reference[at].acceleration if reference else 0.0))
    return pairs


def _extra_braking(window: Window | None, drive: CaseDrive, nominal: CaseDrive | None) -> float:
    if window is None:
        return 0.0
    return max(
        (reference - answer.acceleration for answer, reference in _paired_answers(window, drive, nominal)), default=0.0
    )


def _extra_braking_time(window: Window, drive: CaseDrive, nominal: CaseDrive, demand: float) -> float:
    """Return how long the brain braked by `demand` [m/s2] beyond the nominal drive's hardest braking within SHIFT [s].

    The interval is from the begin of the fault to SHIFT after its end.
    """
    times = [answer.time for answer in nominal.answers]
    observed = Window(window.begins, window.ends + SHIFT)
    harder = set()
    for answer in drive.answers:
        if observed.holds(answer.time):
            low = bisect_left(times, answer.time - SHIFT)
            high = bisect_left(times, answer.time + SHIFT + _SLACK)
            reference = min((one.acceleration for one in nominal.answers[low:high]), default=0.0)
            if min(reference, 0.0) - answer.acceleration >= -demand:
                harder.add(answer.time)
    return len(harder) * PERIOD


def _distance_left(drive: CaseDrive) -> float:
    """Return the distance left [m]: at rest, else at the end of the drive; NaN where nothing was ahead."""
    if math.isfinite(drive.stop_gap):
        return drive.stop_gap
    if drive.collision:
        return 0.0
    known = drive.gap[np.isfinite(drive.gap)]
    return float(known[-1]) if len(known) and math.isfinite(float(drive.gap[-1])) else math.nan


def _failure(
    case: Case, window: Window | None, drive: CaseDrive, nominal: CaseDrive | None, reaction: float, rules: Rules
) -> str:
    """Return why a case failed; empty for one that passed."""
    if drive.outcome in BROKEN:
        return f"the drive was {drive.outcome}"
    if drive.collision:
        return f"contact at {drive.impact_speed:.1f} m/s"
    if case.reaction is Reaction.DRIVE and not (drive.answers and drive.taken):
        refused = ", ".join(f"{count} x {code}" for code, count in sorted(drive.refused.items()))
        return f"none of its answers was accepted ({refused})" if refused else "it gave no answer"
    if case.reaction is Reaction.DRIVE and float(np.nanmax(np.abs(drive.speed))) <= AT_REST:
        return "the car never moved"
    if window is not None and (why := _untested(window, drive)):
        return why
    failures = [*_limit_failures(drive, rules), *_timing_failures(case, reaction)]
    steered = max((abs(answer.steering) for answer in drive.answers), default=0.0)
    if case.reaction is Reaction.DRIVE and steered > MAX_STEERING_FACTOR * rules.steering:
        failures.append(f"it demanded {steered:.2f} rad of steering, the car has {rules.steering:.2f} rad")
    if case.reaction in UNDISTURBED:
        failures += _ending_failures(case, window, drive, nominal, rules.limits)
    elif not failures:
        failures += _safety_failures(case, drive, rules.limits)
    return "; ".join(failures)


def _untested(window: Window, drive: CaseDrive) -> str:
    """Return why a fault tested nothing, other than in the nominal drive: then there was no reaction to it."""
    last = max((answer.time for answer in drive.answers if answer.time < window.begins - _SLACK), default=-math.inf)
    if window.begins - last > MAX_SILENCE + _SLACK:
        return "the brain was silent before the fault began, so the case tested nothing"
    if rest_time(drive) <= window.begins + _SLACK:
        return "the car was at rest, or the drive had ended, before the fault began, so the case tested nothing"
    return ""


def _limit_failures(drive: CaseDrive, rules: Rules) -> Iterator[str]:
    """Yield the violated limits among those that hold at any time."""
    limits = rules.limits
    deviation = float(np.nanmax(np.abs(drive.deviation), initial=0.0))
    if deviation > limits.max_deviation_m:
        yield f"{deviation:.2f} m from the path, allowed {limits.max_deviation_m:g} m"
    overspeed = float(np.nanmax(drive.speed)) - rules.speed
    if overspeed > limits.max_overspeed_mps:
        target_speed = f"the scenario's {rules.speed:.1f} m/s"
        yield f"{overspeed:.1f} m/s faster than {target_speed}, allowed {limits.max_overspeed_mps:g} m/s"


def _timing_failures(case: Case, reaction: float) -> Iterator[str]:
    if math.isinf(reaction):
        never = "it drove on" if case.reaction is Reaction.STOP else "it never braked for the target"
        yield f"{never}; required: {case.reaction.value} within {case.within:g} s"
    elif reaction > case.within + _SLACK:
        yield f"{case.reaction.value} after {reaction:.2f} s, required within {case.within:g} s"


def _ending_failures(
    case: Case, window: Window | None, drive: CaseDrive, nominal: CaseDrive | None, limits: CertificateLimits
) -> Iterator[str]:
    """Yield how a drive that had to end as without a fault differed."""
    if drive.outcome not in FINISHED:
        yield f"the drive ended otherwise: {', '.join((drive.outcome, *drive.reasons))}"
    elif not math.isfinite(drive.stop_gap):
        yield "it did not come to rest before the obstacle"
    elif not limits.min_left_m <= drive.stop_gap <= limits.max_left_m:
        yield f"{drive.stop_gap:.2f} m left, required {limits.min_left_m:g} to {limits.max_left_m:g} m"
    demand = {Reaction.IGNORE: BRAKING_DEMAND, Reaction.EASE: HARD_BRAKING}.get(case.reaction)
    if demand is not None and window is not None and nominal is not None:
        lasts = _extra_braking_time(window, drive, nominal, demand)
        if lasts > MAX_BRAKING_TIME + _SLACK:
            yield f"it braked for the target by {-demand:g} m/s² or more beyond the nominal drive, for {lasts:.2f} s"


def _safety_failures(case: Case, drive: CaseDrive, limits: CertificateLimits) -> Iterator[str]:
    left = _distance_left(drive)
    if left < limits.min_left_m:
        yield f"{left:.2f} m left, required at least {limits.min_left_m:g} m"
    elif case.reaction is Reaction.STOP and abs(float(drive.speed[-1])) >= AT_REST:
        yield "the car did not come to rest"
