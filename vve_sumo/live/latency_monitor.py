"""Measures the latency of each tick of a live drive, leg by leg, and checks it against the rig's budget.

Takes times that the shell measured and the gateway's answers; knows no clock, no process and no file.
"""

from __future__ import annotations

import math
from collections import OrderedDict, deque
from dataclasses import replace
from typing import Any, Final

from vve_sumo.record.latencies import LatencyTally, milliseconds, quantile
from vve_sumo.record.rows import LatencyRow
from vve_sumo.timing import PERIOD

ANSWER_TIMEOUT_TICKS: Final = 5  #: ticks that the gateway has to answer a setpoint
#: More ticks than this within a window whose command comes after the next tick is due are a fault within any budget:
#: every fourth. A budget says how late a command may be; a loop that comes that late so often does not keep time.
MAX_LATE_TICKS: Final = 12
WINDOW_TICKS: Final = 250  #: newest ticks, from which the screen's percentiles are computed


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
        """Return the drive's latencies so far: those of `latency_summary`, and the budget."""
        return self._tally.summary() | {"budget_ms": milliseconds(self._budget)}

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
