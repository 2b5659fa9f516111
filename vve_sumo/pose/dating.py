"""Dates fixes on the drive's clock: the one place where a receiver's time becomes drive time.

The start of a drive, the drive itself and the doctor date their fixes here. It knows fixes and the pose clock; it must
not know sockets, receivers or whether a fix can be trusted.
"""

from __future__ import annotations

import math
from dataclasses import fields
from operator import attrgetter
from typing import Final, NamedTuple

from vve_sumo.pose.clock import ClockReport, PoseClock
from vve_sumo.values import Fix

#: A fix's fields after the first, its time. `dataclasses.replace` takes several times as long.
_after_time: Final = attrgetter(*[field.name for field in fields(Fix)][1:])


class Undated(NamedTuple):
    """A fix that has no time on the drive's clock."""

    reason: str  #: reason code


class FixDater:
    """Dates fixes one by one, in the order of their arrival.

    Only a locked fix tells the time: an unlocked receiver may run on its own clock, seconds off. An unlocked fix is
    dated by what the locked ones before it told, and teaches nothing. A locked fix that is dated ahead of what the
    arrivals before it allow has no date either, until `Clock` finds that the receiver's clock was changed.

    `minimum_delay` is the least time from a fix's epoch to its arrival [s], as the rig declares it. `epoch` is the GNSS
    second of drive time 0 where it is known: in a drive that has begun, and where the host's clock is `absolute`.
    Otherwise the first locked fix sets it.
    """

    def __init__(self, minimum_delay: float, epoch: float = math.nan, *, absolute: bool = False) -> None:
        self._minimum_delay, self._absolute = minimum_delay, absolute
        self._epoch = epoch
        self._clock: PoseClock | None = None
        if math.isfinite(epoch):
            self._clock = PoseClock(epoch, minimum_delay, absolute=absolute)

    @property
    def epoch(self) -> float:
        """GNSS second that dated fixes carry at drive time 0; NaN before it is known. Once known it stays."""
        return self._epoch

    @property
    def measured_epoch(self) -> float:
        """GNSS second of drive time 0 by all locked fixes so far; NaN before the first.

        It differs from `epoch` by what arrivals have taught since, and after a change of the receiver's clock.
        """
        report = self.report()
        return math.nan if report is None else self._epoch - report.offset

    def date(self, received: float, fix: Fix) -> Fix | Undated:
        """Return `fix`, which arrived at drive time `received` [s], dated by the drive's clock since `epoch`."""
        if self._clock is None:
            if not (fix.locked is True and math.isfinite(fix.time)):
                return Undated("status_not_locked")
            self._epoch = fix.time - (received - self._minimum_delay)
            self._clock = PoseClock(self._epoch, self._minimum_delay, absolute=self._absolute)
        clock = self._clock
        made = clock.step(received, fix.time) if fix.locked else clock.at(fix.time)
        if math.isnan(made):
            return Undated("fix_ahead" if fix.locked else "status_not_locked")
        return Fix(self._epoch + made, *_after_time(fix))

    def report(self) -> ClockReport | None:
        """Return the estimate of the receiver's clock against the drive's; None before the epoch is known."""
        return None if self._clock is None else self._clock.report()
