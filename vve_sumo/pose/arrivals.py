"""Checks the time stamp of a message for plausibility against its arrival and the arrivals before it.

Knows arrivals and the time stamps of messages; must not know the rest of their contents. A message can be late by any
delay but never early: the transmission has a minimum delay, and two clocks drift apart slowly. A time stamp ahead of
what the fastest arrivals so far allow is therefore wrong, or the sender's clock was changed. A single wrong time stamp
must have no effect; a changed clock shows in every later message.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Final

DRIFT: Final = 100e-6  #: maximum drift between two clocks [s/s]; twice that of a common quartz
EARLINESS_SHARE: Final = 0.4  #: share of the message interval by which a message may be earlier than the fastest
MAX_EARLINESS: Final = 0.02  #: upper limit of that earliness, however long the interval is [s]
SETTLING_TIME: Final = 0.1  #: for so long after a new fastest arrival, `at_once` is the tolerance [s]

RUN_LENGTH: Final = 3  #: consecutive messages that agree with each other only are accepted if they last:
SMALL_JUMP: Final = 0.05  #: up to here the transmission became faster [s]; the run must last one interval
RUN_TIME: Final = 0.5  #: beyond `SMALL_JUMP` the sender's clock was changed; the run must last this long [s]
AGREEMENT: Final = 0.1  #: maximum difference between consecutive messages of a run [s]; allows for bursts and jitter
AGREEING_KEPT: Final = 10  #: maximum count of messages that agree with the known minute or day


class Judged(enum.Enum):
    """Result of the plausibility check of a time stamp."""

    NEWER = enum.auto()  #: newer than all accepted before
    NOT_NEWER = enum.auto()  #: late, a duplicate, or the sender's clock was set back
    AHEAD = enum.auto()  #: ahead of what the arrivals so far allow: must not be used
    CHANGED = enum.auto()  #: as NEWER; ends a run of AHEAD, after which the sender's clock counts as changed


@dataclass(slots=True)
class _Run:
    """Consecutive messages that are ahead and agree with each other."""

    since: float  #: arrival of the first message
    newest: float  #: time stamp of the last message
    lead: float  #: time stamp minus arrival of the last message
    count: int = 1


class Arrivals:
    """Checks time stamps one by one; one that is neither NEWER nor CHANGED changes no state but the run it belongs to.

    `least` is the smallest earliness that counts [s]. For `SETTLING_TIME` after a message that was faster than all
    before, `at_once` [s] takes its place: the next message of the same burst may be faster still, and where all
    arrivals have the same time, as those of a file do, nothing finer can be seen.
    """

    def __init__(self, least: float, at_once: float) -> None:
        self._least, self._at_once = least, at_once
        self._newest = -math.inf  # time stamp accepted
        self._lead = math.nan  # time stamp minus arrival of the fastest message
        self._led_at = -math.inf  # arrival of the fastest message
        self._faster_at = -math.inf  # arrival that last showed a faster transmission than known before
        self._interval = math.inf  # between time stamps: the least of the recent ones
        self._run: _Run | None = None

    @property
    def newest(self) -> float:
        """The newest time stamp that was accepted [s]; -inf before the first."""
        return self._newest

    def judge(self, received: float, time: float) -> Judged:
        """Check a message that arrived at `received` and is stamped `time` [s], each on its own clock."""
        if not math.isfinite(received + time):
            return Judged.AHEAD
        if not time > self._newest:
            return Judged.NOT_NEWER
        lead, judged = time - received, Judged.NEWER
        ahead = lead - self._allowed_lead(received)
        if ahead > self._tolerance(received):
            judged = self._go_on(received, time, lead, ahead)
            if judged is Judged.AHEAD:
                return judged
            self._lead = math.nan if judged is Judged.CHANGED else -math.inf
        self._believe(received, time, lead)
        return judged

    def _allowed_lead(self, received: float) -> float:
        """Largest lead at `received` of a message as fast as the fastest, drift included; NaN before the first."""
        return self._lead + DRIFT * max(received - self._led_at, 0.0)

    def _young(self, received: float) -> bool:
        return not received - self._faster_at > SETTLING_TIME

    def _tolerance(self, received: float) -> float:
        return (
            self._at_once
            if self._young(received)
            else max(self._least, min(EARLINESS_SHARE * self._interval, MAX_EARLINESS))
        )

    def _go_on(self, received: float, time: float, lead: float, ahead: float) -> Judged:
        """Add a time stamp that is ahead to the run; AHEAD unless the run is now accepted."""
        run = self._run
        if run is not None and time == run.newest:
            return Judged.AHEAD
        if run is None or not (time > run.newest and abs(lead - run.lead) <= AGREEMENT):
            self._run = _Run(received, time, lead)
            return Judged.AHEAD
        run.newest, run.lead, run.count = time, lead, run.count + 1
        lasting = min(self._interval, RUN_TIME) if ahead <= SMALL_JUMP else RUN_TIME
        if run.count < RUN_LENGTH or not (self._young(received) or received - run.since >= lasting):
            return Judged.AHEAD
        return Judged.NEWER if ahead <= SMALL_JUMP else Judged.CHANGED

    def _believe(self, received: float, time: float, lead: float) -> None:
        self._run = None
        self._interval = min(time - self._newest, 1.01 * self._interval)
        self._newest = time
        leaked = self._lead - DRIFT * max(received - self._led_at, 0.0)
        if lead <= leaked:
            return
        if math.isnan(leaked) or (self._young(received) and lead > leaked + self._least):
            self._faster_at = received
        self._lead, self._led_at = lead, received


class Repeated:
    """Decides when a repeated minute or day that differs from the known one is accepted.

    It takes more messages in a row that agree on the new one than agreed with the known one: `RUN_LENGTH` against one,
    at most `AGREEING_KEPT` + 2.
    """

    def __init__(self) -> None:
        self._agreed = 1  # messages that agreed with the known one, the very first included
        self._other = (0, 0)  # offset that the last messages agree on, and their number

    def believe(self, off: int) -> bool:
        """Whether to accept a value that differs from the known one by `off`; if so it becomes the known one."""
        if off == 0:
            self._agreed, self._other = min(self._agreed + 1, AGREEING_KEPT), (0, 0)
            return True
        before, count = self._other
        self._other = (off, count + 1 if off == before else 1)
        if self._other[1] < self._agreed - 1 + RUN_LENGTH:
            return False
        self._agreed, self._other = 1, (0, 0)
        return True
