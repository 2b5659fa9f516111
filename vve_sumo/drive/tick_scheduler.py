"""When the next tick of a live drive begins: integer ticks, phase-locked to the stream of fixes.

Knows times alone, handed in by the shell; no socket, no clock, no fix. All of them are drive times [s].

**The lock.** Tick k has a nominal epoch; it begins when the fix arrives whose epoch is the first not before that, and
without one at `due + grace`. `due` is the nominal epoch plus the latency that a punctual fix has. Both follow the
stream slowly (`SLEW`), so a GNSS clock that runs off the host's takes the ticks with it while a burst of late datagrams
doesn't. Before the first fix, and through an outage, the ticks go on by themselves.

**The miss policy.** A tick whose successor is due already when it could begin is skipped and counted: there are never
two acts in a burst, and no two ticks begin closer than half a period. The street is to be stepped once more for each
skipped tick, so that its time keeps up, but at most `MAX_CATCH_UP` times; beyond that the street's time slips, which is
the fault `overrun`. So is skipping before `OVERRUN_LIMIT` of the last `OVERRUN_WINDOW` ticks.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import median
from typing import Final, NamedTuple

MAX_CATCH_UP: Final = 5  #: steps of the street that make up for skipped ticks at once
OVERRUN_LIMIT: Final = 5  #: ticks after skipped ones, of so many:
OVERRUN_WINDOW: Final = 10

SLEW: Final = 1e-3  #: how fast nominal times follow the stream [s/s]; ten times the drift of a poor clock (100 ppm)
ACQUIRING_SLEW: Final = 0.1  #: the same just after the lock was found [s/s]
ACQUIRING_TIME: Final = 1.0  #: how long that is [s]
GAIN: Final = 0.1  #: share of an epoch's error that one fix takes away
LOST_TIME: Final = 2.0  #: after so long without a fix near a nominal epoch the lock is sought anew [s]

#: Fixes that arrive earlier or later after their epoch than this are not followed [s]: a clock is wrong somewhere.
MIN_FIX_AGE: Final = -0.1
MAX_FIX_AGE: Final = 0.5

#: The latency of a punctual fix: this quantile of the last ones. Low, so that it stays the latency of the punctual ones
#: even where most fixes come in bursts and wait for the last of their burst.
PUNCTUAL_QUANTILE: Final = 0.2
LATENCIES_KEPT: Final = 50
INTERVALS_KEPT: Final = 9  #: between fixes, whose median is the stream's


class ScheduledTick(NamedTuple):
    """A tick that begins now."""

    tick: int  #: its number; greater than the last one's by 1 plus `missed`
    due: float  #: its nominal time [s], never later than now: the time that its pose and setpoint are to have
    woken_by: str  #: "datagram", or "deadline" where the due one did not come
    missed: int  #: ticks skipped just before it
    catch_up: int  #: extra steps of the street before it is placed for the next tick
    faults: tuple[str, ...]  #: "overrun", or nothing


class TickScheduler:
    """Says how long to wait and numbers the ticks.

    The shell waits on its sockets until `wait_until()`, tells `arrived` of every fix and asks again; once that time is
    not later than now, it calls `begin`.
    """

    def __init__(self, start: float, period: float = 0.02, grace: float = 0.003) -> None:
        """Have tick 0 due at `start`; `grace` is how long a tick waits for its fix beyond its due time."""
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
        self._late: deque[bool] = deque(maxlen=OVERRUN_WINDOW)
        self.missed = 0  #: ticks skipped so far

    @property
    def locked(self) -> bool:
        """Whether the ticks follow a stream."""
        return self._near > -math.inf

    @property
    def next_due(self) -> float:
        """Nominal time of the next tick, as far as is known now [s]: where the ego is to be placed for."""
        return self._epoch + self._latency

    def fix_arrived(self, received: float, epoch: float) -> None:
        """Take note of a fix: when its bytes arrived and its epoch, both on the drive's clock.

        One that is not newer than another before, or whose times cannot be, changes nothing.
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
        """Return the time at which the next tick begins unless a fix comes before; in the past for "at once"."""
        earliest = self._begun + 0.5 * self._period
        return earliest if self._due_fix_is_here() else max(earliest, self.next_due + self._grace)

    def begin(self, now: float) -> ScheduledTick:
        """Begin the next tick at `now`, not before `wait_until()`."""
        by = "datagram" if self._due_fix_is_here() else "deadline"
        missed = max(0, math.floor((now - self.next_due) / self._period))
        self._late.append(missed > 0)
        overrun = missed > MAX_CATCH_UP or sum(self._late) >= OVERRUN_LIMIT
        tick, due = self._tick + missed, min(now, self.next_due + missed * self._period)
        self._tick = tick + 1
        self._epoch += (missed + 1) * self._period
        self._begun = now
        self.missed += missed
        return ScheduledTick(tick, due, by, missed, min(missed, MAX_CATCH_UP), ("overrun",) if overrun else ())

    def _due_fix_is_here(self) -> bool:
        # The clocks' estimate puts epochs a little off the nominal ones; that must not cost a whole interval.
        return self._newest >= self._epoch - 0.25 * min(self._interval, self._period)

    def _lock(self, received: float, epoch: float, latency: float) -> None:
        """Make this fix the due one of the tick whose time is nearest, counting the ticks that have passed by then."""
        passed = math.floor((received - self.next_due) / self._period + 0.5)
        self._epoch = epoch - passed * self._period
        self._latency = latency
        self._latencies.clear()
        self._intervals.clear()
        self._interval = self._period
        self._near = self._locked_at = received

    def _follow(self, received: float, epoch: float, elapsed: float) -> None:
        """Move nominal epoch and latency a little towards what the stream shows."""
        self._interval = median(self._intervals)
        comb = min(self._interval, self._period)
        slew = (ACQUIRING_SLEW if received - self._locked_at < ACQUIRING_TIME else SLEW) * elapsed
        error = math.remainder(epoch - self._epoch, comb)
        if abs(error) <= 0.25 * self._period:
            self._near = received
            self._epoch += max(-slew, min(slew, GAIN * error))
        punctual = sorted(self._latencies)[int(PUNCTUAL_QUANTILE * len(self._latencies))]
        self._latency += max(-slew, min(slew, punctual - self._latency))
