"""Checks the time stamp of a message for plausibility against its arrival and the arrivals before it.

It knows arrivals and the times that messages carry; it must not know their other content. A message can be late by any
delay but never early: the path has a least delay, and two clocks drift apart slowly. So a time ahead of what the
fastest arrivals so far allow is false, or the sender's clock was changed. One false time must change nothing; a changed
clock shows in every message from then on.
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

RUN_LENGTH: Final = 3  #: messages in a row that agree with each other alone are accepted, if the run lasts long enough
SMALL_JUMP: Final = 0.05  #: up to this lead the path became faster [s], and the run has to last one interval
RUN_TIME: Final = 0.5  #: beyond it the sender's clock was changed, and the run has to last this long [s]: a trust gap
AGREEMENT: Final = 0.1  #: largest difference in lead within a run [s]: bursts and jitter
AGREEING_KEPT: Final = 10  #: most agreements with a minute or a day that count; more in a row must disagree


class JudgedArrival(enum.Enum):
    """Judgement of a message's time."""

    NEWER = enum.auto()  #: newer than all accepted before
    NOT_NEWER = enum.auto()  #: late, a duplicate, or the sender's clock went back
    AHEAD = enum.auto()  #: cannot be true by what is known: not to be used for anything
    CHANGED = enum.auto()  #: as NEWER, the last of a run of AHEAD after which the sender's clock is taken as changed


# Found once, for every message: Python looks members up in their class at the cost of a call.
_NEWER: Final = JudgedArrival.NEWER


@dataclass(slots=True)
class _Run:
    """Consecutive messages that are ahead and agree with each other."""

    since: float  #: arrival of the first message
    newest: float  #: time stamp of the last message
    lead: float  #: time stamp minus arrival of the last message
    count: int = 1


class Arrivals:
    """Judges times one by one; a time that is not NEWER or CHANGED changes nothing but the run that it belongs to.

    `least` is the smallest earliness that counts [s]. For `SETTLING_TIME` after a message faster than all before, it
    is `at_once` [s]: the next of the same burst may be even faster, and where all arrivals have the same time, as
    those of a file do, nothing finer can be seen.
    """

    def __init__(self, least: float, at_once: float) -> None:
        self._least, self._at_once = least, at_once
        self._newest = -math.inf  # time that was believed
        self._lead = math.nan  # time minus arrival of the fastest
        self._led_at = -math.inf  # arrival of the fastest
        self._faster_at = -math.inf  # arrival at which the path was last found faster than estimated
        self._interval = math.inf  # between times: the least of the last few
        self._run: _Run | None = None

    @property
    def newest(self) -> float:
        """The newest time that was accepted [s]; -inf before the first."""
        return self._newest

    def judge(self, received: float, time: float) -> JudgedArrival:
        """Judge a message that arrived at `received` and carries `time` [s], each on its own clock."""
        if not math.isfinite(received + time):
            return JudgedArrival.AHEAD
        if not time > self._newest:
            return JudgedArrival.NOT_NEWER
        lead, judged = time - received, _NEWER
        drifted = DRIFT * max(received - self._led_at, 0.0)
        ahead = lead - (self._lead + drifted)  # of a message as fast as the fastest; NaN before the first
        if ahead > 0.0 and ahead > self._tolerance(received):
            judged = self._go_on(received, time, lead, ahead)
            if judged is JudgedArrival.AHEAD:
                return judged
            self._lead = math.nan if judged is JudgedArrival.CHANGED else -math.inf
        self._believe(received, time, lead, self._lead - drifted)
        return judged

    def _young(self, received: float) -> bool:
        return not received - self._faster_at > SETTLING_TIME

    def _tolerance(self, received: float) -> float:
        return (
            self._at_once
            if self._young(received)
            else max(self._least, min(EARLINESS_SHARE * self._interval, MAX_EARLINESS))
        )

    def _go_on(self, received: float, time: float, lead: float, ahead: float) -> JudgedArrival:
        """Take a time that is ahead into the run; return whether the run is accepted now."""
        run = self._run
        if run is not None and time == run.newest:
            return JudgedArrival.AHEAD
        if run is None or not (time > run.newest and abs(lead - run.lead) <= AGREEMENT):
            self._run = _Run(received, time, lead)
            return JudgedArrival.AHEAD
        run.newest, run.lead, run.count = time, lead, run.count + 1
        lasting = min(self._interval, RUN_TIME) if ahead <= SMALL_JUMP else RUN_TIME
        if run.count < RUN_LENGTH or not (self._young(received) or received - run.since >= lasting):
            return JudgedArrival.AHEAD
        return JudgedArrival.NEWER if ahead <= SMALL_JUMP else JudgedArrival.CHANGED

    def _believe(self, received: float, time: float, lead: float, leaked: float) -> None:
        """Accept a time; `leaked` is the fastest lead, less what two clocks may have drifted apart since [s]."""
        self._run = None
        self._interval = min(time - self._newest, 1.01 * self._interval)
        self._newest = time
        if lead <= leaked:
            return
        if math.isnan(leaked) or (self._young(received) and lead > leaked + self._least):
            self._faster_at = received
        self._lead, self._led_at = lead, received


class Repeated:
    """A minute or a day that is sent repeatedly: decides when another one than the known one is accepted.

    More messages in a row must agree on it than have confirmed the known one: `RUN_LENGTH` against one, and
    `AGREEING_KEPT` + 2 at most.
    """

    def __init__(self) -> None:
        self._agreed = 1  # messages that confirmed the known one, the very first included
        self._other = (0, 0)  # how far off the last messages were that agree on another one, and their number

    def believe(self, off: int) -> bool:
        """Whether to accept what lies `off` from the known one; if so, it is the known one from then on."""
        if off == 0:
            self._agreed, self._other = min(self._agreed + 1, AGREEING_KEPT), (0, 0)
            return True
        before, count = self._other
        self._other = (off, count + 1 if off == before else 1)
        if self._other[1] < self._agreed - 1 + RUN_LENGTH:
            return False
        self._agreed, self._other = 1, (0, 0)
        return True
