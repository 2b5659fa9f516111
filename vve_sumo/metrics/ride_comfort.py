"""How a ride felt: weighted horizontal accelerations by ISO 2631-1, motion sickness dose and jerk, on whole arrays.

Knows accelerations, speeds and times; no record and no car. The acceleration is that of one point of the car in the
plane of the road: vertical motion, the tilt of the body and the seat between car and passenger are not in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vve_sumo.metrics.frequency_weighting import WD, WF, Weighting, weighted
from vve_sumo.metrics.slope import slope
from vve_sumo.metrics.stopping import AT_REST
from vve_sumo.values import Floats

#: a running root mean square is of so long (ISO 2631-1, 6.3.1) [s]
AVERAGED: Final = 1.0
#: a ride begins so long before its first motion and ends so long after its last, for the jolts of both are felt [s]
MARGIN: Final = 1.0
#: accelerations so far apart in time are joined by a straight line: as long as a setpoint may be acted on [s]
MAX_GAP: Final = 0.1
#: MTVV over the root mean square from which on the latter understates what passengers feel (ISO 2631-1, 6.3.3)
MAX_TRANSIENT_RATIO: Final = 1.5

#: reactions to a vibration total value in public transport, by its bounds [m/s2]; they overlap (ISO 2631-1, C.2.3)
REACTIONS: Final = (
    (0.0, 0.315, "not uncomfortable"),
    (0.315, 0.63, "a little uncomfortable"),
    (0.5, 1.0, "fairly uncomfortable"),
    (0.8, 1.6, "uncomfortable"),
    (1.25, 2.5, "very uncomfortable"),
    (2.0, math.inf, "extremely uncomfortable"),
)


@dataclass(frozen=True, slots=True)
class Ride:
    """Accelerations from MARGIN before the first motion until MARGIN after the last, at even times; shape (n,)."""

    period: float  #: from one time to the next [s]
    time: Floats  #: [s]
    longitudinal: Floats  #: along the heading, forward positive [m/s2]
    lateral: Floats  #: left positive [m/s2]

    @property
    def duration(self) -> float:
        """From the first time to the last [s]."""
        return float(self.time[-1] - self.time[0])

    def covers(self, weighting: Weighting) -> bool:
        """Whether it is as long as one period of the weighting's lower limiting frequency."""
        return self.duration * weighting.high_pass >= 1.0


@dataclass(frozen=True, slots=True)
class RideComfort:
    """How a ride felt; NaN where it was too short to say."""

    longitudinal: float  #: root mean square of the acceleration weighted with Wd [m/s2]
    lateral: float  #: likewise [m/s2]
    max_transient: float  #: MTVV, greatest of the running root mean squares of both together [m/s2]
    sickness_dose: float  #: MSDV, root of the time integral of both accelerations, weighted with Wf, squared [m/s^1.5]
    max_jerk: float  #: greatest size of the rate of change of the acceleration as a vector [m/s3]
    time: Floats  #: of the running root mean squares, shape (n,) [s]
    running: Floats  #: root mean square of the last AVERAGED, weighted with Wd, of both together, shape (n,) [m/s2]

    @property
    def total(self) -> float:
        """Vibration total value of the horizontal axes, weighed alike as for comfort (ISO 2631-1, 8.2.2) [m/s2]."""
        return math.hypot(self.longitudinal, self.lateral)


def lateral_acceleration(time: Floats, x: Floats, y: Floats, heading: Floats) -> Floats:
    """Return the acceleration across the heading, left positive [m/s2], of exact places; NaN at the first and the last.

    time [s], x and y [m], heading [rad], shape (n,). Second differences: what they make of noise is no acceleration.
    Of places at one and the same time the answer is not finite.
    """
    answer = np.full(len(time), np.nan)
    if len(time) > 2:
        with np.errstate(divide="ignore", invalid="ignore"):
            middle = 0.5 * (time[2:] - time[:-2])
            along_x, along_y = (np.diff(np.diff(place) / np.diff(time)) / middle for place in (x, y))
            answer[1:-1] = along_y * np.cos(heading[1:-1]) - along_x * np.sin(heading[1:-1])
    return answer


def ride_of(time: Floats, speed: Floats, longitudinal: Floats, lateral: Floats, period: float) -> Ride | None:
    """Return the ride of a drive, at times `period` [s] apart; None without motion, or with more unknown than MAX_GAP.

    time [s], speed [m/s] and accelerations [m/s2] of the ticks, shape (n,), NaN where they are not known.
    """
    moving = np.flatnonzero(np.abs(speed) > AT_REST)
    if not len(moving):
        return None
    ends = time[moving[[0, -1]]]
    known = np.isfinite(longitudinal) & np.isfinite(lateral) & (time >= ends[0] - MARGIN) & (time <= ends[1] + MARGIN)
    times = time[known]
    if not len(times) or np.diff(np.sort(np.concatenate((times, ends)))).max() > MAX_GAP + 0.5 * period:
        return None
    even = times[0] + period * np.arange(round(float(times[-1] - times[0]) / period) + 1)
    return Ride(period, even, *(np.interp(even, times, values[known]) for values in (longitudinal, lateral)))


def ride_comfort(ride: Ride) -> RideComfort:
    """Return how a ride felt.

    What a weighting says is NaN of a ride that is shorter than one period of its lower limiting frequency: 2.5 s for Wd
    and 12.5 s for Wf. After so long the filter has forgotten its beginning but for a fiftieth.
    """
    axes = ride.longitudinal, ride.lateral
    nothing = np.full(len(ride.time), np.nan)
    x, y = (weighted(axis, WD, ride.period) if ride.covers(WD) else nothing for axis in axes)
    nauseating = (weighted(axis, WF, ride.period) if ride.covers(WF) else nothing for axis in axes)
    running = _running(x * x + y * y, ride.period)
    return RideComfort(
        longitudinal=_rms(x),
        lateral=_rms(y),
        max_transient=float(running.max()),
        sickness_dose=math.sqrt(ride.period * len(ride.time)) * math.hypot(*map(_rms, nauseating)),
        max_jerk=_max_jerk(ride),
        time=ride.time,
        running=running,
    )


def _rms(values: Floats) -> float:
    return math.sqrt(math.fsum((values * values).tolist()) / len(values))


def _running(squares: Floats, period: float) -> Floats:
    """Return the root of the mean over AVERAGED up to each sample; before the first one all was 0."""
    count = round(AVERAGED / period)
    sums = np.cumsum(squares)
    sums[count:] -= sums[:-count].copy()
    return np.sqrt(np.maximum(sums, 0.0) / count)


def _max_jerk(ride: Ride) -> float:
    """Return the greatest size of the jerk [m/s3]; NaN for a ride that is shorter than the window of its slope."""
    jerk = np.hypot(*(slope(ride.time, axis, ride.period) for axis in (ride.longitudinal, ride.lateral)))
    return float(np.fmax.reduce(jerk, initial=np.nan))


def reactions(total: float) -> str:
    """Return what a vibration total value [m/s2] is likely to be called in public transport (ISO 2631-1, C.2.3).

    Two reactions, joined by "to", where the standard's bands overlap.
    """
    return " to ".join(words for low, high, words in REACTIONS if low <= total < high)
