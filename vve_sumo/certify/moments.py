"""When a case's fault begins: at a time at which the nominal drive does not show the required reaction by itself.

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
from vve_sumo.certify.phantoms import FIELD_OF_VIEW
from vve_sumo.certify.results import CaseDrive
from vve_sumo.certify.track import DrivenTrack
from vve_sumo.timing import PERIOD

#: below this speed the car counts as standing [m/s]
AT_REST: Final = 0.05
#: braking episodes are searched above this speed: below it brains release the brake before rest [m/s]
FAST: Final = 3.0
#: longest interruption within one braking episode [s]
MAX_INTERRUPTION: Final = 0.3
#: deceleration assumed for the onset of braking where a drive ended without rest [m/s2]
USUAL_BRAKING: Final = 1.8
#: margin beyond the reaction time in which the nominal drive must not brake [s]
CLEAR: Final = 0.3
#: longest silence after which the gateway still acts on the last setpoint [s]
MAX_SILENCE: Final = 0.1
#: step between two candidate times [s]
STEP: Final = 0.1
#: the path ahead counts as straight up to this distance from the car's axis [m]
MAX_LATERAL_OFFSET: Final = 0.4
#: least distance between a target in a bend and its mirror image [m]: two cars and half a lane
MIN_SEPARATION: Final = 4.0
#: largest distance between the path ahead and a circle of the car's present curvature [m]
MAX_FROM_CIRCLE: Final = 0.6
#: time after the begin of the fault at which these conditions must hold as well [s]
_REACTION: Final = 0.5
_SLACK: Final = 1e-6  # [s]


@dataclass(frozen=True, slots=True)
class Timing:
    """The window of a case's fault."""

    window: Window | None = None  #: None: nothing is injected, or there is no suitable time
    void: str = ""  #: why there is no suitable time


def rest_time(drive: CaseDrive) -> float:
    """Return the drive time from which on the car stands until the end [s]; the end where it does not."""
    moving = np.flatnonzero(~(np.abs(drive.speed) < AT_REST))
    if not len(moving) or moving[-1] + 1 >= len(drive.time):
        return float(drive.time[-1])
    return float(drive.time[moving[-1] + 1])


def unbraked_times(drive: CaseDrive, speed: float) -> list[float]:
    """Return the times of the answers that do not brake while the car is faster than `speed` [m/s]."""
    moving = speeds_at(drive, [answer.time for answer in drive.answers])
    return [
        answer.time
        for answer, fast in zip(drive.answers, (moving > speed).tolist(), strict=True)
        if answer.acceleration > SAFE_DEMAND and fast
    ]


def speeds_at(drive: CaseDrive, times: list[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the car's speed at drive times [m/s]."""
    at = np.searchsorted(drive.time, np.asarray(times, np.float64) + _SLACK, side="right") - 1
    return np.asarray(drive.speed)[at]


def onset_of(drive: CaseDrive) -> float:
    """Return the drive time at which the episode of braking began that ended in rest [s].

    Interruptions of less than MAX_INTERRUPTION belong to an episode. For a drive with a contact, or without rest: the
    time at which braking by USUAL_BRAKING had to begin, counted back from the contact, else from the end.
    """
    unfinished = drive.collision or abs(float(drive.speed[-1])) >= AT_REST
    if unfinished:
        end = drive.contact if math.isfinite(drive.contact) else float(drive.time[-1])
        before = drive.speed[drive.time <= end + _SLACK]
        return max(end - float(np.nanmax(before)) / (2.0 * USUAL_BRAKING), 0.0)
    return _episode(drive, rest_time(drive))


def _episode(drive: CaseDrive, end: float) -> float:
    """Return the begin of the braking episode that lasted to `end` [s]; 0 where the brain braked all the time."""
    latest = last = math.inf
    for time in reversed([time for time in unbraked_times(drive, FAST) if time < end]):
        if last - time > 1.5 * PERIOD:
            latest = time
        last = time
        if latest - last + PERIOD >= MAX_INTERRUPTION - _SLACK:
            return latest + PERIOD
    return 0.0


def timing_of(case: Case, nominal: CaseDrive, bumper: float) -> Timing:
    """Return the window of a case's fault, from the nominal drive with the same seed.

    `bumper`: distance from the rear axle to the front bumper [m].
    """
    if not case.injects:
        return Timing()
    track = track_of(nominal)
    if case.begins is FaultMoment.BEND:
        return _in_a_bend(case, nominal, track, bumper)
    onset = onset_of(nominal)
    for begins in _candidate_times(onset + LEADS[case.begins], onset):
        if math.isfinite(case.lasts) and not _fast(nominal, begins):
            continue
        if case.reaction in UNBRAKED and not _unbraked(nominal, begins, begins + _observed_time(case) + CLEAR):
            continue
        if (
            case.make_scan_fault is not None
            and case.begins is FaultMoment.CRUISE
            and not _straight(nominal, track, begins, bumper)
        ):
            continue
        return Timing(_window(case, begins))
    where = "goes straight on and " if case.make_scan_fault is not None else ""
    unbraked = f", {where}without braking for {_observed_time(case) + CLEAR:.1f} s on end"
    return Timing(
        void=f"the nominal drive is nowhere faster than {FAST:g} m/s{unbraked if case.reaction in UNBRAKED else ''}"
    )


def track_of(drive: CaseDrive) -> DrivenTrack:
    """Return the track of a drive's rear axle."""
    return DrivenTrack(drive.time, drive.x, drive.y, drive.heading)


def _window(case: Case, begins: float) -> Window:
    return Window(begins, begins + case.lasts)


def _observed_time(case: Case) -> float:
    """Return how long after a fault's begin the nominal drive must not brake by itself [s]."""
    within = case.within if math.isfinite(case.within) else 0.0
    return max(within, case.lasts if math.isfinite(case.lasts) else 0.0)


def _candidate_times(preferred: float, last: float) -> Iterator[float]:
    """Yield candidate times for the begin of a fault [s]: the preferred one, then others by their distance from it."""
    first = max(round(preferred / PERIOD), 0)
    step = round(STEP / PERIOD)
    ticks = [*range(first, -1, -step), *range(first + step, round(last / PERIOD) + 1, step)]
    yield from (tick * PERIOD for tick in sorted(ticks, key=lambda tick: abs(tick - first)))


def _fast(drive: CaseDrive, begins: float) -> bool:
    """Whether the car is faster than FAST: a short fault at rest has no effect."""
    return bool(speeds_at(drive, [begins])[0] > FAST)


def _unbraked(drive: CaseDrive, begins: float, ends: float) -> bool:
    """Whether from `begins` to `ends` the brain answers, never brakes, and the car is faster than FAST."""
    times = [answer.time for answer in drive.answers]
    low, high = bisect_left(times, begins - _SLACK), bisect_left(times, ends - _SLACK)
    answers = drive.answers[low:high]
    if not answers or any(answer.acceleration <= SAFE_DEMAND for answer in answers):
        return False
    instants = [begins, *(answer.time for answer in answers), ends]
    if max(after - before for before, after in itertools.pairwise(instants)) > MAX_SILENCE:
        return False
    return bool(np.all(speeds_at(drive, instants) > FAST))


def _straight(drive: CaseDrive, track: DrivenTrack, begins: float, bumper: float) -> bool:
    """Whether the path is straight up to the target's position, for as long as the target is shown."""
    (speed,) = speeds_at(drive, [begins]).tolist()
    return all(
        abs(track.position_ahead(track.driven(time), ahead)[1]) <= MAX_LATERAL_OFFSET
        for time in (begins, begins + 1.0)
        for ahead in (0.5 * ghost_distance(speed), ghost_distance(speed) + bumper)
    )


def _in_a_bend(case: Case, nominal: CaseDrive, track: DrivenTrack, bumper: float) -> Timing:
    """Return the window where the path up to the target is closest to a circle and the mirror image is off the path."""
    candidates: list[tuple[float, float]] = []
    span = _observed_time(case) + CLEAR
    for begins in _candidate_times(0.0, float(nominal.time[-1]) - span):
        if _unbraked(nominal, begins, begins + span):
            (speed,) = speeds_at(nominal, [begins]).tolist()
            error = _from_circle(nominal, track, begins, ghost_distance(speed), bumper)
            if error <= MAX_FROM_CIRCLE:
                candidates.append((error, begins))
    if not candidates:
        return Timing(
            void="the nominal drive has no bend in which the other side of the car's axis is "
            f"{MIN_SEPARATION:g} m from the path: on which side a target is makes no difference in it"
        )
    return Timing(_window(case, min(candidates)[1]))


def _from_circle(drive: CaseDrive, track: DrivenTrack, begins: float, distance: float, bumper: float) -> float:
    """Return the distance of the path, `distance` ahead of the bumper, from a circle of the present curvature [m].

    Infinite where that point is outside the field of view, or closer than MIN_SEPARATION to its mirror image.
    """
    worst = 0.0
    for after in (0.0, _REACTION):
        here = track.driven(begins + after)
        left = max(distance - (here - track.driven(begins)), 0.5)
        forward, lateral = track.position_ahead(here, left + bumper)
        if after == 0.0 and 2.0 * abs(lateral) < MIN_SEPARATION:
            return math.inf
        if forward <= bumper or abs(math.atan2(lateral, forward - bumper)) > 0.9 * FIELD_OF_VIEW:
            return math.inf
        curvature = track.curvature(here)
        worst = max(worst, abs(lateral - 0.5 * curvature * forward**2))
    return worst
