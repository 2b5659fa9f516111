"""Measures the latency of each tick of a live drive, leg by leg, and checks it against the rig's budget.

Takes times that the shell measured and the gateway's answers; knows no clock, no process and no file.
"""

from __future__ import annotations

import math
from array import array
from collections import OrderedDict, deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from vve_sumo.timing import PERIOD
from vve_sumo.values import LatencyRow

if TYPE_CHECKING:
    import pyarrow

ANSWER_TIMEOUT_TICKS: Final = 5  #: ticks that the gateway has to answer a setpoint
#: More ticks than this within a window whose command comes after the next tick is due are a fault within any budget:
#: every fourth. A budget says how late a command may be; a loop that comes that late so often does not keep time.
MAX_LATE_TICKS: Final = 12
WINDOW_TICKS: Final = 250  #: newest ticks, from which the screen's percentiles are computed

#: Legs in order, each from the end of the one before. The first begins when the fix's bytes arrive or, where the
#: deadline woke the tick, when the tick begins.
LEGS: Final = ("wake", "decode", "sensors", "control", "hand_over", "frame")
TOTAL: Final = "total"
DATAGRAM: Final = "datagram"


class LatencyMonitor:
    """Completes each tick's row with the gateway's answer, and counts breaches of the latency budget."""

    def __init__(self, budget: float, breaches: int, window: float = 1.0) -> None:
        """Report a fault once more than `breaches` ticks within `window` [s] exceed `budget` [s] or get no answer.

        Whatever the budget, more than `MAX_LATE_TICKS` that take longer than the period are a fault too.
        """
        self._budget, self._allowed, self._window = budget, breaches, window
        self._open: OrderedDict[int, LatencyRow] = OrderedDict()  # by sequence
        self._done: list[LatencyRow] = []
        self._breaches: deque[float] = deque()
        self._late: deque[float] = deque()
        self._recent: deque[float] = deque(maxlen=WINDOW_TICKS)
        self._tally = LatencyTally()

    def gateway_answered(self, sequence: int, sent: float) -> None:
        """Take the gateway's answer to a setpoint: when the send of its last frame returned [s], NaN without frames."""
        row = self._open.pop(sequence, None)
        if row is not None:
            self._complete(replace(row, framed_s=sent), answered=True)

    def step(self, row: LatencyRow) -> tuple[str, ...]:
        """Take a tick's row, still without `framed_s`; return ("latency_budget",) while too many ticks are late."""
        if row.sequence < 0:
            self._complete(row, answered=True)
        else:
            self._open[row.sequence] = row
        for sequence in [s for s, waiting in self._open.items() if waiting.tick <= row.tick - ANSWER_TIMEOUT_TICKS]:
            self._complete(self._open.pop(sequence), answered=False)
        for times in (self._breaches, self._late):
            while times and not times[0] > row.woken_s - self._window:
                times.popleft()
        late = len(self._breaches) > self._allowed or len(self._late) > MAX_LATE_TICKS
        return ("latency_budget",) if late else ()

    def completed(self) -> list[LatencyRow]:
        """Return the rows that were completed since the last call, for the record."""
        done, self._done = self._done, []
        return done

    def close(self) -> list[LatencyRow]:
        """Return, at the end of the drive, the rows completed since the last call and those still without an answer."""
        rest = list(self._open.values())
        self._open.clear()
        for row in rest:
            self._done.append(row)
            self._tally.add(row)
        return self.completed()

    def screen(self) -> dict[str, float]:
        """Return median and 99th percentile of the last ticks' totals [s], and the ticks missed in the whole drive."""
        recent = sorted(self._recent)
        return {"p50": quantile(recent, 0.5), "p99": quantile(recent, 0.99), "missed": self._tally.missed}

    @property
    def newest(self) -> float:
        """Latency of the newest tick whose frames were sent [s]; NaN before the first."""
        return self._recent[-1] if self._recent else math.nan

    def summary(self) -> dict[str, Any]:
        """Return the drive's figures so far: those of `latency_summary`, and the budget."""
        return self._tally.summary() | {"budget_ms": _ms(self._budget)}

    def _complete(self, row: LatencyRow, *, answered: bool) -> None:
        self._done.append(row)
        took = self._tally.add(row)
        if math.isfinite(took):
            self._recent.append(took)
        # Without frames nothing was commanded, so there is no latency to judge.
        commanded = not math.isnan(row.framed_s)
        if not answered or (commanded and not took <= self._budget):
            self._breaches.append(row.woken_s)
        if commanded and not took <= PERIOD:
            self._late.append(row.woken_s)


class LatencyTally:
    """Counts and samples of completed rows, in flat arrays, which the garbage collector need not traverse."""

    def __init__(self) -> None:
        self._samples = {name: array("d") for name in (*LEGS, TOTAL)}
        self._worst = (-math.inf, -1)
        self.ticks = self.missed = self.skips = self.by_deadline = self.without_frame = 0

    def add(self, row: LatencyRow) -> float:
        """Count a row; return its total [s], NaN where no frame was sent."""
        self.ticks += 1
        self.missed += row.missed
        self.skips += row.missed > 0
        self.by_deadline += row.woken_by != DATAGRAM
        self.without_frame += not math.isfinite(row.framed_s)
        took = legs(row)
        for name, value in took.items():
            if math.isfinite(value):
                self._samples[name].append(value)
        total = took[TOTAL]
        if total > self._worst[0]:
            self._worst = (total, row.tick)
        return total

    def summary(self) -> dict[str, Any]:
        """Return counts, the worst tick, and the percentiles and maximum of every leg [ms]."""
        worst, tick = self._worst
        return {
            "ticks": self.ticks,
            "missed": self.missed,
            "skips": self.skips,
            "woken_by_deadline": self.by_deadline,
            "without_frame": self.without_frame,
            "worst_tick": {"tick": tick, "total_ms": _ms(worst)} if tick >= 0 else None,
            "legs_ms": {name: percentiles(sorted(samples)) for name, samples in self._samples.items()},
        }


def legs(row: LatencyRow) -> dict[str, float]:
    """Return the duration of each leg of a tick and the total [s]; NaN where a leg's begin or end is missing."""
    begin = row.received_s if row.woken_by == DATAGRAM else row.woken_s
    moments = (begin, row.woken_s, row.decoded_s, row.sensed_s, row.decided_s, row.handed_s, row.framed_s)
    took = {name: moments[i + 1] - moments[i] for i, name in enumerate(LEGS)}
    return took | {TOTAL: row.framed_s - begin}


def latency_summary(table: pyarrow.Table) -> dict[str, Any]:
    """Return the figures of a record's `latency` table (columns: LatencyRow): counts, worst tick, percentiles [ms]."""
    tally = LatencyTally()
    for row in rows_of(table):
        tally.add(row)
    return tally.summary()


def rows_of(table: pyarrow.Table) -> Iterator[LatencyRow]:
    """Give the rows of a record's `latency` table one by one."""
    columns = table.to_pydict()
    names = [name for name in columns if name in LatencyRow.__dataclass_fields__]
    for values in zip(*(columns[name] for name in names), strict=True):
        row: dict[str, Any] = dict(zip(names, values, strict=True))
        unknown = {name: math.nan for name, value in row.items() if value is None and name.endswith("_s")}
        yield LatencyRow(**(row | unknown))


def quantile(ordered: Sequence[float], share: float) -> float:
    """Return the smallest of sorted samples that `share` of them do not exceed; NaN of none."""
    if not ordered:
        return math.nan
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


def percentiles(ordered: Sequence[float]) -> dict[str, float | None]:
    """Return p50, p95, p99 and max [ms] of sorted samples [s], rounded to microseconds; None without samples."""
    return {f"p{percent}": _ms(quantile(ordered, percent / 100.0)) for percent in (50, 95, 99)} | {
        "max": _ms(ordered[-1] if ordered else math.nan)
    }


def _ms(seconds: float) -> float | None:
    """Return milliseconds for a summary; None (null in JSON) where the value is not finite."""
    return round(1e3 * seconds, 3) if math.isfinite(seconds) else None
