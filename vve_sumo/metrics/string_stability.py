"""How a disturbance passes from vehicle to vehicle in a string, and how headways are kept: on whole arrays.

Knows speeds, gaps and times; no record and no car. Arrays have an entry a tick.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vve_sumo.values import Floats

#: a leader whose speed varies less about the undisturbed one disturbs nobody: root mean square [m/s]
LEAST_DISTURBANCE = 0.1
#: a follower is settled that for so long [s] keeps to its leader's speed within so much [m/s], while the gap changes by
#: no more than this on average [m/s]: what comes before is its approach, and no answer to a disturbance
SETTLED_FOR, SETTLED_SPEED, SETTLED_GAP_RATE = 3.0, 0.5, 0.2


class Amplification(NamedTuple):
    """Size of a follower's disturbance over its leader's: above 1 the string amplifies it. NaN where it has none."""

    l2: float  #: of the energies: root of the sum of squares over root of the sum of squares
    linf: float  #: of the peaks: greatest size over greatest size


def amplification(leader: ArrayLike, follower: ArrayLike) -> Amplification:
    """Return how much larger a follower's disturbance is than its leader's (Ploeg, van de Wouw and Nijmeijer 2014).

    leader, follower: of the same instants, the speed minus that of the undisturbed string, or the acceleration. A
    string is L2 stable if no leader's disturbance grows in the first sense, L-infinity stable likewise in the second.
    """
    ahead, behind = np.asarray(leader, np.float64), np.asarray(follower, np.float64)
    energy = math.sqrt(float(np.sum(ahead * ahead)))
    if not energy > 0.0:
        return Amplification(math.nan, math.nan)
    return Amplification(
        math.sqrt(float(np.sum(behind * behind))) / energy, float(np.max(np.abs(behind)) / np.max(np.abs(ahead)))
    )


def speed_amplification(leader: Floats, follower: Floats, undisturbed: float | None = None) -> Amplification:
    """Return the amplification of the disturbance of two speeds [m/s].

    undisturbed: speed of the string without the disturbance [m/s], the leader's median where it is not given. NaN of a
    leader that keeps to it within LEAST_DISTURBANCE.
    """
    if not len(leader):
        return Amplification(math.nan, math.nan)
    steady = float(np.median(leader)) if undisturbed is None else undisturbed
    if math.sqrt(float(np.mean((leader - steady) ** 2))) < LEAST_DISTURBANCE:
        return Amplification(math.nan, math.nan)
    return amplification(leader - steady, follower - steady)


def settled_from(time: Floats, gap: Floats, leader: Floats, follower: Floats) -> int:
    """Return the first tick from which on the follower is settled behind its leader; the number of ticks for never.

    At that tick it has the leader's speed within LEAST_DISTURBANCE. String stability is about what a string does that
    leaves its equilibrium (Ploeg et al. 2014), and tests of it let the vehicles settle first (Gunter et al. 2020).
    time: [s], gap: [m], speeds: [m/s], an entry a tick, none NaN.
    """
    number, apart = np.arange(len(time)), np.abs(leader - follower)
    differs = np.where(apart > SETTLED_SPEED, number, len(time))
    next_differs = np.minimum.accumulate(differs[::-1])[::-1]
    until = np.searchsorted(time, time + SETTLED_FOR)
    end = np.minimum(until, len(time) - 1)
    drifts = np.abs(gap[end] - gap) > SETTLED_GAP_RATE * SETTLED_FOR
    begins = (apart <= LEAST_DISTURBANCE) & (until < len(time)) & (next_differs > end) & ~drifts
    settled = np.flatnonzero(begins)
    return int(settled[0]) if len(settled) else len(time)


def time_shares(time: Floats, values: Floats, edges: ArrayLike) -> Floats:
    """Return the share of time that values spend between each two edges: the first belongs to a bin, the second not.

    time: [s]; what holds at a tick holds until the next, the last one counts no time. NaN takes no time. NaN for no
    time at all.
    """
    step = np.append(np.diff(time), 0.0)
    known = np.isfinite(values)
    spent, _ = np.histogram(values[known], bins=np.append(np.asarray(edges, np.float64), np.inf), weights=step[known])
    whole = float(step[known].sum())
    return spent[:-1] / whole if whole > 0.0 else np.full(len(spent) - 1, np.nan)


class GapError(NamedTuple):
    """By how much the time gap is off the wanted one [s]: longer is positive. NaN where there is none."""

    mean: float
    rms: float


def time_gap_error(gap: Floats, speed: Floats, time_gap: float, standstill: float = 0.0) -> GapError:
    """Return the error of the time gap (g - g0) / v - h of a follower with the policy g0 + h v.

    gap: bumper to bumper [m]; speed: of the follower [m/s], above 0; time_gap: the wanted one, h [s]; standstill:
    g0 [m]. NaN in either array is left out.
    """
    error = (gap - standstill) / speed - time_gap
    known = error[np.isfinite(error)]
    if not len(known):
        return GapError(math.nan, math.nan)
    return GapError(float(np.mean(known)), float(np.sqrt(np.mean(known * known))))
