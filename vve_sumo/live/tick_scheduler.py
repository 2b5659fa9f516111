"""Decides when the next tick of a live drive begins: ticks are numbered and phase-locked to the stream of fixes.

Knows only times, handed in by the shell; no socket, no clock, no fix. All times are drive times [s].

**The lock.** Tick k has a nominal epoch. The tick begins when the first fix arrives whose epoch is not before the
nominal epoch (less a quarter of an interval), or without such a fix at `due + grace`. `due` is the nominal epoch plus
the latency of a punctual fix. Nominal epochs and latency follow the stream slowly (`SLEW`): the ticks follow the drift
of a GNSS clock against the host's, but not a burst of late datagrams. Before the first fix, and through an outage, the
ticks go on at their period.

**The miss policy.** A tick is skipped and counted if its successor is already due when the tick could begin. So the
ticks never catch up in a burst, and no two begin closer than half a period. The virtual road is stepped once more for
each skipped tick, so that its time keeps up, but at most `MAX_CATCH_UP` times. Beyond that the road's time slips, which
is the fault `overrun`. It is also `overrun` if `OVERRUN_LIMIT` of the last `OVERRUN_WINDOW` ticks began after a skip,
or `LATE_LIMIT` of the last `LATE_WINDOW`: a loop that is late every third time does not keep time either.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import median
from typing import Final, NamedTuple

from vve_sumo.timing import PERIOD

MAX_CATCH_UP: Final = 5  #: greatest number of extra steps of the virtual road in one tick
OVERRUN_LIMIT: Final = 5  #: ticks that began after a skip, among the last OVERRUN_WINDOW, that are an overrun
OVERRUN_WINDOW: Final = 10
#: The same for lateness that comes back: a fifth of the last second's ticks. A live drive skips fewer than one in fifty
#: (tests/live/test_paper_drive.py).
LATE_LIMIT: Final = 10
LATE_WINDOW: Final = 50

SLEW: Final = 1e-3  #: how fast nominal times follow the stream [s/s]; ten times the drift of a poor clock (100 ppm)
ACQUIRING_SLEW: Final = 0.1  #: the same for ACQUIRING_TIME after the lock was found [s/s]
ACQUIRING_TIME: Final = 1.0  #: [s]
GAIN: Final = 0.1  #: share of the nominal epoch's error that one fix corrects
LOST_TIME: Final = 2.0  #: time without a fix near a nominal epoch after which the next fix sets a new lock [s]

#: Smallest and greatest latency of a fix that the ticks follow [s]; outside, a clock is wrong.
MIN_FIX_AGE: Final = -0.1
MAX_FIX_AGE: Final = 0.5

#: The latency of a punctual fix is this quantile of the last latencies. It is low so that it still describes the
#: punctual fixes where most fixes come in bursts and wait for the last of their burst.
PUNCTUAL_QUANTILE: Final = 0.2
LATENCIES_KEPT: Final = 50
INTERVALS_KEPT: Final = 9  #: intervals between fixes, whose median is taken as the stream's interval


DEADLINE: Final = "deadline"  #: what a tick is woken by that waited for its fix in vain


class ScheduledTick(NamedTuple):
    """A tick that begins now."""

    tick: int  #: number of the tick: the last tick's plus 1 plus `missed`
    due: float  #: nominal time of the tick [s], never later than now: the time of its pose and setpoint
    awaited: float  #: when it could have begun [s]: its fix had come, or was no longer waited for
    woken_by: str  #: "datagram", or DEADLINE where the due fix did not come
    missed: int  #: ticks skipped just before this one
    catch_up: int  #: extra steps of the virtual road before the ego is placed for the next tick
    faults: tuple[str, ...]  #: "overrun", or nothing


class TickScheduler:
    """Computes how long the shell waits, and numbers the ticks.

    The shell waits on its sockets until `wait_until()`. It calls `fix_arrived` for every fix and then `wait_until`
    again. Once that time is not later than now, it calls `begin`.
    """

    def __init__(self, start: float, period: float = PERIOD, grace: float = 0.003) -> None:
        """Tick 0 is due at `start`; `grace` is how long a tick waits for its fix beyond its due time."""
        self._period, self._grace = period, grace
        self._tick = 0
        self._epoch = start  # nominal, of the next tick
        self._latency = 0.0  # of a punctual fix
        self._begun = -math.inf
        self._newest = -math.inf  # epoch of the newest fix
        self._received = -math.inf  # its arrival
        self._near = -math.inf  # arrival of the last fix near a nominal epoch
        self._locked_at = -math.inf
        self._latencies: deque[float] = deque(maxlen=LATENCIES_KEPT)
        self._intervals: deque[float] = deque(maxlen=INTERVALS_KEPT)
        self._interval = period
        self._late: deque[bool] = deque(maxlen=LATE_WINDOW)  # whether a skip was before each of the last ticks
        self.missed = 0  #: ticks skipped so far

    @property
    def locked(self) -> bool:
        """Whether the ticks have ever locked to a stream of fixes."""
        return self._near > -math.inf

    @property
    def next_due(self) -> float:
        """Nominal time of the next tick by the present estimate [s]: the time for which the ego is placed."""
        return self._epoch + self._latency

    def fix_arrived(self, received: float, epoch: float) -> None:
        """Take a fix: when its bytes arrived, and its epoch, both on the drive's clock.

        A fix that is not newer than an earlier one, or whose latency is out of bounds, changes nothing.
        """
        latency = received - epoch
        if not (epoch > self._newest and MIN_FIX_AGE <= latency <= MAX_FIX_AGE):
            return
        elapsed = min(received - self._received, LOST_TIME)
        self._intervals.append(epoch - self._newest)
        self._newest, self._received = epoch, received
        if not received - self._near <= LOST_TIME:
            self._lock(received, epoch, latency)
        elif elapsed > 0.0:
            self._follow(received, epoch, elapsed)
        self._latencies.append(latency)

    def wait_until(self) -> float:
        """Return the time at which the next tick begins unless a fix comes first; a time in the past means at once."""
        earliest = self._begun + 0.5 * self._period
        return earliest if self._due_fix_is_here() else max(earliest, self.next_due + self._grace)

    def begin(self, now: float) -> ScheduledTick:
        """Begin the next tick at `now`, not before `wait_until()`."""
        here = self._due_fix_is_here()
        by = "datagram" if here else DEADLINE
        awaited = max(self.wait_until(), self._received) if here else self.wait_until()
        missed = max(0, math.floor((now - self.next_due) / self._period))
        self._late.append(missed > 0)
        overrun = missed > MAX_CATCH_UP or self._often_late()
        tick, due = self._tick + missed, min(now, self.next_due + missed * self._period)
        self._tick = tick + 1
        self._epoch += (missed + 1) * self._period
        self._begun = now
        self.missed += missed
        faults = ("overrun",) if overrun else ()
        return ScheduledTick(tick, due, min(awaited, now), by, missed, min(missed, MAX_CATCH_UP), faults)

    def _often_late(self) -> bool:
        late = list(self._late)
        return sum(late) >= LATE_LIMIT or sum(late[-OVERRUN_WINDOW:]) >= OVERRUN_LIMIT

    def _due_fix_is_here(self) -> bool:
        # The clock estimate shifts epochs a little against nominal ones: without a tolerance a fix could be missed.
        return self._newest >= self._epoch - 0.25 * min(self._interval, self._period)

    def _lock(self, received: float, epoch: float, latency: float) -> None:
        """Make this fix the due one of the tick nearest in time, counting the ticks that have passed by then."""
        passed = math.floor((received - self.next_due) / self._period + 0.5)
        self._epoch = epoch - passed * self._period
        self._latency = latency
        self._latencies.clear()
        self._intervals.clear()
        self._interval = self._period
        self._near = self._locked_at = received

    def _follow(self, received: float, epoch: float, elapsed: float) -> None:
        """Move nominal epoch and latency a little towards the stream's."""
        self._interval = median(self._intervals)
        comb = min(self._interval, self._period)
        slew = (ACQUIRING_SLEW if received - self._locked_at < ACQUIRING_TIME else SLEW) * elapsed
        error = math.remainder(epoch - self._epoch, comb)
        if abs(error) <= 0.25 * self._period:
            self._near = received
            self._epoch += max(-slew, min(slew, GAIN * error))
        punctual = sorted(self._latencies)[int(PUNCTUAL_QUANTILE * len(self._latencies))]
        self._latency += max(-slew, min(slew, punctual - self._latency))
