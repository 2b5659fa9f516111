"""When a case's fault begins: at a moment at which the nominal drive would not do by itself what the case requires.

It reads the nominal drive; it must not know how a drive is judged afterwards, nor how a fault is made.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from vve_sumo.certify.cases import LEADS, SAFE_DEMAND, UNBRAKED, Case, FaultMoment, ghost_distance
from vve_sumo.certify.link import Window
from vve_sumo.certify.phantoms import FIELD_OF_VIEW, DrivenTrack
from vve_sumo.certify.results import CaseDrive
from vve_sumo.timing import PERIOD

#: the car stands [m/s]
AT_REST: Final = 0.05
#: episodes of braking are looked for above this speed: beneath it brains ease off before rest [m/s]
FAST: Final = 3.0
#: braking that is interrupted for less is one episode [s]
MAX_INTERRUPTION: Final = 0.3
#: deceleration from which the onset of braking is reckoned back where a drive ended without rest [m/s2]
USUAL_BRAKING: Final = 1.8
#: the nominal drive does not brake for so much longer than a reaction may take [s]
CLEAR: Final = 0.3
#: a brain that says nothing for longer is no longer acted on [s]
MAX_SILENCE: Final = 0.1
#: between two moments that are tried [s]
STEP: Final = 0.1
#: the way counts as straight where the place in it is at most so far from the car's axis [m]
MAX_ASIDE: Final = 0.4
#: in a bend, the place in the way and its mirror image are so far apart at least [m]: two cars and half a lane
MIN_SEPARATION: Final = 4.0
#: and the place in the way is at most so far from a circle of the car's present curvature [m]
MAX_FROM_CIRCLE: Final = 0.6
#: for so long after the fault began, too [s]
_REACTION: Final = 0.5
_SLACK: Final = 1e-6  # [s]


@dataclass(frozen=True, slots=True)
class Timing:
    """When a case's fault is there."""

    window: Window | None = None  #: None: nothing is injected, or there is no such moment
    void: str = ""  #: why there is no moment for it


def rest_time(course: CaseDrive) -> float:
    """Return the drive time from which on the car stands to the end [s]; the end where it never does."""
    moving = np.flatnonzero(~(np.abs(course.speed) < AT_REST))
    if not len(moving) or moving[-1] + 1 >= len(course.time):
        return float(course.time[-1])
    return float(course.time[moving[-1] + 1])


def acting(course: CaseDrive, speed: float) -> list[float]:
    """Return when the brain asked for anything but braking while the car was faster than `speed` [m/s]."""
    moving = speeds_at(course, [answer.time for answer in course.answers])
    return [
        answer.time
        for answer, fast in zip(course.answers, (moving > speed).tolist(), strict=True)
        if answer.acceleration > SAFE_DEMAND and fast
    ]


def speeds_at(course: CaseDrive, times: list[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the car's speed at drive times [m/s]."""
    at = np.searchsorted(course.time, np.asarray(times, np.float64) + _SLACK, side="right") - 1
    return np.asarray(course.speed)[at]


def onset_of(course: CaseDrive) -> float:
    """Return the drive time at which the episode of braking began that ended in rest [s].

    Interruptions of less than MAX_INTERRUPTION belong to an episode. Of a drive with a contact, or without rest: the
    time at which a usual braking would have had to begin, reckoned back from the contact, else from the end.
    """
    unfinished = course.collision or abs(float(course.speed[-1])) >= AT_REST
    if unfinished:
        end = course.contact if math.isfinite(course.contact) else float(course.time[-1])
        before = course.speed[course.time <= end + _SLACK]
        return max(end - float(np.nanmax(before)) / (2.0 * USUAL_BRAKING), 0.0)
    return _episode(course, rest_time(course))


def _episode(course: CaseDrive, end: float) -> float:
    """Return when the episode of braking began that was there at the end [s]; 0 where the brain braked all the time."""
    latest = last = math.inf
    for time in reversed([time for time in acting(course, FAST) if time < end]):
        if last - time > 1.5 * PERIOD:
            latest = time
        last = time
        if latest - last + PERIOD >= MAX_INTERRUPTION - _SLACK:
            return latest + PERIOD
    return 0.0


def timing_of(case: Case, nominal: CaseDrive, bumper: float) -> Timing:
    """Return when a case's fault is there, by the nominal drive with the same seed.

    `bumper` lies so far ahead of the rear axle [m].
    """
    if not case.injects:
        return Timing()
    track = track_of(nominal)
    if case.begins is FaultMoment.BEND:
        return _in_a_bend(case, nominal, track, bumper)
    onset = onset_of(nominal)
    for begins in _tried(onset + LEADS[case.begins], onset):
        if math.isfinite(case.lasts) and not _fast(nominal, begins):
            continue
        if case.reaction in UNBRAKED and not _unbraked(nominal, begins, begins + _shown(case) + CLEAR):
            continue
        if (
            case.show is not None
            and case.begins is FaultMoment.CRUISE
            and not _straight(nominal, track, begins, bumper)
        ):
            continue
        return Timing(_window(case, begins))
    where = "goes straight on and " if case.show is not None else ""
    unbraked = f", {where}without braking for {_shown(case) + CLEAR:.1f} s on end"
    return Timing(
        void=f"the nominal drive is nowhere faster than {FAST:g} m/s{unbraked if case.reaction in UNBRAKED else ''}"
    )


def track_of(course: CaseDrive) -> DrivenTrack:
    """Return where the rear axle of a drive went."""
    return DrivenTrack(course.time, course.x, course.y, course.heading)


def _window(case: Case, begins: float) -> Window:
    return Window(begins, begins + case.lasts)


def _shown(case: Case) -> float:
    """Return for how long after a fault's begin the nominal drive tells nothing if it brakes by itself [s]."""
    within = case.within if math.isfinite(case.within) else 0.0
    return max(within, case.lasts if math.isfinite(case.lasts) else 0.0)


def _tried(preferred: float, last: float) -> Iterator[float]:
    """Yield the times of ticks at which a fault might begin [s]: the preferred one, then others by their distance."""
    first = max(round(preferred / PERIOD), 0)
    step = round(STEP / PERIOD)
    ticks = [*range(first, -1, -step), *range(first + step, round(last / PERIOD) + 1, step)]
    yield from (tick * PERIOD for tick in sorted(ticks, key=lambda tick: abs(tick - first)))


def _fast(course: CaseDrive, begins: float) -> bool:
    """Whether the car is faster than FAST then: a fault that is over before the car moves again shows nothing."""
    return bool(speeds_at(course, [begins])[0] > FAST)


def _unbraked(course: CaseDrive, begins: float, ends: float) -> bool:
    """Whether in a span the brain answers all the time, never brakes, and the car is faster than FAST."""
    times = [answer.time for answer in course.answers]
    low, high = bisect_left(times, begins - _SLACK), bisect_left(times, ends - _SLACK)
    answers = course.answers[low:high]
    if not answers or any(answer.acceleration <= SAFE_DEMAND for answer in answers):
        return False
    spots = [begins, *(answer.time for answer in answers), ends]
    if max(after - before for before, after in itertools.pairwise(spots)) > MAX_SILENCE:
        return False
    return bool(np.all(speeds_at(course, spots) > FAST))


def _straight(course: CaseDrive, track: DrivenTrack, begins: float, bumper: float) -> bool:
    """Whether the way goes straight on to where a target would stand, and does so while it is shown."""
    (speed,) = speeds_at(course, [begins]).tolist()
    return all(
        abs(track.seen_from(track.driven(time), ahead)[1]) <= MAX_ASIDE
        for time in (begins, begins + 1.0)
        for ahead in (0.5 * ghost_distance(speed), ghost_distance(speed) + bumper)
    )


def _in_a_bend(case: Case, nominal: CaseDrive, track: DrivenTrack, bumper: float) -> Timing:
    """Return the moment at which the way bends most evenly to a place whose mirror image is not in it."""
    found: list[tuple[float, float]] = []
    span = _shown(case) + CLEAR
    for begins in _tried(0.0, float(nominal.time[-1]) - span):
        if _unbraked(nominal, begins, begins + span):
            (speed,) = speeds_at(nominal, [begins]).tolist()
            error = _from_circle(nominal, track, begins, ghost_distance(speed), bumper)
            if error <= MAX_FROM_CIRCLE:
                found.append((error, begins))
    if not found:
        return Timing(
            void="the nominal drive has no bend in which the other side of the car's axis is "
            f"{MIN_SEPARATION:g} m from the way: on which side a target is does not matter in it"
        )
    return Timing(_window(case, min(found)[1]))


def _from_circle(course: CaseDrive, track: DrivenTrack, begins: float, distance: float, bumper: float) -> float:
    """Return how far the way, `distance` ahead of the bumper, is from a circle of the present curvature [m].

    Infinite where that place is not seen, or is not MIN_SEPARATION from its mirror image.
    """
    worst = 0.0
    for after in (0.0, _REACTION):
        here = track.driven(begins + after)
        left = max(distance - (here - track.driven(begins)), 0.5)
        forward, aside = track.seen_from(here, left + bumper)
        if after == 0.0 and 2.0 * abs(aside) < MIN_SEPARATION:
            return math.inf
        if forward <= bumper or abs(math.atan2(aside, forward - bumper)) > 0.9 * FIELD_OF_VIEW:
            return math.inf
        curvature = track.curvature(here)
        worst = max(worst, abs(aside - 0.5 * curvature * forward**2))
    return worst
