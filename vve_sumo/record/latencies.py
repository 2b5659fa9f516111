"""Figures of the latency of live ticks, leg by leg, from the rows that a record keeps of them.

It knows rows; no clock, no process and no budget.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

from vve_sumo.record.rows import LatencyRow

if TYPE_CHECKING:
    import pyarrow

#: Legs in order, each from the end of the one before. The first begins when the fix's bytes arrive or, where the
#: deadline woke the tick, when the tick begins.
LEGS: Final = ("wake", "decode", "sensors", "control", "hand_over", "frame")
TOTAL: Final = "total"
DATAGRAM: Final = "datagram"


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
            "worst_tick": {"tick": tick, "total_ms": milliseconds(worst)} if tick >= 0 else None,
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
    return {f"p{percent}": milliseconds(quantile(ordered, percent / 100.0)) for percent in (50, 95, 99)} | {
        "max": milliseconds(ordered[-1] if ordered else math.nan)
    }


def milliseconds(seconds: float) -> float | None:
    """Return milliseconds for a summary; None (null in JSON) where the value is not finite."""
    return round(1e3 * seconds, 3) if math.isfinite(seconds) else None
