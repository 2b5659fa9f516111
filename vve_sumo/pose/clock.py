"""Maps GNSS time to drive time: when, on the drive's own clock, a fix was made.

It knows arrivals and the times that fixes carry; it must not know sockets, receivers or the content of a fix. A
constant delay cannot be seen from arrivals: unless the host's clock is disciplined by PTP or PPS, the rig declares the
smallest delay, and every age that follows from it is "at least what was declared".
"""

from __future__ import annotations

import enum
import math
from collections import deque
from dataclasses import dataclass
from itertools import combinations
from statistics import median
from typing import Final

from vve_sumo.pose.arrivals import SMALL_JUMP, Arrivals, JudgedArrival

LEAK: Final = 100e-6  #: rate at which a larger delay is accepted; twice the drift of a common quartz
LEARNING: Final = 2.0  #: for this long after the start a smaller delay is accepted at `LEARNING_SLEW` [s]
LEARNING_SLEW: Final = 0.9  #: rate of acceptance at first; below 1, so that the mapped time never stops
SLEW: Final = 0.01  #: rate at which a smaller delay is accepted later; one early arrival changes next to nothing
DRIFT_SECONDS: Final = 60  #: over which the drift is estimated
DRIFT_KNOWN: Final = 10  #: seconds before which no drift is reported
SPREAD_ARRIVALS: Final = 2000  #: arrivals over which the jitter is computed


class AgeKind(enum.StrEnum):
    """What an age on this clock means."""

    ABSOLUTE = "absolute"  #: host and receiver share a clock
    DECLARED = "declared minimum"  #: a constant delay beyond the declared one would not be seen


@dataclass(frozen=True, slots=True)
class ClockReport:
    """Estimates of the clock; NaN where not known yet."""

    age: AgeKind
    offset: float  #: drive time minus GNSS time since the epoch [s]
    drift_ppm: float  #: of the drive's clock against GNSS, fast positive; median slope of the least delays per second
    jitter_p50: float  #: of arrivals, above the least delay of the window [s]
    jitter_p99: float  #: as jitter_p50


class PoseClock:
    """Maps the time of each fix to drive time, from nothing but the arrivals that it is given.

    `epoch` is the GNSS second that the drive calls 0 (any, where the offset is estimated; the true one where
    `absolute`), `minimum_delay` the least time from a fix's epoch to its arrival that the rig declares [s]. The offset
    falls quickly towards an arrival that was faster than estimated and rises by at most `LEAK` towards slower ones, so
    it stays at the fastest of the recent arrivals while the drift is below `LEAK`; a network that turns slow shows as
    age. Give it fixes of status 4 only: a receiver that is catching up (NCOM status 2, 3) looks like a fast clock.

    A fix that would have arrived more than `arrivals.SMALL_JUMP` faster than any before is set aside. Where such fixes
    agree for `arrivals.RUN_TIME`, the receiver's clock was changed: the offset is taken anew, and the fixes set aside
    until then are missing, which is a gap for the trust gate and the end of a drive.
    """

    def __init__(self, epoch: float, minimum_delay: float, *, absolute: bool = False) -> None:
        self._epoch, self._minimum_delay, self._absolute = epoch, minimum_delay, absolute
        self._offset = 0.0 if absolute else math.nan
        self._first = -math.inf
        self._arrivals = Arrivals(SMALL_JUMP, SMALL_JUMP)
        self._excess: deque[float] = deque(maxlen=SPREAD_ARRIVALS)
        self._seconds: deque[tuple[int, float]] = deque(maxlen=DRIFT_SECONDS)

    def step(self, received: float, time: float) -> float:
        """Return the drive time at which the fix of GNSS time `time` was made, given that it arrived at `received`.

        Strictly increasing where `time` is. A fix that is not newer than the newest is mapped but changes no estimate;
        one that is set aside, or is not finite, gives NaN and changes no estimate.
        """
        made = time - self._epoch
        before = self._arrivals.newest
        judged = self._arrivals.judge(received, made)
        if judged is JudgedArrival.AHEAD:
            return math.nan
        if judged is JudgedArrival.NOT_NEWER:
            return made + self._offset
        lag = received - made
        if before == -math.inf or judged is JudgedArrival.CHANGED:
            self._begin(made, lag)
        elif not self._absolute:
            self._learn(made, made - before, lag - self._minimum_delay)
        self._note(made, lag)
        return made + self._offset

    def at(self, time: float) -> float:
        """Return the drive time of GNSS time `time` by the present estimate; NaN before the first fix."""
        return time - self._epoch + self._offset

    def report(self) -> ClockReport:
        """Return the present estimates; it sorts a window, so it is not for every fix."""
        jitter = sorted(self._excess)
        p50, p99 = (
            jitter[round(share * (len(jitter) - 1))] - jitter[0] if jitter else math.nan for share in (0.5, 0.99)
        )
        age = AgeKind.ABSOLUTE if self._absolute else AgeKind.DECLARED
        return ClockReport(age, self._offset, self._drift_ppm(), p50, p99)

    def _begin(self, made: float, lag: float) -> None:
        """Start the estimates from this arrival alone."""
        self._first = made
        self._excess.clear()
        self._seconds.clear()
        if not self._absolute:
            self._offset = lag - self._minimum_delay

    def _learn(self, made: float, step: float, offset: float) -> None:
        """Move towards the `offset` that this arrival would give with the minimum delay."""
        slew = LEARNING_SLEW if made - self._first < LEARNING else SLEW
        self._offset += min(max(offset - self._offset, -slew * step), LEAK * step)

    def _note(self, made: float, lag: float) -> None:
        self._excess.append(lag - self._offset)
        second = math.floor(made)
        if self._seconds and self._seconds[-1][0] == second:
            lag = min(lag, self._seconds.pop()[1])
        self._seconds.append((second, lag))

    def _drift_ppm(self) -> float:
        """Slope after Theil and Sen, robust against a few slow seconds [ppm]."""
        if len(self._seconds) < DRIFT_KNOWN:
            return math.nan
        slopes = ((lag - past) / (second - then) for (then, past), (second, lag) in combinations(self._seconds, 2))
        return 1e6 * median(slopes)
